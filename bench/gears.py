"""Random gears on random stands: how far each figure is off its truth, with our calibration and with the true one.

    python bench/gears.py --gears 20 --helix-deg 15 --upright
    python bench/gears.py --gears 5 --outliers 0.2 --dropouts 0.1
    python bench/gears.py --dents 32

The truth comes from the virtual stand, which shares no code with the inspection.
"""

import argparse
import sys
import time
from dataclasses import dataclass, field, replace
from math import radians

import numpy as np

from truestand.apply.transfer import transfer
from truestand.calibration.calibrate import calibrate
from truestand.core.calibration import Calibration
from truestand.core.frames import Pose
from truestand.core.inspection import Defect, Inspection
from truestand.core.scan import interpret
from truestand.core.surface import apply_calibration
from truestand.gear.drawing import Gear
from truestand.gear.inspect import inspect_gear
from truestand.sim import (
    Dent,
    FlankErrors,
    GearErrors,
    Simulated,
    VirtualGear,
    paper_shaft,
    paper_simulation,
    paper_stand,
    simulate,
    truth_record,
)

FLANKS = ("left", "right")
MOUNTED = {"standoff": 104.0, "height": 14.0, "plane_offset": 0.15}
"""Gear and shaft in view, at the paper's angle."""
UPRIGHT = {"phi": radians(-70.0), "standoff": 105.0, "height": 2.0, "plane_offset": 0.15}
"""Seen more squarely: both flanks of a helical gear are in view."""


@dataclass
class Study:
    """Errors (um) and U (um) of each figure, by name and calibration."""

    errors: dict[str, list[float]] = field(default_factory=dict)
    inside: dict[str, list[bool]] = field(default_factory=dict)

    def add(self, name: str, value: float | None, true: float | None, U: float | None) -> None:
        if value is None or true is None:
            return
        self.errors.setdefault(name, []).append(1000 * value - true)
        if U is not None:
            self.inside.setdefault(name, []).append(abs(1000 * value - true) <= 1000 * U)

    def table(self) -> str:
        lines = ["| figure | gears | median, um | worst, um | inside U |", "|---|---|---|---|---|"]
        for name, errors in self.errors.items():
            size = np.abs(errors)
            inside = f"{100 * np.mean(self.inside[name]):.0f} %" if name in self.inside else ""
            lines.append(f"| {name} | {len(size)} | {np.median(size):.3f} | {size.max():.3f} | {inside} |")
        return "\n".join(lines)


def gear_of(helix: float) -> Gear:
    tip = 52.0 if not helix else 2 * (24 / np.cos(helix)) + 4.0
    return Gear(24, 2.0, 20.0, 5.0, float(tip), float(tip) - 9.0, helix_angle=helix, accuracy_class=7)


def errors_of(rng: np.random.Generator, dents: tuple[Dent, ...] = ()) -> GearErrors:
    """Of a gear about class 7."""
    left, right = (FlankErrors(float(rng.normal(0, 0.004)), float(rng.normal(0, 0.004))) for _ in range(2))
    return GearErrors(
        phase=radians(float(rng.uniform(0, 15))),
        pitch_left=tuple(rng.normal(0, 0.005, 24)),
        pitch_right=tuple(rng.normal(0, 0.005, 24)),
        eccentricity=float(rng.uniform(0, 0.01)),
        eccentricity_direction=float(rng.uniform(-np.pi, np.pi)),
        thickness=float(rng.normal(-0.03, 0.01)),
        left=left,
        right=right,
        profile_crowning=float(rng.uniform(0, 0.004)),
        helix_crowning=float(rng.uniform(0, 0.006)),
        dents=dents,
    )


def stand_of(rng: np.random.Generator, args: argparse.Namespace):
    base = paper_simulation()
    where, tilt = UPRIGHT if args.upright else MOUNTED, radians(float(rng.uniform(-0.2, 0.2)))
    return paper_stand(), replace(
        base,
        mounting=replace(base.mounting, **where, plane_tilt=tilt),
        running=replace(
            base.running, eccentricity=0.88, eccentricity_direction=float(rng.uniform(-np.pi, np.pi)),
            tilt=float(rng.uniform(0, 0.001)), tilt_direction=float(rng.uniform(-np.pi, np.pi)),
        ),
        workpiece=replace(base.workpiece, form=()),
        optics=replace(base.optics, noise=0.005, fan=radians(32.0 if args.upright else 20.0)),
        acquisition=replace(base.acquisition, profiles=args.profiles, columns=tuple(args.columns)),
    )  # fmt: skip


def true_calibration(simulated: Simulated, ours: Calibration) -> Calibration:
    truth = simulated.truth
    return replace(
        ours,
        table_from_sensor=Pose.from_matrix(truth.table_from_sensor),
        shaft_from_rotor=Pose.from_matrix(truth.shaft_from_rotor),
        speed_factor=1.0,
    )


def compare(study: Study, found: Inspection, part: dict, by: str) -> None:
    for c in found.characteristics:
        if c.tooth is not None:
            continue
        true = truth_of(part, c.name, c.flank, c.value if c.size else None)
        if true is not None:
            study.add(f"{c.name} {by}", c.value, true, c.U)


def truth_of(part: dict, name: str, flank: str | None, value: float | None) -> float | None:
    if name in ("F_p", "f_p"):
        return part[f"{name}_{flank}_um"]
    if name == "F_r":
        return part["F_r_um"]
    if name == "f_Halpha":
        return part["profile"][f"f_Halpha_{flank}_um"]
    if name == "f_Hbeta":
        return part["helix"][f"f_Hbeta_{flank}_um"]
    if name == "s":
        d = part["measuring_diameter_mm"]
        return 1000 * part["nominal_thickness_mm"] + part["thickness_um"] if d else None
    return None


def random_gears(args: argparse.Namespace) -> Study:
    study = Study()
    for seed in range(args.seed, args.seed + args.gears):
        rng = np.random.default_rng(seed)
        gear = gear_of(radians(args.helix_deg))
        errors = errors_of(rng)
        stand, simulation = stand_of(rng, args)
        shaft = simulate(stand, simulation, paper_shaft(), 10 * seed + 1)
        calibration = calibrate(interpret(shaft.recording, stand), paper_shaft())
        rough = replace(
            simulation,
            optics=replace(simulation.optics, outliers=args.outliers, dropouts=args.dropouts),
            acquisition=replace(
                simulation.acquisition, start_angle=radians(args.start_deg), ripple=args.ripple,
                ripple_per_turn=args.ripple_per_turn,
            ),
        )  # fmt: skip
        started = replace(stand, table=replace(stand.table, start="unknown")) if args.start_deg else stand
        scan = interpret(
            simulate(stand, rough, paper_shaft(), 10 * seed + 2, None, VirtualGear(gear, errors)).recording, started
        )
        simulated = simulate(
            stand,
            replace(rough, acquisition=replace(rough.acquisition, profiles=2)),
            paper_shaft(),
            0,
            None,
            VirtualGear(gear, errors),
        )
        part = truth_record(simulated.truth)["part"]
        part["nominal_thickness_mm"] = nominal_thickness(gear)
        begun = time.process_time()
        for by, used in (("ours", calibration), ("true", true_calibration(shaft, calibration))):
            tied = transfer(scan, used)
            found = inspect_gear(apply_calibration(tied.scan, tied.calibration), gear)
            compare(study, found, part, by)
        published = 1000 * found.published.get("F_p left", np.nan)
        seconds = time.process_time() - begun
        told = f"{found.verdict}, {len(found.defects)} defects, published F_p {published:.0f} um"
        print(f"{seed}: {seconds:.1f} s, {told}, {tied.calibration.reasons}", file=sys.stderr)
    return study


def nominal_thickness(gear: Gear) -> float:
    """Transverse, at the reference circle (no profile shift here)."""
    return float(gear.module * np.pi / 2 / np.cos(gear.helix_angle))


def dents(args: argparse.Namespace) -> str:
    """Dents of 4 to 100 um and 0.3 to 1 mm, one a tooth, on both flanks: found, and false alarms."""
    rng = np.random.default_rng(args.seed)
    gear, lines = gear_of(0.0), ["| depth, um | radius, mm | found |", "|---|---|---|"]
    placed = []
    for i in range(args.dents):
        flank = FLANKS[i % 2]
        tooth = 1 + (i // 2) % 24
        placed.append(
            Dent(tooth, flank, float(rng.uniform(6.0, 11.0)), float(rng.uniform(8.0, 22.0)),  # type: ignore[arg-type]
                 float(rng.uniform(*args.radius)), float(np.exp(rng.uniform(*np.log(args.depth)))) / 1000)
        )  # fmt: skip
    stand, simulation = stand_of(rng, args)
    shaft = simulate(stand, simulation, paper_shaft(), 1)
    calibration = calibrate(interpret(shaft.recording, stand), paper_shaft())
    errors = errors_of(rng, tuple(placed))
    scan = interpret(simulate(stand, simulation, paper_shaft(), 2, None, VirtualGear(gear, errors)).recording, stand)
    tied = transfer(scan, calibration)
    found = inspect_gear(apply_calibration(tied.scan, tied.calibration), gear)
    left = list(found.defects)
    for dent in sorted(placed, key=lambda d: -d.depth):
        hit = next((d for d in left if _is(d, dent)), None)
        if hit is not None:
            left.remove(hit)
        told = (
            "no" if hit is None else f"yes, {1000 * (hit.depth or 0):.0f} um, score {hit.score:.0f}, {hit.second_score}"
        )
        lines.append(f"| {1000 * dent.depth:.0f} | {dent.radius:.2f} | {told} |")
    return "\n".join([*lines, "", f"false alarms: {len(left)}", *(str(d) for d in left)])


def _is(found: Defect, dent: Dent) -> bool:
    if found.height is None or found.roll_length is None:
        return False
    same = found.tooth == dent.tooth and found.flank == dent.flank
    return same and abs(found.height - dent.height) < 1.0 and abs(found.roll_length - dent.roll_length) < 1.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gears", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--helix-deg", type=float, default=0.0)
    parser.add_argument("--upright", action="store_true", help="sensor at 70 degrees to the axis")
    parser.add_argument("--profiles", type=int, default=11000)
    parser.add_argument("--columns", nargs="*", default=[])
    parser.add_argument("--outliers", type=float, default=0.0)
    parser.add_argument("--dropouts", type=float, default=0.0)
    parser.add_argument("--start-deg", type=float, default=0.0)
    parser.add_argument("--ripple", type=float, default=0.0)
    parser.add_argument("--ripple-per-turn", type=int, default=1)
    parser.add_argument("--dents", type=int, default=0)
    parser.add_argument("--depth", type=float, nargs=2, default=(4.0, 100.0))
    parser.add_argument("--radius", type=float, nargs=2, default=(0.3, 1.0))
    args = parser.parse_args()
    print(dents(args) if args.dents else random_gears(args).table())


if __name__ == "__main__":
    main()
