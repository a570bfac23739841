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

AGREEING_SHARE = 0.55
"""Share of the samples that must agree."""
SUBSETS = 150
FINALISTS = 8
CONCENTRATION_STEPS = 12
MOST_ORDERS = 8
SEARCHED_ORDERS = 4
"""Up to this order random subsets are clean often enough (0.7^9 = 4 %); higher ones start from the order below."""
MOST_SCATTER_RATIO = 1.3
"""Of a lower order's scatter to the smallest one, up to which the lower order is as good."""
GOOD_SCATTER_MM = 0.0003
"""Scatter below which no further harmonic is fitted here."""
MOST_FORM_MM = 0.5
"""No shaft has a harmonic of form that large; a series that bends itself to an arc does."""
MOST_REMAINING = 0.4
"""Share of the outliers that may remain outliers when a further harmonic explains the others."""
LEAST_SCATTER_MM = 0.002
"""What waves of a higher order than is fitted leave in any case."""
MOST_OFF_SHARE = 0.01
"""Share of the samples that may be off the fit to all of them, for that to be the shaft."""
OUTLIER_SD = 6.0
"""Robust standard deviations beyond which a sample is not the shaft's."""
LEAST_OUTLIER_MM = 0.015
"""Smaller deviations are never outliers."""
_AGREE_WITHIN = NormalDist().inv_cdf((1 + AGREEING_SHARE) / 2)
CONSISTENCY = 1.0 / sqrt(1.0 - 2.0 * _AGREE_WITHIN * NormalDist().pdf(_AGREE_WITHIN) / AGREEING_SHARE)
"""Standard deviation of normal noise over the rms of the samples that agree."""


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
        if design.shape[1] > AGREEING_SHARE * trace.size / 3:
            break
        start = np.append(solution, [0.0, 0.0]) if order > 1 else None
        tried, scatter = _trimmed(design, trace, start, rng if order <= SEARCHED_ORDERS else None)
        too_large = np.abs(tried[3:]).max(initial=0.0) > MOST_FORM_MM
        solution = np.append(solution, [0.0, 0.0]) if too_large else tried
        fits.append((solution, inf if too_large else scatter))
        if scatter < GOOD_SCATTER_MM:
            break
    enough = max(GOOD_SCATTER_MM, MOST_SCATTER_RATIO * min(s for _, s in fits))
    order, (solution, scatter) = next((i + 1, f) for i, f in enumerate(fits) if f[1] <= enough)
    outliers = _outliers(trace - _design(angle, order) @ solution, scatter)
    if outliers.any():
        design = _design(angle, order)
        whole = _fit(design, trace)
        # Trimmed, a series may bend itself to an arc; where all samples agree as well, there are no outliers.
        beyond = np.abs(trace - design @ whole) > OUTLIER_SD * max(scatter, LEAST_SCATTER_MM)
        if beyond.mean() < MOST_OFF_SHARE:
            solution, outliers = whole, beyond
    for more, (other, spread) in enumerate(fits[order:], order + 1):
        # A series too large for form can follow an arc of 55 %; the shaft's explains the whole circumference.
        remaining = _outliers(trace - _design(angle, more) @ other, spread)
        if remaining.sum() < MOST_REMAINING * outliers.sum():
            order, solution, scatter, outliers = more, other, spread, remaining
    for more in range(order + 1, most_orders + 1):
        order, solution, outliers = _reconciled(angle, trace, (order, solution, outliers), more, scatter)
    series = Harmonics(tuple(range(1, order + 1)), float(solution[0]), solution[1::2].copy(), solution[2::2].copy())
    return Wave(series, scatter, outliers)


def _outliers(off: Array, scatter: float) -> Mask:
    return np.asarray(np.abs(off) > max(OUTLIER_SD * scatter, LEAST_OUTLIER_MM))


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
    remaining = _outliers(trace - design @ solution, scatter)
    return (more, solution, remaining) if remaining.sum() < MOST_REMAINING * outliers.sum() else found


def _design(angle: Array, order: int) -> Array:
    """Columns 1, cos t, sin t, cos 2t, ..."""
    columns = [np.ones(angle.size)]
    for n in range(1, order + 1):
        columns += [np.cos(n * angle), np.sin(n * angle)]
    return np.column_stack(columns)


def _trimmed(design: Array, trace: Array, start: Array | None, rng: np.random.Generator | None) -> tuple[Array, float]:
    """Least trimmed squares: parameters and the robust standard deviation."""
    n, p = design.shape
    kept = int(AGREEING_SHARE * n)
    starts = np.empty((0, p)) if start is None else start[None]
    if rng is not None:
        picks = rng.integers(0, n, (SUBSETS, p + 1))
        starts = np.concatenate([starts, (np.linalg.pinv(design[picks]) @ trace[picks, None])[:, :, 0]])
    rough, sums = _concentrated(design, trace, starts, kept, 2)
    finalists = rough[np.argsort(sums, kind="stable")[:FINALISTS]]
    tried, sums = _concentrated(design, trace, finalists, kept, CONCENTRATION_STEPS)
    best = np.argmin(sums)
    return tried[best], sqrt(sums[best] / kept) * CONSISTENCY


def _fit(design: Array, trace: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, trace, rcond=None)[0])


def _concentrated(design: Array, trace: Array, solutions: Array, kept: int, steps: int) -> tuple[Array, Array]:
    """Solutions (s, p) refitted to the samples that lie nearest, again and again; their trimmed sums of squares (s,).

    The trimmed sum of squares can only fall.
    """
    n, p = design.shape
    products, moments = (design[:, :, None] * design[:, None, :]).reshape(n, p * p), design * trace[:, None]
    for _ in range(steps):
        squares = np.square(trace - solutions @ design.T)
        nearest = (squares <= np.partition(squares, kept - 1)[:, kept - 1 : kept]).astype(np.float64)
        normal = (nearest @ products).reshape(-1, p, p) + 1e-12 * kept * np.eye(p)  # all may have one angle
        better = np.asarray(np.linalg.solve(normal, (nearest @ moments)[:, :, None])[:, :, 0], dtype=np.float64)
        if np.abs(better - solutions).max() < 1e-9:
            break
        solutions = better
    squares = np.square(trace - solutions @ design.T)
    return solutions, np.partition(squares, kept - 1)[:, :kept].sum(axis=1)
