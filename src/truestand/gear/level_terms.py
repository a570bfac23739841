"""By what two views of the same flanks may differ smoothly: the terms in which it is told, and which cells tell it."""

from dataclasses import dataclass

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.robust import robust_sd
from truestand.gear.geometry import Involute
from truestand.gear.grid import Grid

LEAST_SPAN = 0.5
"""Of the profile, the face or the teeth over which two views must see the same cells for what goes along them to count.
"""
LEAST_CELLS = 30
"""Of a side that two views must both show."""
ROUNDS, MOST_SD, LEAST_SPREAD = 2, 4.0, 1e-6
"""In which differences of cells are left out that lie so many robust standard deviations off, or mm at least."""
SMOOTH, TERMS = 3, 5
"""A shift, a slope along the profile and one along the face; and what goes once round the gear, cosine and sine."""


@dataclass(frozen=True, slots=True)
class Cells:
    """Where cells lie on each flank: at all ``rolls`` and ``heights`` (mm)."""

    nominal: Involute
    rolls: Array
    heights: Array

    @classmethod
    def of(cls, grid: Grid, rows: slice = slice(None), columns: slice = slice(None)) -> "Cells":
        """Those of a grid in some of its rows and columns."""
        return cls(grid.nominal, grid.rolls[rows], grid.heights[columns])


def compared(both: Mask, cells: Cells) -> tuple[Mask, Array]:
    """Of the cells (teeth, roll lengths, heights) that ``both`` of two views show, those in the evaluation ranges, and
    their terms (n, ``TERMS``), 0 for what they don't tell. None where they are too few.
    """
    (low, high), (bottom, top) = cells.nominal.profile_range, cells.nominal.helix_range
    on_profile = (cells.rolls >= low) & (cells.rolls <= high)
    inside = on_profile[:, None] & (cells.heights >= bottom) & (cells.heights <= top)
    seen = both & inside
    if np.count_nonzero(seen.any(axis=0)) < LEAST_CELLS:
        return np.zeros_like(seen), np.zeros((0, TERMS))
    tooth, row, column = np.nonzero(seen)
    smooth = smooth_terms(cells.nominal, cells.rolls[row], cells.heights[column])
    return seen, np.concatenate([smooth, around(cells.nominal)[:, tooth]]).T * _told(seen, inside)


def without_strays(known: Array, apart: Array) -> Mask:
    """Which of some cells, of ``known`` terms (n, terms) and differences ``apart`` (n,) mm, don't stick out of what the
    others tell.
    """
    on = np.ones(apart.shape, dtype=bool)
    for _ in range(ROUNDS if apart.size else 0):
        rest = np.abs(apart - known @ solved(known[on], apart[on]))
        on &= rest <= max(MOST_SD * robust_sd(rest[on]), LEAST_SPREAD)
    return on


def solved(known: Array, values: Array) -> Array:
    """Coefficients (terms, ...) of ``known`` terms (n, terms) that fit values (n, ...) best; 0 of what isn't told."""
    return np.asarray(np.linalg.lstsq(known.T @ known, known.T @ values, rcond=None)[0])


def _told(seen: Mask, inside: Mask) -> Array:
    """(``TERMS``,) 1 for what cells (teeth, roll lengths, heights) that two views both show tell of their difference, 0
    for what they don't.
    """
    cells, teeth = np.asarray(seen.any(axis=0)), np.asarray(seen.any(axis=(1, 2)))
    along = [cells.any(axis=axis).sum() / max(inside.any(axis=axis).sum(), 1) for axis in (1, 0)]
    turn = teeth.mean()
    return np.array([1.0, *(float(span >= LEAST_SPAN) for span in (*along, turn, turn))])


def smooth_terms(nominal: Involute, roll: Array, height: Array) -> Array:
    """(``SMOOTH``, ...): 1, and from -1 to 1 along the profile and along the face."""
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    along_profile = (2 * roll - low - high) / (high - low) + 0.0 * height
    along_face = (2 * height - bottom - top) / (top - bottom) + 0.0 * roll
    return np.stack([np.ones_like(along_profile), along_profile, along_face])


def around(nominal: Involute) -> Array:
    """Cosine and sine (2, teeth) of where teeth stand round the gear."""
    angle = nominal.gear.pitch * np.arange(nominal.gear.teeth)
    return np.stack([np.cos(angle), np.sin(angle)])
