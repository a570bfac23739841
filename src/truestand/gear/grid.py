"""Flank points reduced to cells of roll length times height, one grid a tooth and flank: what everything is read from.

A cell's value is the mean of the points about its median: strays have no vote. Its median of *all* points is kept
beside it, because trimming would hide a deep dent.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from truestand.core.robust import medians, robust_sd
from truestand.gear.flanks import END_MARGIN, GATE, FlankPoints, Flanks
from truestand.gear.geometry import Involute

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

HEIGHT_CELL = 0.5
"""mm."""
CLIP = 3.5
"""Robust standard deviations about a cell's median that have a vote."""
SPAN = 16 * GATE
"""mm of delta that medians are told in: the published compensation moves teeth by millimetres."""
STRAY = 0.25
"""Share of the flank's usual number of points below which a cell's points are strays that fell where nothing is."""
LEAST_SPREAD = 1e-4
"""mm: the scatter within cells is not taken for less."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Cells (2 flanks, teeth, roll lengths, heights)."""

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
    heights: Array
    """(heights,) mm in C, cell centres."""
    scatter: float
    """Robust standard deviation of a point within its cell, mm."""

    @property
    def seen(self) -> Bools:
        """Cells that hold a point."""
        return np.asarray(self.count > 0)

    @property
    def usual(self) -> Array:
        """Points (2, teeth, 1, 1) that a seen cell of each flank usually holds; 0 where nothing was seen."""
        flanks = self.count.reshape(*self.count.shape[:2], -1)
        medians_ = [[np.median(c[c > 0]) if c.any() else 0.0 for c in side] for side in flanks]
        return np.array(medians_)[:, :, None, None]


def grid_of(flanks: Flanks, nominal: Involute, height_cell: float = HEIGHT_CELL) -> Grid:
    """The cells of all flanks, (2, teeth, roll lengths, heights), ``height_cell`` mm high."""
    g = nominal.gear
    low, high = _face(nominal)
    rolls = ceil(nominal.control_length / g.evaluation.resolution)
    heights = max(1, ceil((high - low) / height_cell))
    shape = (2, g.teeth, rolls, heights)
    cell = cell_of(flanks, nominal, rolls, heights)
    cells = int(np.prod(shape))
    median, count = medians(cell, flanks.delta, cells, SPAN)
    count = _without_strays(count.reshape(2 * g.teeth, -1)).reshape(-1)
    median = np.where(count > 0, median, np.nan)
    off = np.abs(flanks.delta - median[cell])
    known = off[np.isfinite(off)]
    scatter = max(robust_sd(known) if known.size else 0.0, LEAST_SPREAD)
    voting = off < CLIP * scatter
    votes = np.bincount(cell[voting], minlength=cells)

    def mean(values: Array) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.bincount(cell[voting], values[voting], minlength=cells) / votes)

    centres = centres_of(nominal.control_roll, nominal.tip_roll, rolls), centres_of(low, high, heights)
    roll, height = mean(flanks.roll).reshape(shape), mean(flanks.height).reshape(shape)
    return Grid(
        mean(flanks.delta).reshape(shape),
        median.reshape(shape),
        np.where(np.isnan(roll), centres[0][:, None], roll),
        np.where(np.isnan(height), centres[1], height),
        count.reshape(shape).astype(np.float64),
        *centres,
        scatter,
    )


def cell_of(points: FlankPoints | Flanks, nominal: Involute, rolls: int, heights: int) -> NDArray[np.int64]:
    """Flat index (n,) of the cell, among (2, teeth, rolls, heights), in which each point lies."""
    i = _place(points.roll, nominal.control_roll, nominal.tip_roll, rolls)
    j = _place(points.height, *_face(nominal), heights)
    return np.asarray((points.which.astype(np.int64) * rolls + i) * heights + j)


def _face(nominal: Involute) -> tuple[float, float]:
    """Heights between which flanks have cells."""
    return nominal.gear.face_from + END_MARGIN, nominal.gear.face_to - END_MARGIN


def _without_strays(count: NDArray[np.int64]) -> NDArray[np.int64]:
    """Counts (flanks, cells), 0 where there are so few that they are no part of the flank."""
    usual = np.array([np.median(c[c > 0]) if c.any() else 0.0 for c in count])
    return np.where(count >= np.maximum(STRAY * usual, 1.0)[:, None], count, 0)


def centres_of(low: float, high: float, cells: int) -> Array:
    """Centres (cells,) of equal cells from low to high."""
    return np.asarray(low + (np.arange(cells) + 0.5) * (high - low) / cells)


def _place(values: Array, low: float, high: float, cells: int) -> NDArray[np.int64]:
    return np.clip(((values - low) / (high - low) * cells).astype(np.int64), 0, cells - 1)
