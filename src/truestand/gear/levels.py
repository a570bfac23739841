"""Views that read the same flanks a little differently, laid onto each other.

What a sensor makes of steep flanks, of its range and of a laser plane that stands beside where the calibration has it
is alike on every tooth of a side: a shift, a slope along the profile and one along the face. What the table's angle and
its axis make of flanks goes once round the gear, and views beside each other meet it at other angles. All of it is in
the budget of each view; left between them it would be a step on every flank where one of them ceases to see it, which
looks like damage. The same view reads as another one where the part was turned over: what it makes of left flanks it
then makes of right ones, so that their mean is free of much of it (reversal).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.message import Message
from truestand.core.robust import robust_sd
from truestand.gear.disagreement import disagreements
from truestand.gear.fillet import surely_on_flanks
from truestand.gear.flanks import Flanks
from truestand.gear.grid import Grid, grid_of, means_of
from truestand.gear.level_terms import LEAST_CELLS, SMOOTH, TERMS, Cells, around, compared, smooth_terms, without_strays
from truestand.gear.views import GearView, joined, part_of


def levelled(views: tuple[GearView, ...]) -> tuple[tuple[GearView, ...], tuple[Message, ...]]:
    """The views with their flanks at the mean of what all of them read, and why nothing may be decided: slopes that
    differ by more than sensors do. One view alone as it is.
    """
    readers = list(dict.fromkeys(view.calibration.reader for view in views))
    if len(readers) < 2:
        return views, ()
    flanks = joined([view.borne_out() for view in views], views)
    grid = grid_of(flanks)
    means = _by_reader(views, flanks, grid)
    off = _levels(means, grid)
    of_view = [off[readers.index(view.calibration.reader)] for view in views]
    sure = surely_on_flanks(views, [_of_readings(v.flanks, own) for v, own in zip(views, of_view, strict=True)])
    level = (replace(v, flanks=_without(v.flanks, own), level=own) for v, own in zip(sure, of_view, strict=True))
    return tuple(level), disagreements(views, readers, means, grid)


def left_between(views: Sequence[GearView], flanks: Flanks, grid: Grid) -> float:
    """Standard deviation (mm) of what views that are laid onto each other still read otherwise in the cells that they
    both show, noise included; 0 for one view. Readings of the one between those of the other seem to depart by it.
    """
    if len({view.calibration.reader for view in views}) < 2:
        return 0.0
    means = _by_reader(views, flanks, grid)
    apart = [np.where(grid.in_ranges, a - b, np.nan) for a, b in combinations(means, 2)]
    told = np.concatenate([of[np.isfinite(of)] for of in apart])
    return robust_sd(told) if told.size >= LEAST_CELLS else 0.0


def level_of(view: GearView, grid: Grid) -> Array:
    """By how much (2, teeth, roll lengths, heights) mm a view reads flanks more than the mean of all."""
    return _in_cells(np.zeros((2, TERMS)) if view.level is None else view.level, grid)


def levelling(shares: Array, readers: Sequence[str], grid: Grid) -> Callable[[Array], Array]:
    """What is left of fields (views, 2, teeth, roll lengths, heights) mm, by which each view may read delta otherwise,
    when views are laid onto each other: ``shares`` of each view in the cells, who ``readers`` are (views,).

    Inputs move all cells of a view smoothly: none of them stands out as a stray.
    """
    names = list(dict.fromkeys(readers))
    if len(names) < 2:
        return lambda fields: fields
    of = np.array([names.index(reader) for reader in readers])
    whole = np.stack([shares[of == n].sum(axis=0) for n in range(len(names))])
    seen, weights = (whole > 0) & grid.seen, shares / np.where(whole > 0, whole, 1.0)[of]
    solved = [_solved(seen[:, side], grid) for side in (0, 1)]

    def left(fields: Array) -> Array:
        read = weights * fields
        means = np.stack([read[of == n].sum(axis=0) for n in range(len(names))])
        off = np.stack([solve(means[:, side]) for side, solve in enumerate(solved)], axis=1)
        return np.asarray(fields - _in_cells(off, grid)[of])

    return left


def _by_reader(views: Sequence[GearView], flanks: Flanks, grid: Grid) -> list[Array]:
    """What each reader's views show of the cells (2, teeth, roll lengths, heights) mm; ``flanks``: of all views."""
    readers = [view.calibration.reader for view in views]
    return [
        means_of([part_of(flanks, views, k) for k, of in enumerate(readers) if of == reader], grid)
        for reader in dict.fromkeys(readers)
    ]


def _levels(means: Sequence[Array], grid: Grid) -> Array:
    """By how much (readers, 2, ``TERMS``) mm each one reads more than the mean of all; ``means``: of each one, (2,
    teeth, roll lengths, heights) mm; NaN: not seen.
    """
    return np.stack([_off([m[side] for m in means], grid) for side in (0, 1)], axis=1)


def _off(means: Sequence[Array], grid: Grid) -> Array:
    """By how much (views, ``TERMS``) mm each view reads more than the mean of all, on one side's flanks.

    ``means``: of each view, (teeth, roll lengths, heights) mm; NaN: not seen.
    """
    pairs = []
    for a, b in combinations(range(len(means)), 2):
        apart = means[a] - means[b]
        seen, known = compared(np.isfinite(apart), Cells.of(grid))
        on = without_strays(known, apart[seen])
        pairs.append((a, b, known[on], apart[seen][on]))
    normal = _normal(len(means), [(a, b, known) for a, b, known, _ in pairs])
    right = _right(len(means), pairs)
    return np.asarray(np.linalg.lstsq(normal, right.reshape(-1), rcond=None)[0].reshape(right.shape))


def _solved(seen: Mask, grid: Grid) -> Callable[[Array], Array]:
    """The same for any means of views that show these cells, (views, teeth, roll lengths, heights); all count."""
    pairs = list(combinations(range(len(seen)), 2))
    told = [compared(seen[a] & seen[b], Cells.of(grid)) for a, b in pairs]
    normal = _normal(len(seen), [(*pair, known) for pair, (_, known) in zip(pairs, told, strict=True)])
    inverse = np.linalg.pinv(normal)

    def solve(means: Array) -> Array:
        apart = [(a, b, known, (means[a] - means[b])[both]) for (a, b), (both, known) in zip(pairs, told, strict=True)]
        right = _right(len(means), apart)
        return np.asarray((inverse @ right.reshape(-1)).reshape(right.shape))

    return solve


def _normal(views: int, told: Sequence[tuple[int, int, Array]]) -> Array:
    """The normal equations (views ``TERMS``, views ``TERMS``) of what pairs of views differ by in cells of ``known``
    terms (n, ``TERMS``); the mean of all views stays.
    """
    normal = np.zeros((views, TERMS, views, TERMS)) + np.eye(TERMS)[None, :, None, :]
    for a, b, known in told:
        for i, j in product((a, b), repeat=2):
            normal[i, :, j] += (known.T @ known) * (1.0 if i == j else -1.0)
    return np.asarray(normal.reshape(views * TERMS, -1))


def _right(views: int, told: Sequence[tuple[int, int, Array, Array]]) -> Array:
    """The right side (views, ``TERMS``) of these equations, of cells that are so many mm (n,) apart."""
    right = np.zeros((views, TERMS))
    for a, b, known, apart in told:
        right[a] += known.T @ apart
        right[b] -= known.T @ apart
    return right


def _in_cells(level: Array, grid: Grid) -> Array:
    """A level (..., ``TERMS``) mm in the cells (..., teeth, roll lengths, heights)."""
    smooth = np.tensordot(level[..., :SMOOTH], smooth_terms(grid.nominal, grid.rolls[:, None], grid.heights), 1)
    turning = np.tensordot(level[..., SMOOTH:], around(grid.nominal), 1)
    return np.asarray(smooth[..., None, :, :] + turning[..., None, None])


def _without(flanks: Flanks, off: Array) -> Flanks:
    """The flanks without what their view reads more than the others, (2, ``TERMS``) mm."""
    return replace(flanks, delta=flanks.delta - _of_readings(flanks, off))


def _of_readings(flanks: Flanks, off: Array) -> Array:
    """A level (2, ``TERMS``) mm at the readings (n,) of flanks."""
    nominal = flanks.toothing.nominal
    side, tooth = np.divmod(flanks.flank, nominal.gear.teeth)
    smooth = (off[side, :SMOOTH].T * smooth_terms(nominal, flanks.roll, flanks.height)).sum(axis=0)
    turning = off[:, SMOOTH:] @ around(nominal)
    return np.asarray(smooth + turning[side, tooth])
