"""Random stands and random shafts: how often is the calibration right, and does it say so whenever it isn't?

Run with the development environment: python bench/random_stands.py [--stands 1000] [--shafts 1000] [--first-seed 0]
[--range-error-um 25] [--coaxiality-um 10] [--wrong-step-um 45] [--bearing-waves 2]
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import degrees, radians
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table as RichTable

from truestand.calibration.calibrate import calibrate
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.calibration import Calibration
from truestand.core.errors import TruestandError
from truestand.core.frames import Pose
from truestand.core.scan import Scan, interpret
from truestand.core.stand import Sensor, Stand, Table
from truestand.core.surface import apply_calibration
from truestand.sim import (
    Acquisition,
    FormWave,
    Keyway,
    Misalignment,
    Mounting,
    Optics,
    Running,
    Simulated,
    Simulation,
    Truth,
    Workpiece,
    paper_shaft,
    simulate,
)

POINTS, PER_TURN = 480, 1500
VIEWS = (-138.2, -120.0, -60.0, -41.8, 41.8, 60.0, 120.0, 138.2)
WRONG_E, WRONG_PHI, WRONG_EDGE = 0.005, radians(0.05), 0.1
"""mm, rad, mm beyond which an answer that calls itself valid counts as wrong, unless its own U says as much."""


@dataclass(frozen=True)
class Outcome:
    """What became of one random stand; um and degrees."""

    seed: int
    status: str
    e: float = np.nan
    e_U: float = np.nan
    phi: float = np.nan
    field: float = np.nan
    plane: float = np.nan
    """Offset or tilt of the laser plane off the truth, whichever is more of its U."""
    wrong: str = ""


def random_stand(rng: np.random.Generator) -> tuple[Stand, Simulation, Artefact]:
    """The paper's shaft with 5 % outliers, 15 % dropouts, ghosts, form, laser plane to 0.4 mm and 0.5 degrees off."""
    angle = bool(rng.random() < 0.6)
    turns = float(rng.uniform(1.0, 3.0))
    form = tuple(
        FormWave(s, int(n), float(rng.uniform(0, 0.03) / n), float(rng.uniform(0, 6.28)))
        for s in ("base", "bearing") for n in rng.choice(np.arange(2, 9), 3, replace=False)
    )  # fmt: skip
    simulation = Simulation(
        Mounting(
            radians(float(rng.choice(VIEWS)) + rng.uniform(-8, 8)), 95.0, float(rng.uniform(-2.5, 0.5)),
            radians(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.4, 0.4)), float(rng.uniform(0, 6.28)),
        ),
        Running(float(rng.uniform(0.3, 1.5)), float(rng.uniform(0, 6.28)), float(rng.uniform(0, 0.003)),
                float(rng.uniform(0, 6.28))),
        Workpiece(form=form, chamfer=float(rng.choice([0.0, 0.2, 0.5])), fillet=float(rng.choice([0.0, 0.3]))),
        Optics(noise=float(rng.uniform(0.003, 0.008)), outliers=0.05, dropouts=0.15, ghosts=0.1),
        Acquisition(int(turns * PER_TURN), float(rng.uniform(-3, 3)) if angle else 0.0, ("angle",) if angle else ()),
    )  # fmt: skip
    return _stand(rng), simulation, paper_shaft()


def random_shaft(rng: np.random.Generator) -> tuple[Stand, Simulation, Artefact]:
    """Two to five cylinders with chamfers, fillets, grooves and keyways; 30 % invalid readings."""
    count = int(rng.integers(2, 6))
    radii = [float(rng.uniform(5, 18))]
    while len(radii) < count:
        r = float(rng.uniform(5, 18))
        if abs(r - radii[-1]) > 0.8:
            radii.append(r)
    lengths = rng.uniform(4, 22, count)
    bottom = -float(lengths[0])
    cylinders = []
    for k, (r, length) in enumerate(zip(radii, lengths, strict=True)):
        cylinders.append(Cylinder(f"c{k}", 2 * round(r, 3), bottom, bottom + float(length), 0.002))
        bottom += float(length)
    shaft = Artefact(tuple(cylinders), "random")
    chosen = cylinders[int(rng.integers(0, count))]
    keyways = []
    if rng.random() < 0.5:
        at = float(rng.uniform(chosen.bottom, chosen.top - 1.5))
        keyways.append(
            Keyway(chosen.name, 0.0, 1e6, float(rng.uniform(0.2, 0.6)), at, at + float(rng.uniform(0.5, 1.5)))
        )
    if rng.random() < 0.3:
        keyways.append(
            Keyway(chosen.name, float(rng.uniform(0, 6)), float(rng.uniform(2, 5)), float(rng.uniform(0.5, 2)))
        )
    simulation = Simulation(
        Mounting(
            radians(float(rng.choice(VIEWS)) + rng.uniform(-10, 10)), float(rng.uniform(88, 100)),
            float(rng.uniform(cylinders[0].bottom + 2, cylinders[min(1, count - 1)].top)),
            radians(rng.uniform(-0.3, 0.3)), float(rng.uniform(-0.3, 0.3)),
        ),
        Running(float(rng.uniform(0.0, 1.5)), float(rng.uniform(0, 6.28)), float(rng.uniform(0, 0.002)), 1.0),
        Workpiece(chamfer=float(rng.uniform(0, 0.5)), fillet=float(rng.uniform(0, 0.5)), keyways=tuple(keyways)),
        Optics(noise=float(rng.uniform(0.002, 0.02)), dropouts=float(rng.uniform(0, 0.3)),
               outliers=float(rng.uniform(0, 0.1)), ghosts=0.05, fan=float(rng.uniform(0.15, 0.4))),
        Acquisition(int(1.2 * PER_TURN), 0.0, ("angle",)),
    )  # fmt: skip
    return _stand(rng), simulation, shaft


def _stand(rng: np.random.Generator) -> Stand:
    direction = "ccw" if rng.random() < 0.5 else "cw"
    sensor = Sensor("front", 200.0, POINTS, (70.0, 120.0), bool(rng.random() < 0.3), linearity_U=0.02)
    return Stand(Table(2 * np.pi * 200 / PER_TURN, direction, "home"), (sensor,))


def try_stand(seed: int, range_error: float = 0.0, coaxiality: float = 0.0, wrong_step: float = 0.0) -> Outcome:
    """A random stand; mm of smooth range error (one sine over the range), by which the bearing's axis is off, and by
    which its radius is not as drawn."""
    rng = np.random.default_rng(seed)
    stand, simulation, shaft = random_stand(rng)
    if range_error:
        bent = replace(simulation.optics, nonlinearity=range_error, nonlinearity_phase=float(rng.uniform(0, 6.28)))
        simulation = replace(simulation, optics=bent)
    if coaxiality:
        off = coaxiality * np.exp(1j * rng.uniform(0, 6.28))
        axis = Misalignment("bearing", float(off.real), float(off.imag))
        simulation = replace(simulation, workpiece=replace(simulation.workpiece, misalignments=(axis,)))
        base, bearing = shaft.cylinders
        shaft = replace(shaft, cylinders=(base, replace(bearing, coaxiality_U=coaxiality)))
    if wrong_step:
        base, bearing = shaft.cylinders
        drawn = replace(bearing, diameter=bearing.diameter + 2 * wrong_step * float(rng.choice([-1, 1])))
        made = simulate(stand, simulation, shaft, seed)
        return _judged(seed, made, interpret(made.recording, stand), replace(shaft, cylinders=(base, drawn)))
    return _tried(seed, stand, simulation, shaft)


def try_bearing(seed: int, waves: int) -> Outcome:
    """A round shaft of little or much eccentricity, its steps coaxial to 0.2 um, on a table whose bearing moves it by
    some waves of 1 to 7 um, 5 to 28 times a turn."""
    rng = np.random.default_rng(seed)
    stand, simulation, shaft = random_stand(rng)
    eccentricity = float(np.exp(rng.uniform(np.log(0.05), np.log(1.5))))
    simulation = replace(
        simulation, optics=Optics(noise=0.002, dropouts=0.02), workpiece=Workpiece(),
        running=replace(simulation.running, eccentricity=eccentricity),
    )  # fmt: skip
    base, bearing = shaft.cylinders
    shaft = replace(shaft, cylinders=(base, replace(bearing, coaxiality_U=2e-4)))
    made = simulate(stand, simulation, shaft, seed)
    scan = interpret(made.recording, stand)
    x, _, z = Pose.from_matrix(made.truth.table_from_sensor).rotation.T @ np.array([1.0, 0.0, 0.0])
    by = np.zeros((scan.profiles, 1))
    for n in rng.integers(5, 29, waves):
        by += rng.uniform(0.001, 0.007) * np.cos(n * scan.angle + rng.uniform(0, 6.28))[:, None]
    return _judged(seed, made, replace(scan, x=scan.x + by * x, z=scan.z + by * z), shaft)


def try_shaft(seed: int) -> Outcome:
    stand, simulation, shaft = random_shaft(np.random.default_rng(seed))
    return _tried(seed, stand, simulation, shaft)


def _tried(seed: int, stand: Stand, simulation: Simulation, shaft: Artefact) -> Outcome:
    made = simulate(stand, simulation, shaft, seed)
    return _judged(seed, made, interpret(made.recording, stand), shaft)


def _judged(seed: int, made: Simulated, scan: Scan, shaft: Artefact) -> Outcome:
    simulation = made.truth.simulation
    try:
        found = calibrate(scan, shaft)
    except TruestandError as refused:
        return Outcome(seed, "refused", wrong=str(refused)[:60])
    e = abs(found.eccentricity - simulation.running.eccentricity)
    e_U = found.uncertainty["eccentricity_um"].U / 1000
    phi = abs(np.angle(np.exp(1j * (found.phi - simulation.mounting.phi))))
    wrong = []
    if e > max(WRONG_E, 2 * e_U):
        wrong.append(f"e {1e3 * e:.1f} um")
    if phi > max(WRONG_PHI, 2 * radians(found.uncertainty["phi_deg"].U)):
        wrong.append(f"phi {degrees(phi):.3f} deg")
    height = abs(shoulder_error(found, made.truth, shaft))
    if "height" not in found.not_identifiable and height > WRONG_EDGE:
        wrong.append(f"height {height:.2f} mm")
    if height > 5.0:
        wrong.append(f"wrong cylinder, {height:.1f} mm")
    said = found.status if found.status == "valid" else f"untrusted: {found.reasons[0][:60]}"
    plane = plane_error(found, made.truth)
    if plane > 2.0:
        wrong.append(f"laser plane {plane:.1f} U")
    return Outcome(
        seed, said, 1e3 * e, 1e3 * e_U, degrees(phi), 1e3 * field_error(found, made.truth), plane, ", ".join(wrong)
    )


def plane_error(found: Calibration, truth: Truth) -> float:
    """Error of the laser plane's offset or tilt over its U, whichever is more; 0 where neither is known."""
    mounting, U = truth.simulation.mounting, found.uncertainty
    ratios = [0.0]
    if found.plane_offset is not None:
        ratios.append(abs(found.plane_offset - mounting.plane_offset) / U["laser_plane_offset_mm"].U)
    if found.plane_tilt is not None:
        ratios.append(degrees(abs(found.plane_tilt - mounting.plane_tilt)) / U["laser_plane_tilt_deg"].U)
    return max(ratios)


def shoulder_error(found: Calibration, truth: Truth, shaft: Artefact) -> float:
    """Height (mm) at which the calibration puts the corner of the shoulder, which stands at the drawing's."""
    pose = Pose.from_matrix(truth.table_from_sensor)
    corner = np.array([shaft.base.radius, pose.translation[1], shaft.shoulder])
    return float(found.table_from_sensor(pose.inverse(corner))[2]) - shaft.shoulder


def field_error(found: Calibration, truth: Truth) -> float:
    """rms distance (mm) of calibrated from true points over the sensor's field and a turn, height and azimuth apart."""
    z, slope = np.meshgrid(np.linspace(72, 118, 9), np.linspace(-0.14, 0.14, 9))
    x, z = (z * slope).ravel(), z.ravel()
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    view = Scan(np.tile(x, (12, 1)), np.tile(z, (12, 1)), angle, found.stand, "angle")
    ours = apply_calibration(view, found)
    true = replace(
        found, table_from_sensor=Pose.from_matrix(truth.table_from_sensor),
        shaft_from_rotor=Pose.from_matrix(truth.shaft_from_rotor),
    )  # fmt: skip
    theirs = apply_calibration(view, true)
    dx, dy, dz = ours.x - theirs.x, ours.y - theirs.y, ours.z - theirs.z
    turn = (theirs.x * dy - theirs.y * dx).sum() / (theirs.x**2 + theirs.y**2).sum()
    squares = (dx + turn * theirs.y) ** 2 + (dy - turn * theirs.x) ** 2 + (dz - dz.mean()) ** 2
    return float(np.sqrt(squares.mean()))


def study(what: Any, seeds: range, title: str, workers: int) -> None:
    console = Console(width=120)
    with ProcessPoolExecutor(workers) as pool:
        done = list(track(pool.map(what, seeds, chunksize=4), title, total=len(seeds), console=Console(stderr=True)))
    valid = [o for o in done if o.status == "valid"]
    table = RichTable("figure", "value", title=f"{title}: {len(done)} from seed {seeds.start}")
    counts = [sum(o.status.startswith(kind) for o in done) for kind in ("valid", "untrusted", "refused")]
    table.add_row("valid / untrusted / refused", " / ".join(map(str, counts)))
    table.add_row("silently wrong", str(sum(bool(o.wrong) for o in valid)))
    for name, values in (("eccentricity, um", [o.e for o in valid]), ("phi, degrees", [o.phi for o in valid]),
                         ("field, um rms", [o.field for o in valid]),
                         ("laser plane, of its U", [o.plane for o in valid])):  # fmt: skip
        q = np.quantile(values, [0.5, 0.95, 1.0]) if values else [np.nan] * 3
        table.add_row(f"{name}: median, 95 %, worst", "  ".join(f"{v:.4f}" for v in q))
    covered = np.mean([o.e <= o.e_U for o in valid]) if valid else np.nan
    table.add_row("eccentricity within U", f"{covered:.1%}")
    console.print(table)
    for o in done:
        if o.status != "valid" or o.wrong:
            console.print(f"{o.seed:6} {o.status:75.75} {o.wrong}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stands", type=int, default=1000)
    parser.add_argument("--shafts", type=int, default=1000)
    parser.add_argument("--range-error-um", type=float, default=0.0)
    parser.add_argument("--coaxiality-um", type=float, default=0.0)
    parser.add_argument("--wrong-step-um", type=float, default=0.0)
    parser.add_argument("--bearing-waves", type=int, default=0)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    a = parser.parse_args()
    um = 1e-3
    what = partial(
        try_stand, range_error=um * a.range_error_um, coaxiality=um * a.coaxiality_um, wrong_step=um * a.wrong_step_um
    )
    if a.bearing_waves:
        what = partial(try_bearing, waves=a.bearing_waves)
    if a.stands:
        study(what, range(a.first_seed, a.first_seed + a.stands), "random stands", a.workers)
    if a.shafts:
        study(try_shaft, range(a.first_seed, a.first_seed + a.shafts), "random shafts", a.workers)


if __name__ == "__main__":
    main()
