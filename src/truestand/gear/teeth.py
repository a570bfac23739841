"""Teeth as a whole: tip and root diameter, and missing teeth, broken corners, burrs.

All are read from the folded map: the teeth cut open and laid side by side, as the median radius over the place within
the pitch and the height. It needs no flank, so it also shows teeth that aren't there and corners that broke off.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.calibration import Contribution
from truestand.core.harmonics import fit_harmonics_robustly
from truestand.core.inspection import GUARD_FACTOR, Defect, decide
from truestand.core.message import Message
from truestand.core.robust import medians, nan_median, robust_sd
from truestand.core.surface import Surface, each_of
from truestand.gear.flanks import END_MARGIN, TIP_MARGIN, Flanks, Toothing, blocks, toothed_zone
from truestand.gear.geometry import Involute
from truestand.gear.grid import bin_index, centres_of

PLACES = 48
HEIGHT_CELL, COLUMNS = 0.5, 2.0
"""mm, and points of a profile that a cell must be high at least."""
THIN = 2
"""Every so many points of a profile make the map where they lie close enough."""
LEAST_SHARE = 0.25
"""Share of a tip's usual number of points at a height below which they are outliers."""
REACH = 1.0
"""mm beyond tip and root that the map covers."""
TIP_SHARE = 0.6
"""Share of the tip's land about its middle that shows the tip diameter."""
ROOT_PLACE = 0.46
"""Share of the pitch from the tooth's centre beyond which lies the root."""
MISSING_SHARE = 0.6
"""Share of the tooth's height, as drawn, that must be missing for the tooth to be missing."""
TOOTH_DEPTH = 0.1
"""mm of radius by which a tooth's tip may be lower than the other teeth's (CONTRACT.md, Verdicts)."""
TIP_SIGMA = 4.0
"""Standard deviations of noise by which flank points keep from the tip's land."""
LEAST_TIP_U = 0.005
"""mm, k = 2: the depth of a broken tip is not known better."""
ALIKE = 0.5
"""Share of the teeth from which a height at which tips are low says nothing: a chamfer, or a reflection."""
ON_MOST = 0.75
"""Share of the teeth that must show a place of the tip for it to be missed on the others."""
LEAST_TEETH, ROUNDS = 6, 30
"""Teeth that show a wave round the gear, and rounds of least absolute deviations that find it."""
LEAST_ROWS = 2
"""Rows of the map that must bear a defect out: one alone may be an outlier."""
NARROW_LAND = "tip land narrower than a cell"
"""Line of the budget of a tip diameter."""
SIGNIFICANT = 7.0
"""Score from which a deviation is a defect: robust standard deviations, on flanks (``defects``)."""


@dataclass(frozen=True, slots=True)
class FoldedMap:
    """All teeth cut open and laid side by side: median radius (teeth, places, heights) mm; NaN = not seen.

    ``places`` (n,): share of the pitch from the tooth's centre, -0.5..0.5; ``heights`` (m,) mm in C.
    """

    radius: Array
    places: Array
    heights: Array

    @property
    def row_height(self) -> float:
        """mm; 1 where there is but one row."""
        return float(self.heights[1] - self.heights[0]) if self.heights.size > 1 else 1.0

    def tips(self, nominal: Involute) -> Array:
        """Radius (teeth, places, heights) mm of the tips' lands."""
        return self.radius[:, _tip_places(self.places, nominal)]

    def tip_radius(self, nominal: Involute) -> Array:
        """Median radius (teeth,) mm of each tip's land, NaN where not seen."""
        return nan_median(self.tips(nominal).reshape(self.radius.shape[0], -1), 1)


@dataclass(frozen=True, slots=True)
class Diameter:
    """A tip or root diameter, mm."""

    name: str
    value: float
    U: float
    coverage: float
    budget: tuple[Contribution, ...]


def fold(surfaces: Surface | Sequence[Surface], toothing: Toothing, rows: int | None = None) -> FoldedMap:
    """The folded map of every tooth as one scan shows it or several in one frame, of so many ``rows`` over the height
    or of as many as its points fill.
    """
    every = each_of(surfaces)
    profiles = sum(surface.x.shape[0] for surface in every)
    nominal = toothing.nominal
    g = nominal.gear
    low, high = g.root_diameter / 2 - REACH, g.tip_diameter / 2 + REACH
    bottom, top = g.face_from + END_MARGIN, g.face_to - END_MARGIN
    angle, radius, height = _zone(every, toothing, low, high, THIN)
    if rows is None and COLUMNS * (top - bottom) * profiles > HEIGHT_CELL * height.size:
        angle, radius, height = _zone(every, toothing, low, high)
    pitches = (angle - toothing.first_tooth) / g.pitch
    tooth = np.rint(pitches)
    place = bin_index(pitches - tooth, -0.5, 0.5, PLACES)
    spacing = (top - bottom) * profiles / max(height.size, 1)  # of the points of a profile
    rows = rows or max(1, round((top - bottom) / max(HEIGHT_CELL, COLUMNS * spacing)))
    row = bin_index(height, bottom, top, rows)
    cell = ((tooth.astype(np.int64) % g.teeth) * PLACES + place) * rows + row
    middle, span = (low + high) / 2, 1.01 * (high - low)
    median, count = medians(cell, radius - middle, g.teeth * PLACES * rows, span)
    shape = (g.teeth, PLACES, rows)
    places = centres_of(-0.5, 0.5, PLACES)
    found = (median + middle).reshape(shape)
    tip = _tip_places(places, nominal)
    found[:, tip] = _without_outliers(found[:, tip], count.reshape(shape)[:, tip])
    return FoldedMap(found, places, centres_of(bottom, top, rows))


def _zone(
    surfaces: Sequence[Surface], toothing: Toothing, low: float, high: float, thin: int = 1
) -> tuple[Array, Array, Array]:
    """Angles (rad), radii and heights (n,) mm of the points with radii ``low`` to ``high`` (mm), every ``thin``-th of
    a profile.
    """
    nominal, datum = toothing.nominal, toothing.datum
    zones = [toothed_zone(s, nominal, datum, rows, low, high, thin) for s in surfaces for rows in blocks(s)]
    angle, radius, height = (
        np.concatenate([getattr(zone, name) for zone in zones]) for name in ("angle", "radius", "height")
    )
    return angle, radius, height


def _without_outliers(tips: Array, count: NDArray[np.int64]) -> Array:
    """The tips' lands, NaN at heights with far fewer points than usual: outliers where no point of a profile falls."""
    points = count.sum(axis=1, keepdims=True)
    usual = float(np.median(points[points > 0])) if points.any() else 0.0
    return np.where(points < LEAST_SHARE * usual, np.nan, tips)


def _tip_places(places: Array, nominal: Involute) -> Mask:
    """Places that lie on the tip's land."""
    half = float(nominal.half_angle(np.asarray(nominal.gear.tip_diameter / 2))) / nominal.gear.pitch
    return np.asarray(np.abs(places) <= max(TIP_SHARE * half, 0.6 / PLACES))


def missing_teeth(folded: FoldedMap, nominal: Involute) -> Mask:
    """Teeth (teeth,) that are not there; those that were not seen are."""
    g = nominal.gear
    lowest = g.tip_diameter / 2 - MISSING_SHARE * (g.tip_diameter - g.root_diameter) / 2
    by_tooth = folded.tips(nominal).reshape(g.teeth, -1)
    seen = np.isfinite(by_tooth)
    low = np.count_nonzero(seen & (np.nan_to_num(by_tooth) < lowest), axis=1)
    return np.asarray(low > 0.5 * np.maximum(seen.sum(axis=1), 1))


def teeth_there(folded: FoldedMap, nominal: Involute) -> Mask:
    """Teeth (teeth,) but for those that the drawing leaves out, from whichever tooth it counts."""
    gear, missing = nominal.gear, missing_teeth(folded, nominal)
    drawn = np.zeros(gear.teeth, dtype=bool)
    drawn[np.array(gear.missing_teeth, dtype=np.intp) - 1] = True
    as_drawn = drawn.any() and any(np.array_equal(missing, np.roll(drawn, k)) for k in range(gear.teeth))
    return ~missing if as_drawn else np.ones(gear.teeth, dtype=bool)


def other_teeth(folded: FoldedMap, nominal: Involute) -> tuple[Message, ...]:
    """Why nothing may be decided where the part has teeth that the drawing leaves out; empty where it has none."""
    drawn, missing = len(set(nominal.gear.missing_teeth)), int(missing_teeth(folded, nominal).sum())
    if missing >= drawn:
        return ()
    text = (
        f"the drawing leaves out {drawn} of {nominal.gear.teeth} teeth, the part misses {missing}: check "
        "missing_teeth, or it is another part"
    )
    return (Message("other_teeth", text),)


def tip_and_root(folded: FoldedMap, nominal: Involute, radial: tuple[Contribution, ...]) -> tuple[Diameter, ...]:
    """Tip and root diameter: twice the mean over the teeth of each tooth's median radius; no tip where no tooth is.

    ``radial``: lines of U (k = 2, mm) of a diameter of the part.
    """
    tips = np.where(missing_teeth(folded, nominal)[:, None, None], np.nan, folded.tips(nominal))
    roots = folded.radius[:, np.abs(folded.places) >= ROOT_PLACE]
    return _diameter("d_a", tips, (*radial, *_narrow_land(nominal))), _diameter("d_f", roots, radial)


def _narrow_land(nominal: Involute) -> tuple[Contribution, ...]:
    """The line (U, k = 2, mm) of a tip diameter whose land is narrower than a cell of the map, which holds some of the
    flanks then; none of a wide one.
    """
    radius = nominal.gear.tip_diameter / 2
    land = 2 * radius * float(nominal.half_angle(np.asarray(radius)))
    beside = max(nominal.gear.pitch * radius / PLACES - land, 0.0) / 2
    low = beside * nominal.base_radius / sqrt(radius**2 - nominal.base_radius**2)
    return (Contribution(NARROW_LAND, 4 * low / sqrt(3.0), 2 * low / sqrt(3.0), "rectangular"),) if low else ()


def _diameter(name: str, radius: Array, radial: tuple[Contribution, ...]) -> Diameter:
    by_tooth = radius.reshape(radius.shape[0], -1)
    seen = np.isfinite(by_tooth).mean(axis=1) > 0.2
    if not seen.any():
        return Diameter(name, np.nan, np.nan, 0.0, ())
    radii = nan_median(by_tooth[seen], axis=1)
    if radii.size >= 3:  # chipped and missing teeth are no diameter
        off = np.abs(radii - np.median(radii))
        radii = radii[off <= max(4 * robust_sd(off), 0.02)]
    u = float(radii.std()) / np.sqrt(radii.size)
    lines = tuple(sorted((*radial, Contribution("scatter of the teeth", 4 * u, u)), key=lambda c: -c.U))
    return Diameter(name, 2 * float(radii.mean()), hypot(*(c.U for c in lines)), float(seen.mean()), lines)


def below_tips(flanks: Flanks, folded: FoldedMap, scatter: float) -> Flanks:
    """Without what may be the tip's land: it is seldom just where the drawing has it, and noise makes it thick.

    ``scatter``: standard deviation of a flank's points, mm. A broken tooth ends like the others.
    """
    nominal = flanks.toothing.nominal
    usual, tips = usual_tips(folded, nominal), folded.tip_radius(nominal)
    tips = np.where(np.abs(tips - usual) < TOOTH_DEPTH, tips, usual)
    margin = max(TIP_MARGIN, TIP_SIGMA * scatter * nominal.gear.tip_diameter / 2 / nominal.tip_roll)
    return flanks.select(nominal.radius(flanks.roll) < tips[flanks.flank % nominal.gear.teeth] - margin)


def tooth_defects(folded: FoldedMap, nominal: Involute, face: tuple[float, float]) -> tuple[Defect, ...]:
    """Missing teeth, broken corners, burrs: the tip's land of each tooth against the drawing's or the others'.

    ``face``: heights (mm in C) between which the toothing was seen; beyond lie the real end faces.
    """
    missing = missing_teeth(folded, nominal)
    all_drops = usual_tips(folded, nominal)[:, None] - nan_median(folded.tips(nominal), 1)
    half = folded.row_height / 2
    on_face = (folded.heights - half >= face[0]) & (folded.heights + half <= face[1])
    drops = np.where(on_face, all_drops, np.nan)
    known = drops[~missing][np.isfinite(drops[~missing])]
    U = max(2 * robust_sd(known - np.median(known)), LEAST_TIP_U) if known.size else LEAST_TIP_U
    least = max(TOOTH_DEPTH - GUARD_FACTOR * U / 2, TOOTH_DEPTH / 2)
    low = np.nan_to_num(drops[~missing]) > least
    drops = np.where(low.sum(axis=0) >= ALIKE * max(int((~missing).sum()), 1), np.nan, drops)
    hidden = ~np.isfinite(drops) & (np.isfinite(drops).mean(axis=0) >= ON_MOST)
    found = []
    for tooth, drop in enumerate(drops):
        if missing[tooth]:
            whole = all_drops[tooth]
            found.append(_defect(folded, tooth, np.isfinite(whole), whole, "missing tooth", U))
            continue
        found += _broken_tips(folded, tooth, drop, hidden[tooth], least, U)
        burrs = [rows for rows in _runs(drop < -least) if rows.sum() >= LEAST_ROWS]
        found += [_defect(folded, tooth, rows, drop, "burr", U) for rows in burrs]
    return tuple(found)


def _broken_tips(folded: FoldedMap, tooth: int, drop: Array, hidden: Mask, least: float, U: float) -> list[Defect]:
    """Where a tip is lower by ``least`` (mm) than the others', or hidden: beside a broken edge lies its shadow."""
    low = np.nan_to_num(drop) > least
    found = []
    for run in _runs(low | ~np.isfinite(drop)):  # rows that no tooth shows part nothing
        at = np.flatnonzero(run & (low | hidden))
        if not at.size:
            continue
        rows = np.zeros_like(run)
        rows[at[0] : at[-1] + 1] = True
        if low[rows].any():
            kind = "chipped end" if rows[0] != rows[-1] else "chipped tip"
            found.append(_defect(folded, tooth, rows, drop, kind, U))
        else:
            found.append(_hidden_tip(folded, tooth, rows))
    return found


def usual_tips(folded: FoldedMap, nominal: Involute) -> Array:
    """Radius (teeth,) at which each tooth would end like the others: their median and, off the datum's axis, a wave
    that comes round once; the drawing's where none is left. Teeth that are far from it have no say.
    """
    tips = folded.tip_radius(nominal)
    known = np.isfinite(tips) & ~missing_teeth(folded, nominal)
    if np.count_nonzero(known) < LEAST_TEETH:
        return np.full(tips.size, float(np.median(tips[known])) if known.any() else nominal.gear.tip_diameter / 2)
    around = np.arange(tips.size, dtype=np.float64) * nominal.gear.pitch
    wave = fit_harmonics_robustly(around, np.where(known, tips, np.nan), (1,), TOOTH_DEPTH / 10, ROUNDS)
    return wave(around)


def _runs(on: Mask) -> list[Mask]:
    """Stretches of neighbouring rows."""
    from scipy.ndimage import label

    marked, number = label(on)
    return [marked == n for n in range(1, number + 1)]


def _defect(folded: FoldedMap, tooth: int, rows: Mask, drop: Array, kind: str, U: float) -> Defect:
    """A defect of a tooth's tip, with its verdict: a burr has none."""
    depth = float(np.nanmax(drop[rows]) if kind != "burr" else np.nanmin(drop[rows]))
    verdict = None if kind == "burr" else decide(depth, U, (None, TOOTH_DEPTH))
    if verdict == "does_not_conform" and np.count_nonzero(rows) < LEAST_ROWS:
        verdict = "undecided"  # a reflection may lie on one row of the tip
    score = abs(depth) / TOOTH_DEPTH * SIGNIFICANT
    height, extent = float(folded.heights[rows].mean()), float(rows.sum()) * folded.row_height
    return Defect(tooth + 1, None, None, height, depth, extent, kind, score, U=U, verdict=verdict)


def _hidden_tip(folded: FoldedMap, tooth: int, rows: Mask) -> Defect:
    """A stretch of a tip that was not seen, where the other teeth have theirs: it may have broken off."""
    height, extent = float(folded.heights[rows].mean()), float(rows.sum()) * folded.row_height
    return Defect(tooth + 1, None, None, height, None, extent, "hidden tip", 0.0, verdict="undecided")
