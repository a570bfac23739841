"""Two sensors about one table: where they stand, whether their U covers it, and what their seams notice.

    python bench/two_views.py poses --stands 100
    python bench/two_views.py ideal --stands 20
    python bench/two_views.py exact --stands 20
    python bench/two_views.py seams --stands 100
    python bench/two_views.py gears

poses: linearity of 20 um in one wave, coaxiality of 10 um, mountings, diameters and what the table's bearing does once
a turn towards each sensor drawn; ideal: none of it, 0.5 um of noise; exact: no noise either. seams: a helical gear by
both, the rear one moved by 20 um towards the axis since the calibration in every second stand. gears: helical gears of
both hands, figures against the truth.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import atan2, cos, degrees, hypot, radians, sin, sqrt, tau

import numpy as np

from truestand.apply.views import roll_views
from truestand.calibration.views import calibrate_views
from truestand.core.artefact import Artefact
from truestand.core.assumptions import BEARING_U
from truestand.core.errors import TruestandError
from truestand.core.frames import Pose, about_axis
from truestand.core.harmonics import wrap
from truestand.core.scan import Scan, interpret
from truestand.core.stand import Sensor, Stand, Table
from truestand.gear.drawing import Gear
from truestand.gear.inspect import inspect_gear
from truestand.report.true_values import true_values
from truestand.sim import (
    FlankErrors,
    GearErrors,
    Misalignment,
    Mounting,
    Optics,
    Running,
    Simulation,
    VirtualGear,
    Workpiece,
    paper_shaft,
    paper_simulation,
    simulate,
)
from truestand.sim.gear_truth import gear_figures
from truestand.sim.truth import Truth, truth_record

AZIMUTH, FAN, COUNTS = radians(120.0), radians(32.0), 360_000
NAMES = ("front", "rear")
FRONT = Mounting(phi=radians(-70.0), standoff=105.0, height=2.0)
REAR = Mounting(phi=radians(-110.0), standoff=105.0, height=2.0, azimuth=AZIMUTH)
ABOVE = (
    replace(FRONT, phi=radians(-125.0), standoff=95.0, height=-1.0),
    replace(REAR, phi=radians(-115.0), standoff=95.0, height=-1.0),
)
"""Both see the shoulder's face."""
LINEARITY_U, COAXIALITY_U = 0.02, 0.01
IDEAL = {"ideal": 0.0005, "exact": 0.0}
"""mm of noise, all that is drawn of such sensors."""
MOVED, OUTSIDE = 0.02, 25.0
"""mm: the move, and the radius at which the relative pose is looked at."""


@dataclass(frozen=True)
class World:
    """One stand as it is."""

    stand: Stand
    artefact: Artefact
    simulation: Simulation
    optics: tuple[Optics, Optics]
    running: tuple[Running, Running]
    """As each sensor sees it: what the table's bearing does once a turn looks like eccentricity."""

    def scans(self, seed: int, part: VirtualGear | None = None, moved: float = 0.0) -> tuple[Scan, Scan]:
        """By both sensors; the rear one ``moved`` towards the axis, mm."""
        (front, _), (rear, _) = self.seen(seed, part, moved)
        return front, rear

    def seen(self, seed: int, part: VirtualGear | None = None, moved: float = 0.0) -> list[tuple[Scan, Truth]]:
        """The same with the truth of each."""
        found = []
        for k, name in enumerate(NAMES):
            simulation = self.simulation
            if k and moved:
                front, (rear, where) = simulation.views
                other = replace(where, standoff=where.standoff - moved / abs(sin(where.phi)))
                simulation = replace(simulation, views=(front, (rear, other)))
            own = replace(simulation.seen_from(name), optics=self.optics[k], running=self.running[k])
            made = simulate(self.stand.of_view(name), own, self.artefact, 1000 * seed + k, None, part)
            scan = interpret(made.recording, self.stand, view=name)
            found.append((scan, made.truth))
        return found


def world(
    rng: np.random.Generator, places: tuple[Mounting, Mounting], ideal: float | None, per_turn: int, points: int
) -> World:
    """``ideal``: mm of noise of sensors and a shaft without any other error; None: they err."""
    base, shaft = paper_simulation(), paper_shaft()
    bearing = replace(shaft.cylinders[1], coaxiality_U=COAXIALITY_U)
    errs = ideal is None
    artefact = replace(shaft, cylinders=(shaft.cylinders[0], bearing)) if errs else shaft
    size = float(errs)
    off = size * rng.normal(0, COAXIALITY_U / 2, 2)
    slope = size * rng.normal(0, COAXIALITY_U / 2 / bearing.length, 2)
    workpiece = Workpiece(
        misalignments=(Misalignment("bearing", *off, *slope),),
        diameter_errors=(("base", size * float(rng.normal(0, 0.001))), ("bearing", size * float(rng.normal(0, 0.001)))),
    )
    views = tuple(
        (name, replace(
            p, phi=p.phi + radians(rng.normal(0, 1.0)), standoff=p.standoff + rng.normal(0, 1.0),
            height=p.height + rng.normal(0, 0.5), plane_offset=float(rng.normal(0, 0.5)),
            plane_tilt=radians(rng.normal(0, 0.5)), azimuth=p.azimuth + radians(rng.normal(0, 3.0)),
        ))
        for name, p in zip(NAMES, places, strict=True)
    )  # fmt: skip
    optics = tuple(
        replace(base.optics, fan=FAN, noise=0.005 if ideal is None else ideal, step_z=size * 0.004,
                step_x=size * 0.001, nonlinearity=size * float(rng.normal(0, LINEARITY_U / 2 * sqrt(2.0))),
                nonlinearity_phase=float(rng.uniform(0, tau)), scale_error=size * float(rng.normal(0, 5e-5)))
        for _ in NAMES
    )  # fmt: skip
    running = replace(
        base.running, eccentricity=float(rng.uniform(0.6, 1.5)), eccentricity_direction=float(rng.uniform(0, tau)),
        tilt=float(rng.uniform(2e-4, 1e-3)), tilt_direction=float(rng.uniform(0, tau)),
    )  # fmt: skip
    acquisition = replace(base.acquisition, profiles=round(1.1 * per_turn), columns=("encoder",))
    linearity = LINEARITY_U if errs else 0.0005
    sensors = tuple(Sensor(n, 200.0, points, (70.0, 120.0), linearity_U=linearity, incidence_U=0.005) for n in NAMES)
    stand = Stand(Table(tau * 200.0 / per_turn, "ccw", "home"), sensors, counts_per_turn=COUNTS)
    simulation = replace(
        base, mounting=Mounting(), running=running, workpiece=workpiece, acquisition=acquisition, views=views
    )
    aside = size * rng.normal(0, BEARING_U / 2, (2, 2))
    return World(
        stand, artefact, simulation, (optics[0], optics[1]), (off_by(running, *aside[0]), off_by(running, *aside[1]))
    )


def off_by(running: Running, x: float, y: float) -> Running:
    """The same shaft a little aside, mm."""
    x += running.eccentricity * cos(running.eccentricity_direction)
    y += running.eccentricity * sin(running.eccentricity_direction)
    return replace(running, eccentricity=hypot(x, y), eccentricity_direction=atan2(y, x))


def try_poses(ideal: float | None, seed: int) -> tuple[float, ...]:
    """Errors of azimuth (urad) and height (um) of the rear view, and both in U."""
    rng = np.random.default_rng(seed)
    here = world(rng, ABOVE, ideal, 2000, 320)
    seen = here.seen(seed)
    found = calibrate_views(tuple(scan for scan, _ in seen), here.artefact)
    rear = found.of_view("rear")
    front, other = (where for _, where in here.simulation.views)
    azimuth = wrap(rear.azimuth - (other.azimuth - front.azimuth))
    height = rear.height
    U = rear.uncertainty
    first, second = (Pose.from_matrix(truth.table_from_sensor) for _, truth in seen)
    told = found.views[0].table_from_sensor.inverse @ rear.first_from_table @ rear.table_from_sensor
    between = first.inverse @ about_axis(other.azimuth - front.azimuth, 0.0) @ second
    point = second.inverse(np.array([OUTSIDE, 0.0, 0.0]))
    off = first.rotation @ (told(point) - between(point))
    trace = float(np.trace((told.inverse @ between).rotation))
    turned = 1e6 * float(np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0)))
    shares = degrees(azimuth) / U["azimuth_deg"].U, height / U["height_mm"].U
    across = 1e3 * float(np.hypot(off[0], off[1]))
    return 1e6 * azimuth, 1e3 * height, *shares, float(bool(found.reasons)), across, turned


def helical(angle: float) -> Gear:
    tip = 48.0 / cos(radians(angle)) + 4.0
    return Gear(24, 2.0, 20.0, 5.0, tip, tip - 9.0, helix_angle=radians(angle), accuracy_class=7)


def real_gear(gear: Gear, rng: np.random.Generator) -> VirtualGear:
    pitch = [tuple(rng.normal(0, 0.005, gear.teeth)) for _ in range(2)]
    left, right = (FlankErrors(float(rng.normal(0, 0.004)), float(rng.normal(0, 0.003))) for _ in range(2))
    return VirtualGear(gear, GearErrors(phase=float(rng.uniform(0, 0.2)), pitch_left=pitch[0], pitch_right=pitch[1],
                                        eccentricity=0.008, left=left, right=right))  # fmt: skip


def try_seam(seed: int) -> tuple[bool, bool, float]:
    """Whether the rear view had moved, whether it was noticed, and the largest seam in U."""
    rng = np.random.default_rng(seed)
    here = world(rng, (FRONT, REAR), None, 2000, 240)
    gear = helical(15.0)
    found = calibrate_views(here.scans(seed), here.artefact)
    moved = bool(seed % 2)
    surfaces = roll_views(here.scans(seed + 1, real_gear(gear, rng), MOVED if moved else 0.0), found)
    try:
        inspection = inspect_gear(surfaces, gear)
    except TruestandError as error:
        print(f"seed {seed}, {'moved' if moved else 'not moved'}: refused: {error}", flush=True)
        return moved, True, 0.0
    named = {r.code for r in inspection.reasons}
    noticed = bool(named & {"views_contradict", "shaft_turned", "sensor_moved_radially"})
    if noticed and not moved:
        print(f"seed {seed}, not moved: {', '.join(sorted(named))}", flush=True)
    return moved, noticed, max((abs(s.difference) / s.U for s in inspection.seams), default=0.0)


def try_gear(angle: float, seed: int) -> dict[str, tuple[float, float, str]]:
    """Error and U (um) of the worst line of each figure, and its status."""
    rng = np.random.default_rng(seed)
    here = world(rng, (FRONT, REAR), IDEAL["ideal"], 4000, 480)
    gear, found = helical(angle), calibrate_views(here.scans(seed), here.artefact)
    part = real_gear(gear, rng)
    seen = here.seen(seed + 1, part)
    inspection = inspect_gear(roll_views(tuple(scan for scan, _ in seen), found), gear)
    truth = gear_figures(part, here.artefact, here.simulation.workpiece)
    told = true_values(inspection, truth_record(seen[0][1]))
    truth |= {("F_r", "", None): told["F_r", None] / 1000, ("s", "", None): told["s", None]}
    worst: dict[str, tuple[float, float, str]] = {}
    for c in inspection.characteristics:
        true = truth.get((c.name, c.flank or "", c.tooth))
        if true is not None and c.value is not None and c.U is not None:
            error = 1000 * (c.value - true)
            if abs(error) >= abs(worst.get(c.name, (0.0, 0.0, ""))[0]):
                worst[c.name] = error, 1000 * c.U, c.status
    missing = [f"{c.name} {c.flank}" for c in inspection.characteristics if c.tooth is None and c.status != "measured"]
    worst["not measured"] = (float(len(missing)), 0.0, ", ".join(missing))
    return worst


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("poses", *IDEAL, "seams", "gears"))
    parser.add_argument("--stands", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=90000)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + 2 * options.stands, 2)
    with ProcessPoolExecutor(options.jobs) as pool:
        if options.what == "poses" or options.what in IDEAL:
            rows = np.array(list(pool.map(partial(try_poses, IDEAL.get(options.what)), seeds)))
            for k, name in ((0, "azimuth, urad"), (1, "height, um"), (5, "off at 25 mm, um"), (6, "turned, urad")):
                size = np.abs(rows[:, k])
                print(
                    f"{name}: median {np.median(size):.2f}, 95 % {np.quantile(size, 0.95):.2f}, worst {size.max():.2f}"
                )
            for k, name in ((2, "azimuth"), (3, "height")):
                share = np.abs(rows[:, k])
                print(f"{name}: inside U {100 * np.mean(share <= 1):.1f} %, rms {np.sqrt(np.mean(share**2)):.2f} U, "
                      f"worst {share.max():.2f} U")  # fmt: skip
            print(f"untrusted: {int(rows[:, 4].sum())} of {len(rows)}")
        elif options.what == "seams":
            rows = np.array(list(pool.map(try_seam, [s + k % 2 for k, s in enumerate(seeds)])))
            moved = rows[:, 0] > 0
            noticed, seam = rows[:, 1] > 0, rows[:, 2]
            for which, of, word in ((moved, "moved", "noticed"), (~moved, "not moved", "alarms")):
                print(f"{of}: {word} {noticed[which].sum()} of {which.sum()}; "
                      f"seam, U: median {np.median(seam[which]):.2f}, largest {seam[which].max():.2f}")  # fmt: skip
        else:
            angles = (15.0, -15.0, 20.0, -20.0, 30.0, -30.0)
            for angle, worst in zip(angles, pool.map(try_gear, angles, seeds[: len(angles)]), strict=True):
                listed = ", ".join(f"{n} {e:+.2f} ({U:.2f})" for n, (e, U, _) in worst.items() if n != "not measured")
                print(f"{angle:+.0f} deg: {listed}; not measured: {worst['not measured'][2] or 'none'}")


if __name__ == "__main__":
    main()
