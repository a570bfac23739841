"""Maxima and ranges read too large from noise; how much, and what remains without it.

A statistic is read again with noise of the known size added, and the square of what it reads is extrapolated along the
variance to none (SIMEX, Cook and Stefanski 1994): what is noise only comes out as zero, and what noise hardly touches
stays as it is.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from truestand.core.arrays import Array

Statistics = Callable[[Array], Array]
"""Values (..., n) to statistics (k,), each zero or more and growing with noise."""

TRIALS = 30


@dataclass(frozen=True, slots=True)
class Cleared:
    """Statistics (k,): as they read, without the noise's share, and their standard deviation from noise."""

    raw: Array
    value: Array
    u: Array


def cleared(statistics: Statistics, values: Array, noise: Array) -> Cleared:
    """Statistics of ``values`` without the share of independent ``noise`` (standard deviations, of values' shape).

    NaN among the values stay; the same values give the same answer.
    """
    raw = statistics(values)
    noisier = _with_noise(statistics, values, noise)
    more = np.maximum(noisier.mean(axis=0), raw)  # noise never makes them smaller but for the trials' own chance
    value = np.sqrt(np.maximum(2 * raw**2 - more**2, 0.0))
    return Cleared(raw, value, noisier.std(axis=0))


def from_noise(statistics: Statistics, values: Array, noise: Array) -> Array:
    """What the statistics (k,) read on average where there is nothing but the noise; NaN among the values stay."""
    return np.asarray(_with_noise(statistics, 0.0 * values, noise).mean(axis=0))


def _with_noise(statistics: Statistics, values: Array, noise: Array) -> Array:
    """The statistics (TRIALS, k) of values with noise drawn on them."""
    rng = np.random.default_rng(1)  # any fixed seed
    return np.stack([statistics(values + noise * rng.standard_normal(values.shape)) for _ in range(TRIALS)])
