"""The scatter of the data's pull where neighbouring profiles err alike: vibration, air, electronics.

A sector of the surface is the independent piece of evidence as long as neighbours err independently. Where they don't,
the noise of a cell is taken as one part of its own and one that all cells of a profile share, each with its spectrum
over waves a turn. What a cell has of its own is seen at every wave; what all share is hidden at few waves, where the
fit takes it for form, and is carried down from above as first-order autoregressive noise on a white floor (Whittle
1953).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

MEMORIES = np.concatenate([[0.0], 1.0 - np.geomspace(0.9, 0.005, 40)])
"""Correlations between neighbouring sectors that are tried."""
FLOORS = np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.98])
"""Shares of white noise that are tried."""
SHOWN = 9.0
"""Twice the log-likelihood that memory must gain: less comes up in white noise."""
LEAST_SECTORS = 60
TAKEN = 2
"""Unknowns of each strand's slowest waves that the fit takes out: offset and slope over height."""


@dataclass(frozen=True, slots=True)
class Strands:
    """Cells by sector (S) and by bin of height (B), all turns together, scaled to noise of one size."""

    residuals: Array
    """(S, B)."""
    looks: Array
    """(S, B, p): the Jacobian, scaled likewise."""


def strands_of(residuals: Array, jacobian: Array, weights: Array, sector: Ints, bins: Ints) -> Strands:
    """The cells (n,) as strands.

    Args:
        residuals: mm.
        jacobian: (n, p).
        weights: 1/mm2.
        sector: stretch of table angle, the same on every turn.
        bins: bin of height.
    """
    shape = (int(sector.max()) + 1, int(bins.max()) + 1)
    cell = sector * shape[1] + bins
    order = np.argsort(cell, kind="stable")
    found, starts = np.unique(cell[order], return_index=True)
    mass = np.add.reduceat(weights[order], starts)
    root = np.sqrt(np.maximum(mass, 1e-300))
    pulls = np.add.reduceat((weights * residuals)[order], starts) / root
    looks = np.add.reduceat((weights[:, None] * jacobian)[order], starts) / root[:, None]
    seen = mass > 0
    flat, wide = np.zeros(shape[0] * shape[1]), np.zeros((shape[0] * shape[1], jacobian.shape[1]))
    flat[found[seen]], wide[found[seen]] = pulls[seen], looks[seen]
    return Strands(flat.reshape(shape), wide.reshape(*shape, -1))


def shared_scatter(strands: Strands, orders: int) -> Array | None:
    """Scatter (p, p) of the pull from noise with memory; None where the noise has none.

    ``orders``: highest wave a turn that the fit takes for form.
    """
    count, bins = strands.residuals.shape
    if count < LEAST_SECTORS or 2 * orders + 2 > count // 2 or bins < 2 * TAKEN:
        return None
    waves = np.fft.rfft(strands.residuals, axis=0)
    seen = np.count_nonzero(strands.residuals) / strands.residuals.size
    own = np.square(np.abs(waves)).mean(axis=1) / (count * seen)
    together = np.square(np.abs(waves.sum(axis=1))) / (count * bins * seen)
    above = slice(orders + 1, -1)
    red_own, red_together = _red(own[1:-1], count, 1, bins), _red(together[above], count, orders + 1, 1)
    if red_own is None and red_together is None:
        return None
    own[: orders + 1] *= bins / (bins - TAKEN)
    own = _smoothed(own)
    common = np.zeros(own.size)
    if red_together is not None:
        common = np.maximum(red_together - own, 0.0) / bins
        if common[above].mean() * bins < 0.2 * own[above].mean():  # what chance makes of independent strands
            common[:] = 0.0
    both = np.full(own.size, 2.0)
    both[0] = both[-1] = 1.0
    looks = np.fft.rfft(strands.looks, axis=0)
    each = (looks * np.sqrt(both * own / count)[:, None, None]).reshape(-1, looks.shape[2])
    alike = looks.sum(axis=1) * np.sqrt(both * common / count)[:, None]
    return np.asarray((each.conj().T @ each).real + (alike.conj().T @ alike).real)


def _red(power: Array, count: int, first: int, averaged: int) -> Array | None:
    """The autoregressive spectrum (count // 2 + 1,) that fits the power from wave ``first`` on; None if white does."""
    wave = np.arange(count // 2 + 1)
    rho, floor = MEMORIES[:, None, None], FLOORS[None, :, None]
    red = (1.0 - rho**2) / (1.0 + rho**2 - 2.0 * rho * np.cos(2.0 * np.pi * wave / count))
    models = ((1.0 - floor) * red + floor).reshape(-1, wave.size)
    inside = models[:, first : first + power.size]
    scale = (power / inside).mean(axis=1)
    cost = 2.0 * averaged * (np.log(inside).sum(axis=1) + power.size * np.log(scale))
    best = int(np.argmin(cost))
    return None if cost[0] - cost[best] < SHOWN else np.asarray(models[best] * scale[best])


def _smoothed(power: Array) -> Array:
    """Means over bands of waves that double in width; the mean radius is taken to err as the slowest wave does."""
    smooth = power.copy()
    low = 1
    while low < power.size:
        high = min(max(low + 1, 2 * low - (low > 2)), power.size)
        smooth[low:high] = power[low:high].mean()
        low = high
    smooth[0] = smooth[1]
    return smooth
