"""Robust statistics, and the one rule by which a reading is an outlier: Tukey's biweight.

Weights, cost, slope and correction belong together: all fits take them from here. Below them stand the medians and
trimmed means of many cells at once.
"""

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask

MAD_TO_SD = 1.4826
"""Standard deviation of normal noise over its median absolute deviation: 1 / Phi^-1(3/4)."""
TUKEY = 4.685
"""Tukey's constant: standard deviations at which a weight becomes zero; 95 % efficient for normal noise."""
TRIMMED_SD = 4.0
"""Robust standard deviations from a cell's mean beyond which a value is left out of it."""
TRIMMING_PASSES = 4
MOST_FIT_STEPS = 30
FIT_SETTLED = 1e-9
"""Change of a solution, in its own unit, below which it is settled."""


def robust_sd(deviations: Array) -> float:
    """Standard deviation of normal noise with the same median absolute deviation from 0; deviations of any shape.

    NaN where there are none. Source: Rousseeuw and Croux 1993.
    """
    return MAD_TO_SD * float(np.median(np.abs(deviations))) if deviations.size else float("nan")


def tukey_weights(ratio: Array) -> Array:
    """Tukey's biweight (any shape) of deviations over the limit at which the weight is zero (Beaton and Tukey 1974)."""
    return np.square(np.maximum(1.0 - np.square(ratio), 0.0))


def tukey_slopes(weights: Array) -> Array:
    """Derivative of the score (weight times deviation) by the deviation, dimensionless, of weights (any shape)."""
    return np.asarray(5.0 * weights - 4.0 * np.sqrt(weights))


def tukey_cost(ratio: Array) -> float:
    """Sum of the cost that the weights minimise, in squared standard deviations of the noise."""
    remaining = np.maximum(1.0 - np.square(ratio), 0.0)
    return TUKEY**2 / 3.0 * float(np.sum(1.0 - remaining * remaining * remaining))


def m_estimator_correction(weight: float, slope: float) -> float:
    """How much more an estimate scatters than its weights say, at most 2: their sum over the sum of the score's slopes.

    Source: Huber 1981, section 6.6.
    """
    return weight / max(slope, 0.5 * weight, 1e-300)


def tukey_fit(design: Array, samples: Array, least_limit: float) -> tuple[Array, Array]:
    """Least squares of samples (n,) by Tukey's weights: the solution (m,) for a design (n, m), and the weights (n,).

    ``least_limit`` (the samples' unit): deviations below it are never outliers.
    """
    solution = np.linalg.lstsq(design, samples, rcond=None)[0]
    for _ in range(MOST_FIT_STEPS):
        deviations = samples - design @ solution
        weights = tukey_weights(deviations / max(TUKEY * robust_sd(deviations), least_limit))
        before = solution
        solution = np.linalg.lstsq(design * weights[:, None], samples * weights, rcond=None)[0]
        if np.abs(solution - before).max() < FIT_SETTLED:
            break
    return np.asarray(solution), weights


def nan_median(values: Array, axis: int) -> Array:
    """Median along an axis, NaN aside; NaN where there is nothing else (``np.nanmedian`` warns there, and is slow)."""
    ordered = np.sort(values, axis=axis)  # NaN last
    number = np.isfinite(ordered).sum(axis=axis, keepdims=True)
    low, high = np.maximum(number - 1, 0) // 2, number // 2
    pair = [np.take_along_axis(ordered, np.minimum(i, ordered.shape[axis] - 1), axis) for i in (low, high)]
    return np.asarray(np.where(number > 0, (pair[0] + pair[1]) / 2, np.nan).squeeze(axis))


def row_medians(values: Array, on: Mask, least: int) -> Array:
    """Median (N,) of each row's values (N, M) that are ``on``; NaN where they are fewer than ``least``."""
    enough = np.count_nonzero(on, axis=1) >= least
    return nan_median(np.where(on & enough[:, None], values, np.nan), axis=1)


def medians(
    cell: NDArray[np.integer], values: Array, cells: int, span: float | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Median (cells,), in the values' unit, of the values (n,) in each cell, NaN where there is none; and their number.

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


def trimmed_means(cell: NDArray[np.integer], values: Array, cells: int) -> tuple[Array, Array]:
    """Mean (cells,) of the values (n,) in each cell without outliers, 0 where there is none, and how many they are."""
    trusted = np.ones(values.size, dtype=np.bool_)
    for _ in range(TRIMMING_PASSES):
        count = np.bincount(cell[trusted], minlength=cells).astype(np.float64)
        means = np.bincount(cell[trusted], values[trusted], cells) / np.maximum(count, 1.0)
        off = np.abs(values - means[cell])
        trusted = off < TRIMMED_SD * robust_sd(off) + 1e-9
    return means, count
