"""Random gears with random damage: is what is decided right, and is what is measured inside U?

    python bench/damaged_gears.py --gears 300
    python bench/damaged_gears.py --gears 20 --first 40 --list
    python bench/damaged_gears.py --every 1 --kinds scratch --flanks 2

Every third tooth (each: ``--every 1``) may carry damage: a groove across the face, along the profile or aslant, a dent,
a worn band, material on top, a crater; some carry what looks like material and is none (a second reflection). True
figures come from the virtual stand's surface, which shares no code with the inspection.
"""

import argparse
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache, partial
from math import cos, log, radians

import numpy as np

from truestand.apply.transfer import roll
from truestand.calibration.calibrate import calibrate
from truestand.core.inspection import Characteristic
from truestand.core.scan import Scan, interpret
from truestand.gear.drawing import Gear
from truestand.gear.geometry import involute
from truestand.gear.inspect import inspect_gear
from truestand.sim import (
    Dent,
    FlankErrors,
    GearErrors,
    Scratch,
    Simulation,
    VirtualGear,
    paper_shaft,
    paper_simulation,
    paper_stand,
    simulate,
)
from truestand.sim.gear_errors import Worn
from truestand.sim.gear_truth import gear_figures

POINTS, PROFILES, LONG = 320, 4400, 11000
"""Readings of a profile, and profiles: 1.1 turns, and the paper's 2.75 of one scan in four."""
KINDS = ("none", "across", "along", "dent", "wear", "on top", "crater", "reflection", "scratch")
INCIDENCE_U = 0.005
Damage = Dent | Worn | Scratch


@dataclass
class Count:
    """Lines by what became of them."""

    lines: int = 0
    inside: int = 0
    beyond_1_5: int = 0
    beyond_3: int = 0
    decided: int = 0
    near_limit: int = 0
    wrong_near: int = 0
    wrong_far: int = 0
    must_fail: int = 0
    failed: int = 0
    notes: list[str] = field(default_factory=list)


def gear_of(rng: np.random.Generator) -> Gear:
    helix = radians(float(rng.choice([0.0, 0.0, 15.0, 20.0, -25.0])))
    teeth = int(rng.integers(20, 29))
    reference = 2.0 * teeth / cos(helix)
    return Gear(teeth, 2.0, 20.0, 5.0, reference + 4.0, reference - 5.0, helix_angle=helix, accuracy_class=10)


def damage_of(kind: str, tooth: int, flank: str, gear: Gear, rng: np.random.Generator) -> tuple[Damage, ...]:
    nominal = involute(gear)
    low, high = nominal.profile_range
    bottom, top = nominal.helix_range
    depth = float(np.exp(rng.uniform(log(0.005), log(0.1))))
    if kind == "across":
        width, start = float(rng.uniform(0.6, 3.0)), float(rng.uniform(low, high - 0.5))
        return (Worn(tooth, flank, (start, start + width), (gear.face_from - 1, gear.face_to + 1), depth, 0.1),)
    if kind == "along":
        width, start = float(rng.uniform(0.6, 4.0)), float(rng.uniform(bottom, top - 0.5))
        return (Worn(tooth, flank, (0.0, 40.0), (start, start + width), depth, 0.1),)
    if kind == "dent":
        place = float(rng.uniform(low, high - 0.5)), float(rng.uniform(bottom, top))
        return (Dent(tooth, flank, *place, float(rng.uniform(0.4, 2.0)), depth),)
    if kind == "scratch":
        places = [(float(rng.uniform(low, high)), float(rng.uniform(bottom, top))) for _ in range(2)]
        return (Scratch(tooth, flank, *places, float(rng.uniform(0.6, 1.6)), depth),)
    if kind == "wear":
        start, width = float(rng.uniform(low, high - 2)), float(rng.uniform(2.0, 4.0))
        rolls = (start, start + width)
        return (Worn(tooth, flank, rolls, (gear.face_from - 1, gear.face_to + 1), min(depth, 0.05), width / 2),)
    rolls = _stretch(low - 0.5, high, 1.0, 3.0, rng)
    heights = _stretch(bottom, top, 1.5, 8.0, rng)
    if kind == "crater":
        return (Worn(tooth, flank, rolls, heights, float(rng.uniform(0.1, 0.6)), 0.2),)
    return (Worn(tooth, flank, rolls, heights, -float(rng.uniform(0.01, 0.15)), 0.15),)


def _stretch(low: float, high: float, least: float, most: float, rng: np.random.Generator) -> tuple[float, float]:
    start = float(rng.uniform(low, high - least))
    return start, start + float(rng.uniform(least, most))


def errors_of(gear: Gear, rng: np.random.Generator) -> GearErrors:
    """Of a gear about class 8."""
    left, right = (FlankErrors(float(rng.normal(0, 0.005)), float(rng.normal(0, 0.005))) for _ in range(2))
    return GearErrors(
        phase=radians(float(rng.uniform(1, 12))),
        pitch_left=tuple(rng.normal(0, 0.005, gear.teeth)),
        pitch_right=tuple(rng.normal(0, 0.005, gear.teeth)),
        thickness=float(rng.normal(-0.03, 0.01)),
        left=left,
        right=right,
        profile_crowning=float(rng.uniform(0, 0.006)),
        helix_crowning=float(rng.uniform(0, 0.006)),
    )


def simulation_of(upright: bool, profiles: int, speckle: float) -> Simulation:
    """The stand; ``upright``: its sensor looks at the axis at 70 degrees, as helical gears need it."""
    base = paper_simulation()
    where = (
        {"phi": radians(-70.0), "standoff": 105.0, "height": 2.0} if upright else {"standoff": 104.0, "height": 14.0}
    )
    return replace(
        base,
        mounting=replace(base.mounting, plane_offset=0.15, plane_tilt=radians(0.1), **where),
        running=replace(base.running, eccentricity=0.88, tilt=0.0004, tilt_direction=radians(110.0)),
        workpiece=replace(base.workpiece, form=()),
        optics=replace(base.optics, noise=0.005, fan=radians(32.0 if upright else 20.0), speckle=speckle),
        acquisition=replace(base.acquisition, profiles=profiles, columns=("angle",)),
    )


def stand_of():
    base = paper_stand()
    sensor = replace(base.sensor, points=POINTS, incidence_U=INCIDENCE_U)
    return replace(base, sensors=(sensor,), table=replace(base.table, angle_U=1e-5))


@cache
def calibrated(upright: bool):
    shaft = simulate(stand_of(), simulation_of(upright, 5500, 0.0), paper_shaft(), 1)
    return replace(calibrate(interpret(shaft.recording, stand_of()), paper_shaft()), reasons=())


def scan_of(gear: Gear, errors: GearErrors, simulation: Simulation, seed: int) -> Scan:
    return interpret(
        simulate(stand_of(), simulation, paper_shaft(), seed, None, VirtualGear(gear, errors)).recording, stand_of()
    )


def judge(count: Count, c: Characteristic, true: float, label: str) -> None:
    """Enter one line: ``true`` (mm)."""
    count.lines += 1
    if c.value is None or c.U is None or c.limits is None or c.verdict is None:
        return
    low, high = -1e9 if c.limits[0] is None else c.limits[0], c.limits[1] or 0.0
    beyond = max(true - high, low - true)  # > 0: does not conform
    if beyond > 2 * c.U:
        count.must_fail += 1
        count.failed += c.verdict == "does_not_conform"
        if c.verdict != "does_not_conform":
            count.notes.append(
                f"{label}: {c.verdict} {c.name} {c.flank} {c.tooth} but true {1000 * true:.1f}; {c.reason}"
            )
    near = abs(beyond) <= c.U
    count.near_limit += near
    if c.verdict == "undecided":
        return
    count.decided += 1
    off = abs(c.value - true)
    count.inside += off <= c.U
    count.beyond_1_5 += off > 1.5 * c.U
    count.beyond_3 += off > 3 * c.U
    wrong = (c.verdict == "conforms") != (beyond <= 0)
    count.wrong_near += wrong and near
    count.wrong_far += wrong and not near
    if wrong or off > 1.5 * c.U:
        kind = "wrong" if wrong else "outside"
        count.notes.append(
            f"{label}: {kind} {c.name} {c.flank} {c.tooth}: {1000 * c.value:.1f} +- {1000 * c.U:.1f}, true "
            f"{1000 * true:.1f}, limit {1000 * high:.0f}, {c.verdict}; {c.reason}"
        )


def one_gear(
    seed: int, narrowest: float | None, every: int, among: tuple[str, ...], flanks: int
) -> tuple[str, str, Count, float]:
    rng = np.random.default_rng(seed)
    gear = gear_of(rng)
    gear = replace(gear, evaluation=replace(gear.evaluation, narrowest_damage=narrowest))
    errors, kinds, apparent = errors_of(gear, rng), [], []
    damage: list[Damage] = []
    for tooth in range(2 if every > 1 else 1, gear.teeth + (every == 1), every):
        for flank in rng.permutation(["left", "right"])[:flanks]:
            kind = str(rng.choice(among))
            kinds.append(kind)
            if kind != "none":
                (apparent if kind == "reflection" else damage).extend(damage_of(kind, tooth, flank, gear, rng))
    speckle = float(rng.choice([0.0, 0.0, 0.005, 0.01, 0.02]))
    profiles = int(rng.choice([PROFILES, PROFILES, PROFILES, LONG]))
    simulation = simulation_of(bool(gear.helix_angle), profiles, speckle)
    real = _with(errors, damage)
    true = gear_figures(VirtualGear(gear, real), paper_shaft(), simulation.workpiece)
    begun = time.process_time()
    scan, calibration = scan_of(gear, _with(real, apparent), simulation, seed), calibrated(bool(gear.helix_angle))
    found = inspect_gear(roll(scan, calibration), gear)
    seconds = time.process_time() - begun
    count = Count()
    for c in found.characteristics:
        key = (c.name, c.flank or "", c.tooth)
        if key in true:
            judge(count, c, true[key], f"seed {seed}, z {gear.teeth}, speckle {1000 * speckle:.0f}")
    return f"{Counter(kinds)}", found.verdict, count, seconds


def _with(errors: GearErrors, damage: list[Damage]) -> GearErrors:
    dents, worn, scratches = (tuple(d for d in damage if isinstance(d, kind)) for kind in (Dent, Worn, Scratch))
    return replace(
        errors,
        dents=(*errors.dents, *dents), worn=(*errors.worn, *worn), scratches=(*errors.scratches, *scratches),
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gears", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--narrowest", type=float, help="mm: damage that must not escape (narrowest_damage_mm)")
    parser.add_argument("--every", type=int, default=3, help="teeth of which one may be damaged")
    parser.add_argument("--flanks", type=int, default=1, help="of such a tooth")
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--list", action="store_true", help="list each line that is wrong or outside 1.5 U")
    args = parser.parse_args()
    total, verdicts = Count(), Counter()
    options = {"narrowest": args.narrowest, "every": args.every, "among": tuple(args.kinds), "flanks": args.flanks}
    work = partial(one_gear, **options)
    with ProcessPoolExecutor(args.workers) as pool:
        seeds = range(args.first, args.first + args.gears)
        for kinds, verdict, count, seconds in pool.map(work, seeds):
            verdicts[verdict] += 1
            for name in Count.__dataclass_fields__:
                setattr(total, name, getattr(total, name) + getattr(count, name))
            print(f"{verdict}, {seconds:.1f} s, {kinds}", file=sys.stderr)
            if args.list:
                print("\n".join(count.notes), flush=True)
    t = total
    print(
        f"{args.gears} gears, verdicts {dict(verdicts)}; {t.lines} lines, {t.decided / t.lines:.1%} decided\n"
        f"decided: inside U {t.inside / max(t.decided, 1):.2%}, beyond 1.5 U {t.beyond_1_5 / max(t.decided, 1):.2%}, "
        f"beyond 3 U {t.beyond_3}\n"
        f"wrong and decided: {t.wrong_near} of {t.near_limit} lines within U of the limit, {t.wrong_far} farther out\n"
        f"beyond the limit by more than 2 U: {t.failed} of {t.must_fail} do not conform"
    )


if __name__ == "__main__":
    main()
