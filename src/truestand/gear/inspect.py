"""The inspection of a gear, from the rolled-up scan to characteristics with their uncertainty and verdict."""

from dataclasses import dataclass, replace
from math import cos

import numpy as np

from truestand.apply.datum import datum_of
from truestand.core.arrays import Array
from truestand.core.calibration import Calibration
from truestand.core.errors import NotEnoughData, WrongDrawing
from truestand.core.inspection import Inspection
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration
from truestand.gear.angle import AngleCorrection, correct_angle
from truestand.gear.budget import expanded, influences_of, radial_lines
from truestand.gear.characteristics import Assessment, characteristics_of, settings_of
from truestand.gear.damage import damage_of, zones_of
from truestand.gear.defects import DefectMap, chipped_flanks, find_defects
from truestand.gear.drawing import Gear
from truestand.gear.evaluate import (
    Measures,
    Weights,
    corrected,
    evaluate,
    figures_of,
    noise_of,
    pitch_extremes,
    weights_of,
)
from truestand.gear.flanks import Flanks, find_flanks, find_toothing
from truestand.gear.geometry import FLANKS, Involute, involute, pitch_span
from truestand.gear.grid import Coverage, Grid, coverage_of, grid_of
from truestand.gear.match import check_drawing
from truestand.gear.remarks import remarks_of, unevenness
from truestand.gear.teeth import FoldedMap, fold, tip_and_root

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
    rolls: Array
    """(2, teeth, n): where the points of ``measures.profile`` lie."""
    coverage: Coverage
    folded: FoldedMap | None = None
    defect_map: DefectMap | None = None
    published_index: Array | None = None
    """F_i (2, teeth) after the published compensation."""


def inspect_gear(surface: Surface, gear: Gear) -> Inspection:
    """Pitch, run-out, thickness, profile, helix and defects of a rolled-up gear.

    Raises:
        NotEnoughData: nothing of the toothing is in view.
        WrongDrawing: what was seen is another gear than the drawing's.
        BadRecipe: the surface doesn't say from which scan and calibration it comes.
    """
    scan, calibration = surface.origin
    nominal, datum = involute(gear), datum_of(calibration, gear.datum, gear.bore_clearance)
    flanks = find_flanks(surface, find_toothing(surface, nominal, datum))
    reasons = _reasons(surface, flanks, calibration)
    correction = correct_angle(surface, flanks, scan, calibration)
    flanks, scan = correction.flanks, correction.scan
    weights, measures = evaluate_flanks(flanks)
    coverage = coverage_of(weights.grid, scan.step)
    folded = fold(correction.surface, flanks.toothing)
    assessment = _assess(correction, weights, measures, coverage)
    defects, defect_map = find_defects(flanks, folded, coverage, weights.grid.scatter)
    published = _published(flanks, scan, correction.calibration)
    diameters = tip_and_root(folded, nominal, radial_lines(assessment.influences))
    return Inspection(
        kind="gear",
        name=gear.name,
        characteristics=characteristics_of(assessment, diameters),
        defects=(*defects, *chipped_flanks(assessment.damage, defects)),
        reasons=(*reasons, *unevenness(correction)),
        remarks=remarks_of(correction, coverage, assessment.damage, measures),
        settings=settings_of(nominal, datum, scan),
        defect_depth=gear.defect_depth,
        deviation=_deviation(flanks, surface),
        evidence=GearEvidence(
            nominal, flanks.toothing.first_tooth, weights.grid, measures, weights.rolls.reshape(2, gear.teeth, -1),
            coverage, folded, defect_map, published,
        ),
        published=_published_figures(published, nominal),
    )  # fmt: skip


def evaluate_flanks(flanks: Flanks) -> tuple[Weights, Measures]:
    """Weights of the flanks' cells, and the measures read with them."""
    grid = grid_of(flanks)
    weights = weights_of(grid)
    return weights, evaluate(grid.delta, weights)


def _reasons(surface: Surface, flanks: Flanks, calibration: Calibration) -> tuple[str, ...]:
    """Why nothing may be decided: the calibration's reasons and, if it has any, a drawing that doesn't fit."""
    reasons = calibration.reasons
    if calibration.method == "paper":
        reasons = (*reasons, "the calibration is of the published method, which moves no axis: calibrate with "
                   "--method stand")  # fmt: skip
    try:
        check_drawing(surface, flanks)
    except WrongDrawing as wrong:
        if not reasons:  # off its axis, every gear looks like another one
            raise
        reasons = (*reasons, str(wrong))
    if not flanks.delta.size:
        raise NotEnoughData("found no readings on the flanks; check face_from_mm and where the sensor looks")
    return reasons


def _assess(correction: AngleCorrection, weights: Weights, measures: Measures, coverage: Coverage) -> Assessment:
    """The figures, freed of the bias of noise, with every line of their budget."""
    flanks, scan, nominal = correction.flanks, correction.scan, weights.grid.nominal
    noisier, noise = noise_of(measures, weights)
    influences = influences_of(
        scan, correction.calibration, weights.grid, flanks.toothing, correction.before_rms or 0.0
    )  # fmt: skip
    return Assessment(
        nominal,
        corrected(figures_of(measures, nominal), noisier),
        expanded(influences, measures, weights) | {"noise": noise},
        influences,
        coverage,
        damage_of(flanks, weights, scan.step),
        zones_of(weights.grid, scan.step),
        measures.runout_per_delta,
    )


def _deviation(flanks: Flanks, surface: Surface) -> Array:
    """Normal deviation (N, M) mm of every reading on a flank, NaN elsewhere."""
    deviation = np.full(surface.x.size, np.nan)
    deviation[flanks.index] = flanks.delta * cos(flanks.toothing.nominal.base_helix)
    return deviation.reshape(surface.x.shape)


def _published(flanks: Flanks, scan: Scan, calibration: Calibration) -> Array:
    """Tooth positions F_i (2, teeth) as the published compensation would have them: the same readings, known to be on
    these flanks, through its chain.
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
    return evaluate_flanks(replace(flanks, delta=delta, roll=roll, height=height))[1].index


def _published_figures(index: Array, nominal: Involute) -> dict[str, float]:
    found = pitch_extremes(index, pitch_span(nominal.gear))
    return {
        f"{name} {flank}": float(values[side])
        for name, values in found.items()
        for side, flank in enumerate(FLANKS)
        if np.isfinite(values[side])
    }
