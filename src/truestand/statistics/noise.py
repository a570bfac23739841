"""Maxima and ranges read too large from noise; how much, and what remains without it.

A statistic is read again with noise of the known size added, and what it reads is extrapolated to none (SIMEX, Cook and
Stefanski 1994): what is noise only comes out as zero, and what noise hardly touches stays as it is. Noise adds to
extremes by its standard deviation, to the square of a mean square by its variance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.assumptions import K

Statistics = Callable[[Array], Array]
"""Values (..., n) to statistics (k,), each zero or more and growing with noise."""

TRIALS = 30
EXTRAPOLATED = 2.0
"""Times as much as the raw value, an extreme that was extrapolated scatters at most: tried on waves of 0 to 100 times
the noise.
"""


@dataclass(frozen=True, slots=True)
class Cleared:
    """Statistics (k,): as they read, and without the noise's share."""

    raw: Array
    scatter: Array
    """Standard deviation of ``raw`` from noise."""
    value: Array
    u: Array
    """Standard uncertainty of ``value`` from noise. What is taken off scatters, too."""


def cleared(statistics: Statistics, values: Array, noise: Array, extremes: Mask) -> Cleared:
    """Statistics of ``values`` without the share of independent ``noise`` (standard deviations, of values' shape).

    ``extremes`` (k,): those that are maxima or ranges; others are mean squares, or like them. NaN among the values
    stay; the same values give the same answer.
    """
    raw = statistics(values)
    noisier = _with_noise(statistics, values, noise)
    more = np.maximum(noisier.mean(axis=0), raw)  # noise never makes them smaller but for the trials' own chance
    scatter = noisier.std(axis=0)
    by_deviation = np.maximum(raw - (more - raw) / (sqrt(2.0) - 1.0), 0.0)
    square = np.maximum(2 * raw**2 - more**2, 0.0)
    by_variance = np.sqrt(square)
    # What is left of a difference of squares scatters the more, the less is left.
    up = np.sqrt(square + 2 * K * np.abs(raw) * scatter) - by_variance
    value = np.where(extremes, by_deviation, by_variance)
    u = np.where(extremes, EXTRAPOLATED * scatter, np.hypot(up / K, (by_variance - by_deviation) / K))
    return Cleared(raw, scatter, value, u)


def from_noise(statistics: Statistics, values: Array, noise: Array) -> Array:
    """What the statistics (k,) read on average where there is nothing but the noise; NaN among the values stay."""
    return np.asarray(_with_noise(statistics, 0.0 * values, noise).mean(axis=0))


def _with_noise(statistics: Statistics, values: Array, noise: Array) -> Array:
    """The statistics (TRIALS, k) of values with noise drawn on them."""
    rng = np.random.default_rng(1)  # any fixed seed
    return np.stack([statistics(values + noise * rng.standard_normal(values.shape)) for _ in range(TRIALS)])
