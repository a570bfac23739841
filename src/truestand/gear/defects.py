"""Defects of flanks: what one tooth has and its neighbours don't.

Each cell is compared with the median tooth, freed of the tooth's own smooth shape, through matched filters of three
sizes; what stands out of the noise of all flanks is a dent or a bump. Cells at the border of what was seen are left
out: edges make false alarms.
"""

from dataclasses import dataclass, replace
from importlib.util import find_spec
from math import pi, sqrt

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.inspection import Defect, Verdict, decide
from truestand.core.robust import MAD_TO_SD, robust_sd
from truestand.gear.coverage import Coverage
from truestand.gear.damage import Damage
from truestand.gear.flanks import Flanks, flank_heights
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import Grid, grid_of
from truestand.gear.smooth_flanks import residuals, smooth_flanks
from truestand.gear.teeth import SIGNIFICANT, TOOTH_DEPTH, FoldedMap, tooth_defects

HEIGHT_CELL = 0.25
"""mm: finer than for the figures."""
FILTER_SIZES = (0.15, 0.3, 0.6)
"""mm: standard deviations of the matched filters."""
UNRESOLVED = 2.0
"""How often deeper than it was seen a dent may be that few profiles cross."""
LEAST_DEPTH = 0.002
"""mm."""
BORDER = 2
"""Cells at the border of what was seen that are left out."""
PROFILE_GAP = 9
"""Cells of roll length that may lie between two profiles: a deep dent near the root moves them apart."""
LEAST_CELLS = 2
"""Cells that must bear a defect out: one alone may be outliers."""
FULL, LEAST_POINTS = 0.5, 2
"""Share of the flank's usual number of points, and points, that a cell needs."""
SINGLE_SIGMA, SINGLE_RATIO = 6.0, 3.0
"""Robust standard deviations from which a cell stands out, and how often as much as any cell beside it makes it a
single one, an outlier."""
PATCH = 2
"""Cells about the middle of the patches that the isolation forest looks at."""
PATCHES = 20_000


@dataclass(frozen=True, slots=True)
class DefectMap:
    """Residual against the median tooth, (2, teeth, roll lengths, heights): mm, and its score in robust sigma."""

    residual: Array
    score: Array
    rolls: Array
    heights: Array


def find_defects(
    flanks: Flanks, folded: FoldedMap, there: Mask, coverage: Coverage
) -> tuple[tuple[Defect, ...], DefectMap | None]:
    """Defects of teeth and flanks, highest score first, and the map of the flanks (None where no flank was seen).

    ``there`` (teeth,): teeth that the drawing has.
    """
    nominal = flanks.toothing.nominal
    of_teeth = tooth_defects(folded, nominal, flank_heights(flanks))
    missing = {d.tooth for d in of_teeth if d.kind == "missing tooth"}
    of_teeth = tuple(d for d in of_teeth if d.tooth is None or there[d.tooth - 1])
    if not coverage.position.any():
        return of_teeth, None
    grid = grid_of(flanks, HEIGHT_CELL)
    rest = residuals(grid.median, smooth_flanks(grid, whole_flank=True))
    residual = _without_outliers(np.where(_full(grid), rest, np.nan))
    found_map = DefectMap(residual, _scores(residual, grid), grid.rolls, grid.heights)
    found = [
        d for d in _on_flanks(found_map, grid) if d.tooth not in missing and not _beside_chip(d, of_teeth, nominal)
    ]
    return tuple(sorted((*of_teeth, *_second_scores(found, found_map)), key=lambda d: -d.score)), found_map


def chipped_flanks(damage: tuple[Damage, ...], defects: tuple[Defect, ...]) -> tuple[Defect, ...]:
    """Regions of flanks that are, or may be, deeper than a tooth may be broken: chips.

    They decide where profiles enough cross them. Of teeth that ``defects`` name as broken they say nothing new.
    """
    broken = {d.tooth for d in defects if d.verdict == "does_not_conform"}
    found = []
    for d in damage:
        if d.tooth + 1 in broken or d.depth is None or d.depth_U is None:
            continue
        verdict = decide(d.depth, d.depth_U, (None, TOOTH_DEPTH))
        if verdict != "conforms":
            found.append(_of_region(d, "chipped flank", TOOTH_DEPTH, verdict if d.resolved else "undecided"))
    return tuple(found)


def held_against(limit: float, damage: tuple[Damage, ...], defects: tuple[Defect, ...]) -> tuple[Defect, ...]:
    """The defects with a verdict of dents and bumps that are, or may be, deeper or higher than ``limit`` mm.

    Depths are those of regions of damage. Of one that was not seen whole only its least depth is known, and of a dent
    smaller than a region its half; what lies on top may be a second reflection.
    """
    found = list(defects)
    for d in damage:
        if d.depth is None or d.depth_U is None:
            continue
        verdict = decide(abs(d.depth), d.depth_U, (None, limit))
        whole = d.resolved and not d.hidden
        if verdict == "conforms" and not whole:
            verdict = "undecided" if d.hidden else decide(UNRESOLVED * abs(d.depth), d.depth_U, (None, limit))
        if verdict == "conforms":
            continue
        judged = _of_region(d, "bump" if d.on_top else "dent", limit, "undecided" if d.on_top else verdict)
        found = [f for f in found if not _lies_in(f, d)] + [judged]
    return tuple(
        replace(f, verdict="undecided")
        if f.kind in ("dent", "bump") and f.verdict is None and abs(f.depth or 0.0) > limit / UNRESOLVED
        else f
        for f in found
    )


def _lies_in(defect: Defect, region: Damage) -> bool:
    """Whether a dent or bump lies in a region of damage."""
    if defect.kind not in ("dent", "bump") or (defect.tooth, defect.flank) != (region.tooth + 1, FLANKS[region.side]):
        return False
    (a, b), (c, e), margin = region.rolls, region.heights, (defect.extent or 0.0) / 2
    inside = a - margin <= (defect.roll_length or 0.0) <= b + margin
    return inside and c - margin <= (defect.height or 0.0) <= e + margin


def _of_region(d: Damage, kind: str, limit: float, verdict: Verdict) -> Defect:
    (a, b), (c, e), depth = d.rolls, d.heights, d.depth or 0.0
    place, extent, score = ((a + b) / 2, (c + e) / 2), max(b - a, e - c), abs(depth) / limit * SIGNIFICANT
    return Defect(d.tooth + 1, FLANKS[d.side], *place, depth, extent, kind, score, U=d.depth_U, verdict=verdict)


def _without_outliers(residual: Array) -> Array:
    """Residuals (2, teeth, roll lengths, heights), NaN where a cell stands out and none beside it does."""
    from scipy.ndimage import maximum_filter

    beside = np.ones((1, 1, 3, 3), dtype=bool)
    beside[0, 0, 1, 1] = False
    size = np.nan_to_num(np.abs(residual))
    known = size[np.isfinite(residual)]
    usual = SINGLE_SIGMA * robust_sd(known) if known.size else 0.0
    single = np.zeros(residual.shape, dtype=bool)
    for sign in (1.0, -1.0):
        of_sign = np.where(sign * np.nan_to_num(residual) > 0, size, 0.0)
        largest_beside = maximum_filter(of_sign, footprint=beside, mode="constant")
        single |= (of_sign > usual) & (of_sign > SINGLE_RATIO * largest_beside)
    return np.where(single, np.nan, residual)


def _full(grid: Grid) -> Mask:
    """Cells with points enough that outliers don't make up their median."""
    return np.asarray(grid.count >= np.maximum(FULL * grid.usual, LEAST_POINTS))


def _scores(residual: Array, grid: Grid) -> Array:
    """The filtered residual in robust standard deviations, signed, of the size that stands out most; NaN at borders."""
    from scipy.ndimage import gaussian_filter1d

    inner = _inner(np.isfinite(residual))
    count = np.where(inner & np.isfinite(residual), grid.count, 0.0)
    values = np.where(count > 0, residual, 0.0)
    best = np.zeros(residual.shape)
    for size in FILTER_SIZES:

        def smooth(a: Array, narrower: float = 1.0, size: float = size) -> Array:
            for axis, step in zip((2, 3), grid.size, strict=True):
                a = gaussian_filter1d(a, size / step / narrower, axis=axis, mode="constant", truncate=3.0)
            return a

        weight = smooth(count)
        with np.errstate(invalid="ignore", divide="ignore"):
            height = smooth(count * values) / weight
            spread = np.sqrt(smooth(count, sqrt(2.0))) / weight  # of a mean weighted by g: sqrt(sum g^2 n) / sum g n
            ratio = height / spread
        ratio[~inner | ~np.isfinite(ratio)] = np.nan
        for side in range(2):
            scatter = MAD_TO_SD * float(np.nanmedian(np.abs(ratio[side]))) if np.isfinite(ratio[side]).any() else np.inf
            scaled = np.nan_to_num(ratio[side] / max(scatter, 1e-300))
            best[side] = np.where(np.abs(scaled) > np.abs(best[side]), scaled, best[side])
    return np.where(inner, best, np.nan)


def _inner(seen: Mask) -> Mask:
    """Cells well inside what was seen; stripes between profiles are inside."""
    from scipy.ndimage import binary_closing, binary_erosion

    ends = (PROFILE_GAP, PROFILE_GAP)
    whole = np.pad(seen, ((0, 0), (0, 0), ends, ends))
    whole = binary_closing(whole, np.ones((1, 1, PROFILE_GAP, 3), dtype=bool))
    whole = binary_erosion(whole, np.ones((1, 1, 3, 3), dtype=bool), BORDER)
    return np.asarray(whole[:, :, PROFILE_GAP:-PROFILE_GAP, PROFILE_GAP:-PROFILE_GAP])


def _on_flanks(m: DefectMap, grid: Grid) -> list[Defect]:
    from scipy.ndimage import label

    found = []
    for side in range(2):
        for tooth in range(m.score.shape[1]):
            score = np.nan_to_num(m.score[side, tooth])
            for sign, kind in ((-1.0, "dent"), (1.0, "bump")):
                blobs, number = label(sign * score > SIGNIFICANT, np.ones((3, 3)))
                found += [
                    d for n in range(1, number + 1)
                    if (d := _defect(m, grid, (side, tooth), blobs == n, sign, kind)) is not None
                ]  # fmt: skip
    return found


def _defect(m: DefectMap, grid: Grid, at: tuple[int, int], blob: Mask, sign: float, kind: str) -> Defect | None:
    """The defect of one stretch of cells that stand out, described by its peak."""
    score = np.where(blob, sign * np.nan_to_num(m.score[at]), 0.0)
    i, j = (int(k) for k in np.unravel_index(int(np.argmax(score)), score.shape))
    near = slice(max(i - 2, 0), i + 3), slice(max(j - 2, 0), j + 3)
    heights = np.where(blob[near], sign * m.residual[at][near], np.nan)
    if not np.isfinite(heights).any():
        return None
    depth = float(np.nanmax(heights))
    bearing = np.count_nonzero(blob & (sign * np.nan_to_num(m.residual[at]) > depth / 3))
    if depth < LEAST_DEPTH or bearing < LEAST_CELLS:
        return None
    cell = grid.size[0] * grid.size[1]
    deep = blob & (sign * np.nan_to_num(m.residual[at]) > depth / 2)
    share = np.isfinite(m.residual[at])[blob].mean()  # stripes between profiles count as what is beside them
    return Defect(
        at[1] + 1, FLANKS[at[0]], float(grid.rolls[i]), float(grid.heights[j]), -sign * depth,
        2 * sqrt(max(int(deep.sum()), 1) / max(float(share), 0.2) * cell / pi), kind, float(score.max()),
    )  # fmt: skip


def _beside_chip(d: Defect, of_teeth: tuple[Defect, ...], nominal: Involute) -> bool:
    """Whether a defect of a flank is but the edge of a broken corner that is named already."""
    return any(
        chip.tooth == d.tooth
        and chip.height is not None and d.height is not None and chip.extent is not None and d.roll_length is not None
        and abs(chip.height - d.height) < chip.extent / 2 + 1.0
        and d.roll_length > nominal.control_roll + 0.3 * nominal.control_length
        for chip in of_teeth
    )  # fmt: skip


def _second_scores(found: list[Defect], m: DefectMap) -> list[Defect]:
    """The same with a second score by an isolation forest: the share of all patches that look less strange."""
    if not found or find_spec("sklearn") is None:
        return found
    from sklearn.ensemble import IsolationForest

    usable = np.flatnonzero(np.isfinite(m.score).reshape(-1))
    drawn = np.random.default_rng(0).choice(usable, min(PATCHES, usable.size), replace=False)
    sample = _patches(m.residual, drawn)
    forest = IsolationForest(n_estimators=100, random_state=0).fit(sample)
    usual = np.sort(-forest.score_samples(sample))
    strange = -forest.score_samples(_patches(m.residual, np.array([_cell_of(d, m) for d in found])))
    shares = np.searchsorted(usual, strange) / usual.size
    return [replace(d, second_score=float(share)) for d, share in zip(found, shares, strict=True)]


def _cell_of(d: Defect, m: DefectMap) -> int:
    """Flat index of the cell in which a defect of a flank lies."""
    assert d.tooth is not None and d.roll_length is not None and d.height is not None
    i, j = int(np.argmin(np.abs(m.rolls - d.roll_length))), int(np.argmin(np.abs(m.heights - d.height)))
    return int(np.ravel_multi_index((FLANKS.index(d.flank or "left"), d.tooth - 1, i, j), m.residual.shape))


def _patches(residual: Array, cells: Ints) -> Array:
    """Patches (n, 25) of residuals about ``cells`` (n,), given by their flat index; 0 where nothing was seen."""
    padded = np.pad(np.nan_to_num(residual), ((0, 0), (0, 0), (PATCH, PATCH), (PATCH, PATCH)))
    side, tooth, i, j = np.unravel_index(cells, residual.shape)
    size = 2 * PATCH + 1
    return np.stack([padded[side, tooth, i + a, j + b] for a in range(size) for b in range(size)], axis=1)
