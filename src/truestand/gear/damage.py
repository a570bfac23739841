"""Damage of flanks: regions whose readings depart together, and regions that no reading confirms.

Figures take damage in, as the standards define them (``traces``). What is found here is named, told apart from the rest
of a flank, and decides what a figure may say: material on top may be a second reflection, a region that no reading
confirms may hide anything, and a groove narrower than three profiles may be deeper than they saw. One cell that departs
is dirt, a region of cells is material.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Literal

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.inspection import CONTRADICTS
from truestand.core.robust import nan_median, robust_sd
from truestand.gear.evaluate import Evaluator
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import TRACE_SHARE, Grid, bridge_gaps, cell_of, number_in, step_on_flank
from truestand.gear.missed_rays import unseen_cells, with_those_between
from truestand.gear.rays import FlankRays
from truestand.gear.seen_flanks import Influence
from truestand.gear.smooth_flanks import SmoothFlanks, residuals, shared_shape
from truestand.gear.traces import Traces, helix_of, helix_points, profile_points, stretches_inside

Zone = Literal["profile", "helix", "position", "ball", "area"]

FAR_OFF, FAR_OFF_BY = 0.1, 3.9
"""Weight in its smooth flank below which a cell departs from it: so many robust standard deviations off, of cells. The
mean of few readings scatters more than most cells do: it must be as many of its own.
"""
DEPARTS, SHARE, FEW = 5.0, 0.25, 2
"""Robust standard deviations by which a reading departs; share and number of such readings that mark a cell."""
CLEAR = 6.0
"""Standard deviations of its cells' sum from which a region is no noise: speckle makes less than one of them a gear."""
LEAST_CELLS, IN_ONE_ROW = 4, 8
"""Cells that make a region, and so many where they lie in one row: fewer may be outliers, or speckle."""
DEPTH_QUANTILE = 0.98
"""Quantile of a region's readings that is its depth: the last few may be outliers."""
LEAST_DEPTH = 0.005
"""mm below which a region is not named: a sensor's steps look like that."""
DEPTH_SHARE_U = 0.1
"""Of a region's depth: U (k = 2) of the depth beside noise."""
CONFIRMED = 0.5
"""Of a cell's usual readings: with fewer on the flank and as many outside the gate, the cell is not confirmed."""
LEAST_OUTSIDE = 4
"""Readings outside the gate in a cell and those beside it from which they are no outliers."""
STEPS_ACROSS = 3.0
"""Steps of the table that a region must be wide for its depth to be known."""
MOST_SHADOW = 0.25
"""Share of its width over which the edge's shadow may reach, as deep as it was seen, for its bottom to be seen."""
LEAST_MISSED, MOST_MISSED = 1.0, 0.1
"""Weight, and share of its cells, of the rays that did not meet a region from which its bottom is hidden."""
LEAST_STEPS = 1.5
"""Steps of the table that it must be wide for its depth to be known to a half."""
STEPS_BESIDE = 1.0
"""Steps of the table to either side of a circle in which the profiles lie that meet a flank next to it."""
BETWEEN = 2
"""Cells along the height that may lie between two rays of one region."""
OFTEN = 0.2
"""Share of a region's rows in which it must end within the middle of the face for that to count."""
ROWS_ACROSS = 3
"""Rows of cells along the height that a region must be wide for its depth to be known."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A region of one flank that departs from the rest of it, or that no reading confirms."""

    side: int
    """0 left, 1 right."""
    tooth: int
    """From 0."""
    cells: Mask
    """(roll lengths, heights), with those within half a step of the table of what is hidden."""
    depth: float | None
    """mm by which its readings depart, positive into the material; None: not seen."""
    depth_U: float | None
    """Of the depth (k = 2), mm, where it was seen: a dent that profiles cross is known to a tenth."""
    clear: bool
    """Whether it stands out of all that noise looks like."""
    resolved: bool
    """Whether profiles enough cross it to tell its depth,"""
    hidden: bool
    """and whether its bottom may lie in the shadow of its edge or between two profiles, or nothing of it was seen:
    what lies on top has none."""
    ends_at_middle: bool
    """Whether its edges run through the middle of the face, where profiles are read."""
    rolls: tuple[float, float]
    """mm, from and to."""
    heights: tuple[float, float]
    """mm in C, from and to."""
    unread: bool = False
    """Whether the helix goes straight on, without a point, at heights of it."""
    alone: bool = False
    """Whether nothing shows it but that single profiles lack readings there, between two that show the flank: a hole
    that is no wider than two steps of the table, or readings that got lost.
    """

    @property
    def on_top(self) -> bool:
        """Whether its readings lie above the flank: a second reflection looks like that, too."""
        return self.depth is not None and self.depth < 0

    @property
    def text(self) -> str:
        """Where it is, and what it is."""
        (a, b), (c, d) = self.rolls, self.heights
        flank = f"tooth {self.tooth + 1} {FLANKS[self.side]}"
        where = f"{flank}, roll length {a:.1f} to {b:.1f} mm, height {c:.1f} to {d:.1f} mm"
        if self.depth is None:
            return f"{where}: no reading shows the flank"
        least = "" if self.resolved and not self.hidden else "at least "
        side = "below" if self.depth > 0 else "above"
        return f"{where}: readings {least}{1000 * abs(self.depth):.0f} um {side} the flank"


def with_deep_damage(flanks: Flanks, grid: Grid) -> Flanks:
    """The flanks, whose cells are ``grid``, with the readings outside the gate where they stand instead of the flank's:
    it is broken there.
    """
    outside = flanks.outside_gate
    cut = _cut(flanks, grid)
    cell = cell_of(outside, grid.nominal, grid.rolls.size, grid.edges)
    return flanks.joined([outside.select(cut.reshape(-1)[cell])]) if cut.any() else flanks


def damage_of(
    flanks: Flanks, evaluator: Evaluator, rays: FlankRays, step: float, radial: float, there: Mask, apart: float,
    influences: Sequence[Influence],
) -> tuple[Damage, ...]:  # fmt: skip
    """Regions of cells inside the evaluation ranges that depart from the smooth flanks, by more than ``influences`` of
    the budget explain, or are not seen; tooth by tooth.

    ``step``: table angle from one profile to the next, rad; ``radial``: share 0..1 of the rays' direction that points
    at the axis; ``there`` (teeth,): teeth that the drawing has; ``apart``: standard deviation (mm) of what views read
    otherwise.
    """
    grid, smooth, teeth = evaluator.grid, evaluator.smooth, evaluator.grid.nominal.gear.teeth
    rest = residuals(grid.delta, smooth) + _raised_on_all(smooth)
    cell = cell_of(flanks, grid.nominal, grid.rolls.size, grid.edges)
    depth = (grid.delta - rest).reshape(-1)[cell] - flanks.delta
    known = depth[np.isfinite(depth)]
    # Speckle is alike within a cell; without noise nanometres would depart.
    spread = max(grid.scatter, LEAST_DEPTH / DEPARTS, robust_sd(known) if known.size else 0.0)
    shared = hypot(evaluator.noise.of_row, apart)
    of_cells = np.hypot(spread / np.sqrt(np.maximum(grid.count, 1.0)), shared)
    by_few = np.abs(rest) < FAR_OFF_BY * of_cells
    far_off = (smooth.weight.reshape(rest.shape) < FAR_OFF) & np.isfinite(grid.delta) & ~by_few
    found = []
    departs = DEPARTS * hypot(spread, shared)
    lower, higher = (number_in(cell[sign * depth > departs], grid) for sign in (1, -1))
    below, above = (far_off & (rest < 0)) | _departing(lower, grid), (far_off & (rest > 0)) | _departing(higher, grid)
    unseen, missed = unseen_cells(rays, there)
    unusual, not_met = (np.maximum(missed, weight * rays.in_runs.missed) for weight in (IN_ONE_ROW, 1))
    for sign, departing, number, marked, weight in (
        (1, below, lower, below | unseen, np.maximum(below, unusual)), (-1, above, higher, above, above),
    ):  # fmt: skip
        marked = marked & grid.in_ranges & there[:, None, None]
        bridged = with_those_between(bridge_gaps(marked, grid, step), grid.seen, BETWEEN)
        for side, tooth in np.argwhere(marked.any(axis=(2, 3))):
            own = np.flatnonzero(flanks.flank == side * teeth + tooth)
            of_flank = (cells[side, tooth] for cells in (marked, weight, number, bridged))
            for region in _regions(*of_flank):
                on = (region & departing[side, tooth]).reshape(-1)
                found.append(_damage(_Region(
                    int(side), int(tooth), region, sign, sign * depth[own[on[cell[own] % region.size]]], spread,
                    evaluator.noise.ratio(side, tooth, rest[side, tooth], region),
                    float(not_met[side, tooth][region].sum()),
                    float(unusual[side, tooth][region].sum()) >= LEAST_CELLS,
                    not (region & ~rays.alone.missed[side, tooth]).any(),
                ), grid, step, radial))  # fmt: skip
    found = [d for d in found if d.depth is None or abs(d.depth) > LEAST_DEPTH]
    found = _beyond_the_budget(found, rest, smooth, influences)
    return tuple(sorted(found, key=lambda d: (d.tooth, d.side, d.rolls, d.heights)))


def _beyond_the_budget(
    found: list[Damage], rest: Array, smooth: SmoothFlanks, influences: Sequence[Influence]
) -> list[Damage]:
    """Regions whose cells lie, on the mean, so many U off the smooth flanks that inputs of the budget don't explain it.

    Where ends of profiles are seen on a few teeth only, what steep incidence does to them is shared by no others, and
    stands out.
    """
    regions = [(d.side, d.tooth, d.cells & np.isfinite(rest[d.side, d.tooth])) for d in found]
    known = np.zeros(len(found))
    for influence in influences if found else ():
        known = np.hypot(known, _means(residuals(influence.field, smooth), regions))
    beyond = np.abs(_means(rest, regions)) > CONTRADICTS * known
    return [d for d, further in zip(found, beyond, strict=True) if d.depth is None or further]


def _means(values: Array, regions: Sequence[tuple[int, int, Mask]]) -> Array:
    """Of values (2, teeth, roll lengths, heights) over regions of some flanks; 0 where one has no cells."""
    return np.array([
        values[side, tooth][cells].sum() / max(np.count_nonzero(cells), 1) for side, tooth, cells in regions
    ])  # fmt: skip


def _raised_on_all(smooth: SmoothFlanks) -> Array:
    """By how much (2, 1, roll lengths, heights) mm places stand above what all teeth share along each row and column.

    No machining leaves a spot on every tooth at the same place, but a second reflection in every tooth space does.
    """
    from scipy.ndimage import label

    shape = shared_shape(smooth.grid.delta, smooth)
    rows, columns = nan_median(shape, axis=2)[:, :, None], nan_median(shape, axis=1)[:, None, :]
    rest = np.nan_to_num(shape - rows - columns + nan_median(shape.reshape(2, -1), axis=1)[:, None, None])
    raised = np.zeros_like(shape)
    for side in (0, 1):
        told = rest[side][np.isfinite(shape[side])]
        if not told.size:
            continue
        spots, number = label(rest[side] > DEPARTS * max(robust_sd(told), LEAST_DEPTH / DEPARTS), np.ones((3, 3)))
        large = [n for n in range(1, number + 1) if np.count_nonzero(spots == n) >= LEAST_CELLS]
        raised[side] = np.where(np.isin(spots, large), rest[side], 0.0)
    return raised[:, None]


def unseen_in_traces(grid: Grid, traces: Traces, step: float) -> tuple[Damage, ...]:
    """Stretches inside profiles and helices that no reading shows: what they hide is not known."""
    zones, found = zones_of(grid, step), []
    centres = grid.rolls[:, None], grid.heights[None, :]
    for axis, zone, seen, at in (
        (0, zones["profile"], ~traces.between, profile_points(grid.nominal)),
        (1, zones["helix"], np.isfinite(helix_of(grid.delta, traces)), helix_points(grid.nominal)),
    ):
        half = grid.size[axis] / 2
        for flank, first, last in stretches_inside(seen):
            region = zone & (centres[axis] > at[first] - half) & (centres[axis] < at[last] + half)
            side, tooth = divmod(flank, grid.delta.shape[1])
            found.append(unseen_region(side, tooth, region, grid))
    return tuple(found)


def with_unread(damages: tuple[Damage, ...], zone: Mask, traces: Traces) -> tuple[Damage, ...]:
    """The same, ``unread`` where a helix, read from a ``zone`` (roll lengths, heights), has no point at some height."""
    heights = np.isfinite(traces.heights).reshape(2, -1, traces.heights.shape[1])
    return tuple(
        replace(d, unread=bool(((d.cells & zone).any(axis=0) & ~heights[d.side, d.tooth]).any())) for d in damages
    )


def without_damage(grid: Grid, damages: tuple[Damage, ...]) -> Grid:
    """The grid as if no reading had fallen on damage, nor beyond the evaluation ranges of flanks that have any."""
    count, delta = grid.count.copy(), grid.delta.copy()
    for d in damages:
        left_out = d.cells | ~grid.in_ranges[d.side, d.tooth]
        count[d.side, d.tooth][left_out], delta[d.side, d.tooth][left_out] = 0.0, np.nan
    return replace(grid, count=count, delta=delta)


def clear_of(damages: tuple[Damage, ...], grid: Grid) -> Mask:
    """Cells (2, teeth, roll lengths, heights) of damage that stands out of all that noise looks like."""
    cells = np.zeros(grid.delta.shape, dtype=bool)
    for d in damages:
        if d.clear:
            cells[d.side, d.tooth] |= d.cells
    return cells


@dataclass(frozen=True, slots=True)
class _Region:
    """Cells of a flank that depart together, or are not seen, and what readings and rays say of them."""

    side: int
    tooth: int
    cells: Mask
    """(roll lengths, heights)."""
    sign: int
    """1 below the flank, -1 above."""
    depths: Array
    """(n,) mm of the readings that depart, positive the way of ``sign``,"""
    spread: float
    """and the standard deviation of readings on sound flanks."""
    ratio: float
    """Sum of the cells over what noise makes of it."""
    not_met: float
    """Weight of the rays that did not meet it,"""
    unseen: bool
    """whether they alone would make a region of it,"""
    alone: bool
    """and whether all of them are of profiles that lack it alone."""


def _damage(region: _Region, grid: Grid, step: float, radial: float) -> Damage:
    """What is known of one region."""
    at, cells = (region.side, region.tooth), region.cells
    rolls = _extent(grid.rolls, grid.size[0], np.asarray(cells.any(axis=1)))
    heights = _extent(grid.heights, grid.size[1], np.asarray(cells.any(axis=0)))
    about = bridge_gaps(cells[None, None], grid, step)[0, 0]
    depth = region.sign * float(np.quantile(region.depths, DEPTH_QUANTILE)) if region.depths.size else 0.0
    if not region.depths.size or (abs(depth) <= LEAST_DEPTH and region.unseen):
        may_be = about | may_go_on(about, grid.seen[at])
        unseen = unseen_region(region.side, region.tooth, may_be, grid)
        return replace(unseen, rolls=rolls, heights=heights, alone=region.alone)
    width, middle = _widest(cells, grid)
    steps = width / float(step_on_flank(grid.nominal, middle, step))
    shadow = depth * _shadow(grid.nominal, middle, radial)
    mostly_met = region.not_met < max(LEAST_MISSED, MOST_MISSED * np.count_nonzero(cells))
    hidden = depth > 0 and (steps < LEAST_STEPS or shadow > MOST_SHADOW * width or not mostly_met)
    return Damage(
        *at,
        about | may_go_on(about, grid.seen[at]) if hidden else cells,
        depth,
        depth_U=hypot(DEPTH_SHARE_U * depth, 2 * region.spread),
        clear=abs(region.ratio) > CLEAR,
        resolved=steps >= STEPS_ACROSS and int(cells.sum(axis=1).max()) >= ROWS_ACROSS,
        hidden=hidden,
        ends_at_middle=_ends_at_middle(grid, at, cells, depth),
        rolls=rolls,
        heights=heights,
    )


def may_go_on(region: Mask, seen: Mask) -> Mask:
    """Cells (roll lengths, heights) to which a region may go on along the height: of its roll lengths, at heights next
    to it and to one another of which profiles show less than ``CONFIRMED`` of those.
    """
    from scipy.ndimage import binary_propagation

    rows, heights = np.asarray(region.any(axis=1)), np.asarray(region.any(axis=0))
    open_heights = heights | (seen[rows].mean(axis=0) < CONFIRMED)
    goes_on = np.asarray(binary_propagation(heights, mask=open_heights))
    return np.asarray(rows[:, None] & goes_on & ~seen)


def unseen_region(side: int, tooth: int, cells: Mask, grid: Grid) -> Damage:
    """A region of a flank, ``cells`` (roll lengths, heights), that no reading shows."""
    return Damage(
        side, tooth, cells, depth=None, depth_U=None, clear=False, resolved=False, hidden=True, ends_at_middle=False,
        rolls=_extent(grid.rolls, grid.size[0], np.asarray(cells.any(axis=1))),
        heights=_extent(grid.heights, grid.size[1], np.asarray(cells.any(axis=0))),
    )  # fmt: skip


def _ends_at_middle(grid: Grid, at: tuple[int, int], region: Mask, depth: float) -> bool:
    """Whether a region (roll lengths, heights) ends within the middle of the face in many of the rows that it touches:
    cells there differ by half of its depth.
    """
    middle = _middle_of_face(grid)
    rows = region[:, middle].any(axis=1)
    cells = grid.delta[at][rows][:, middle]
    apart = np.fmax.reduce(cells, axis=1) - np.fmin.reduce(cells, axis=1)
    return bool(np.count_nonzero(apart > abs(depth) / 2) > OFTEN * np.count_nonzero(rows))


def _widest(region: Mask, grid: Grid) -> tuple[float, float]:
    """How wide (mm of roll length) a region (roll lengths, heights) is at the height where it is widest, and the middle
    there: what runs aslant is narrower than its extent.
    """
    widest = int(region.sum(axis=0).argmax())
    low, high = _extent(grid.rolls, grid.size[0], region[:, widest])
    return high - low, (low + high) / 2


def _shadow(nominal: Involute, roll: float, radial: float) -> float:
    """How far (mm) along the flank an edge of 1 mm hides what lies behind it: the tangent of the incidence."""
    facing = radial * roll / float(nominal.radius(np.asarray(roll)))
    return sqrt(1.0 - facing**2) / max(facing, 1e-3)


def _departing(number: Array, grid: Grid) -> Mask:
    """Cells (2, teeth, roll lengths, heights) of which many a reading departs, by the ``number`` of those that do."""
    return np.asarray(number >= np.maximum(SHARE * grid.count, FEW))


def _cut(flanks: Flanks, grid: Grid) -> Mask:
    """Cells (2, teeth, roll lengths, heights) where readings lie outside the gate instead of on the flank."""
    from scipy.ndimage import uniform_filter

    at = cell_of(flanks.outside_gate, grid.nominal, grid.rolls.size, grid.edges)
    outside = number_in(at, grid)
    enough = np.maximum(CONFIRMED * grid.usual, FEW)
    together = 15 * uniform_filter(outside, (1, 1, 5, 3), mode="constant")
    cut = (outside >= enough) & (grid.count < enough) & (together > LEAST_OUTSIDE - 0.5)
    return np.asarray(cut & grid.in_ranges)


def _regions(cells: Mask, weight: Array, departing: Array, bridged: Mask) -> list[Mask]:
    """Stretches of cells (roll lengths, heights) that hang together in ``bridged`` and weigh enough, or of which
    readings enough are ``departing``: where profiles lie close, a row of few cells has many.
    """
    from scipy.ndimage import label

    marked, number = label(bridged, np.ones((3, 3)))
    regions = (cells & (marked == n) for n in range(1, number + 1))
    return [
        r
        for r in regions
        if weight[r].sum() >= (IN_ONE_ROW if r.any(axis=1).sum() == 1 else LEAST_CELLS)
        or departing[r].sum() >= IN_ONE_ROW
    ]


def _extent(centres: Array, size: float, on: Mask) -> tuple[float, float]:
    """From and to (mm) of some cells with ``centres`` (n,) and a ``size`` in mm."""
    return float(centres[on][0] - size / 2), float(centres[on][-1] + size / 2)


def zones_of(grid: Grid, step: float) -> dict[Zone, Mask]:
    """Cells (roll lengths, heights) that figures are read from as their standard has them, and some more about them.

    Profile: at the middle of the face. Helix: on the measuring circle. Position: where both meet. Ball: at the middle
    of the face, where it touches.
    """
    nominal = grid.nominal

    def about(roll: float) -> Mask:
        width = grid.size[0] / 2 + STEPS_BESIDE * float(step_on_flank(nominal, roll, step))
        return np.asarray(np.abs(grid.rolls - roll) <= width)[:, None]

    middle = _middle_of_face(grid)[None, :]
    area = np.ones((grid.rolls.size, grid.heights.size), dtype=bool)
    circle, ball = about(nominal.measuring_roll), about(nominal.ball_roll)
    return {
        "profile": area & middle, "helix": area & circle, "position": circle & middle, "ball": ball & middle,
        "area": area,
    }  # fmt: skip


def _middle_of_face(grid: Grid) -> Mask:
    """Cells (heights,) of the middle of the face and one more to either side."""
    height = TRACE_SHARE * grid.nominal.gear.face_width + grid.size[1]
    return np.asarray(np.abs(grid.heights - grid.nominal.middle) <= height)


def damage_in(damages: tuple[Damage, ...], zone: Mask, side: int | None, tooth: int | None) -> tuple[Damage, ...]:
    """The regions that touch a figure read from ``zone`` (roll lengths, heights) of a flank; None: of every flank."""
    return tuple(
        d for d in damages if side in (None, d.side) and tooth in (None, d.tooth) and bool((d.cells & zone).any())
    )
