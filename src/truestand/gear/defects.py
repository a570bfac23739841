"""Defects: what one tooth has and its neighbours don't.

On the flanks: each cell against the median tooth, freed of the tooth's own smooth shape, through matched filters of
three sizes; what stands out of the noise of all flanks is a dent or a bump. Cells at the border of what was seen are
left out: edges make false alarms. On whole teeth: the folded map tells missing teeth, broken corners and burrs.
"""

from importlib.util import find_spec
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from truestand.core.inspection import GUARD_FACTOR, Defect, Flank, decide
from truestand.core.robust import MAD_TO_SD, robust_sd
from truestand.gear.coverage import Coverage
from truestand.gear.damage import Damage
from truestand.gear.evaluate import residuals, weigh
from truestand.gear.evidence import DefectMap, FoldedMap
from truestand.gear.flanks import TIP_MARGIN, Flanks, flank_heights, only
from truestand.gear.fold import gone_teeth, tip_places
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import Grid, grid_of

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

HEIGHT_CELL = 0.25
"""mm: finer than for the figures."""
SIZES = (0.15, 0.3, 0.6)
"""mm: standard deviations of the matched filters."""
SIGNIFICANT = 7.0
"""Robust standard deviations of the filtered residual over all flanks."""
LEAST_DEPTH = 0.002
"""mm."""
BORDER = 2
"""Cells at the border of what was seen that tell nothing."""
GAP = 9
"""Cells of roll length that may lie between two profiles: a deep dent near the root moves them apart."""
TOOTH_DEPTH = 0.1
"""mm of radius by which a tooth's tip may miss what the other teeth have (CONTRACT.md, Verdicts)."""
CHIP_GUARD = 0.01
"""mm by which a flank must be deeper for it to be doubted: dents are told to a tenth of their depth."""
LEAST_TIP_U = 0.005
"""mm, k = 2: the depth of a broken tip is not known better."""
ALIKE = 0.5
"""Share of the teeth from which a height at which tips are low tells nothing: a chamfer, or a reflection."""
ON_MOST = 0.75
"""Share of the teeth that must show a place of the tip for it to be missed on the others."""
LEAST_ROUND, ROUNDS = 6, 30
"""Teeth that tell a wave round the gear, and rounds of least absolute deviations that find it."""
LEAST_CELLS = 2
"""Cells that must bear a finding out: one alone may be strays."""
FULL, LEAST_POINTS = 0.5, 2
"""Share of the flank's usual number of points, and points, that a cell needs."""
TIP_SIGMA = 4.0
"""Standard deviations of noise by which flank points keep from the tip's land."""
LONE_SIGMA, LONE = 6.0, 3.0
"""Robust standard deviations from which a cell stands out, and how often as much as any cell about it makes it lone."""
PATCH = 2
"""Cells about the middle of the patches that the isolation forest looks at."""
PATCHES = 20_000


def find_defects(
    flanks: Flanks, folded: FoldedMap, coverage: Coverage, nominal: Involute, scatter: float
) -> tuple[tuple[Defect, ...], DefectMap | None]:
    """Defects, deepest doubt last, and the map that they were found on (None where no flank was seen).

    ``scatter``: standard deviation of a flank's points, mm.
    """
    whole = _whole_teeth(folded, nominal, flank_heights(flanks, nominal))
    gone = {d.tooth for d in whole if d.kind == "missing tooth"}
    if not coverage.position.any():
        return whole, None
    grid = grid_of(_below_tips(flanks, folded, nominal, scatter), nominal, HEIGHT_CELL)
    weighed = weigh(grid, nominal, everywhere=True)
    residual = _without_lone(np.where(_full(grid), residuals(grid.median, weighed), np.nan))
    score = _scores(residual, grid)
    found_map = DefectMap(residual, score, grid.rolls, grid.heights)
    found = [d for d in _on_flanks(found_map, grid) if d.tooth not in gone and not _at_chip(d, whole, nominal)]
    found = _scored_again(found, found_map)
    return tuple(sorted((*whole, *found), key=lambda d: -d.score)), found_map


def chipped_flanks(damage: tuple[Damage, ...], told: tuple[Defect, ...]) -> tuple[Defect, ...]:
    """Regions of flanks deeper than a tooth may be broken: chips, unless the sensor was deceived.

    Of teeth that are ``told`` to be broken they say nothing new.
    """
    broken = {d.tooth for d in told if d.verdict is not None}
    found = []
    for d in damage:
        if d.tooth + 1 in broken or (not d.beyond and (d.depth or 0.0) <= TOOTH_DEPTH + CHIP_GUARD):
            continue
        (a, b), (c, e) = d.rolls, d.heights
        flank: Flank = FLANKS[d.side]  # type: ignore[assignment]
        place, extent = ((a + b) / 2, (c + e) / 2), max(b - a, e - c)
        found.append(Defect(d.tooth + 1, flank, *place, d.depth, extent, "chipped flank", 0.0, verdict="undecided"))
    return tuple(found)


def _below_tips(flanks: Flanks, folded: FoldedMap, nominal: Involute, scatter: float) -> Flanks:
    """Without what may be the tip's land: it is seldom just where the drawing has it, and noise makes it thick."""
    seen = _tips(folded, nominal)
    tips = np.where(np.isfinite(seen), seen, nominal.gear.tip_diameter / 2)
    margin = max(TIP_MARGIN, TIP_SIGMA * scatter * nominal.gear.tip_diameter / 2 / nominal.tip_roll)
    radius = nominal.radius(flanks.roll)
    return only(flanks, radius < tips[flanks.which % nominal.gear.teeth] - margin)


def _tips(folded: FoldedMap, nominal: Involute) -> Array:
    """Radius (teeth,) of the tips' lands, NaN where not seen."""
    tip = folded.radius[:, tip_places(folded, nominal)]
    return _median(tip.reshape(tip.shape[0], -1), 1)


def _without_lone(residual: Array) -> Array:
    """Residuals (2, teeth, roll lengths, heights), NaN where a cell stands out and none about it does: strays."""
    from scipy.ndimage import maximum_filter

    about = np.ones((1, 1, 3, 3), dtype=bool)
    about[0, 0, 1, 1] = False
    size = np.nan_to_num(np.abs(residual))
    known = size[np.isfinite(residual)]
    usual = LONE_SIGMA * robust_sd(known) if known.size else 0.0
    lone = np.zeros(residual.shape, dtype=bool)
    for sign in (1.0, -1.0):
        here = np.where(sign * np.nan_to_num(residual) > 0, size, 0.0)
        beside = maximum_filter(here, footprint=about, mode="constant")
        lone |= (here > usual) & (here > LONE * beside)
    return np.where(lone, np.nan, residual)


def _full(grid: Grid) -> Bools:
    """Cells with points enough that strays don't make up their median."""
    return np.asarray(grid.count >= np.maximum(FULL * grid.usual, LEAST_POINTS))


def _scores(residual: Array, grid: Grid) -> Array:
    """The filtered residual in robust standard deviations, signed, of the size that stands out most; NaN at borders."""
    from scipy.ndimage import gaussian_filter1d

    inner = _inner(np.isfinite(residual))
    count = np.where(inner & np.isfinite(residual), grid.count, 0.0)
    values = np.where(count > 0, residual, 0.0)
    steps = grid.rolls[1] - grid.rolls[0], grid.heights[1] - grid.heights[0]
    best = np.zeros(residual.shape)
    for size in SIZES:

        def smooth(a: Array, narrower: float = 1.0, size: float = size) -> Array:
            for axis, step in zip((2, 3), steps, strict=True):
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


def _inner(seen: Bools) -> Bools:
    """Cells well inside what was seen; stripes between profiles are inside."""
    from scipy.ndimage import binary_closing, binary_erosion

    closed = np.zeros_like(seen)
    for side in range(seen.shape[0]):
        for tooth in range(seen.shape[1]):
            whole = np.pad(seen[side, tooth], GAP)
            whole = binary_closing(whole, np.ones((GAP, 3), dtype=bool))
            whole = binary_erosion(whole, np.ones((3, 3), dtype=bool), BORDER)
            cut = slice(GAP, -GAP)
            closed[side, tooth] = whole[cut, cut]
    return closed


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


def _defect(m: DefectMap, grid: Grid, at: tuple[int, int], blob: Bools, sign: float, kind: str) -> Defect | None:
    """The defect of one stretch of cells that stand out, told by its peak."""
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
    cell = (grid.rolls[1] - grid.rolls[0]) * (grid.heights[1] - grid.heights[0])
    deep = blob & (sign * np.nan_to_num(m.residual[at]) > depth / 2)
    share = np.isfinite(m.residual[at])[blob].mean()  # stripes between profiles count as what is beside them
    flank: Flank = FLANKS[at[0]]  # type: ignore[assignment]
    return Defect(
        at[1] + 1, flank, float(grid.rolls[i]), float(grid.heights[j]), -sign * depth,
        2 * sqrt(max(int(deep.sum()), 1) / max(float(share), 0.2) * cell / pi), kind, float(score.max()),
    )  # fmt: skip


def _whole_teeth(folded: FoldedMap, nominal: Involute, face: tuple[float, float]) -> tuple[Defect, ...]:
    """Missing teeth, broken corners, burrs: the tip's land of each tooth against the drawing's or the others'.

    ``face``: heights (mm in C) between which the toothing was seen; beyond lie the real end faces.
    """
    tip = folded.radius[:, tip_places(folded, nominal)]
    gone = gone_teeth(folded, nominal)
    drop = _usual_tips(folded, nominal, gone)[:, None] - _median(tip, 1)
    half = _length(folded, np.ones(1, dtype=bool)) / 2
    on_face = (folded.heights - half >= face[0]) & (folded.heights + half <= face[1])
    whole, drop = drop, np.where(on_face, drop, np.nan)
    known = drop[~gone][np.isfinite(drop[~gone])]
    U = max(2 * robust_sd(known - np.median(known)), LEAST_TIP_U) if known.size else LEAST_TIP_U
    least = max(TOOTH_DEPTH - GUARD_FACTOR * U / 2, TOOTH_DEPTH / 2)
    low = np.nan_to_num(drop[~gone]) > least
    drop = np.where(low.sum(axis=0) >= ALIKE * max(int((~gone).sum()), 1), np.nan, drop)
    hidden = ~np.isfinite(drop) & (np.isfinite(drop).mean(axis=0) >= ON_MOST)
    found = []
    for tooth, row in enumerate(drop):
        if gone[tooth]:
            found.append(_tooth(folded, tooth, np.isfinite(whole[tooth]), whole[tooth], "missing tooth", U))
            continue
        found += _broken(folded, tooth, row, hidden[tooth], least, U)
        found += [_tooth(folded, tooth, run, row, "burr", U) for run in _runs(row < -least) if run.sum() >= LEAST_CELLS]
    return tuple(found)


def _broken(folded: FoldedMap, tooth: int, drop: Array, hidden: Bools, least: float, U: float) -> list[Defect]:
    """Where a tip is lower by ``least`` (mm) than the others', or hidden: beside a broken edge lies its shadow."""
    low = np.nan_to_num(drop) > least
    found = []
    for stretch in _runs(low | ~np.isfinite(drop)):  # rows that no tooth shows part nothing
        run = _filled(stretch & (low | hidden))
        at_end = (run[0] and not run[-1]) or (run[-1] and not run[0])
        if low[run].any():
            found.append(_tooth(folded, tooth, run, drop, "chipped end" if at_end else "chipped tip", U))
        elif run.any():
            found.append(_hidden(folded, tooth, run))
    return found


def _usual_tips(folded: FoldedMap, nominal: Involute, gone: Bools) -> Array:
    """Radius (teeth,) at which each tooth would end like the others: their median and, off the datum's axis, a wave
    that comes round once; the drawing's where none is left. Teeth that are far from it have no say.
    """
    tips = _tips(folded, nominal)
    able = np.isfinite(tips) & ~gone
    around = np.arange(tips.size) * nominal.gear.pitch
    design = np.stack([np.ones(tips.size), np.cos(around), np.sin(around)], axis=1)
    usual = np.full(tips.size, float(np.median(tips[able])) if able.any() else nominal.gear.tip_diameter / 2)
    if np.count_nonzero(able) < LEAST_ROUND:
        return usual
    for _ in range(ROUNDS):
        weight = np.where(able, 1 / np.maximum(np.abs(np.nan_to_num(tips) - usual), TOOTH_DEPTH / 10), 0.0)
        root = np.sqrt(weight)[:, None]
        found = np.linalg.lstsq(design * root, np.nan_to_num(tips) * root[:, 0], rcond=None)[0]
        usual = design @ found
    return np.asarray(usual)


def _median(values: Array, axis: int) -> Array:
    """Median along an axis, NaN aside; NaN where there is nothing else."""
    ordered = np.sort(values, axis=axis)  # NaN last
    number = np.isfinite(ordered).sum(axis=axis, keepdims=True)
    low, high = np.maximum(number - 1, 0) // 2, number // 2
    found = [np.take_along_axis(ordered, np.minimum(i, ordered.shape[axis] - 1), axis) for i in (low, high)]
    return np.asarray(np.where(number > 0, (found[0] + found[1]) / 2, np.nan).squeeze(axis))


def _filled(on: Bools) -> Bools:
    """From the first row to the last."""
    rows = np.flatnonzero(on)
    filled = np.zeros_like(on)
    if rows.size:
        filled[rows[0] : rows[-1] + 1] = True
    return filled


def _runs(on: Bools) -> list[Bools]:
    """Stretches of rows."""
    from scipy.ndimage import label

    marked, number = label(on)
    return [marked == n for n in range(1, number + 1)]


def _tooth(folded: FoldedMap, tooth: int, run: Bools, drop: Array, kind: str, U: float) -> Defect:
    """A finding on a tooth's tip, with its verdict: a burr has none."""
    depth = float(np.nanmax(drop[run]) if kind != "burr" else np.nanmin(drop[run]))
    verdict = None if kind == "burr" else decide(depth, U, (None, TOOTH_DEPTH))
    if verdict == "does_not_conform" and np.count_nonzero(run) < LEAST_CELLS:
        verdict = "undecided"  # a reflection may lie on one row of the tip
    score = abs(depth) / TOOTH_DEPTH * SIGNIFICANT
    return Defect(
        tooth + 1, None, None, float(folded.heights[run].mean()), depth, _length(folded, run), kind, score, U=U,
        verdict=verdict,
    )  # fmt: skip


def _hidden(folded: FoldedMap, tooth: int, run: Bools) -> Defect:
    """A stretch of a tip that nobody saw, where the other teeth have theirs: it may have broken off."""
    height = float(folded.heights[run].mean())
    return Defect(tooth + 1, None, None, height, None, _length(folded, run), "hidden tip", 0.0, verdict="undecided")


def _length(folded: FoldedMap, run: Bools) -> float:
    """mm of height that a stretch of the folded map's rows covers."""
    return float(run.sum()) * float(folded.heights[1] - folded.heights[0] if folded.heights.size > 1 else 1.0)


def _at_chip(d: Defect, whole: tuple[Defect, ...], nominal: Involute) -> bool:
    """Whether a finding on a flank is but the edge of a broken corner that is told already."""
    return any(
        w.tooth == d.tooth
        and w.height is not None and d.height is not None and w.extent is not None and d.roll_length is not None
        and abs(w.height - d.height) < w.extent / 2 + 1.0
        and d.roll_length > nominal.control_roll + 0.3 * nominal.control_length
        for w in whole
    )  # fmt: skip


def _scored_again(found: list[Defect], m: DefectMap) -> list[Defect]:
    """The same with the isolation forest's word beside it: share of all patches that look less strange."""
    if not found or find_spec("sklearn") is None:
        return found
    from dataclasses import replace

    from sklearn.ensemble import IsolationForest

    windows = _windows(m.residual)
    usable = np.isfinite(m.score).reshape(-1)
    rng = np.random.default_rng(0)
    some = rng.choice(np.flatnonzero(usable), min(PATCHES, int(usable.sum())), replace=False)
    forest = IsolationForest(n_estimators=100, random_state=0).fit(windows(some))
    usual = np.sort(-forest.score_samples(windows(some)))
    shape = m.residual.shape
    places = [_index(d, m, shape) for d in found]
    strange = -forest.score_samples(windows(np.array(places)))
    return [
        replace(d, second_score=float(np.searchsorted(usual, s) / usual.size))
        for d, s in zip(found, strange, strict=True)
    ]


def _index(d: Defect, m: DefectMap, shape: tuple[int, ...]) -> int:
    assert d.tooth is not None and d.roll_length is not None and d.height is not None
    side = FLANKS.index(d.flank or "left")
    place = (
        side,
        d.tooth - 1,
        int(np.argmin(np.abs(m.rolls - d.roll_length))),
        int(np.argmin(np.abs(m.heights - d.height))),
    )
    return int(np.ravel_multi_index(place, shape))


def _windows(residual: Array):  # type: ignore[no-untyped-def]
    """Patches (n, 25) of residuals about cells given by their flat index; what was not seen is 0."""
    padded = np.pad(np.nan_to_num(residual), ((0, 0), (0, 0), (PATCH, PATCH), (PATCH, PATCH)))

    def at(cells: NDArray[np.intp]) -> Array:
        side, tooth, i, j = np.unravel_index(cells, residual.shape)
        size = 2 * PATCH + 1
        return np.stack([padded[side, tooth, i + a, j + b] for a in range(size) for b in range(size)], axis=1)

    return at
