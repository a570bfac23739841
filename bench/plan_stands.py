"""Is what a plan promises what an inspection delivers? Stands drawn about a plan, their errors against the plan's U.

    python bench/plan_stands.py spur --stands 50
    python bench/plan_stands.py helical --stands 50 --json out.json

Every stand is mounted as planned to half a degree and half a millimetre, calibrated, and inspects one part that has
deviations of its own, of form too. What nobody knows of a stand is drawn from what the budget says of it: the sensor's
linearity (one and two waves over the range) and scale, how it reads steep flanks, the encoder's error, the table's
sideways motion (as an angle), its bearing (as motion of the part), the shaft's diameter and coaxiality. Printed: U of
the plan over twice the rms error, for each characteristic; of all teeth, where there are several.
"""

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from itertools import product
from math import acos, asin, atan, cos, radians, sin, tan, tau

import numpy as np

from truestand.apply.transfer import roll
from truestand.apply.views import roll_views
from truestand.calibration.calibrate import calibrate
from truestand.calibration.views import calibrate_views
from truestand.core.assumptions import BEARING_U, ENCODER_U, INCIDENCE_U, SCALE_U, SIDEWAYS_U
from truestand.core.errors import TruestandError
from truestand.core.inspection import Inspection
from truestand.core.scan import Recording, interpret
from truestand.core.stand import Stand
from truestand.gear.drawing import Gear
from truestand.parts.drawings import Section, Turned
from truestand.parts.inspect import Part, inspect
from truestand.planning.place import Place
from truestand.planning.plan import Plan, Task, plan
from truestand.sim import (
    FlankErrors,
    FormWave,
    GearErrors,
    Misalignment,
    Mounting,
    Optics,
    VirtualGear,
    VirtualTurned,
    Workpiece,
    paper_shaft,
    paper_simulation,
    paper_stand,
    simulate,
)
from truestand.sim.gear_truth import gear_figures

SPUR = Gear(24, 2.0, 20.0, 5.0, 52.0, 43.0, accuracy_class=7)
TIP = 48.0 / cos(radians(20.0)) + 4.0
PARTS: dict[str, Part] = {
    "spur": SPUR,
    "helical": replace(SPUR, helix_angle=radians(20.0), tip_diameter=TIP, root_diameter=TIP - 9.0),
    "ring": replace(SPUR, teeth=80, module=1.0, tip_diameter=82.0, root_diameter=77.5),
    "stepped": Turned((
        Section("flange", 3.0, 12.0, 30.0, (29.95, 30.05), 0.02, runout_limit=0.03),
        Section("middle", 12.0, 20.0, 24.0, (23.95, 24.05), 0.02, runout_limit=0.03),
        Section("top", 20.0, 28.0, 18.0, (17.95, 18.05), 0.02, runout_limit=0.03),
    )),
}  # fmt: skip
PER_TURN, TURNS, POINTS, FAN, LIMIT = 2000, 2.0, 320, radians(30.0), radians(85.0)
COUNTS = 360_000
LINEARITY = 0.01
"""mm: standard deviation of the range error's cosine, and of its sine: known to 20 um (k = 2); half of it of two waves.
"""
FORM, FLANK_FORM = 0.003, 0.0015
"""mm: amplitude of the turned part's waves; standard deviation of that of the flanks'."""
ECCENTRICITY = 1.0
"""mm, of the shaft on the table."""
FAR_BEYOND = 1.5
"""U by which a line is off that is named."""
LOST = 0.1
"""mm of U from which nothing is known of a line: parts of it count as not seen."""
LESS_STEEP = 20
"""Incidences below the flanks' at which a sensor's error is told: with a corner there the shaft's plane was 2 U off."""
FEED = 2.0
"""mm of height from one feed mark of the gear to the next."""


@cache
def planned(name: str, views: int | None) -> Plan:
    return plan(PARTS[name], stand(), paper_shaft(), Task(turns=TURNS), views)


def stand() -> Stand:
    base = paper_stand()
    line = tuple(2 * z * tan(FAN / 2) for z in (70.0, 120.0))
    sensor = replace(base.sensor, points=POINTS, line=line, incidence_limit=LIMIT, noise=0.005, profile_rate=200.0)
    return replace(
        base, table=replace(base.table, speed=tau * 200.0 / PER_TURN), counts_per_turn=COUNTS, sensors=(sensor,)
    )


def with_angle_errors(recording: Recording, rng: np.random.Generator, part: Part) -> Recording:
    """The encoder's error once a turn and faster, and the table's sideways motion at the part's radius."""
    angle = recording.encoder * (tau / COUNTS)
    teeth = part.teeth if isinstance(part, Gear) else 24
    radius = part.teeth * part.module / 2 if isinstance(part, Gear) else 12.0
    waves = [(1, ENCODER_U), *((n, ENCODER_U / n) for n in (max(2, teeth // 4),))]
    waves += [(n, SIDEWAYS_U / radius) for n in (2, max(2, teeth // 4))]
    error = sum(rng.normal(0, U / 2) * f(n * angle) for n, U in waves for f in (np.cos, np.sin))
    return replace(recording, encoder=recording.encoder + error * (COUNTS / tau))


class Untrusted(TruestandError):
    """An inspection that decides nothing."""


Found = dict[tuple[str, str], list[tuple[float, float]]]
"""Of each characteristic, by name and flank or section: error and U of each line (tooth) of the inspection, mm."""


def try_stand(name: str, views: int | None, seed: int) -> Found:
    """One stand about the plan: calibrated, and a part inspected on it."""
    rng, part, found = np.random.default_rng(seed), PARTS[name], planned(name, views)
    shaft, base = paper_shaft(), paper_simulation()
    certified = real_shaft(rng)
    directions = rng.uniform(0, tau, 2).tolist()
    running = replace(base.running, eccentricity=ECCENTRICITY, eccentricity_direction=directions[0], tilt=3e-4,
                      tilt_direction=directions[1])  # fmt: skip
    acquisition = replace(base.acquisition, profiles=round(PER_TURN * TURNS), columns=("encoder",))
    true, angle_seed = real_part(part, rng), int(rng.integers(1 << 30))
    moved = carried(true, rng)
    shafts, parts = [], []
    for k, view in enumerate(found.views):
        name_of_view, place = view.mount.sensor.name, mounted_about(view.mount.place, rng)
        own = found.setting.stand.of_view(name_of_view)
        simulation = replace(
            base, mounting=Mounting(azimuth=0.0), running=running, optics=real_sensor(part, place, rng),
            acquisition=acquisition, workpiece=certified, views=((name_of_view, place),),
        ).seen_from(name_of_view)  # fmt: skip
        for on_shaft, scans in ((None, shafts), (moved, parts)):
            made = simulate(own, simulation, shaft, seed + k, None, on_shaft)
            recording = with_angle_errors(made.recording, np.random.default_rng(angle_seed), part)
            scans.append(interpret(recording, own))
    if len(shafts) > 1:
        surfaces = roll_views(tuple(parts), calibrate_views(tuple(shafts), shaft))
    else:
        surfaces = (roll(parts[0], calibrate(shafts[0], shaft)),)
    inspection = inspect(surfaces, part)
    if inspection.reasons:
        raise Untrusted(str(inspection.reasons[0]))
    return held_against(inspection, true_figures(true, certified, shaft))


def real_shaft(rng: np.random.Generator) -> Workpiece:
    """A shaft as far off its drawing as its certificate leaves open."""
    bearing = paper_shaft().cylinders[1]
    u = (bearing.coaxiality_U or 0.0) / 2
    axis = Misalignment("bearing", *rng.normal(0.0, u, 2), *rng.normal(0.0, u / bearing.length, 2))
    return Workpiece(misalignments=(axis,), diameter_errors=(("base", float(rng.normal(0.0, 0.001))),))


def mounted_about(p: Place, rng: np.random.Generator) -> Mounting:
    """The place as somebody would hit it."""
    return Mounting(
        p.phi + radians(rng.normal(0, 0.5)), p.standoff + rng.normal(0, 0.5), p.height + rng.normal(0, 0.5),
        radians(rng.normal(0, 0.25)), p.plane_offset + rng.normal(0, 0.25), p.azimuth + radians(rng.normal(0, 1)),
    )  # fmt: skip


def real_sensor(part: Part, place: Mounting, rng: np.random.Generator) -> Optics:
    """A sensor whose range errs as its data sheet says, and which reads steep flanks otherwise."""
    return replace(
        paper_simulation().optics, fan=FAN, most_incidence=LIMIT, noise=0.005,
        nonlinearity=float(rng.rayleigh(LINEARITY)), nonlinearity_phase=float(rng.uniform(0, tau)),
        faster_nonlinearity=((2, float(rng.rayleigh(LINEARITY / 2)), float(rng.uniform(0, tau))),),
        scale_error=float(rng.normal(0, SCALE_U / 2)),
        flank_bias=flank_bias(part, place, rng) if isinstance(part, Gear) else (),
    )  # fmt: skip


def flank_bias(gear: Gear, place: Mounting, rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """By how much flanks read farther out, from the least to the most incidence at which any is seen: a shift, a slope,
    a bend and a wave of half their size; less steep surfaces, the shaft's, by the tangent less.
    """
    level, slope, bend, wave = rng.normal(0, INCIDENCE_U / 2, 4)
    least, most = incidences(gear, place)
    steep = np.linspace(-0.5, 0.5, 17)
    read = level + slope * steep + bend * (4.0 * steep**2 - 0.5) + wave / 4 * np.sin(tau * steep)
    below, angles = np.linspace(0.0, least, LESS_STEEP)[:-1], np.linspace(least, most, steep.size)
    read = np.concatenate([read[0] * np.tan(below) / tan(least), read])
    return tuple(zip([*below.tolist(), *angles.tolist()], read.tolist(), strict=True))


def incidences(gear: Gear, place: Mounting) -> tuple[float, float]:
    """The least and the most at which a tip, or a root, of either flank is seen of a gear on a shaft that runs out."""
    helix, normal_angle = gear.helix_angle, gear.pressure_angle
    angle = atan(tan(normal_angle) / cos(helix))
    base, base_helix = gear.teeth * gear.module / 2 / cos(helix) * cos(angle), asin(sin(helix) * cos(normal_angle))
    radii = gear.tip_diameter / 2, max(1.005 * base, gear.root_diameter / 2 + 0.25 * gear.module)
    aside, along = abs(place.plane_offset) + ECCENTRICITY, atan(gear.face_width / 2 / place.standoff)
    cosines = [
        cos(base_helix) * sin(acos(base / r) + off / r) * sin(ray) + side * sin(base_helix) * cos(ray)
        for r, off, ray, side in product(radii, (-aside, aside), (-place.phi - along, -place.phi + along), (-1, 1))
    ]
    return acos(max(cosines)), acos(max(min(cosines), cos(LIMIT)))


def held_against(inspection: Inspection, truth: dict) -> Found:
    lines: Found = {}
    for c in inspection.characteristics:
        key = (c.name, c.flank or c.section or "", c.tooth)
        if c.value is not None and c.U is not None and key in truth:
            lines.setdefault(key[:2], []).append((c.value - truth[key], c.U))
    return lines


def real_part(part: Part, rng: np.random.Generator):
    """A part with errors of its own."""
    if isinstance(part, Gear):
        pitch = [tuple(rng.normal(0, 0.004, part.teeth)) for _ in range(2)]
        left, right = (FlankErrors(float(rng.normal(0, 0.003)), float(rng.normal(0, 0.003))) for _ in range(2))
        return VirtualGear(part, GearErrors(
            phase=float(rng.uniform(0, 0.2)), pitch_left=pitch[0], pitch_right=pitch[1], eccentricity=0.008,
            left=left, right=right, profile_wave=float(rng.normal(0, FLANK_FORM)), profile_waves=2.0,
            feed_marks=float(rng.normal(0, FLANK_FORM)), feed_mark_spacing=FEED,
        ))  # fmt: skip
    waves = tuple(FormWave(s.name, 3, FORM, float(rng.uniform(0, tau))) for s in part.sections)
    return VirtualTurned(part, Workpiece(form=waves))


def carried(part, rng: np.random.Generator):
    """The part as the table's bearing carries it: aside once a turn, or in waves, where once a turn can't be told."""
    aside = rng.normal(0, BEARING_U / 2, 2)
    if isinstance(part, VirtualGear):
        errors = part.errors
        x, y = errors.eccentricity + aside[0], aside[1]
        return VirtualGear(part.gear, replace(errors, eccentricity=float(np.hypot(x, y)),
                                              eccentricity_direction=float(np.arctan2(y, x))))  # fmt: skip
    phase = float(rng.uniform(0, tau))
    waves = tuple(FormWave(s.name, 2, float(aside[0]), phase) for s in part.turned.sections)
    return VirtualTurned(part.turned, Workpiece(form=(*part.workpiece.form, *waves)))


def true_figures(part, workpiece: Workpiece, shaft) -> dict:
    """By name, flank or section, and tooth."""
    if isinstance(part, VirtualGear):
        return {(n, flank or "", tooth): v for (n, flank, tooth), v in gear_figures(part, shaft, workpiece).items()}
    found = {}
    for s in part.turned.sections:
        found["d", s.name, None] = s.diameter
        found["roundness", s.name, None] = 2 * FORM
        found["runout", s.name, None] = 2 * FORM
    return found


def odd_lines(found: Found) -> Iterator[str]:
    """What is far beyond its U, and how much nothing is known of."""
    for key, lines in found.items():
        error, U = max(lines, key=lambda line: abs(line[0] / line[1]))
        if abs(error) > FAR_BEYOND * U:
            yield f"{' '.join(key)} {1000 * error:.1f} um off at U {1000 * U:.1f}"
    lost = sum(U >= LOST for lines in found.values() for _, U in lines)
    if lost:
        yield f"{lost} lines with a U of {LOST:g} mm and more"


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--stands", type=int, default=50)
    parser.add_argument("--views", type=int)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json")
    options = parser.parse_args()
    found = planned(options.part, options.views)
    print(f"{options.part}: {len(found.views)} views, complete {found.complete}")
    told: dict[tuple[str, str], list[tuple[float, float]]] = {}
    refused = {"refused": 0, "untrusted": 0}
    seeds = range(options.first_seed, options.first_seed + options.stands)
    with ProcessPoolExecutor(options.jobs) as pool:
        jobs = {seed: pool.submit(partial(try_stand, options.part, options.views), seed) for seed in seeds}
        for seed, job in jobs.items():
            try:
                for key, lines in job.result().items():
                    told.setdefault(key, []).extend(lines)
                for text in odd_lines(job.result()):
                    print(f"seed {seed}: {text}", flush=True)
            except TruestandError as error:
                kind = "untrusted" if isinstance(error, Untrusted) else "refused"
                refused[kind] += 1
                print(f"{kind}, seed {seed}: {error}", flush=True)
    print(
        "| characteristic | U planned, um | U inspected, um | 2 rms error, um | largest | of its U | planned / 2 rms |"
    )
    print("|---|---|---|---|---|---|---|")
    ratios = {}
    for e in found.expected:
        if e.U is None or (e.name, e.where) not in told:
            continue
        errors, inspected = np.array(told[e.name, e.where]).T
        twice, U = 2000 * _root_mean_square(errors), 1000 * _root_mean_square(inspected[inspected < LOST])
        ratios[f"{e.name} {e.where}".strip()] = ratio = 1000 * e.U / twice
        um = f"{1000 * e.U:.2f} | {U:.2f} | {twice:.2f} | {1000 * np.abs(errors).max():.2f}"
        print(f"| {e.name} {e.where} | {um} | {np.abs(errors / inspected).max():.2f} | {ratio:.2f} |", flush=True)
    lost = ", ".join(f"{number} {kind}" for kind, number in refused.items())
    print(f"{options.stands} stands, {lost}; ratio {min(ratios.values()):.2f} to {max(ratios.values()):.2f}")
    if options.json:
        with open(options.json, "w") as file:  # noqa: PTH123
            json.dump(ratios, file, indent=2)


if __name__ == "__main__":
    main()
