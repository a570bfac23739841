"""The figures of a trace: slope and crowning by least squares, form and total as extremes after the low-pass."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import log, pi, sqrt

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.robust import MAD_TO_SD, nan_median

LEAST_CELLS = 6
"""Cells along a trace that it needs."""
LEAST_OTHERS = 6
"""Flanks of a side that tell how far its traces may leave their mean lines."""
LEAST_REACH = 0.4
"""Share of an evaluation range over which a trace must reach."""
LEAST_CUTOFF = 0.25
"""mm: wavelength of the low-pass at least (ISO 1328-1:2013),"""
CUTOFF_SHARE = 1 / 30
"""and its share of the evaluation length or the face."""
GAUSS = sqrt(log(2.0) / pi)
"""Width of the weighting function over the wavelength that it halves (ISO 16610-21)."""
NEGLIGIBLE = 4.0
"""Widths of the Gaussian beyond which it is below 1e-21."""
SMOOTHED = 2 * pi / GAUSS**2 * (1 / 12 + 1 / 6)
"""Square of a wavelength, in cells, by which the means of cells and straight lines between them are smoother already:
variances of the weighting functions of a box and a triangle, over the Gaussian's."""


@dataclass(frozen=True, slots=True)
class Line:
    """What a trace (flanks, POINTS) says; mm, (flanks,), NaN for a flank of which too little was seen."""

    slope: Array
    """Rise of the mean line over the length of slope deviations."""
    form: Array
    total: Array
    crowning: Array
    """Height of the mean parabola over the whole control length or face."""
    filtered: Array
    """(flanks, POINTS): the trace after the low-pass."""


def line_of(
    trace: Array, at: Array, cells: Ints, slope_length: float, whole: float, cutoff_of: float, cell: float = 0.0
) -> Line:
    """The figures of traces (flanks, POINTS) at places (POINTS,).

    ``cells`` (flanks,): how many it rests on; ``whole``: control length or face (mm); ``cutoff_of``: length
    (mm) whose share is the low-pass's wavelength; ``cell``: length (mm) of cells whose means, and straight lines
    between them, the trace is.
    """
    seen = np.isfinite(trace)
    able = (cells >= LEAST_CELLS) & (seen.mean(axis=1) > LEAST_REACH)
    weight, values = seen.astype(np.float64), np.where(seen, trace, 0.0)
    number = np.maximum(weight.sum(axis=1), 1.0)
    x = np.where(seen, at - ((weight * at).sum(axis=1) / number)[:, None], 0.0)
    square = np.maximum((x * x).sum(axis=1), 1e-300)
    slope = (x * values).sum(axis=1) / square
    rest = np.where(seen, values - (values.sum(axis=1) / number)[:, None] - slope[:, None] * x, 0.0)
    cutoff = max(cutoff_of * CUTOFF_SHARE, LEAST_CUTOFF)
    filtered = _low_pass(rest, weight, at, sqrt(max(cutoff**2 - SMOOTHED * cell**2, 1e-12)))
    full = filtered + values - rest
    bend = np.where(seen, x * x - (square / number)[:, None], 0.0)
    bend = bend - np.where(seen, ((bend * x).sum(axis=1) / square)[:, None] * x, 0.0)
    curve = (bend * values).sum(axis=1) / np.maximum((bend * bend).sum(axis=1), 1e-300)
    form, total = (range_of(v, v, seen) for v in (filtered, full))
    slope, form, total, crowning = (
        np.where(able, f, np.nan) for f in (slope * slope_length, form, total, -curve * (whole / 2) ** 2)
    )
    return Line(slope, form, total, crowning, np.where(seen, full, np.nan))


def unseen_ends(trace: Array, at: Array, figures: Callable[[Array], Line]) -> Line:
    """By how much (mm) the figures of traces (flanks, POINTS), first those of one side, then those of the other, may be
    off because their ends were not seen.

    The largest of what they change by where the ends go on level, where they go on as mean curves of the second and the
    third degree do, and where they leave the mean line as those do of flanks of the side that show more.
    """
    seen = np.isfinite(trace)
    lines, bends = _lines_and_bends(trace, at)
    level, *others = ends = [trace.copy() for _ in range(5)]
    for flank in np.flatnonzero((seen.sum(axis=1) >= LEAST_CELLS) & ~seen.all(axis=1)):
        on, off = seen[flank], ~seen[flank]
        level[flank] = np.interp(at, at[on], trace[flank, on])
        held = np.interp(at, at[on], trace[flank, on] - lines[flank, on])
        curves = [np.polyval(np.polyfit(at[on], trace[flank, on], degree), at) - lines[flank] for degree in (2, 3)]
        further = [curves[0], _within(curves[1], held), *(held + s * sqrt(3.0) * bends[flank] for s in (-1.0, 1.0))]
        for end, values in zip(others, further, strict=True):
            end[flank, off] = (lines[flank] + values)[off]
    base, found = figures(trace), [figures(end) for end in ends]

    def apart(name: str) -> Array:
        return np.asarray(np.fmax.reduce([np.abs(getattr(end, name) - getattr(base, name)) for end in found]))

    return Line(apart("slope"), apart("form"), apart("total"), apart("crowning"), apart("filtered"))


def _lines_and_bends(trace: Array, at: Array) -> tuple[Array, Array]:
    """Mean lines (flanks, POINTS) mm of traces and, beyond what was seen of one, by how much (standard deviation, mm)
    others of the same side leave theirs from there; 0 where fewer than ``LEAST_OTHERS`` show it.
    """
    seen = np.isfinite(trace)
    able, lines, bends = seen.sum(axis=1) >= LEAST_CELLS, np.zeros(trace.shape), np.zeros(trace.shape)
    for flank in np.flatnonzero(able):
        lines[flank] = np.polyval(np.polyfit(at[seen[flank]], trace[flank, seen[flank]], 1), at)
    rest = trace - lines
    sides = np.repeat(np.arange(2), len(trace) // 2)
    for flank in np.flatnonzero(able & ~seen.all(axis=1)):
        first, last = np.flatnonzero(seen[flank])[[0, -1]]
        others = rest[sides == sides[flank]]
        below, above = others[:, :first] - others[:, [first]], others[:, last + 1 :] - others[:, [last]]
        bends[flank, :first], bends[flank, last + 1 :] = _spread(below), _spread(above)
    return lines, bends


def _within(curve: Array, rest: Array) -> Array:
    """A curve (n,) that leaves the range of the ``rest`` of what was seen by no more than that range."""
    low, high = rest.min(), rest.max()
    return np.clip(curve, low - (high - low), high + (high - low))


def _spread(differences: Array) -> Array:
    """Robust standard deviation of each column of differences (flanks, n), NaN: not known; 0 of few."""
    known = np.isfinite(differences).sum(axis=0) >= LEAST_OTHERS
    return np.where(known, MAD_TO_SD * nan_median(np.abs(differences), axis=0), 0.0)


def range_of(high: Array, low: Array, seen: Mask) -> Array:
    """Largest of ``high`` less least of ``low`` (flanks,) of what was seen; 0 where nothing was."""
    top, bottom = np.where(seen, high, -np.inf).max(axis=1), np.where(seen, low, np.inf).min(axis=1)
    return np.asarray(np.where(seen.any(axis=1), top - bottom, 0.0))


def _low_pass(values: Array, weight: Array, at: Array, cutoff: float) -> Array:
    """Traces (flanks, n) at evenly spaced places (n,) after a Gaussian that halves waves of ``cutoff`` mm."""
    from scipy.ndimage import correlate1d

    window = _gaussian(float(at[-1] - at[0]) / (at.size - 1) / (GAUSS * cutoff), at.size)
    total, of = (correlate1d(v, window, axis=1, mode="constant") for v in (weight * values, weight))
    return np.asarray(total / np.maximum(of, 1e-300))


@lru_cache(maxsize=8)
def _gaussian(spacing: float, most: int) -> Array:
    """(n,) by how much a place and at ``most`` so many on either side, ``spacing`` widths of the Gaussian apart, count
    for it.
    """
    reach = min(most, int(NEGLIGIBLE / spacing))
    return np.asarray(np.exp(-pi * np.square(spacing * np.arange(-reach, reach + 1))))
