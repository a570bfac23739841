"""Do the intervals hold what they promise? Coverage of U over many virtual scans.

Noise: the same stand scanned again and again with another noise; the part of U that a second scan does not share must
hold 95 % of the errors. Budget: coaxiality, radii and linearity drawn from what certificate and data sheet say of them;
the whole U must hold at least 95 %. Views: the same, and mounting and scale, of sensors at 12 to 60 degrees to the
axis; how many are untrusted though right, and how many valid ones are off by 2 and 3 U.

Run with the development environment: python bench/intervals.py [--scans 1000] [--budgets 300] [--views 300]
[--first-seed 0]
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from math import hypot, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table as RichTable

from truestand.calibration.calibrate import calibrate
from truestand.core.artefact import Artefact
from truestand.core.calibration import Calibration
from truestand.core.errors import TruestandError
from truestand.core.frames import sensor_parameters, shaft_parameters
from truestand.core.scan import Scan, interpret
from truestand.core.stand import Sensor, Stand, Table
from truestand.sim import (
    Acquisition,
    FormWave,
    Misalignment,
    Mounting,
    Optics,
    Running,
    Simulated,
    Simulation,
    Workpiece,
    paper_shaft,
    simulate,
)

Array = NDArray[np.float64]

POINTS, PER_TURN, TURNS = 320, 1500, 1.3
NOISE = 0.008
"""mm, standard deviation of every kind of noise."""
KINDS = {"white": 0.0, "AR(1) 0.5": 0.5, "AR(1) 0.9": 0.9, "AR(1) 0.99": 0.99, "speckle": None}
FORM = tuple(
    FormWave(s, n, 0.01 / n, 0.7 * n) for s in ("base", "bearing") for n in range(2, 7)
)  # fmt: skip
PHI, D, ALPHA, E, BETA, TILT, LEAN = radians(-138.2), 0.2, radians(0.2), 0.88, 0.6, 0.001, 2.0


def stand() -> Stand:
    # A wide prior: with a narrow one the one truth of the noise study would be drawn towards its middle every time.
    sensor = Sensor(
        "front", 200.0, POINTS, (70.0, 120.0), linearity_U=0.02, plane_offset_U=10.0, plane_tilt_U=radians(10.0)
    )
    return Stand(Table(2 * np.pi * 200 / PER_TURN, "ccw", "home"), (sensor,))


def simulation(**parts: Any) -> Simulation:
    base = Simulation(
        Mounting(PHI, 95.0, -1.0, ALPHA, D), Running(E, BETA, TILT, LEAN), Workpiece(form=FORM),
        Optics(noise=0.0, step_x=0.0, step_z=0.0), Acquisition(int(TURNS * PER_TURN), 0.0, ("angle",)),
    )  # fmt: skip
    return replace(base, **parts)


@cache
def clean() -> Simulated:
    """The scan without noise: cast once."""
    return simulate(stand(), simulation(), paper_shaft())


def noisy(kind: str, seed: int) -> Scan:
    """The same scan with one kind of noise along the range."""
    made = clean().recording
    rng = np.random.default_rng(seed)
    rho = KINDS[kind]
    if rho is None:  # fixed to the surface: every turn reads the same
        speckle = rng.normal(0.0, NOISE, (PER_TURN, POINTS))
        noise = speckle[np.arange(made.z.shape[0]) % PER_TURN]
    else:
        noise = rng.normal(0.0, NOISE, made.z.shape)
        for i in range(1, noise.shape[0]):
            noise[i] = rho * noise[i - 1] + np.sqrt(1 - rho * rho) * noise[i]
    z = made.z + noise
    return interpret(replace(made, x=made.x * (z / made.z), z=z), stand())


def errors_of(found: Calibration, truth: Simulated) -> dict[str, float]:
    """Error of each quantity in the unit of its U."""
    true, rotor = truth.truth.table_from_sensor, truth.truth.shaft_from_rotor
    phi = float(np.arctan2(true[2, 0], true[2, 2]))
    own = sensor_parameters(found.table_from_sensor)
    mounted = truth.truth.simulation.mounting
    ex, ey, tx, ty = shaft_parameters(found.shaft_from_rotor)
    back = np.linalg.inv(rotor)
    ax, ay = back[0, 2] / back[2, 2], back[1, 2] / back[2, 2]
    e = back[:2, 3] - np.array([ax, ay]) * back[2, 3]
    return {
        "eccentricity_um": 1000 * (hypot(ex, ey) - hypot(*e)),
        "eccentricity_direction_deg": _degrees(np.arctan2(ey, ex) - np.arctan2(e[1], e[0])),
        "phi_deg": _degrees(own[0] - phi),
        "radial_position_mm": float(found.table_from_sensor.translation[0] - true[0, 3]),
        "laser_plane_offset_mm": own[4] - mounted.plane_offset,
        "laser_plane_tilt_deg": _degrees(own[3] - mounted.plane_tilt),
        "tilt_mrad": 1000 * (hypot(tx, ty) - hypot(ax, ay)),
    }


def _degrees(angle: float) -> float:
    return float(np.degrees(np.angle(np.exp(1j * angle))))


def noise_part(found: Calibration) -> dict[str, float]:
    """The part of U that a second scan of the same artefact does not share, by quantity."""
    return {
        key: next(c.U for c in u.contributions if c.name == "noise") for key, u in found.uncertainty.items()
    }  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """Error over U by quantity."""

    kind: str
    ratio: dict[str, float]
    reasons: tuple[str, ...] = ()
    label: str = ""


def try_noise(job: tuple[str, int]) -> Trial:
    kind, seed = job
    found = calibrate(noisy(kind, seed), paper_shaft())
    errors, U = errors_of(found, clean()), noise_part(found)
    return Trial(kind, {key: abs(e) / U[key] for key, e in errors.items()})


def drawn(rng: np.random.Generator) -> tuple[Simulation, Artefact]:
    """A stand whose artefact and sensor are off by what their papers allow; 2 um each of diameter and coaxiality."""
    shaft = paper_shaft()
    base, bearing = shaft.cylinders
    stated = tuple(replace(c, diameter_U=0.002, coaxiality_U=0.002) for c in (base, bearing))
    off, lean = rng.normal(0, 0.001, 2), rng.normal(0, 0.001 / bearing.length, 2)
    diameters = tuple((c.name, float(rng.normal(0, 0.001))) for c in stated)
    workpiece = Workpiece(
        form=FORM, diameter_errors=diameters,
        misalignments=(Misalignment("bearing", float(off[0]), float(off[1]), float(lean[0]), float(lean[1])),),
    )  # fmt: skip
    optics = Optics(
        noise=NOISE, nonlinearity=float(abs(rng.normal(0, 0.01))), nonlinearity_phase=float(rng.uniform(0, 6.28))
    )
    mounting = Mounting(PHI, 95.0, -1.0, radians(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.4, 0.4)))
    running = Running(float(rng.uniform(0.6, 1.5)), float(rng.uniform(0, 6.28)), float(rng.uniform(0, 0.003)), LEAN)
    return simulation(workpiece=workpiece, optics=optics, mounting=mounting, running=running), replace(
        shaft, cylinders=stated
    )


def try_budget(seed: int) -> Trial:
    simulated, artefact = drawn(np.random.default_rng(seed))
    made = simulate(stand(), simulated, artefact, seed)
    found = calibrate(interpret(made.recording, stand()), artefact)
    errors = errors_of(found, made)
    return Trial("budget", {key: abs(e) / found.uncertainty[key].U for key, e in errors.items()})


def try_view(seed: int) -> Trial:
    """A sensor somewhere at 12 to 60 degrees to the axis, looking down or up, everything off by what is stated."""
    rng = np.random.default_rng(seed)
    simulated, artefact = drawn(rng)
    aslant = radians(float(rng.uniform(12.0, 60.0)))
    phi = float(rng.choice([-aslant, aslant, aslant - np.pi, np.pi - aslant]))
    mounting = Mounting(
        phi, 95.0, float(rng.uniform(-2.5, 0.5)), radians(float(rng.normal(0.0, 0.5))), float(rng.normal(0.0, 0.5))
    )
    optics = replace(simulated.optics, scale_error=float(rng.normal(0.0, 5e-5)), outliers=0.02, dropouts=0.1)
    simulated = replace(simulated, mounting=mounting, optics=optics)
    sensor = replace(stand().sensor, plane_offset_U=None, plane_tilt_U=None)
    assumed = replace(stand(), sensors=(sensor,))
    made = simulate(assumed, simulated, artefact, seed)
    label = f"seed {seed}, phi {np.degrees(phi):.1f}"
    try:
        found = calibrate(interpret(made.recording, assumed), artefact)
    except TruestandError as refused:
        return Trial("views", {}, (f"refused: {refused}",), label)
    errors = errors_of(found, made)
    ratio = {k: abs(e) / found.uncertainty[k].U for k, e in errors.items() if k not in found.not_identifiable}
    return Trial("views", ratio, tuple(found.reasons), label)


def show_views(trials: list[Trial]) -> None:
    """Inside U by quantity of the valid ones, and what went wrong."""
    refused = [t for t in trials if not t.ratio]
    untrusted = [t for t in trials if t.ratio and t.reasons]
    valid = [t for t in trials if t.ratio and not t.reasons]
    table = RichTable(
        "quantity", "known", "inside U", "U rms", "beyond 2 U", "beyond 3 U", title=f"{len(valid)} valid stands"
    )
    for key in dict.fromkeys(k for t in valid for k in t.ratio):
        r = np.array([t.ratio[key] for t in valid if key in t.ratio])
        table.add_row(key, f"{r.size}", f"{np.mean(r <= 1):.1%}", f"{np.sqrt(np.mean(r**2)):.2f}",
                      f"{np.sum(r > 2)}", f"{np.sum(r > 3)}")  # fmt: skip
    console = Console(width=150)
    console.print(table)
    right = [t for t in untrusted if max(t.ratio.values()) <= 2]
    console.print(f"{len(refused)} refused; {len(untrusted)} untrusted, {len(right)} of them though within 2 U")
    for t in (*refused, *untrusted, *(t for t in valid if max(t.ratio.values()) > 2)):
        worst = max(t.ratio, key=lambda k: t.ratio[k]) if t.ratio else ""
        console.print(f"{t.label}: {worst} {t.ratio.get(worst, 0):.1f} U; {'; '.join(r[:90] for r in t.reasons)}")


def run(what: Any, jobs: list[Any], title: str, workers: int) -> list[Trial]:
    with ProcessPoolExecutor(workers) as pool:
        return list(track(pool.map(what, jobs, chunksize=4), title, total=len(jobs), console=Console(stderr=True)))


def show(trials: list[Trial], title: str) -> None:
    kinds = list(dict.fromkeys(t.kind for t in trials))
    table = RichTable("quantity", *kinds, title=title)
    for key in trials[0].ratio:
        cells = []
        for kind in kinds:
            ratios = np.array([t.ratio[key] for t in trials if t.kind == kind])
            cells.append(f"{np.mean(ratios <= 1):.1%}  ({np.sqrt(np.mean(ratios**2)):.2f} U rms)")
        table.add_row(key, *cells)
    Console(width=150).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scans", type=int, default=1000)
    parser.add_argument("--budgets", type=int, default=300)
    parser.add_argument("--views", type=int, default=300)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    a = parser.parse_args()
    clean()
    seeds = range(a.first_seed, a.first_seed + a.scans)
    if a.scans:
        trials = run(try_noise, [(k, s) for k in KINDS for s in seeds], "noise", a.workers)
        show(trials, f"Errors within the noise part of U (k = 2): {a.scans} scans of each kind")
    if a.views:
        show_views(run(try_view, list(range(a.first_seed, a.first_seed + a.views)), "views", a.workers))
    if a.budgets:
        trials = run(try_budget, list(range(a.first_seed, a.first_seed + a.budgets)), "budget", a.workers)
        show(trials, f"Errors within U (k = 2): {a.budgets} stands drawn from their papers")


if __name__ == "__main__":
    main()
