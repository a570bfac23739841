"""Straight lines between the points of a trace, and the mean trace of several columns."""

from dataclasses import dataclass
from math import inf

import numpy as np

from truestand.core.arrays import Array, Ints, Mask

LEAST_COLUMNS = 0.5
"""Share of the columns at the middle of the face that must be seen."""


@dataclass(frozen=True, slots=True)
class Interpolation:
    """Straight lines between values, (flanks, places) each."""

    first: Ints
    """Index of the value before a place,"""
    last: Ints
    """and of the one behind it."""
    share: Array
    """0..1 of the way from one to the other."""
    seen: Mask
    inside: Mask
    """Places between two values; beyond the first and the last one their value holds."""

    def __call__(self, values: Array) -> Array:
        """Values (flanks, n) read at the places; NaN where not seen."""
        before, behind = (np.take_along_axis(values, at, axis=1) for at in (self.first, self.last))
        return np.where(self.seen, before + self.share * (behind - before), np.nan)


@dataclass(frozen=True, slots=True)
class Joined:
    """The mean trace of columns, of each of which some was seen; linear in them, by weights.

    Where some of them end (beyond it they hold their value for a while), the mean of the others goes on by its steps:
    columns stand at other heights where damage ends between them, and the trace must not step where one of them does.
    Fewer than half of them don't say how all go on: there those that hold count, too.
    """

    first: Ints
    """(flanks, columns, places): of the value before a place, its index in all values (flanks, columns, n),"""
    last: Ints
    """and of the one behind it."""
    share: Array
    """0..1 of the way from one to the other."""
    of_mean: Array
    """(flanks, columns, places) in the mean of those seen,"""
    of_step: Array
    """(flanks, columns, places - 1) in its step to the next place,"""
    of_level: Array
    """and (flanks, places) in the mean over the places that most columns reach."""
    seen: Mask
    """(flanks, places): by most columns."""

    def __call__(self, values: Array) -> Array:
        """The trace (flanks, places) of values (flanks, columns, n); NaN where not seen."""
        before, behind = (np.take(values, at) for at in (self.first, self.last))
        read = before + self.share * (behind - before)
        mean = np.einsum("fcp,fcp->fp", self.of_mean, read)
        path = np.zeros(mean.shape)
        np.cumsum(np.einsum("fcp,fcp->fp", self.of_step, np.diff(read, axis=2)), axis=1, out=path[:, 1:])
        level = np.einsum("fp,fp->f", self.of_level, mean - path)
        return np.where(self.seen, path + level[:, None], np.nan)


def joined_columns(columns: tuple[Interpolation, ...], number: int) -> Joined:
    """The mean trace of some columns of so many values, each read at the same places."""
    seen, inside = (np.stack(of, axis=1) for of in ([c.seen for c in columns], [c.inside for c in columns]))
    first, last, share = (np.stack([getattr(c, of) for c in columns], axis=1) for of in ("first", "last", "share"))
    before = number * np.arange(first.shape[0] * len(columns)).reshape(-1, len(columns), 1)
    those, reached = seen.sum(axis=1), inside.sum(axis=1)
    known = those >= LEAST_COLUMNS * len(columns)
    holding, going_on = (on[:, :, 1:] & on[:, :, :-1] for on in (seen, inside))
    most = going_on.sum(axis=1, keepdims=True) >= LEAST_COLUMNS * len(columns)
    stepping = np.where(most, going_on & holding, holding)
    level = (reached == reached.max(axis=1, keepdims=True)) & known
    return Joined(
        before + first, before + last, share, _shares(seen & known[:, None]), _shares(stepping), _shares(level), known
    )


def _shares(on: Mask) -> Array:
    """Weights of those that count, the same for each, along the columns (flanks, columns, places) or places."""
    return np.asarray(on / np.maximum(on.sum(axis=1, keepdims=True), 1))


def interpolation(at: Array, places: Array, beyond: Array, widest: float = inf) -> Interpolation:
    """Straight lines between values of each flank at ``at`` (flanks, n) mm, NaN: not seen, read at ``places``.

    ``beyond`` (flanks, n) mm: so far beyond the first and the last one their value holds; farther nothing is seen, nor
    between two that are more than ``widest`` mm apart.
    """
    seen = np.isfinite(at)
    number = seen.sum(axis=1, keepdims=True)
    order, final = np.argsort(~seen, axis=1, kind="stable"), np.maximum(number - 1, 0)  # those seen come first
    x, reach = (np.take_along_axis(of, order, axis=1) for of in (np.where(seen, at, inf), beyond))
    before = (x[:, None] <= places[:, None]).sum(axis=2)
    below = np.clip(before - 1, 0, np.maximum(number - 2, 0))
    behind = np.minimum(below + 1, final)
    start, end, farthest = (np.take_along_axis(x, k, axis=1) for k in (below, behind, final))
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = end - start
        share = np.where(apart > 0, np.clip((places - start) / apart, 0.0, 1.0), 0.0)
    inside = (places >= x[:, :1]) & (places <= farthest)
    known = (places >= x[:, :1] - reach[:, :1]) & (places <= farthest + np.take_along_axis(reach, final, axis=1))
    known &= (apart <= widest) | ~inside
    first, last = (np.take_along_axis(order, k, axis=1) for k in (below, behind))
    return Interpolation(first, last, share, known, inside)
