"""Our two methods and general libraries on the same scans: by how much each puts the shaft's axis wrong.

Run with the development environment: python bench/compare.py
"""

from dataclasses import replace
from math import hypot, radians
from time import perf_counter
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from truestand.calibration.peers import Finding, peers
from truestand.core.frames import Pose, shaft_parameters
from truestand.core.scan import interpret
from truestand.sim import Keyway, Patch, Simulation, paper_shaft, paper_simulation, paper_stand, simulate

ROUND: dict[str, Any] = {"workpiece": {"form": ()}, "acquisition": {"profiles": 8000}}
OFF: dict[str, Any] = {"mounting": {"plane_offset": 0.25, "plane_tilt": radians(0.3)},
                       "running": {"tilt": 0.001, "tilt_direction": 2.0}}  # fmt: skip
SITUATIONS: dict[str, dict[str, Any]] = {
    "round shaft, plane through the axis, two turns": ROUND,
    "the same, 2.75 turns": ROUND | {"acquisition": {"profiles": 11000}},
    "the paper's scan: 85 um oval, 2.75 turns": {},
    "plane 0.25 mm and 0.3 deg off, shaft tilted 1 mrad": ROUND | OFF,
    "5 % wild readings": ROUND | {"optics": {"outliers": 0.05}},
    "keyway of 6 mm in both steps": ROUND | {
        "workpiece": {"form": (), "keyways": tuple(Keyway(s, 1.0, 6.0, 2.5) for s in ("base", "bearing"))}
    },
    "150 um of dirt on 30 % of the base": ROUND | {
        "workpiece": {"form": (), "patches": (Patch("base", 1.0, 0.3, 0.15),)}
    },
    "table 2 % faster than stated": ROUND | {"acquisition": {"profiles": 8000, "speed_factor": 1.02}},
}  # fmt: skip


def simulation(changes: dict[str, Any]) -> Simulation:
    base = paper_simulation()
    return replace(base, **{part: replace(getattr(base, part), **values) for part, values in changes.items()})


def axis_errors(changes: dict[str, Any]) -> list[tuple[str, str]]:
    """Way and axis error in um (or why there is none), with its time."""
    made = simulate(paper_stand(), simulation(changes), paper_shaft(), 1)
    scan = interpret(made.recording, paper_stand())
    ex, ey, tx, ty = shaft_parameters(Pose.from_matrix(made.truth.shaft_from_rotor))
    errors = []
    for way in peers(scan, paper_shaft()):
        begun = perf_counter()
        found = way.tried()
        took = perf_counter() - begun
        said = "none"
        if isinstance(found, Finding):
            off = hypot(found.axis[0] - ex - tx * found.height, found.axis[1] - ey - ty * found.height)
            said = f"{1000 * off:.3f} um, {took:.2f} s"
        errors.append((f"{way.name} ({way.library})", said))
    return errors


def main() -> None:
    found = {name: axis_errors(changes) for name, changes in track(SITUATIONS.items(), console=Console(stderr=True))}
    table = Table("situation", "method", "axis off, time", title="Distance of the shaft's axis from the true one")
    for name, errors in found.items():
        for i, (way, said) in enumerate(errors):
            table.add_row("" if i else name, way, said, end_section=i == len(errors) - 1)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
