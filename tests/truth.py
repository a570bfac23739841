"""The table of named stands with their truth, through which every stage of the product is run."""

from dataclasses import dataclass, field, replace
from functools import cache
from math import radians, tau
from typing import Any

from truestand.core.artefact import Artefact
from truestand.core.scan import Scan, interpret
from truestand.core.stand import Stand, Table
from truestand.sim import (
    FormWave,
    Keyway,
    Simulated,
    Simulation,
    paper_shaft,
    paper_simulation,
    paper_stand,
    simulate,
    truth_record,
)

ABOVE = radians(-138.198)
"""A sensor that looks from the bearing's side and so sees the shoulder face."""
POINTS, PER_TURN = 160, 1000
"""Readings of a profile and profiles of a turn: a sixteenth of the paper's scan; a calibration takes half a second.
Full scans are measured by bench/accuracy.py and bench/speed.py."""
PLANE = {"plane_offset": 0.25, "plane_tilt": radians(0.3)}
TILTED = {"tilt": 0.001, "tilt_direction": 2.0}
ROUND: dict[str, Any] = {"form": ()}


@dataclass(frozen=True)
class Named:
    """One stand: what differs from the paper's."""

    mounting: dict[str, Any] = field(default_factory=dict)
    running: dict[str, Any] = field(default_factory=dict)
    workpiece: dict[str, Any] = field(default_factory=dict)
    optics: dict[str, Any] = field(default_factory=dict)
    acquisition: dict[str, Any] = field(default_factory=dict)
    mirrored: bool = False
    direction: str = "ccw"
    points: int = POINTS
    per_turn: int = PER_TURN

    def stand(self) -> Stand:
        base = paper_stand()
        rate = self.per_turn * base.table.speed / tau
        sensor = replace(base.sensor, mirrored=self.mirrored, points=self.points, profile_rate=rate)
        table = Table(base.table.speed, self.direction, base.table.start)
        return replace(base, table=table, sensors=(sensor,), counts_per_turn=36000)

    def simulation(self) -> Simulation:
        base = paper_simulation()
        return Simulation(
            replace(base.mounting, **self.mounting),
            replace(base.running, **self.running),
            replace(base.workpiece, **self.workpiece),
            replace(base.optics, **self.optics),
            replace(base.acquisition, **{"profiles": 2750, **self.acquisition}),
        )


ONE_TURN = {"profiles": PER_TURN}
ANGLE = {"profiles": PER_TURN, "columns": ("angle",)}

STANDS = {
    "paper": Named(),
    "plane off and tilted": Named(PLANE, TILTED, ROUND, {"noise": 0.010}),
    "without noise": Named(
        {**PLANE, "plane_offset": 0.6}, TILTED, optics={"noise": 0.0, "step_z": 0.0, "step_x": 0.0}, acquisition=ANGLE
    ),
    "sensor 25 um non-linear": Named(optics={"nonlinearity": 0.025}),
    "sensor non-linear, plane off": Named(PLANE, optics={"nonlinearity": 0.025}),
    "sensor non-linear from step to step": Named(
        optics={"nonlinearity": 0.025, "nonlinearity_phase": radians(90.0)}, acquisition=ONE_TURN
    ),
    "clockwise": Named(PLANE, TILTED, acquisition=ONE_TURN, direction="cw"),
    "from above": Named({"phi": ABOVE, **PLANE}, TILTED, acquisition=ONE_TURN),
    "other side": Named({"phi": radians(41.802), **PLANE}, TILTED, acquisition=ONE_TURN),
    "mirrored": Named(PLANE, TILTED, acquisition=ONE_TURN, mirrored=True),
    "mirrored, from above, clockwise": Named(
        {"phi": -ABOVE, **PLANE}, TILTED, acquisition=ANGLE, mirrored=True, direction="cw"
    ),
    "any start angle": Named(PLANE, TILTED, acquisition={**ANGLE, "start_angle": 2.5}),
    "encoder": Named(PLANE, TILTED, acquisition={"profiles": PER_TURN, "columns": ("encoder",), "start_angle": -1.0}),
    "five turns": Named(PLANE, TILTED, acquisition={"profiles": 5 * PER_TURN}),
    "one and a third turns": Named(PLANE, TILTED, acquisition={"profiles": 1333}),
    "speed 5 % wrong": Named(acquisition={"speed_factor": 1.05}),
    "tilted 5 mrad": Named(running={"tilt": 0.005, "tilt_direction": 1.0}, acquisition=ANGLE),
    "dirty": Named(
        workpiece={"chamfer": 0.3, "keyways": (Keyway("base", 1.0, 6.0, 2.5, -30.0, 0.0),)},
        optics={"outliers": 0.1, "dropouts": 0.2, "ghosts": 0.2, "patches": 30},
        acquisition=ANGLE,
    ),
    "eccentric 2.5 mm": Named(PLANE, {"eccentricity": 2.5, **TILTED}, acquisition=ANGLE),
    "centred": Named(running={"eccentricity": 0.0}, acquisition=ANGLE),
    "speckled": Named(optics={"speckle": 0.005, "correlated_noise": 0.005}),
    "many harmonics": Named(
        workpiece={
            "form": tuple(FormWave(s, n, 0.02 / n, float(n * n)) for s in ("base", "bearing") for n in range(2, 13))
        },
        acquisition=ANGLE,
    ),
}


@cache
def simulated(name: str, seed: int = 0) -> Simulated:
    """The virtual scan of a named stand."""
    named = STANDS[name]
    return simulate(named.stand(), named.simulation(), paper_shaft(), seed)


def scan_of(name: str, seed: int = 0) -> Scan:
    """The scan as its stand sees it."""
    return interpret(simulated(name, seed).recording, STANDS[name].stand())


def shaft() -> Artefact:
    """The artefact of every named stand."""
    return paper_shaft()


def truth_of(name: str) -> dict[str, Any]:
    """What is true of a named stand, with the keys of calibration.json."""
    return truth_record(simulated(name).truth)
