"""A trace as a series: least squares at known frequencies, and the nearest Fourier bin to compare with.

Least squares at the known frequency is exact for any arc; the nearest bin of a discrete Fourier transform leaks
whenever the arc is no whole number of turns (theory page, *Leakage*).
"""

from dataclasses import dataclass
from math import hypot, pi

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import NotEnoughData

RIDGE = 1e-14
"""Share of a normal matrix's trace that is added to its diagonal."""
ALIKE = 0.25
"""Share of a wave by which those of several surfaces may differ and be the same one."""
SETTLED = 1e-6
"""Change of a robust fit's coefficients, as a share of ``least``, below which it is settled."""


@dataclass(frozen=True, slots=True)
class Harmonics:
    """mean + sum over ``orders`` of cos_i cos(n_i t) + sin_i sin(n_i t), in the trace's unit."""

    orders: tuple[int, ...]
    mean: float
    cos: Array
    sin: Array

    def amplitude(self, upr: int) -> float:
        """Amplitude of the harmonic ``upr``, in the trace's unit."""
        i = self.orders.index(upr)
        return hypot(self.cos[i], self.sin[i])

    def __call__(self, angle: Array) -> Array:
        """The series at ``angle`` (rad)."""
        phases = np.multiply.outer(np.asarray(angle, dtype=np.float64), np.array(self.orders, dtype=np.float64))
        return self.mean + np.cos(phases) @ self.cos + np.sin(phases) @ self.sin


def shared_waves(waves: Array) -> Array:
    """Amplitudes (n,) of those complex ``waves`` (surfaces, n) that all surfaces have alike; 0 for the others."""
    common = waves.mean(axis=0)
    alike = np.abs(waves - common).max(axis=0) < ALIKE * np.abs(common)
    return np.where(alike, np.abs(common), 0.0)


def fit_harmonics(angle: Array, trace: Array, orders: tuple[int, ...] = (1,)) -> Harmonics:
    """Linear least squares of a trace (N,) over table angle (N,) rad; NaN samples are left out.

    Raises:
        NotEnoughData: fewer samples than coefficients.
    """
    design, samples = _system(angle, trace, orders)
    return _series(orders, _solve(design, samples))


def fit_harmonics_robustly(
    angle: Array, trace: Array, orders: tuple[int, ...], least: float, passes: int = 15
) -> Harmonics:
    """Least absolute deviations of a trace (N,) over table angle (N,) rad, by iteratively reweighted least squares.

    Deviations below ``least`` (the trace's unit) weigh the same.

    Raises:
        NotEnoughData: fewer samples than coefficients.
    """
    design, samples = _system(angle, trace, orders)
    weighted, solution = design, np.zeros(design.shape[1])
    for _ in range(passes):
        normal = weighted.T @ design
        ridge = RIDGE * float(np.trace(normal)) * np.eye(solution.size)  # an arc too short for its orders is singular
        before, solution = solution, np.asarray(np.linalg.solve(normal + ridge, weighted.T @ samples), np.float64)
        if np.abs(solution - before).max() < SETTLED * least:
            break
        weighted = design / np.maximum(np.abs(samples - design @ solution), least)[:, None]
    return _series(orders, solution)


def _system(angle: Array, trace: Array, orders: tuple[int, ...]) -> tuple[Array, Array]:
    """Design matrix (n, columns) and samples (n,) of what was seen."""
    seen = np.isfinite(trace) & np.isfinite(angle)
    columns = 1 + 2 * len(orders)
    if np.count_nonzero(seen) < columns:
        raise NotEnoughData(
            f"found {np.count_nonzero(seen)} samples, need {columns} for {len(orders)} harmonics; scan for longer"
        )
    phases = np.multiply.outer(angle[seen], np.array(orders, dtype=np.float64))
    return np.hstack([np.ones((len(phases), 1)), np.cos(phases), np.sin(phases)]), trace[seen]


def _solve(design: Array, samples: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, samples, rcond=None)[0], dtype=np.float64)


def _series(orders: tuple[int, ...], solution: Array) -> Harmonics:
    n = len(orders)
    return Harmonics(orders, float(solution[0]), solution[1 : 1 + n], solution[1 + n :])


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
