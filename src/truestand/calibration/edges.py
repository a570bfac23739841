"""Edges of a surface: where dirt, a flat or a shallow keyway begins and ends.

Form goes in waves, dirt begins at once. A series of waves follows dirt of 10 to 25 um on a third of one cylinder so
closely that it is taken for form, and its wave once a turn for the cylinder's axis. But no series rises at once, and
what it leaves at the edges stands far out of the noise.
"""

from dataclasses import dataclass
from math import tau

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.harmonics import fit_harmonics_robustly
from truestand.core.robust import robust_sd

SECTORS = 360
"""Stretches of the circumference that are trusted or not."""
COUNT = SECTORS // 2
"""Of a turn, that are looked at together: narrower than the shortest wave, wide enough for some profiles."""
SMOOTH = 6
"""Waves that are taken for the shaft's before edges are looked for in what they leave."""
MOST_SEARCHES = 8
"""The highest dirt hides the others."""
MOST_OTHER = 0.45
"""Share of a surface that may be other than the shaft."""
BESIDE = 2
"""Of these, on either side of an edge, that are compared with each other."""
EDGE_SD = 6.0
"""Robust standard deviations beyond which a rise is an edge: of 160 sound surfaces the largest was 5.8 (of 0.1 um), of
those beyond LEAST_EDGE_MM 4.0.
"""
LEAST_EDGE_MM = 0.002
"""mm: smaller ones are never edges."""
LESSER = 0.5
"""Of the largest edge, below which others are looked for when it is gone: beside an edge, a series of waves swings."""
LEAST_WEIGHT = 0.3
"""Share of the median weight below which a sector shows nothing."""
WAVE = 4.0
"""Median amplitudes of the orders near it from which a wave stands out alone."""
NEAR_ORDERS, SPREAD = 5, 2
"""On either side: orders that a wave is compared with, and those to which it spreads."""
ALIKE = 0.25
"""Share of its height by which an edge may differ from that of another surface and be the table's."""


@dataclass(frozen=True, slots=True)
class Edges:
    """Where a surface rises or falls at once: sectors (n,) of table angle, ascending, and by how much (n,) mm."""

    sector: Ints
    rise: Array

    @property
    def largest(self) -> float:
        """mm; 0 without edges."""
        return float(np.abs(self.rise).max(initial=0.0))

    def apart_from(self, others: "tuple[Edges, ...]") -> "Edges":
        """Without those that another surface has as well, as high: a table's angle that jumps makes such."""
        alone = np.ones(self.sector.size, dtype=np.bool_)
        for other in others:
            beside = (self.sector[:, None] - other.sector + BESIDE) % COUNT <= 2 * BESIDE
            alike = np.abs(self.rise[:, None] - other.rise) < ALIKE * np.abs(self.rise[:, None])
            alone &= ~(beside & alike).any(axis=1)
        return Edges(self.sector[alone], self.rise[alone])

    def cut_out(self) -> Mask:
        """The stretches (SECTORS,) that lie higher or lower than most of the surface, with the edges themselves; none
        where the edges don't add up to such stretches.
        """
        level = np.cumsum(np.bincount(self.sector, np.sign(self.rise), COUNT)).astype(np.intp)
        mask = level != level.min() + np.argmax(np.bincount(level - level.min()))
        mask[self.sector] = True
        mask |= np.roll(mask, 1) | np.roll(mask, -1)
        if not self.sector.size or level[-1] != 0:
            mask[:] = False
        return np.repeat(mask, SECTORS // COUNT)


def between_edges(angle: Array, traces: Array) -> Mask:
    """Stretches (bands, SECTORS) in which a surface lies higher or lower than on most of a turn.

    ``traces``: (bands, n) mm over table ``angle`` (n,) rad.
    """
    mask = np.zeros((len(traces), SECTORS), dtype=np.bool_)
    for _ in range(MOST_SEARCHES):
        left = np.where(mask[:, sector_of(angle)], np.nan, traces)
        found = edges_of([_left_by_waves(angle, trace) for trace in left], SMOOTH)
        own = [edges.apart_from((*found[:k], *found[k + 1 :])) for k, edges in enumerate(found)]
        more = mask | np.stack([edges.cut_out() for edges in own])
        if (more == mask).all() or more.mean(axis=1).max() > MOST_OTHER:
            break
        mask = more
    return mask


def edges_of(surfaces: list[tuple[Array, Array, Array]], orders: int) -> tuple[Edges, ...]:
    """The edges of each surface: table angle (n,) rad, weight (n,) and what waves of form up to ``orders`` leave of its
    readings (n,) mm.
    """
    return tuple(_edges(_around(*surface), orders) for surface in surfaces)


def sector_of(angle: Array) -> Ints:
    """Sector (n,) of table angles (n,) rad."""
    return np.asarray(np.floor(angle * (SECTORS / tau)).astype(np.intp) % SECTORS)


def _left_by_waves(angle: Array, trace: Array) -> tuple[Array, Array, Array]:
    """Angle, weight and what the first waves and steady drift leave of a trace (n,) mm, where it is seen."""
    seen = np.isfinite(trace)
    waves = np.multiply.outer(angle[seen], np.arange(1, SMOOTH + 1))
    design = np.column_stack([np.ones(len(waves)), np.flatnonzero(seen) / trace.size, np.cos(waves), np.sin(waves)])
    left = trace[seen] - design @ np.linalg.lstsq(design, trace[seen], rcond=None)[0]
    return angle[seen], np.ones(left.size), left


def _around(angle: Array, weight: Array, residuals: Array) -> Array:
    """Mean residual (COUNT,) mm over a turn; NaN where too little is seen."""
    sector = sector_of(angle) // (SECTORS // COUNT)
    sums, weights = np.bincount(sector, weight * residuals, COUNT), np.bincount(sector, weight, COUNT)
    seen = weights > 0
    enough = seen & (weights > LEAST_WEIGHT * np.median(weights[seen])) if seen.any() else seen
    return np.asarray(np.divide(sums, weights, out=np.full(COUNT, np.nan), where=enough))


def _edges(around: Array, orders: int) -> Edges:
    """The edges in what waves up to ``orders`` leave of a turn: the largest, and those not much smaller."""
    around = _without_waves(around, orders)
    rise = np.mean([np.roll(around, -s) - np.roll(around, s) for s in range(1, BESIDE + 1)], axis=0)
    size = np.nan_to_num(np.abs(rise))
    edge = size.max() > max(LEAST_EDGE_MM, EDGE_SD * robust_sd(rise[np.isfinite(rise)]))
    near = [np.roll(size, s) for s in range(-BESIDE - 1, BESIDE + 2)]
    at = np.flatnonzero(edge & (size > LESSER * size.max()) & (size == np.max(near, axis=0)))
    return Edges(at, rise[at])


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
