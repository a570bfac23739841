"""Two sensors about one table: the paper's stand with a second one beside it."""

from dataclasses import replace
from functools import cache
from math import radians

from truestand.core.artefact import Artefact
from truestand.core.scan import Scan, interpret
from truestand.core.stand import Stand
from truestand.sim import Mounting, Simulated, Simulation, paper_shaft, paper_simulation, simulate
from truth import ANGLE, STANDS

AZIMUTH = radians(120.0)
FRONT = Mounting(plane_offset=0.25, plane_tilt=radians(0.3))
REAR = Mounting(phi=radians(-133.0), plane_offset=-0.3, plane_tilt=radians(-0.2), azimuth=AZIMUTH)
SHAFT = paper_shaft()


def two_sensors(**sensor) -> Stand:
    """The stand with the sensors *front* and *rear*; ``sensor``: what else their recipes say."""
    stand = STANDS["paper"].stand()
    return replace(stand, sensors=tuple(replace(stand.sensor, name=name, **sensor) for name in ("front", "rear")))


def two_views(front: Mounting = FRONT, rear: Mounting = REAR, **parts) -> Simulation:
    """The paper's scan, 1,000 profiles of one turn with their angles, from both sides; ``parts`` of it are others."""
    base = paper_simulation()
    simulation = replace(
        base, running=replace(base.running, tilt=0.001, tilt_direction=2.0),
        acquisition=replace(base.acquisition, **ANGLE), views=(("front", front), ("rear", rear)),
    )  # fmt: skip
    return replace(simulation, **parts)


@cache
def seen(simulation: Simulation, view: str, stand: Stand | None = None, artefact: Artefact = SHAFT) -> Simulated:
    """The virtual scan of one of them."""
    stand = (stand or two_sensors()).of_view(view)
    return simulate(stand, simulation.seen_from(view), artefact, seed=1 + (view == "rear"))


def scans_of(simulation: Simulation, stand: Stand | None = None) -> tuple[Scan, Scan]:
    """The scans of both."""
    stand = stand or two_sensors()
    front, rear = (interpret(seen(simulation, v, stand).recording, stand, view=v) for v in ("front", "rear"))
    return front, rear
