"""Flank points reduced to cells of roll length times height, one grid a tooth and flank: what everything is read from.

A cell's value is the mean of its points, outliers among them are out already (``lone_readings_on``). Its median
stands beside it for the search for defects. Cells have edges where traces have theirs: at the middle of the face
+- b / 20.

Radial rays sample a flank coarsely near its root: one step of the table covers rb dtheta / sin^2 alpha of roll length.
A cell between two profiles is not hidden, so it counts as seen when its neighbours within one such step are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.robust import medians, robust_sd
from truestand.gear.flanks import END_MARGIN, GATE, FlankPoints, Flanks
from truestand.gear.geometry import Involute

HEIGHT_CELL, SPACINGS = 0.25, 1.5
"""mm of height of a cell, and spacings of a profile's points that it must hold at least."""
TRACE_SHARE = 1 / 20
"""Share of the face to either side of its middle in which profile and position are read."""
MEDIAN_SPAN = 16 * GATE
"""mm of delta in which medians are found: the published compensation moves teeth by millimetres."""
LEAST_SHARE = 0.25
"""Share of the number of points that are usual of a flank, at the roll length of a cell, below which the cell's points
are outliers, off the flank,"""
SOLID_SHARE = 0.05
"""and of what is left, below which a cell does not count as seen."""
LEAST_SPREAD = 1e-4
"""mm: the scatter within cells is not taken for less."""
FINE_STEP = 0.25
"""mm of roll length that a step of the table should not exceed at the root."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Cells (2 flanks, teeth, roll lengths, heights)."""

    nominal: Involute
    delta: Array
    """mm, NaN where no point fell."""
    median: Array
    """mm, of all points."""
    roll: Array
    """Mean roll length of a cell's points; its centre where there is none."""
    height: Array
    """Mean height of a cell's points; its centre where there is none."""
    count: Array
    """Points."""
    rolls: Array
    """(roll lengths,) mm, cell centres."""
    edges: Array
    """(heights + 1,) mm in C, of the cells."""
    scatter: float
    """Robust standard deviation of a point within its cell, mm."""

    @property
    def heights(self) -> Array:
        """(heights,) mm in C, cell centres."""
        return np.asarray((self.edges[:-1] + self.edges[1:]) / 2)

    @property
    def seen(self) -> Mask:
        """Cells that hold a point."""
        return np.asarray(self.count > 0)

    @property
    def size(self) -> tuple[float, float]:
        """Roll length and height (mm) of a cell."""
        return self.nominal.control_length / self.rolls.size, float(np.ptp(self.edges)) / (self.edges.size - 1)

    @property
    def usual(self) -> Array:
        """Points (2, teeth, 1, 1) that a seen cell of each flank usually holds; 0 where nothing was seen."""
        return _usual(self.count.reshape(-1, self.rolls.size * self.heights.size)).reshape(*self.count.shape[:2], 1, 1)

    @property
    def solid(self) -> Mask:
        """Cells that hold more than outliers."""
        return np.asarray(self.count > SOLID_SHARE * self.usual)

    @property
    def in_ranges(self) -> Mask:
        """Cells inside both evaluation ranges."""
        (low, high), (bottom, top) = self.nominal.profile_range, self.nominal.helix_range
        in_profile = (self.roll >= low) & (self.roll <= high)
        return np.asarray(in_profile & (self.height >= bottom) & (self.height <= top))


def grid_of(flanks: Flanks, height_cell: float | None = None) -> Grid:
    """The cells of all flanks, (2, teeth, roll lengths, heights), about ``height_cell`` mm high.

    None: ``HEIGHT_CELL``, or as high as the points of a profile need.
    """
    nominal = flanks.toothing.nominal
    height_cell = height_cell or max(HEIGHT_CELL, SPACINGS * _spacing(flanks))
    rolls, edges = ceil(nominal.control_length / nominal.gear.evaluation.resolution), height_edges(nominal, height_cell)
    shape = (2, nominal.gear.teeth, rolls, edges.size - 1)
    cell = cell_of(flanks, nominal, rolls, edges)
    cells = int(np.prod(shape))
    median, number = medians(cell, flanks.delta, cells, MEDIAN_SPAN)
    centres = centres_of(nominal.control_roll, nominal.tip_roll, rolls), (edges[:-1] + edges[1:]) / 2
    count = _without_outliers(number.reshape(2 * nominal.gear.teeth, rolls, -1), _often_met(nominal, centres[0]))
    count = count.reshape(-1)
    off = np.abs(flanks.delta - median[cell])

    def mean(values: Array) -> Array:
        total = np.bincount(cell, values, minlength=cells)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(shape)

    roll, height = mean(flanks.roll), mean(flanks.height)
    return Grid(
        nominal,
        mean(flanks.delta),
        np.where(count > 0, median, np.nan).reshape(shape),
        np.where(np.isnan(roll), centres[0][:, None], roll),
        np.where(np.isnan(height), centres[1], height),
        count.reshape(shape).astype(np.float64),
        centres[0],
        edges,
        max(robust_sd(off) if off.size else 0.0, LEAST_SPREAD),
    )


def means_of(of: Sequence[Flanks], grid: Grid) -> Array:
    """Mean delta (2, teeth, roll lengths, heights) mm of some points in the cells of a grid; NaN: none."""
    cells = [cell_of(flanks, grid.nominal, grid.rolls.size, grid.edges) for flanks in of]
    count = sum(np.bincount(cell, minlength=grid.delta.size) for cell in cells)
    total = sum(np.bincount(c, f.delta, minlength=grid.delta.size) for c, f in zip(cells, of, strict=True))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(grid.delta.shape)


def _spacing(flanks: Flanks) -> float:
    """Median mm of height from one point of a profile to the next."""
    beside = np.diff(flanks.index) == 1
    return float(np.median(np.abs(np.diff(flanks.height)[beside]))) if beside.any() else 0.0


def height_edges(nominal: Involute, height_cell: float) -> Array:
    """Edges (n,) mm, C, of cells about ``height_cell`` mm high: some between the ends of the band in which profiles are
    read, some below, as many above.
    """
    bottom, top = nominal.gear.face_from + END_MARGIN, nominal.gear.face_to - END_MARGIN
    half = TRACE_SHARE * nominal.gear.face_width
    low, high = nominal.middle - half, nominal.middle + half
    within = max(1, round(2 * half / height_cell))
    beside = max(1, ceil((low - bottom) / height_cell - 1e-9))
    parts = np.linspace(bottom, low, beside + 1), np.linspace(low, high, within + 1), np.linspace(high, top, beside + 1)
    return np.concatenate([parts[0], parts[1][1:], parts[2][1:]])


def cell_of(points: FlankPoints | Flanks, nominal: Involute, rolls: int, edges: Array) -> NDArray[np.int64]:
    """Flat index (n,) of the cell, among (2, teeth, rolls, heights), in which each point lies."""
    i = bin_index(points.roll, nominal.control_roll, nominal.tip_roll, rolls)
    j = column_of(points.height, edges)
    return np.asarray((points.flank.astype(np.int64) * rolls + i) * (edges.size - 1) + j)


def number_in(cell: NDArray[np.int64], grid: Grid) -> Array:
    """How many points each cell (2, teeth, roll lengths, heights) has, by the cell (n,) of each point."""
    return np.bincount(cell, minlength=grid.count.size).reshape(grid.count.shape).astype(np.float64)


def each_of(number: NDArray[np.signedinteger[Any]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of groups with a ``number`` (n,) of members: the group of each member, and how many of it are before that one."""
    group = np.repeat(np.arange(number.size), number)
    return group, np.arange(group.size) - (np.cumsum(number) - number)[group]


def column_of(height: Array, edges: Array) -> NDArray[np.int64]:
    """Which of the cells between ``edges`` each height (n,) mm lies in; the first or the last where it lies beyond."""
    return np.clip(np.searchsorted(edges, height, side="right") - 1, 0, edges.size - 2)


def _usual(count: Array | NDArray[np.generic]) -> Array:
    """Median number of points (flanks,) of the cells (flanks, cells) that hold any."""
    return np.array([np.median(c[c > 0]) if c.any() else 0.0 for c in count])


def _often_met(nominal: Involute, rolls: Array) -> Array:
    """How often (rolls, 1) profiles meet a flank at some roll lengths (mm): the share of the most often met of them."""
    often = 1.0 / step_on_flank(nominal, rolls, 1.0)
    return np.asarray(often / often.max())[:, None]


def _without_outliers(count: NDArray[np.int64], often: Array) -> NDArray[np.int64]:
    """Counts (flanks, rolls, heights), 0 where there are so few that they are no part of the flank, which is met so
    ``often`` (rolls, 1).
    """
    usual = _usual((count / often).reshape(len(count), -1))[:, None, None] * often
    return np.where(count >= np.maximum(LEAST_SHARE * usual, 1.0), count, 0)


def centres_of(low: float, high: float, cells: int) -> Array:
    """Centres (cells,) of equal cells from low to high."""
    return np.asarray(low + (np.arange(cells) + 0.5) * (high - low) / cells)


def bin_index(values: Array, low: float, high: float, cells: int) -> NDArray[np.int64]:
    """Which of equal cells from low to high each value (n,) lies in; the first or the last where it lies beyond."""
    return np.clip(((values - low) / (high - low) * cells).astype(np.int64), 0, cells - 1)


def bridge_gaps(cells: Mask, grid: Grid, step: float) -> Mask:
    """The same cells (2, teeth, roll lengths, heights) and those within half a ``step`` of the table (rad) of them:
    what lies between two profiles.
    """
    reach = np.ceil(step_on_flank(grid.nominal, grid.rolls, step) / 2 / grid.size[0]).astype(np.intp)
    bridged = np.zeros_like(cells)
    for i, r in enumerate(reach):
        bridged[:, :, i] = cells[:, :, max(i - r, 0) : i + r + 1].any(axis=2)
    return bridged


def step_on_flank(nominal: Involute, roll: Array | float, step: float) -> Array:
    """Roll length (mm) that one ``step`` of the table (rad) covers where the roll length is ``roll`` mm."""
    square = np.square(np.asarray(roll, dtype=np.float64))
    sine = square / (square + nominal.base_radius**2)
    return np.asarray(nominal.base_radius * abs(step) / np.maximum(sine, 1e-6))


def profiles_for(nominal: Involute, roll: float) -> int:
    """Profiles a turn with which a step covers ``FINE_STEP`` mm of roll length there."""
    return ceil(2 * pi / (FINE_STEP / float(step_on_flank(nominal, roll, 1.0))))
