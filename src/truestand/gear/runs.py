"""Readings that profiles lack between two on a flank, one by one or in runs, and which of these no chance makes.

A flank is broken or covered there, or readings got lost. Chance makes neither runs much longer than usual, nor runs of
many profiles beside each other at one place. A run that one profile lacks alone, between two that show the flank, got
lost or hides a hole no wider than two steps of the table; where such runs are anywhere, they got lost.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints, Mask
from truestand.gear.flanks import Flanks
from truestand.gear.grid import Grid, bin_index, column_of, each_of, number_in

USUALLY, LONGER, LEAST_RUN = 0.75, 2.5, 4
"""Quantile of the longest runs of readings that flanks of a side lack, how many times as long one must be to be none of
the usual, and by how many readings more.
"""
RUN_BY_CHANCE, LEAST_CHANCE_RUN = 0.01, 3
"""Probability that any run of a side is as long by chance, and readings that such a run has at least."""
LEAST_SHARE, MOST_SHARE = 1e-3, 0.9
"""Share of the lost readings of a side after which the next one is lost, too, at least and at most,"""
BLOCKS_OF_FACE = 4
"""and how many blocks of the face, along and across it, it is told from."""
CELLS_HIGH, OVERLAP = (1, 2, 3, 4, 5, 6), 2.0
"""Cells from which runs are high that are looked at by themselves; times as often as runs reach a cell, another one
overlaps them: it may begin above or below.
"""
ANYWHERE = 5
"""Teeth and blocks with runs that one profile lacks alone, from which they are anywhere: one place of all flanks, or a
groove along or across them, is in four blocks at most.
"""


@dataclass(frozen=True, slots=True)
class Between:
    """Cells (2, teeth, roll lengths, heights) between two readings that a profile has on a flank."""

    cells: Mask
    missed: Mask
    """Of which more readings are missing than there are,"""
    in_runs: Mask
    """where unusually many are missing on end,"""
    alone: Mask
    """where they are and both profiles beside have theirs,"""
    blind: Mask
    """and for which the sensor is blind."""
    on_end: float
    """Cells that get lost together, usually."""


@dataclass(frozen=True, slots=True)
class _Runs:
    """Runs (n,) of readings that profiles lack between two on a flank."""

    length: NDArray[np.int64]
    """Readings of points that see anything; 0 outside the roll lengths that count."""
    flank: Ints
    profile: Ints
    row: Ints
    """Of cells, in which its middle lies."""
    block: Ints
    """Of the face, likewise."""
    columns: Ints
    """(2, n) of cells: those of the readings below and above it."""
    alone: Mask
    """Whether both profiles beside have their readings there."""

    def columns_each(self) -> tuple[Ints, Ints]:
        """The run and the column (m,) of each cell that runs reach."""
        number = np.where(self.length > 0, self.columns[1] - self.columns[0] + 1, 0)
        run, below = each_of(number)
        return run, self.columns[0, run] + below


@dataclass(frozen=True, slots=True)
class _Lacked:
    """Readings (n,) that profiles lack: of which run, and where they would lie."""

    run: Ints
    index: Ints
    """Of the scan."""
    flank: Ints
    roll: Array
    height: Array


def between_readings(flanks: Flanks, grid: Grid, live: Mask, limits: tuple[float, float]) -> Between:
    """What profiles lack on flanks, at roll lengths within ``limits`` (mm).

    ``live`` (points,): points of the sensor that see anything in this scan. What the others don't see is not missing.
    """
    order, apart = flanks.along_profiles(live.size)
    at = np.flatnonzero(apart > 1)
    lacked = _lacked(flanks, order[at], order[at + 1])
    row = _row_of(lacked.roll, grid)
    cell = (lacked.flank * grid.rolls.size + row) * grid.heights.size + column_of(lacked.height, grid.edges)
    of_live = live[lacked.index % live.size]
    # What a profile lacks along the range's end is beyond it, whatever row holds its cell.
    missing, blind = (number_in(cell[of], grid) for of in (of_live & _within(lacked.roll, limits), ~of_live))
    spacing = np.abs(np.diff(flanks.height[order]))[apart == 1]
    of_cell = float(np.median(spacing)) / grid.size[1] if spacing.size else 1.0
    runs = _runs(flanks, grid, limits, (order[at], order[at + 1]), lacked, live)
    usual = _usual_length(runs, grid.delta.shape[1])
    long = _longer_than_usual(runs, usual, grid.delta.shape[1])
    passed = np.asarray(of_cell * np.bincount(_row_of(flanks.roll, grid), minlength=grid.rolls.size))
    by_many = _of_many_profiles(runs, grid, passed) | (long & ~runs.alone)
    in_runs, not_alone = (number_in(cell[told[lacked.run]], grid) > 0 for told in (long | by_many, by_many))
    inside = _within(grid.rolls, limits)[:, None]
    return Between(
        cells=inside & (grid.seen | (missing > 0)),
        missed=inside & (missing > grid.count),
        in_runs=in_runs,
        alone=in_runs & ~not_alone,
        blind=(blind > grid.count) & (missing == 0),
        on_end=1.0 + (usual - 1.0) * min(of_cell, 1.0),
    )


def _lacked(flanks: Flanks, before: Ints, after: Ints) -> _Lacked:
    """The readings that profiles lack between those ``before`` and ``after`` each run, evenly spread."""
    number = flanks.index[after] - flanks.index[before] - 1
    run, lacked_before = each_of(number)
    behind = 1 + lacked_before
    share = behind / (1 + number[run])
    roll, height = (
        (1.0 - share) * values[before[run]] + share * values[after[run]] for values in (flanks.roll, flanks.height)
    )
    return _Lacked(run, flanks.index[before[run]] + behind, flanks.flank[before[run]].astype(np.int64), roll, height)


def _runs(
    flanks: Flanks, grid: Grid, limits: tuple[float, float], ends: tuple[Ints, Ints], lacked: _Lacked, live: Mask
) -> _Runs:
    """The runs between readings (n,) at both ``ends``, of readings ``lacked`` by points that are ``live``."""
    before, after = ends
    of_live, flank = live[lacked.index % live.size], flanks.flank[before]
    length = np.bincount(lacked.run[of_live], minlength=before.size)
    roll, height = ((values[before] + values[after]) / 2 for values in (flanks.roll, flanks.height))
    row, across = _row_of(roll, grid), bin_index(height, grid.edges[0], grid.edges[-1], BLOCKS_OF_FACE)
    before_it, after_it = (np.isin(lacked.index + n, flanks.index, kind="table") for n in (-live.size, live.size))
    columns = np.sort(column_of(np.stack([flanks.height[before], flanks.height[after]]), grid.edges), axis=0)
    return _Runs(
        length=np.where(_within(roll, limits), length, 0),
        flank=flank.astype(np.int64),
        profile=flanks.index[before] // live.size,
        row=row,
        block=row * BLOCKS_OF_FACE // grid.rolls.size * BLOCKS_OF_FACE + across,
        columns=columns,
        alone=np.bincount(lacked.run[of_live & ~(before_it & after_it)], minlength=before.size) == 0,
    )


def _row_of(roll: Array, grid: Grid) -> NDArray[np.intp]:
    """In which row of cells roll lengths (n,) mm lie."""
    return bin_index(roll, grid.nominal.control_roll, grid.nominal.tip_roll, grid.rolls.size)


def _within(roll: Array, limits: tuple[float, float]) -> Mask:
    return np.asarray((roll > limits[0]) & (roll < limits[1]))


def _usual_length(runs: _Runs, teeth: int) -> float:
    """The mean length of the run that a lost reading lies in: few long ones among many single ones count. Where a
    reading that follows a lost one gets lost with a probability p, it is (1 + p) / (1 - p).

    The median of blocks: damage at one place of all flanks, or in a groove along or across them, is in few. Where few
    get lost, most blocks have none; then those tell which profiles lack alone, if they are anywhere.
    """
    every = _lengths(runs.length, runs.block)
    usual = float(np.quantile(np.where(np.isfinite(every), every, 1.0), 0.5, method="lower"))
    of_alone = _lengths(np.where(runs.alone, runs.length, 0), runs.block)
    told = of_alone[np.isfinite(of_alone)]
    if min(told.size, np.unique(runs.flank[runs.alone & (runs.length > 0)] % teeth).size) < ANYWHERE:
        return usual
    return max(usual, float(np.quantile(told, 0.5, method="lower")))


def _lengths(length: NDArray[np.int64], block: Ints) -> Array:
    """By blocks of the face, the mean length of the run that a lost reading lies in; NaN where none is lost."""
    lost, squares = (np.bincount(block, length**n, minlength=BLOCKS_OF_FACE**2) for n in (1, 2))
    return np.where(lost > 0, squares / np.maximum(lost, 1.0), np.nan)


def _longer_than_usual(runs: _Runs, usual: float, teeth: int) -> Mask:
    """Which runs (n,) are longer than chance makes the longest one of a flank: than most flanks have it, and, as most
    may be damaged alike, than it is where each lost reading is followed by another one as seldom as their ``usual``
    length says.
    """
    longest = np.zeros(2 * teeth)
    np.maximum.at(longest, runs.flank, runs.length)
    on_most = LONGER * np.quantile(longest.reshape(2, teeth), USUALLY, axis=1) + LEAST_RUN
    side = runs.flank // teeth
    number = np.bincount(side[runs.length > 0], minlength=2)
    share = np.clip((usual - 1.0) / (usual + 1.0), LEAST_SHARE, MOST_SHARE)
    by_chance = 1.0 + np.log(RUN_BY_CHANCE / np.maximum(number, 1)) / np.log(share)
    return np.asarray(runs.length >= np.minimum(on_most, np.maximum(by_chance, LEAST_CHANCE_RUN))[side])


def _of_many_profiles(runs: _Runs, grid: Grid, passed: Array) -> Mask:
    """Which runs (n,) so many profiles beside each other have overlapping as chance does not, where each is followed by
    another one as seldom as they are in that row of cells; and which of those that are so many cells high at least.

    ``passed`` (roll lengths,): how many cells of a row all profiles pass.
    """
    run, column = runs.columns_each()
    side, high = runs.flank // grid.delta.shape[1], np.bincount(run, minlength=runs.length.size)
    told = np.zeros(runs.length.size, dtype=bool)
    for least in CELLS_HIGH:
        of = high[run] >= least
        profiles = _beside_each_other(runs, run[of], column[of])
        of_row = np.bincount(runs.row[run[of]], minlength=grid.rolls.size) / np.maximum(passed, 1.0)
        share = np.clip(OVERLAP * of_row[runs.row], LEAST_SHARE, MOST_SHARE)
        number = np.bincount(side[high >= least], minlength=2)[side]
        told |= (high >= least) & (number * share ** (profiles - 1.0) < RUN_BY_CHANCE)
    return told


def _beside_each_other(runs: _Runs, run: Ints, column: Ints) -> Array:
    """Over how many profiles beside each other runs (n,) go on, that overlap from one to the next in some ``column``
    (m,) of a ``run`` (m,).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    flank, profile, number = runs.flank[run], runs.profile[run], runs.length.size
    order = np.lexsort((profile, column, flank))
    follows = np.logical_and.reduce([np.diff(v[order]) == step for v, step in ((flank, 0), (column, 0), (profile, 1))])
    ends = run[order[:-1][follows]], run[order[1:][follows]]
    _, chain = connected_components(coo_array((np.ones(ends[0].size), ends), (number, number)), directed=False)
    first, last = np.full(number, np.iinfo(np.int64).max), np.zeros(number, dtype=np.int64)
    np.minimum.at(first, chain, runs.profile)
    np.maximum.at(last, chain, runs.profile)
    return np.asarray((last - first)[chain] + 1.0)
