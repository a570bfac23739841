"""Edges of a surface: where dirt, a flat or a shallow keyway that was taken for form begins or ends. No series of waves
rises at once, and what it leaves there stands far out of the noise.
"""

from math import tau

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.harmonics import fit_harmonics_robustly
from truestand.core.robust import robust_sd

SECTORS = 360
"""Stretches of the circumference that are trusted or not."""
COUNT = SECTORS // 2
"""Of a turn, that are looked at together: narrower than the shortest wave, wide enough for some profiles."""
BESIDE = 2
"""Of these, on either side of an edge, that are compared with each other."""
EDGE_SD = 6.0
"""Robust standard deviations beyond which a rise is an edge: of 160 sound surfaces the largest was 5.8 (of 0.1 um), of
those beyond LEAST_EDGE_MM 4.0.
"""
LEAST_EDGE_MM = 0.002
"""mm: smaller ones are never edges."""
LEAST_WEIGHT = 0.3
"""Share of the median weight below which a sector shows nothing."""
WAVE = 4.0
"""Median amplitudes of the orders near it from which a wave stands out alone."""
NEAR_ORDERS, SPREAD = 5, 2
"""On either side: orders that a wave is compared with, and those to which it spreads."""


def largest_edge(angle: Array, weight: Array, residuals: Array, orders: int) -> tuple[float, float]:
    """By how much (mm) a surface rises or falls at once, at most, and at which table angle (rad); 0 within noise.

    ``residuals`` (n,) mm: what waves of form up to ``orders`` leave of its readings at table ``angle`` (n,) rad.
    """
    left = _without_waves(around(angle, weight, residuals), orders)
    rise = np.mean([np.roll(left, -s) - np.roll(left, s) for s in range(1, BESIDE + 1)], axis=0)
    size = np.nan_to_num(np.abs(rise))
    at = int(np.argmax(size))
    noise = robust_sd(rise[np.isfinite(rise)]) if size[at] else 0.0
    return float(size[at]) if size[at] > EDGE_SD * noise else 0.0, (at + 0.5) * tau / COUNT


def sector_of(angle: Array) -> Ints:
    """Sector (n,) of table angles (n,) rad."""
    return np.asarray(np.floor(angle * (SECTORS / tau)).astype(np.intp) % SECTORS)


def stretch_of(angle: Array) -> Ints:
    """Which of the COUNT stretches of a turn angles (n,) rad lie in."""
    return sector_of(angle) // (SECTORS // COUNT)


def around(angle: Array, weight: Array, residuals: Array) -> Array:
    """Mean residual (COUNT,) mm over a turn; NaN where too little is seen."""
    stretch = stretch_of(angle)
    sums, weights = np.bincount(stretch, weight * residuals, COUNT), np.bincount(stretch, weight, COUNT)
    seen = weights > 0
    enough = seen & (weights > LEAST_WEIGHT * np.median(weights[seen])) if seen.any() else seen
    return np.asarray(np.divide(sums, weights, out=np.full(COUNT, np.nan), where=enough))


def _without_waves(around: Array, orders: int) -> Array:
    """What is left (COUNT,) mm without waves beyond ``orders`` that stand out of its spectrum alone; an edge is in all
    of it. The shaft's travel spreads a wave to the orders beside its own.
    """
    amplitude = np.abs(np.fft.rfft(np.nan_to_num(around)))[orders + 1 : -1]
    near = np.pad(amplitude, NEAR_ORDERS, constant_values=np.nan)
    near = np.lib.stride_tricks.sliding_window_view(near, 2 * NEAR_ORDERS + 1)
    strong = np.convolve(amplitude > WAVE * np.nanmedian(near, axis=1), np.ones(2 * SPREAD + 1), "same")
    waves = orders + 1 + np.flatnonzero(strong)
    if not 0 < waves.size < np.count_nonzero(np.isfinite(around)) / 4:
        return around
    angle = np.linspace(0.0, tau, COUNT, endpoint=False, dtype=np.float64)
    return np.asarray(around - fit_harmonics_robustly(angle, around, tuple(waves.tolist()), LEAST_EDGE_MM)(angle))
