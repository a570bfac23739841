"""The wave of a turning shaft when up to 45 % of the circumference is not the shaft: a flat, a keyway, dirt.

Least trimmed squares (Rousseeuw 1984) by concentration steps from many small random subsets: the fit that the best 55 %
of the samples agree on. The order of the series is the lowest on which they agree: each further harmonic could
absorb a flat, so it has to earn its place.
"""

from dataclasses import dataclass
from math import inf, sqrt
from statistics import NormalDist

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.harmonics import Harmonics

KEPT = 0.55
"""Share of the samples that must agree."""
SUBSETS = 150
FINALISTS = 8
CONCENTRATIONS = 12
MOST_ORDERS = 8
SEARCHED_ORDERS = 4
"""Up to this order random subsets are clean often enough (0.7^9 = 4 %); higher ones start from the order below."""
WORTH = 1.3
"""A lower order is as good where its scatter is at most this many times that of the highest."""
GOOD_ENOUGH = 0.0003
"""mm of scatter below which no further harmonic is asked for here."""
MOST_FORM = 0.5
"""mm: no shaft has a harmonic of form that large; a series that bends itself to an arc does."""
MOST_LEFT = 0.4
"""Share of the outliers that may remain outliers when a further harmonic explains the others."""
LEAST_SCATTER = 0.002
"""mm: what waves of a higher order than is looked at leave in any case."""
FEW = 0.01
"""Share of the samples that may be off the fit to all of them, for that to be the shaft."""
OUTSIDE = 6.0
"""Robust standard deviations from which a sample is not the shaft's."""
LEAST_OUTSIDE = 0.015
"""mm: never call smaller deviations outliers."""


@dataclass(frozen=True, slots=True)
class Wave:
    """What the majority of a trace agrees on."""

    series: Harmonics
    scatter: float
    """mm, robust standard deviation of the samples that agree."""
    outliers: Mask
    """(n,) samples that are not the shaft's round surface."""


def robust_wave(angle: Array, trace: Array, most_orders: int = MOST_ORDERS) -> Wave:
    """The series of a trace (n,) mm over table angle (n,) rad that the best 55 % of its samples agree on."""
    rng = np.random.default_rng(20220711)  # any fixed seed: the same scan gives the same answer
    fits = []
    solution = np.zeros(1)
    for order in range(1, most_orders + 1):
        design = _design(angle, order)
        if design.shape[1] > KEPT * trace.size / 3:
            break
        start = np.append(solution, [0.0, 0.0]) if order > 1 else None
        tried, scatter = _trimmed(design, trace, start, rng if order <= SEARCHED_ORDERS else None)
        too_large = np.abs(tried[3:]).max(initial=0.0) > MOST_FORM
        solution = np.append(solution, [0.0, 0.0]) if too_large else tried
        fits.append((solution, inf if too_large else scatter))
        if scatter < GOOD_ENOUGH:
            break
    enough = max(GOOD_ENOUGH, WORTH * min(s for _, s in fits))
    order, (solution, scatter) = next((i + 1, f) for i, f in enumerate(fits) if f[1] <= enough)
    outliers = _outside(trace - _design(angle, order) @ solution, scatter)
    if outliers.any():
        design = _design(angle, order)
        whole = _fit(design, trace)
        # Trimmed, a series may bend itself to an arc; where all samples agree as well, there are no outliers.
        beyond = np.abs(trace - design @ whole) > OUTSIDE * max(scatter, LEAST_SCATTER)
        if beyond.mean() < FEW:
            solution, outliers = whole, beyond
    for more, (other, spread) in enumerate(fits[order:], order + 1):
        # A series too large for form can follow an arc of 55 %; the shaft's explains the whole circumference.
        left = _outside(trace - _design(angle, more) @ other, spread)
        if left.sum() < MOST_LEFT * outliers.sum():
            order, solution, scatter, outliers = more, other, spread, left
    for more in range(order + 1, most_orders + 1):
        order, solution, outliers = _reconciled(angle, trace, (order, solution, outliers), more, scatter)
    series = Harmonics(tuple(range(1, order + 1)), float(solution[0]), solution[1::2].copy(), solution[2::2].copy())
    return Wave(series, scatter, outliers)


def _outside(off: Array, scatter: float) -> Mask:
    return np.asarray(np.abs(off) > max(OUTSIDE * scatter, LEAST_OUTSIDE))


def _reconciled(
    angle: Array, trace: Array, found: tuple[int, Array, Mask], more: int, scatter: float
) -> tuple[int, Array, Mask]:
    """The series with ``more`` harmonics, fitted to all but the outliers, if it explains most of them too.

    It does where they are form of a higher order; a flat, a keyway or dirt, which the fit doesn't see, stays.
    """
    _, _, outliers = found
    if not outliers.any():
        return found
    design = _design(angle, more)
    if design.shape[1] > np.count_nonzero(~outliers) / 3:
        return found
    solution = _fit(design[~outliers], trace[~outliers])
    left = _outside(trace - design @ solution, scatter)
    return (more, solution, left) if left.sum() < MOST_LEFT * outliers.sum() else found


def _design(angle: Array, order: int) -> Array:
    """Columns 1, cos t, sin t, cos 2t, ..."""
    columns = [np.ones(angle.size)]
    for n in range(1, order + 1):
        columns += [np.cos(n * angle), np.sin(n * angle)]
    return np.column_stack(columns)


def _trimmed(design: Array, trace: Array, start: Array | None, rng: np.random.Generator | None) -> tuple[Array, float]:
    """Least trimmed squares: parameters and the robust standard deviation."""
    n, p = design.shape
    kept = int(KEPT * n)
    starts = [] if start is None else [start]
    if rng is not None:
        picks = rng.integers(0, n, (SUBSETS, p + 1))
        starts += [_fit(design[i], trace[i]) for i in picks]
    rough = [_concentrated(design, trace, s, kept, 2) for s in starts]
    rough.sort(key=lambda f: f[1])
    best = min(
        (_concentrated(design, trace, s, kept, CONCENTRATIONS) for s, _ in rough[:FINALISTS]), key=lambda f: f[1]
    )
    return best[0], sqrt(best[1] / kept) * _CONSISTENT


def _fit(design: Array, trace: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, trace, rcond=None)[0])


def _concentrated(design: Array, trace: Array, solution: Array, kept: int, steps: int) -> tuple[Array, float]:
    """Refit to the samples that lie nearest, again and again: the trimmed sum of squares can only fall."""
    for _ in range(steps):
        squares = np.square(trace - design @ solution)
        nearest = np.argpartition(squares, kept - 1)[:kept]
        rows = design[nearest]
        normal = rows.T @ rows + 1e-12 * np.eye(rows.shape[1])
        better = np.asarray(np.linalg.solve(normal, rows.T @ trace[nearest]), dtype=np.float64)
        if np.abs(better - solution).max() < 1e-9:
            break
        solution = better
    squares = np.square(trace - design @ solution)
    return solution, float(np.partition(squares, kept - 1)[:kept].sum())


def _consistency() -> float:
    """What makes the trimmed rms the standard deviation of normal noise."""
    normal = NormalDist()
    q = normal.inv_cdf((1 + KEPT) / 2)
    return 1.0 / sqrt(1.0 - 2.0 * q * normal.pdf(q) / KEPT)


_CONSISTENT = _consistency()
