"""What a real sensor and a real table add to geometry: noise, range errors, lost and false readings, uneven turning."""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from truestand.core.stand import Stand
from truestand.sim.simulation import Acquisition, Optics

Array = NDArray[np.float64]

GHOST_REACH = 3.0
"""mm of height about the shoulder in which double reflections happen."""


REFLECTION_AT = 0.45
"""Where in the range a reflection that stands still comes from."""


def table_angles(stand: Stand, a: Acquisition, rng: Generator) -> tuple[Array, NDArray[np.int64], Array, float]:
    """True table angle (N,) rad, counter, time (s) of the profiles that arrive, and the mean step."""
    speed, rate = stand.table.speed or np.pi / 10, stand.sensor.profile_rate or 200.0
    total = a.profiles + a.dropped
    time = np.arange(total) / rate
    turned = np.where(time < a.ramp, time**2 / (2 * max(a.ramp, 1e-9)), time - a.ramp / 2)
    turned = turned * speed * a.speed_factor
    turned = turned + a.ripple / a.ripple_per_turn * np.sin(a.ripple_per_turn * turned)
    kept = np.setdiff1d(np.arange(total), _gaps(total, a.dropped, rng))[: a.profiles]
    angle = a.start_angle + stand.table.sign * turned
    return angle[kept], kept.astype(np.int64), time[kept], speed * a.speed_factor / rate


def _gaps(total: int, dropped: int, rng: Generator) -> NDArray[np.intp]:
    """Which profiles get lost: up to five runs, none at the ends."""
    runs = min(5, dropped)
    lost: set[int] = set()
    for i in range(runs):
        length = dropped // runs + (i < dropped % runs)
        while True:
            start = int(rng.integers(1, max(total - length - 1, 2)))
            run = set(range(start, start + length))
            if not run & lost:
                lost |= run
                break
    return np.array(sorted(lost), dtype=np.intp)


def range_error(z: Array, optics: Optics, limits: tuple[float, float]) -> Array:
    """The sensor's smooth range error (mm), a function of range only."""
    low, high = limits
    error = optics.scale_error * (z - (low + high) / 2)
    if optics.nonlinearity:
        error = error + optics.nonlinearity * np.sin(2 * np.pi * (z - low) / (high - low) + optics.nonlinearity_phase)
    return np.asarray(error)


def noise(shape: tuple[int, int], optics: Optics, rng: Generator) -> Array:
    """White noise, and noise that neighbouring points of a line share."""
    total = rng.normal(0.0, optics.noise, shape) if optics.noise else np.zeros(shape)
    if optics.correlated_noise:
        n = optics.correlation
        white = rng.normal(0.0, optics.correlated_noise, (shape[0], shape[1] + n - 1))
        sums = np.cumsum(np.pad(white, ((0, 0), (1, 0))), axis=1)
        total = total + (sums[:, n:] - sums[:, :-n]) / np.sqrt(n)
    return total


class Speckle:
    """A random field fixed to the surface: the same cell gives the same error on every turn."""

    def __init__(self, optics: Optics, rng: Generator) -> None:
        self.sigma, self.cell = optics.speckle, optics.speckle_cell
        self.field = rng.normal(0.0, self.sigma, (1009, 2003)) if self.sigma else None

    def __call__(self, psi: Array, height: Array) -> Array | float:
        """The error (mm) at polar angle and height."""
        if self.field is None:
            return 0.0
        around = np.floor(psi * (10.0 / self.cell)).astype(np.intp)
        up = np.floor(height / self.cell).astype(np.intp)
        return np.asarray(self.field[(around + 7 * up) % 1009, (up + 31 * around) % 2003])


def false_and_lost(
    z: Array, height: Array, optics: Optics, limits: tuple[float, float], shoulder: float, rng: Generator
) -> Array:
    """Readings with outliers, ghosts and random losses put in."""
    if optics.ghosts:
        with np.errstate(invalid="ignore"):
            near = (np.abs(height - shoulder) < GHOST_REACH) & (rng.random(z.shape) < optics.ghosts)
        z = np.where(near, z + rng.uniform(-1.5, 1.5, z.shape), z)
    if optics.reflection:
        low, high = limits
        still = low + REFLECTION_AT * (high - low) + rng.normal(0.0, optics.noise, z.shape)
        z = np.where(rng.random(z.shape) < optics.reflection, still, z)
    if optics.outliers:
        z = np.where(rng.random(z.shape) < optics.outliers, rng.uniform(*limits, z.shape), z)
    if optics.dropouts:
        z = np.where(rng.random(z.shape) < optics.dropouts, np.nan, z)
    return z


def lose_patches(z: Array, optics: Optics, rng: Generator) -> None:
    """Whole patches of readings lost, in place."""
    for _ in range(optics.patches):
        row, column = rng.integers(0, z.shape[0]), rng.integers(0, z.shape[1])
        z[row : row + 40, column : column + 30] = np.nan


def quantised(values: Array, step: float) -> Array:
    """Whole steps, as the decimal number that a sensor's file would hold."""
    if not step:
        return values
    per_mm = round(1.0 / step)
    if abs(per_mm * step - 1.0) > 1e-9:
        return np.asarray(np.rint(values / step) * step)
    return np.asarray(np.rint(values * per_mm) / per_mm)
