"""A trace as a series: least squares at known frequencies, and the nearest Fourier bin to compare with.

Least squares at the known frequency is exact for any arc; the nearest bin of a discrete Fourier transform leaks
whenever the arc is no whole number of turns (theory page, *Leakage*).
"""

from dataclasses import dataclass
from math import atan2, hypot, pi

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import NotEnoughData

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Harmonics:
    """mean + sum over ``orders`` of cos_i cos(n_i t) + sin_i sin(n_i t) (+ drift from first to last sample)."""

    orders: tuple[int, ...]
    mean: float
    cos: Array
    sin: Array
    drift: float = 0.0

    def amplitude(self, upr: int) -> float:
        """Amplitude of the harmonic ``upr``, in the trace's unit."""
        i = self.orders.index(upr)
        return hypot(self.cos[i], self.sin[i])

    def phase(self, upr: int) -> float:
        """Phase p of the harmonic A cos(upr t - p), rad in (-pi, pi]."""
        i = self.orders.index(upr)
        return atan2(self.sin[i], self.cos[i])

    def __call__(self, angle: Array) -> Array:
        """The series at ``angle`` (rad), without the drift."""
        phases = np.multiply.outer(np.asarray(angle, dtype=np.float64), np.array(self.orders, dtype=np.float64))
        return self.mean + np.cos(phases) @ self.cos + np.sin(phases) @ self.sin


def fit_harmonics(angle: Array, trace: Array, orders: tuple[int, ...] = (1,), drift: bool = False) -> Harmonics:
    """Linear least squares of a trace (N,) over table angle (N,) rad; NaN samples are left out.

    Raises:
        NotEnoughData: fewer samples than coefficients.
    """
    design, samples = _system(angle, trace, orders, drift)
    return _series(orders, _solve(design, samples), drift)


def fit_harmonics_robustly(
    angle: Array, trace: Array, orders: tuple[int, ...], least: float, passes: int = 15
) -> Harmonics:
    """Least absolute deviations of a trace (N,) over table angle (N,) rad, by least squares weighted again and again.

    Deviations below ``least`` (the trace's unit) weigh the same.

    Raises:
        NotEnoughData: fewer samples than coefficients.
    """
    design, samples = _system(angle, trace, orders, False)
    weighted, solution = design, np.zeros(design.shape[1])
    for _ in range(passes):
        solution = _solve(weighted.T @ design, weighted.T @ samples)
        weighted = design / np.maximum(np.abs(samples - design @ solution), least)[:, None]
    return _series(orders, solution, False)


def _system(angle: Array, trace: Array, orders: tuple[int, ...], drift: bool) -> tuple[Array, Array]:
    """Design matrix (n, columns) and samples (n,) of what was seen."""
    seen = np.isfinite(trace) & np.isfinite(angle)
    columns = 1 + 2 * len(orders) + drift
    if np.count_nonzero(seen) < columns:
        raise NotEnoughData(
            f"found {np.count_nonzero(seen)} samples, need {columns} for {len(orders)} harmonics; scan for longer"
        )
    return _design(angle, orders, drift)[seen], trace[seen]


def _solve(design: Array, samples: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, samples, rcond=None)[0], dtype=np.float64)


def _series(orders: tuple[int, ...], solution: Array, drift: bool) -> Harmonics:
    n = len(orders)
    mean, last = float(solution[0]), float(solution[-1]) if drift else 0.0
    return Harmonics(orders, mean, solution[1 : 1 + n], solution[1 + n : 1 + 2 * n], last)


def _design(angle: Array, orders: tuple[int, ...], drift: bool) -> Array:
    phases = np.multiply.outer(angle, np.array(orders, dtype=np.float64))
    parts = [np.ones((angle.size, 1)), np.cos(phases), np.sin(phases)]
    if drift:
        parts.append(np.linspace(-0.5, 0.5, angle.size)[:, None])
    return np.hstack(parts)


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """mean + amplitude cos(2 pi frequency t - phase); ``sd`` is of the residual with n - 4 degrees of freedom."""

    mean: float
    amplitude: float
    frequency: float
    """Per unit of time."""
    phase: float
    sd: float


FINER = 8
"""Frequencies tried between two Fourier bins: the best fit's valley is one bin wide, so none is stepped over."""


def fit_sinusoid(time: Array, samples: Array) -> Sinusoid:
    """The least-squares sinusoid of unknown frequency: every frequency is tried, then the best one sharpened.

    A local solver from a guessed frequency ends in whatever valley it starts in (NIST's LEW data are a trap of that
    kind); mean, cosine and sine are solved exactly for every frequency, which leaves one unknown to search.

    Raises:
        NotEnoughData: fewer than five samples, or no span of time.
    """
    span = float(np.ptp(time)) if time.size else 0.0
    if time.size < 5 or span <= 0:
        raise NotEnoughData(f"found {time.size} samples over {span:g}, need five at different times; measure longer")
    highest = 0.5 * (time.size - 1) / span
    tried = np.arange(0.5, FINER * highest * span) / (FINER * span)
    best = float(tried[int(np.argmin([_misfit(time, samples, f) for f in tried]))])
    width = 1.0 / (FINER * span)
    for _ in range(40):  # golden section: each pass keeps 0.618 of the valley
        lower, upper = best - 0.382 * width, best + 0.382 * width
        costs = [_misfit(time, samples, f) for f in (lower, best, upper)]
        best, width = (lower, best, upper)[int(np.argmin(costs))], 0.618 * width
    wave = fit_harmonics(2 * pi * best * time, samples)
    sd = float(np.sqrt(_misfit(time, samples, best) / (time.size - 4)))
    return Sinusoid(wave.mean, wave.amplitude(1), best, wave.phase(1), sd)


def _misfit(time: Array, samples: Array, frequency: float) -> float:
    """Sum of squares that the best sinusoid of this frequency leaves."""
    design = _design(2 * pi * frequency * time, (1,), False)
    left = samples - design @ _solve(design, samples)
    return float(left @ left)


@dataclass(frozen=True, slots=True)
class Bin:
    """One bin of a discrete Fourier transform: amplitude and phase of A cos(2 pi k i / N - phase)."""

    index: int
    amplitude: float
    phase: float


def nearest_bin(trace: Array, revolutions: float) -> Bin:
    """The Fourier bin next to once per turn (paper Eq. 9): the published estimate, leakage included."""
    index = max(1, round(revolutions))
    spectrum = np.fft.rfft(trace - trace.mean())
    value = 2.0 * spectrum[index] / trace.size
    return Bin(index, float(abs(value)), float(-np.angle(value)))


def wrap(angle: float) -> float:
    """``angle`` (rad) brought to (-pi, pi]."""
    return pi - (pi - angle) % (2 * pi)
