"""Robust statistics: the standard deviation from the median of deviations, Tukey's biweight, medians of many cells."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAD_TO_SD = 1.4826
"""Standard deviation of normal noise over its median absolute deviation: 1 / Phi^-1(3/4)."""
TUKEY = 4.685
"""Tukey's constant: standard deviations at which a weight becomes zero; 95 % efficient for normal noise."""


def robust_sd(deviations: Array) -> float:
    """Standard deviation of normal noise with the same median absolute deviation from 0; deviations of any shape.

    NaN where there are none. Source: Rousseeuw and Croux 1993.
    """
    return MAD_TO_SD * float(np.median(np.abs(deviations))) if deviations.size else float("nan")


def tukey_weights(ratio: Array) -> Array:
    """Tukey's biweight (any shape) of deviations over the limit at which the weight is zero."""
    return np.square(np.maximum(1.0 - np.square(ratio), 0.0))


def medians(
    cell: NDArray[np.integer], values: Array, cells: int, span: float | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Median (cells,) of the values (n,) in each cell, NaN where there is none, and how many there are.

    One sort of one key, the cell before the point and the value behind it: 1e5 cells leave 1e-10 of ``span``. Values
    lie within half a ``span`` of 0; what lies beyond counts as lying there. None: as wide as the values are.
    """
    width = 2.1 * float(np.abs(values).max(initial=1e-9)) if span is None else span
    key = np.sort(cell + np.clip(values / width + 0.5, 0.0, 0.999999))
    count = np.bincount(cell, minlength=cells).astype(np.int64)
    first = np.cumsum(count) - count
    found = np.full(cells, np.nan)
    some = count > 0
    low, high = first[some] + (count[some] - 1) // 2, first[some] + count[some] // 2
    found[some] = ((key[low] + key[high]) / 2 - np.flatnonzero(some) - 0.5) * width
    return found, count
