"""How a column of cells is read at one roll length: between the nearest of them, or, where it says the same, from a
parabola through some more, which is quieter.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from truestand.core.arrays import Array, Ints, Mask

LEAST_WIDE = 5
"""Cells that the parabola needs."""
SAME = 3.5
"""Standard deviations within which the parabola and the nearest cells say the same."""
MOST_LEVELLED = 0.0005
"""mm by which a parabola may level the waves of a flank."""
TINY = 1e-12
"""mm: a cell at the place itself is the one before it."""


@dataclass(frozen=True)
class Reading:
    """How each column is read at one roll length."""

    weights: Array
    """(flanks, heights, roll lengths) of its cells, 0 for those not seen."""
    seen: Mask
    """(flanks, heights): columns with cells on both sides of the place."""
    below: Array
    """(flanks, heights) mm by which the flank may lie below, where it bends between the nearest cells; else 0."""
    above: Array
    """The same above."""

    def __call__(self, delta: Array) -> Array:
        """delta (flanks, heights) there, of cells (2, teeth, roll lengths, heights); 0 where not seen."""
        near, weights = self._near
        cells = np.nan_to_num(delta[:, :, near])
        return np.asarray(np.einsum("frh,frh->fh", weights, cells.reshape(weights.shape)))

    @cached_property
    def _near(self) -> tuple[slice, Array]:
        """The roll lengths of cells that have any weight, and the weights (flanks, roll lengths, heights) of those."""
        on = np.flatnonzero(self.weights.any(axis=(0, 1)))
        near = slice(int(on[0]), int(on[-1]) + 1) if on.size else slice(0)
        return near, np.ascontiguousarray(self.weights[:, :, near].swapaxes(1, 2))


def columns_of(cells: Array) -> Array:
    """Cells (2, teeth, roll lengths, heights) as columns (flanks, heights, roll lengths)."""
    return np.asarray(cells.reshape(-1, *cells.shape[2:]).swapaxes(1, 2))


def reading_at(
    values: Array, x: Array, variance: Array, waves: Array, shared: Array, reaches: Sequence[float], half_cell: float
) -> Reading:
    """How columns of cells (flanks, heights, roll lengths) are read at 0, at ``x`` from it (NaN: not seen).

    ``shared``: by how much more the shape that all teeth have stands there than at 0. On flanks whose ``waves`` a
    parabola would level, the nearest cells stand.

    ``reaches``: mm to either side of which a parabola may take cells, the widest first. Where cells depart from it, or
    it from the nearest cells, by more than noise does, the flank bends there: those stand, and it may be anywhere
    between them, or between the ones next to them where they reach across 0 (``half_cell`` mm), on top of that shape.
    """
    nearest, below, above = _between(x, values - shared, half_cell)
    too_high = (np.nan_to_num(nearest) * shared).sum(axis=2)
    below, above = np.maximum(below + too_high, 0.0), np.maximum(above - too_high, 0.0)
    seen = np.asarray(np.isfinite(nearest).all(axis=2))
    weights, bends = nearest, seen.copy()
    for reach in reaches:
        parabola, off = _parabola(np.where(np.abs(x) < reach, x, np.nan), values, reach, variance)
        apart = parabola - nearest
        noise = np.sqrt((np.nan_to_num(apart) ** 2 * variance).sum(axis=2))
        with np.errstate(invalid="ignore"):
            same = bends & (np.abs((apart * values).sum(axis=2)) <= SAME * noise) & (off <= SAME)
            levelled = np.abs((np.nan_to_num(apart) * waves).sum(axis=2)).max(axis=1) > MOST_LEVELLED
            same &= ~levelled[:, None]
        weights, bends = np.where(same[..., None], parabola, weights), bends & ~same
    return Reading(np.nan_to_num(weights), seen, np.where(bends, below, 0.0), np.where(bends, above, 0.0))


def gap_about(x: Array) -> Array:
    """How far (...) mm those of some ``x`` (..., n) that are nearest to 0 on either side are apart; NaN: not seen."""
    behind, before = np.where(x > 0, x, np.inf).min(axis=-1), np.where(x <= 0, x, -np.inf).max(axis=-1)
    return np.asarray(behind - before)


def _between(x: Array, values: Array, half_cell: float) -> tuple[Array, Array, Array]:
    """Weights (..., n) of straight lines between those nearest to 0 on either side; NaN where a side has none.

    And how far (...) below and above the line at 0 they lie, and those nearest to 0 that don't reach across it.
    """
    low, first = _nearest(-x, 0.0)
    high, last = _nearest(x, TINY)
    known = np.isfinite(first) & np.isfinite(last)
    share = np.where(known, first, 0.0) / np.where(known, first + last, 1.0)
    weights = np.zeros(x.shape)
    np.put_along_axis(weights, low, 1.0 - share, -1)
    np.put_along_axis(weights, high, share, -1)
    weights[~known[..., 0]] = np.nan
    about = [(low, first), (high, last), _nearest(-x, half_cell), _nearest(x, half_cell)]
    ends = [np.where(np.isfinite(d), np.take_along_axis(values, side, -1), np.nan)[..., 0] for side, d in about]
    line = (1.0 - share[..., 0]) * ends[0] + share[..., 0] * ends[1]
    return weights, line - np.fmin.reduce(ends), np.fmax.reduce(ends) - line


def _nearest(distance: Array, least: float) -> tuple[Ints, Array]:
    """Which (..., 1) of some cells (..., n), NaN: not seen, is the nearest of those ``least`` mm and more away, and its
    distance; infinite where there is none.
    """
    away = np.where(distance >= least, distance, np.inf)
    at = away.argmin(axis=-1)[..., None]
    return at, np.take_along_axis(away, at, -1)


def _parabola(x: Array, values: Array, reach: float, variance: Array) -> tuple[Array, Array]:
    """Weights (..., n) that read a parabola through values at ``x`` at 0; NaN with fewer than ``LEAST_WIDE`` of them.

    And by how many standard deviations (...) one of them departs from it at most.
    """
    on = np.isfinite(x)
    u = np.where(on, x / reach, 0.0)
    weight = np.where(on, 1.0 / np.maximum(variance, 1e-18), 0.0)
    weight = weight / np.maximum(weight.max(axis=-1, keepdims=True), 1e-300)
    terms = np.stack([np.ones(u.shape), u, u * u], axis=-1)
    weighted = (terms * weight[..., None]).swapaxes(-1, -2)
    normal = weighted @ terms
    low, *_, high = np.moveaxis(np.linalg.eigvalsh(np.nan_to_num(normal)), -1, 0)
    able = (on.sum(axis=-1) >= LEAST_WIDE) & (high < 1e6 * low)
    normal[~able] = np.eye(3)
    solver = np.linalg.inv(normal) @ weighted
    solver[~able] = np.nan
    rest = values - (terms @ (solver @ values[..., None]))[..., 0]
    off = np.where(on, np.abs(rest) / np.sqrt(np.maximum(variance, 1e-18)), 0.0).max(axis=-1)
    return np.asarray(solver[..., 0, :]), off
