"""Filters of roundness by undulations per revolution: Gaussian (ISO 12181-2, ISO 16610-21) and sharp (brick wall).

A harmonic of n UPR passes the Gaussian with 2^-((n/nc)^2), half at the cut-off nc; the sharp filter lets all pass up to
nc, and none beyond. Evenly spaced profiles go through a Fourier transform, which is exact; others through least squares
of the harmonics that pass.
"""

from dataclasses import dataclass
from math import pi, tau
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe, NotEnoughData

FilterKind = Literal["gaussian", "sharp"]

EVEN_SPACING = 1e-6
"""Largest departure from even spacing, as a share of it, at which a profile counts as evenly spaced."""
NEGLIGIBLE = 4
"""From this many cut-offs on nothing passes the Gaussian: 2^-16."""
MOST_UPR = 100_000.0
"""No profile has as many points."""


@dataclass(frozen=True, slots=True)
class UprFilter:
    """A low-pass filter with its cut-off in UPR."""

    cutoff: float
    kind: FilterKind = "gaussian"

    def __post_init__(self) -> None:
        if not 0 < self.cutoff <= MOST_UPR:
            raise BadRecipe(
                f"found a cut-off of {self.cutoff:g} UPR, need a positive one up to {MOST_UPR:g}; 15, 50, 150 and 500 "
                "are usual"
            )

    @property
    def highest(self) -> float:
        """UPR beyond which nothing passes."""
        return self.cutoff * (NEGLIGIBLE if self.kind == "gaussian" else 1)

    def transmission(self, upr: NDArray[Any]) -> Array:
        """Share (n,) of each harmonic's amplitude that passes."""
        relative = np.asarray(upr, dtype=np.float64) / self.cutoff
        return np.exp2(-np.square(relative)) if self.kind == "gaussian" else np.where(relative <= 1.0, 1.0, 0.0)


def upr_filter(angle: Array, deviation: Array, low_pass: UprFilter) -> Array:
    """The waves of a profile that pass: deviations (n,) at angles (n,) rad in any order.

    Raises:
        NotEnoughData: the profile is open, or too few samples for the cut-off.
    """
    order = np.argsort(angle)
    sorted_, n = np.asarray(angle)[order], len(angle)
    gaps = np.diff(np.append(sorted_, sorted_[0] + tau))
    if np.abs(gaps - tau / n).max() <= EVEN_SPACING * tau / n:
        passed = filtered_evenly(deviation[order], low_pass)
    else:
        highest = max(1, min(int(low_pass.highest), n // 4))
        _demand_closed(float(gaps.max()), highest)
        passed = _uneven(sorted_, deviation[order], low_pass, highest)
    out = np.empty(n)
    out[order] = passed
    return out


def filtered_evenly(deviation: Array, low_pass: UprFilter) -> Array:
    """The waves that pass of closed profiles (..., n) mm of even spacing."""
    spectrum = np.fft.rfft(deviation)
    return np.fft.irfft(spectrum * low_pass.transmission(np.arange(spectrum.shape[-1])), deviation.shape[-1])


def _demand_closed(gap: float, highest: int) -> None:
    """Half of the shortest wave that passes is what a gap may hide."""
    limit = pi / highest * 1.5
    if gap > limit:
        raise NotEnoughData(
            f"found a gap of {np.degrees(gap):.1f} degrees in the profile, need a closed one (at most "
            f"{np.degrees(limit):.1f} for this cut-off); measure the whole circumference or filter more strongly"
        )


def _uneven(angle: Array, deviation: Array, low_pass: UprFilter, highest: int) -> Array:
    """Least squares of all harmonics up to ``highest``; the normal matrix depends on differences of orders only."""
    turn = np.exp(1j * angle)
    moments = np.empty(2 * highest + 1, dtype=np.complex128)
    right = np.empty(highest + 1, dtype=np.complex128)
    wave = np.ones(angle.size, dtype=np.complex128)
    for k in range(2 * highest + 1):
        moments[k] = wave.sum()
        if k <= highest:
            right[k] = wave.conj() @ deviation
        wave *= turn
    both = np.concatenate([np.conj(right[:0:-1]), right])
    lag = np.subtract.outer(np.arange(both.size), np.arange(both.size))
    matrix = np.where(lag >= 0, np.conj(moments[np.abs(lag)]), moments[np.abs(lag)])
    series = np.linalg.solve(matrix, both)[highest:] * low_pass.transmission(np.arange(highest + 1))
    passed = np.full(angle.size, float(series[0].real))
    wave = np.ones(angle.size, dtype=np.complex128)
    for k in range(1, highest + 1):
        wave *= turn
        passed += 2.0 * (series[k] * wave).real
    return passed
