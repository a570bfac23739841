"""Medians of many small groups at once."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def medians(cell: NDArray[np.integer], values: Array, cells: int, span: float) -> tuple[Array, NDArray[np.int64]]:
    """Median (cells,) of the values (n,) in each cell, NaN where there is none, and how many there are.

    One sort of one key, the cell before the point and the value behind it: 1e5 cells leave 1e-10 of ``span``. Values
    lie within half a ``span`` of 0; what lies beyond counts as lying there.
    """
    key = np.sort(cell + np.clip(values / span + 0.5, 0.0, 0.999999))
    count = np.bincount(cell, minlength=cells).astype(np.int64)
    first = np.cumsum(count) - count
    found = np.full(cells, np.nan)
    some = count > 0
    low, high = first[some] + (count[some] - 1) // 2, first[some] + count[some] // 2
    found[some] = ((key[low] + key[high]) / 2 - np.flatnonzero(some) - 0.5) * span
    return found, count
