"""What the form of a round feature does to its centre where only part of it was measured.

All round, lobes stand square to centre and radius: they move neither. On an arc they do, and the least squares take up
most of them: what is left looks like little form and less doubt. Lobes of every number from two on are taken for as
likely as is usual, their amplitude falling with the number, and as large as the deviations say that are left.
"""

from functools import cache

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.assumptions import K
from truestand.form.associate import LAYOUTS, FittedFeature
from truestand.form.axes import hemisphere

LOBES = np.arange(2, 31)
"""Undulations of the form that is thought of,"""
VARIANCE = 1.0 / LOBES**2
"""and their share of it: amplitudes fall with the number of lobes, as on most turned and ground parts."""
FEW_LOBES = np.arange(2, 6)
"""That an arc hardly shows."""
LEAST_KEPT = 1e-9
"""Share of the form that deviations show at least: of less, numbers say nothing."""
LEAST_FREEDOM = 1.0
SECTORS = 360
CAPS = 400
"""Stretches of a circumference, or of a sphere, in which form is taken for the same."""


def form_covariance(points: Array, fitted: FittedFeature, noise: float) -> Array:
    """Covariance (m, m) of a round feature's parameters from the form that points (n, 3) mm show above their ``noise``
    (mm, of one); 0 for other features.
    """
    n, m = len(points), fitted.unit_covariance.shape[0]
    form = float(np.square(fitted.deviation).sum()) - max(n - m, 0) * noise**2
    if fitted.slopes is None or form <= 0:
        return np.zeros((m, m))
    place, alike = _places(points, fitted)
    solver = fitted.unit_covariance @ fitted.slopes.T
    of_slopes, of_solver = (_sums(a, place, len(alike)) for a in (fitted.slopes.T, solver))
    left = (np.diag(np.bincount(place, minlength=len(alike))) - of_slopes.T @ of_solver) @ alike
    kept = max(float(np.trace(left)), LEAST_KEPT * n)  # of each unit of form, summed over the points
    freedom = kept**2 / max(float((left * left.T).sum()), 1e-300)
    return np.asarray(of_solver @ alike @ of_solver.T * form / kept * _widening(freedom) ** 2)


def lobe_leverage(points: Array, fitted: FittedFeature) -> float:
    """By how much (mm) few lobes of 1 mm move a feature's centre at most; 0 for one that is not round about an axis."""
    if fitted.slopes is None or fitted.feature == "sphere":
        return 0.0
    place, _ = _places(points, fitted)
    position = (fitted.unit_covariance @ fitted.slopes.T)[LAYOUTS[fitted.feature].position]
    turned = np.multiply.outer(FEW_LOBES, np.arange(SECTORS) * (2 * np.pi / SECTORS))
    waves = np.stack([np.cos(turned), np.sin(turned)], axis=-1)  # (numbers of lobes, sectors, 2)
    moved = _sums(position, place, SECTORS) @ waves
    return float(np.linalg.norm(moved, 2, axis=(1, 2)).max())


def _widening(freedom: float) -> float:
    """By how much U is wider where its standard deviation rests on few degrees of freedom (GUM G.6.4)."""
    from scipy.special import ndtr, stdtrit

    return float(stdtrit(max(freedom, LEAST_FREEDOM), ndtr(K)) / K)


def _sums(values: Array, place: Ints, places: int) -> Array:
    """Sums (m, places) of values (m, n)."""
    return np.stack([np.bincount(place, row, places) for row in values])


def _places(points: Array, fitted: FittedFeature) -> tuple[Ints, Array]:
    """Where on the feature each point lies (n,), and how alike the form is (places, places) there: 1 in the same."""
    if fitted.feature == "sphere":
        from scipy.spatial import cKDTree

        centres, alike = _caps()
        away = points - fitted.point
        return cKDTree(centres).query(away / np.linalg.norm(away, axis=1, keepdims=True))[1], alike
    local = (points - fitted.point) @ fitted.frame.T
    turns = np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) + 0.5
    return (turns * SECTORS).astype(np.intp) % SECTORS, _sectors()


@cache
def _sectors() -> Array:
    """How alike the form is in the sectors of a circumference (SECTORS, SECTORS)."""
    step = np.arange(SECTORS)
    series = VARIANCE @ np.cos(np.outer(LOBES, step) * (2 * np.pi / SECTORS)) / VARIANCE.sum()
    return np.asarray(series[np.abs(np.subtract.outer(step, step))])


@cache
def _caps() -> tuple[Array, Array]:
    """Unit vectors (CAPS, 3) to stretches of a sphere, and how alike the form is there (CAPS, CAPS)."""
    upper = hemisphere(CAPS // 2)
    centres = np.vstack([upper, -upper])
    series = np.zeros(LOBES[-1] + 1)
    series[LOBES] = VARIANCE
    cosine = np.clip(centres @ centres.T, -1.0, 1.0)
    return centres, np.polynomial.legendre.legval(cosine, series) / VARIANCE.sum()
