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


def cleared(statistics: Statistics, values: Array, noise: Array, trials: int = TRIALS, seed: int = 1) -> Cleared:
    """Statistics of ``values`` without the share of independent ``noise`` (standard deviations, of values' shape).

    NaN among the values stay; the same seed gives the same answer.
    """
    rng = np.random.default_rng(seed)
    raw = statistics(values)
    noisier = np.stack([statistics(values + noise * rng.standard_normal(values.shape)) for _ in range(trials)])
    more = np.maximum(noisier.mean(axis=0), raw)  # noise never makes them smaller but for the trials' own chance
    value = np.sqrt(np.maximum(2 * raw**2 - more**2, 0.0))
    return Cleared(raw, value, noisier.std(axis=0) if trials > 1 else np.zeros_like(raw))


def from_noise(statistics: Statistics, values: Array, noise: Array, trials: int = TRIALS, seed: int = 1) -> Array:
    """What the statistics (k,) read on average where there is nothing but the noise; NaN among the values stay."""
    rng = np.random.default_rng(seed)
    nothing = 0.0 * values
    return np.asarray(
        np.mean([statistics(nothing + noise * rng.standard_normal(values.shape)) for _ in range(trials)], axis=0)
    )
