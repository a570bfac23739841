"""The inspection of a gear, from the rolled-up scan to characteristics with their uncertainty and verdict."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, hypot

import numpy as np

from truestand.apply.datum import Datum, datum_of
from truestand.core.arrays import Array
from truestand.core.calibration import Calibration
from truestand.core.errors import NotEnoughData, WrongDrawing
from truestand.core.frames import UNKNOWNS
from truestand.core.inspection import Inspection, Seam, contradictions
from truestand.core.message import Message
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration, each_of, stacked
from truestand.gear.angle import with_correct_angles
from truestand.gear.assess import assess
from truestand.gear.blind import blind_of_helices
from truestand.gear.broken_edges import broken_edges
from truestand.gear.budget import influences_of, radial_lines, weighed
from truestand.gear.characteristics import characteristics_of, settings_of, without_damage_of
from truestand.gear.coverage import Coverage, coverage_of
from truestand.gear.damage import (
    damage_of,
    unseen_in_traces,
    with_deep_damage,
    with_unread,
    zones_of,
)
from truestand.gear.defects import DefectMap, chipped_flanks, find_defects, held_against
from truestand.gear.disagreement import slopes_known
from truestand.gear.drawing import Gear
from truestand.gear.ends import unseen_at_ends
from truestand.gear.evaluate import (
    Evaluator,
    Measures,
    evaluate,
    evaluator_of,
    pitch_extremes,
)
from truestand.gear.face import other_diameters, other_face
from truestand.gear.flanks import Flanks, find_toothing
from truestand.gear.geometry import FLANKS, SIGMA, Involute, involute, pitch_span
from truestand.gear.grid import Grid, grid_of
from truestand.gear.levels import left_between, levelled
from truestand.gear.match import check_drawing
from truestand.gear.rays import rays_of_views
from truestand.gear.remarks import contradicting_turns, remarks_of, unevenness
from truestand.gear.seams import tied, tied_roughly
from truestand.gear.smooth_flanks import areal_positions, smooth_flanks, smooth_surface
from truestand.gear.teeth import FoldedMap, below_tips, fold, other_teeth, teeth_there, tip_and_root
from truestand.gear.views import GearView, each_by_one_side, joined, views_of, with_views

PUBLISHED_THIN = 8
"""Every so many points of a profile go through the published compensation, for comparison."""


@dataclass(frozen=True, slots=True)
class GearEvidence:
    """What a gear's report draws: everything that the figures were read from. It is no part of the record.

    Arrays are (2 flanks, teeth, ...), left first; mm.
    """

    nominal: Involute
    first_tooth: float
    """Polar angle (rad, about the datum axis) of the centre of tooth 1 at the middle of the face."""
    grid: Grid
    measures: Measures
    coverage: Coverage
    folded: FoldedMap | None = None
    defect_map: DefectMap | None = None
    published_index: Array | None = None
    """F_i (2, teeth) after the published compensation."""


def inspect_gear(
    surface: Surface | Sequence[Surface], gear: Gear, sides_tied: bool = True, datum: Datum | None = None
) -> Inspection:
    """Pitch, run-out, thickness, profile, helix and defects of a rolled-up gear, by one view of it or by several in one
    frame (``roll_views``).

    ``sides_tied``: whether left and right flanks are as far apart as they are seen: not where they were seen before
    and after the part was turned over (``clampings``). ``datum``: the axis to judge by, where it is not as drawn.

    Raises:
        NotEnoughData: nothing of the toothing is in view.
        WrongDrawing: what was seen is another gear than the drawing's.
        BadRecipe: a surface doesn't say from which scan and calibration it comes.
    """
    surfaces = each_of(surface)
    nominal, datum = involute(gear), datum or datum_of(surfaces[0].origin[1], gear.datum, gear.bore_clearance)
    surfaces, seams = tied_roughly(surfaces, nominal, datum)
    whole = stacked(surfaces)
    views = views_of(surfaces, find_toothing(surfaces, nominal, datum))
    views = views if sides_tied else each_by_one_side(views)
    reasons = _reasons(whole, views, seams)
    views = tuple(view.with_lone_readings() for view in with_correct_angles(views))
    views, seams = (views, seams) if seams else tied(views)
    views, apart = levelled(views)
    seen, step = [view.borne_out() for view in views], max((v.scan.step for v in views), key=abs)
    flanks = joined(seen, views)
    folded, grid = fold([view.surface for view in views], flanks.toothing), grid_of(flanks)
    flanks = joined(_below_own_tips(seen, views, folded, grid.scatter), views)
    complete = with_deep_damage(flanks, grid)
    evaluator, measures = evaluate_flanks(complete, step)
    there = teeth_there(folded, nominal)
    smooth = smooth_surface(evaluator.grid.delta, evaluator.smooth)
    rays = rays_of_views(evaluator.grid, smooth, complete, views)
    unshown = rays.beside.hidden | rays.own.hidden_between
    coverage = coverage_of(evaluator, measures, step, blind_of_helices(views), unshown, sides_tied)
    radial, left = min(_radial_share(v.calibration) for v in views), left_between(views, flanks, evaluator.grid)
    influences = influences_of(weighed(views, complete, evaluator.grid), evaluator.grid, complete.toothing)
    damage = damage_of(complete, evaluator, rays, step, radial, there, left, influences)
    damage = with_unread(damage, zones_of(evaluator.grid, step)["helix"], evaluator.traces)
    told = (*damage, *unseen_at_ends(complete, evaluator.grid, step, whole.x.shape[1]))
    gaps = unseen_in_traces(evaluator.grid, evaluator.traces, step)
    assessment = assess(influences, evaluator, step, measures, coverage, told, gaps, there)
    defects, defect_map = find_defects(flanks, folded, there, coverage)
    defects = (*defects, *broken_edges(flanks, folded, evaluator.grid.scatter, there, defects))
    defects = (*defects, *chipped_flanks(damage, defects))
    if not gear.damage_decides:
        defects = tuple(replace(d, verdict=None) for d in defects)
    if gear.defect_depth is not None:
        defects = held_against(gear.defect_depth, damage, defects)
    published = _published(flanks, views[0].scan, views[0].calibration) if len(views) == 1 else None
    diameters = tip_and_root(folded, nominal, radial_lines(assessment.influences))
    return Inspection(
        kind="gear",
        name=gear.name,
        characteristics=with_views(characteristics_of(assessment, diameters), flanks, views),
        without_damage=with_views(without_damage_of(assessment), flanks, views),
        defects=defects,
        reasons=tuple(dict.fromkeys([*reasons, *apart, *_further_reasons(whole, views, folded, seams)])),
        remarks=remarks_of(views, coverage, damage, measures, diameters),
        settings=settings_of(nominal, datum, [view.scan for view in views], evaluator.grid.size[1]),
        defect_depth=gear.defect_depth,
        seams=seams,
        deviation=_deviation(complete, whole.x.shape),
        evidence=GearEvidence(
            nominal, flanks.toothing.first_tooth, evaluator.grid, measures, coverage, folded, defect_map, published
        ),
        published={} if published is None else _published_figures(published, nominal),
    )


def _radial_share(calibration: Calibration) -> float:
    """Share 0..1 of the direction of the sensor's rays that points at the table's axis."""
    x, y, _ = calibration.table_from_sensor.rotation[:, 2]
    return hypot(x, y)


def _below_own_tips(
    seen: Sequence[Flanks], views: tuple[GearView, ...], folded: FoldedMap, scatter: float
) -> list[Flanks]:
    """The flanks of each view below the tips as that view shows them: in range, views differ by more than by noise."""
    maps = [folded] if len(views) == 1 else [fold(view.surface, view.flanks.toothing) for view in views]
    return [below_tips(flanks, own, scatter) for flanks, own in zip(seen, maps, strict=True)]


def evaluate_flanks(flanks: Flanks, step: float) -> tuple[Evaluator, Measures]:
    """How the flanks are read, and what they say; ``step``: table angle from one profile to the next, rad."""
    evaluator = evaluator_of(grid_of(flanks), step)
    return evaluator, evaluate(evaluator.grid.delta, evaluator)


def _reasons(surface: Surface, views: tuple[GearView, ...], seams: tuple[Seam, ...]) -> tuple[Message, ...]:
    """Why nothing may be decided: the calibration's reasons, views that contradict each other and, if there are any, a
    drawing that doesn't fit.
    """
    flanks = joined([view.flanks for view in views], views)
    reasons = tuple(dict.fromkeys(reason for view in views for reason in _calibration_reasons(view.calibration)))
    reasons = (*reasons, *contradictions(seams))
    try:
        check_drawing(surface, flanks, max(max(slopes_known(view).values()) for view in views))
    except WrongDrawing as wrong:
        if not reasons:  # off its axis, every gear looks like another one
            raise
        reasons = (*reasons, Message("wrong_drawing", str(wrong)))
    else:
        hidden = all("height" in view.calibration.not_identifiable for view in views)
        height_U = min(view.calibration.height_known for view in views) if hidden else 0.0
        reasons = (*reasons, *other_face(surface, flanks.toothing, height_U))
    if not flanks.delta.size:
        raise NotEnoughData("found no readings on the flanks; check face_from_mm and where the sensor looks")
    return reasons


def _further_reasons(
    surface: Surface, views: tuple[GearView, ...], folded: FoldedMap, seams: tuple[Seam, ...]
) -> tuple[Message, ...]:
    """Why nothing may be decided, of what an inspection finds: other teeth, a table that turned unevenly, seams."""
    toothing = views[0].flanks.toothing
    return (
        *other_diameters(folded, surface, toothing),
        *other_teeth(folded, toothing.nominal),
        *(reason for view in views for reason in (*contradicting_turns(view), *unevenness(view))),
        *contradictions(seams),
    )


def _calibration_reasons(calibration: Calibration) -> tuple[Message, ...]:
    """What speaks against deciding anything by a calibration."""
    reasons = calibration.reasons
    if calibration.method == "paper":
        text = "the calibration is of the published method, which moves no axis: calibrate with --method stand"
        reasons = (*reasons, Message("published_method", text))
    if calibration.covariance.shape[0] < UNKNOWNS:
        text = "the calibration carries no covariance, so U leaves its part out: use the whole record"
        reasons = (*reasons, Message("no_covariance", text))
    return reasons


def _deviation(flanks: Flanks, shape: tuple[int, ...]) -> Array:
    """Normal deviation (N, M) mm of every reading on a flank, NaN elsewhere."""
    deviation = np.full(int(np.prod(shape)), np.nan)
    deviation[flanks.index] = flanks.delta * cos(flanks.toothing.nominal.base_helix)
    return deviation.reshape(shape)


def _published(flanks: Flanks, scan: Scan, calibration: Calibration) -> Array:
    """Tooth positions F_i (2, teeth), of whole flanks, as the published compensation would have them.

    The same readings, known to be on these flanks, go through its chain.
    """
    nominal = flanks.toothing.nominal
    row, column = np.divmod(flanks.index, scan.x.shape[1])
    sample = column % PUBLISHED_THIN == 0
    thinned = replace(scan, x=scan.x[:, ::PUBLISHED_THIN], z=scan.z[:, ::PUBLISHED_THIN], intensity=None)
    surface = apply_calibration(thinned, replace(calibration, method="paper"))
    flanks = flanks.select(sample)
    at = row[sample], column[sample] // PUBLISHED_THIN
    x, y, height = surface.x[at], surface.y[at], surface.z[at]
    radius = np.hypot(x, y)
    tooth = flanks.toothing.first_tooth + flanks.flank % nominal.gear.teeth * nominal.gear.pitch
    off = np.angle(np.exp(1j * (np.arctan2(y, x) - tooth - (height - nominal.middle) * nominal.twist)))
    sigma = np.where(flanks.flank < nominal.gear.teeth, 1.0, -1.0)
    delta = nominal.base_radius * (sigma * off - nominal.half_angle(radius))
    roll = np.sqrt(np.maximum(radius**2 - nominal.base_radius**2, 0.0))
    grid = grid_of(replace(flanks, delta=delta, roll=roll, height=height))
    return np.asarray(SIGMA[:, None] * areal_positions(grid.delta, smooth_flanks(grid)) * nominal.arc_per_delta)


def _published_figures(index: Array, nominal: Involute) -> dict[str, float]:
    found = pitch_extremes(index, pitch_span(nominal.gear))
    return {
        f"{name} {flank}": float(values[side])
        for name, values in found.items()
        for side, flank in enumerate(FLANKS)
        if np.isfinite(values[side])
    }
