"""The inspection of a gear, from the rolled-up scan to characteristics with their uncertainty and verdict."""

from dataclasses import dataclass, replace
from math import cos, degrees

import numpy as np
from numpy.typing import NDArray

from truestand.apply.datum import Datum, datum_of
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe, NotEnoughData, WrongDrawing
from truestand.core.inspection import Inspection
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration
from truestand.gear.angle import Steadied, steadied
from truestand.gear.budget import expanded, influences_of, radial_lines
from truestand.gear.characteristics import Told, characteristics_of, settings_of
from truestand.gear.coverage import FINE, Coverage, coverage_of, profiles_for, step_on_flank
from truestand.gear.damage import Damage, damage_of, zones_of
from truestand.gear.defects import chipped_flanks, find_defects
from truestand.gear.diagnosis import diagnosis
from truestand.gear.drawing import Gear
from truestand.gear.evaluate import Measures, Weighed, evaluate, pitch_extremes, weigh
from truestand.gear.evidence import GearEvidence
from truestand.gear.figures import corrected, figures_of, noise_of
from truestand.gear.flanks import Flanks, find_flanks
from truestand.gear.fold import fold, tip_and_root
from truestand.gear.geometry import FLANKS, Involute, involute, pitch_span
from truestand.gear.grid import Grid, grid_of
from truestand.gear.match import check_drawing

Array = NDArray[np.float64]

SHORT = 0.6
"""mm by which the flanks seen may end before the drawing's face does without a word."""
MOST_TOLD = 12
"""Regions left out that the remarks name."""
PUBLISHED_THIN = 8
"""Every so many points of a profile go through the published compensation, for comparison."""


@dataclass(frozen=True, slots=True)
class Read:
    """The flanks as they were read."""

    flanks: Flanks
    grid: Grid
    weighed: Weighed
    measures: Measures


def inspect_gear(surface: Surface, gear: Gear) -> Inspection:
    """Pitch, run-out, thickness, profile, helix and defects of a rolled-up gear.

    Raises:
        NotEnoughData: nothing of the toothing is in view.
        WrongDrawing: what was seen is another gear than the drawing's.
        BadRecipe: the surface doesn't say from which scan and calibration it comes.
    """
    scan, calibration = origin_of(surface)
    nominal, datum = involute(gear), datum_of(calibration, gear.datum, gear.bore_clearance)
    flanks = find_flanks(surface, nominal, datum.pose)
    reasons = _reasons(calibration)
    try:
        check_drawing(surface, nominal, datum.pose, flanks)
    except WrongDrawing as wrong:
        if not reasons:  # off its axis, every gear looks like another one
            raise
        reasons = (*reasons, str(wrong))
    if not flanks.delta.size:
        raise NotEnoughData("found no readings on the flanks; check face_from_mm and where the sensor looks")
    steady = steadied(surface, flanks, scan, calibration, nominal, datum.pose)
    surface, flanks, scan, calibration = steady.surface, steady.flanks, steady.scan, steady.calibration
    read = read_flanks(flanks, nominal)
    coverage = coverage_of(read.grid, nominal, scan.step)
    folded = fold(surface, nominal, datum.pose, flanks.turned)
    told = _told(read, scan, calibration, nominal, datum, coverage, steady.was or 0.0)
    published = _published(flanks, scan, calibration, nominal)
    defects, defect_map = find_defects(flanks, folded, coverage, nominal, read.grid.scatter)
    evidence = GearEvidence(
        nominal, flanks.turned, read.grid, read.measures, read.weighed.rolls.reshape(2, gear.teeth, -1), coverage,
        folded, defect_map, published,
    )  # fmt: skip
    return Inspection(
        kind="gear",
        name=gear.name,
        characteristics=characteristics_of(told, nominal, tip_and_root(folded, nominal, radial_lines(told.influences))),
        defects=(*defects, *chipped_flanks(told.damage, defects)),
        reasons=(*reasons, *_unevenness(steady)),
        remarks=(
            *_remarks(coverage, scan, calibration, nominal),
            *_of_damage(told.damage),
            *_of_face(flanks, nominal),
            *_of_angle(steady),
            *diagnosis(read.measures, nominal),
        ),
        settings=settings_of(nominal, datum, scan),
        defect_depth=gear.defect_depth,
        deviation=_deviation(flanks, surface, nominal),
        evidence=evidence,
        published=_published_figures(published, nominal),
    )


def origin_of(surface: Surface) -> tuple[Scan, Calibration]:
    """The scan that was rolled up and the calibration that did it.

    Raises:
        BadRecipe: the surface carries none.
    """
    if surface.scan is None or surface.calibration is None:
        raise BadRecipe("found a surface without its scan and calibration, need one that `roll` made")
    return surface.scan, surface.calibration


def read_flanks(flanks: Flanks, nominal: Involute) -> Read:
    """Cells, weights and measures of flank points."""
    grid = grid_of(flanks, nominal)
    weighed = weigh(grid, nominal)
    return Read(flanks, grid, weighed, evaluate(grid.delta, weighed, grid, nominal))


def _told(
    read: Read, scan: Scan, calibration: Calibration, nominal: Involute, datum: Datum, coverage: Coverage, uneven: float
) -> Told:
    """The figures, freed of what noise lifts them by, with every line of their doubt."""
    noisier, noise = noise_of(read.measures, read.weighed, read.grid, nominal)
    base = figures_of(read.measures, nominal)
    influences = influences_of(scan, calibration, read.grid, nominal, datum, read.flanks.turned, uneven)
    joined = expanded(influences, read.measures, read.weighed, read.grid, nominal)
    return Told(
        corrected(base, noisier), joined | {"noise": noise}, influences, coverage,
        damage_of(read.flanks, read.grid, read.weighed, nominal, scan.step),
        zones_of(read.grid, nominal, scan.step), read.measures.runout_per_delta,
    )  # fmt: skip


def _deviation(flanks: Flanks, surface: Surface, nominal: Involute) -> Array:
    deviation = np.full(surface.x.size, np.nan)
    deviation[flanks.index] = flanks.delta * cos(nominal.base_helix)
    return deviation.reshape(surface.x.shape)


def _published(flanks: Flanks, scan: Scan, calibration: Calibration, nominal: Involute) -> Array:
    """Tooth positions F_i (2, teeth) as the published compensation would have them: the same readings, known to be on
    these flanks, through its chain.
    """
    row, column = np.divmod(flanks.index, scan.x.shape[1])
    some = column % PUBLISHED_THIN == 0
    few = replace(scan, x=scan.x[:, ::PUBLISHED_THIN], z=scan.z[:, ::PUBLISHED_THIN], intensity=None)
    surface = apply_calibration(few, replace(calibration, method="paper"))
    at = row[some], column[some] // PUBLISHED_THIN
    x, y, height, which = surface.x[at], surface.y[at], surface.z[at], flanks.which[some]
    radius = np.hypot(x, y)
    centre = flanks.turned + which % nominal.gear.teeth * nominal.gear.pitch + (height - nominal.middle) * nominal.twist
    off = np.angle(np.exp(1j * (np.arctan2(y, x) - centre)))
    side = np.where(which < nominal.gear.teeth, 1.0, -1.0)
    delta = nominal.base_radius * (side * off - nominal.half_angle(radius))
    rolls = np.sqrt(np.maximum(radius**2 - nominal.base_radius**2, 0.0))
    moved = Flanks(delta, rolls, height, which, flanks.profile[some], flanks.index[some], flanks.turned)
    return read_flanks(moved, nominal).measures.index


def _published_figures(index: Array, nominal: Involute) -> dict[str, float]:
    found = pitch_extremes(index, pitch_span(nominal.gear))
    return {
        f"{name} {flank}": float(values[side])
        for name, values in found.items()
        for side, flank in enumerate(FLANKS)
        if np.isfinite(values[side])
    }


def _reasons(calibration: Calibration) -> tuple[str, ...]:
    if calibration.method == "paper":
        return (*calibration.reasons, "the calibration is of the published method, which moves no axis: calibrate with "
                "--method stand",)  # fmt: skip
    return calibration.reasons


def _remarks(coverage: Coverage, scan: Scan, calibration: Calibration, nominal: Involute) -> tuple[str, ...]:
    found = []
    if not coverage.position.any():
        found.append(
            "hardly any of the flanks was seen near the middle of the face: check face_from_mm, the sensor's height "
            "and its fan"
        )
    for side, flank in enumerate(FLANKS):
        if not coverage.position[side].any() and coverage.position.any():
            found.append(
                f"the {flank} flanks were not seen: the camera looks from the other side; scan once more with the "
                "sensor or the gear turned over, or with a second sensor"
            )
    if nominal.gear.accuracy_class is None and not nominal.gear.limits:
        found.append("no line has a limit: measured, not judged; add accuracy_class to the recipe")
    coarse = float(step_on_flank(nominal, nominal.control_roll, scan.step))
    if coarse > 4 * FINE:
        enough = profiles_for(nominal, max(nominal.control_roll, 3.0))
        found.append(
            f"coarse near the root: one profile a {coarse:.1f} mm of roll length at its lower end; {enough} profiles a "
            f"turn would make it {FINE:g} mm from 3 mm up"
        )
    if calibration.covariance.shape[0] < 8:
        found.append("the calibration record carries no covariance: it is taken as exact, and U leaves its part out")
    if abs(degrees(nominal.gear.helix_angle)) > 0 and scan.revolutions < 1:
        found.append("less than a turn: teeth at the ends of the scan are seen in part")
    return tuple(found)


def _unevenness(steady: Steadied) -> tuple[str, ...]:
    if steady.left is None or not steady.uneven:
        return ()
    apart = steady.left if steady.explained else steady.was
    return (
        f"the table turned unevenly: passes of one flank are {1000 * (apart or 0.0):.1f} um (rms) apart, pitch may be "
        "wrong by as much and more: record the table's angle, or turn it steadily",
    )


def _of_face(flanks: Flanks, nominal: Involute) -> tuple[str, ...]:
    g = nominal.gear
    if not flanks.height.size:
        return ()
    bottom, top = float(flanks.height.min()), float(flanks.height.max())
    if bottom - g.face_from < SHORT and g.face_to - top < SHORT:
        return ()
    return (
        f"flanks were seen from height {bottom:.1f} to {top:.1f} mm, the drawing's face is {g.face_from:g} to "
        f"{g.face_to:g} mm: check face_from_mm and face_width_mm, or part of it is out of view",
    )


def _of_damage(damage: tuple[Damage, ...]) -> tuple[str, ...]:
    """What the figures leave out: the deepest and what nobody saw first."""
    gravest = sorted(damage, key=lambda d: -1e9 if d.depth is None else -abs(d.depth))
    more = (f"{len(damage) - MOST_TOLD} more regions of flanks are left out",) if len(damage) > MOST_TOLD else ()
    return (*(f"left out of the flank's figures: {d.text}" for d in gravest[:MOST_TOLD]), *more)


def _of_angle(steady: Steadied) -> tuple[str, ...]:
    scan, was, left = steady.scan, steady.was, steady.left
    if scan.angle_source in ("angle", "encoder"):
        return ()
    what = "the angle comes from a steady speed"
    if was is not None and left is not None and left < was:
        what += f"; {scan.revolutions:.2f} turns freed it of {1000 * was:.1f} um (rms) that don't repeat every turn"
    elif scan.revolutions < 2:
        what += "; two turns and more would tell it from uneven turning"
    return (f"{what}; what repeats every turn looks like pitch and stands in U: an encoder would settle it",)
