"""Form of associated features: roundness, cylindricity, straightness, flatness, and run-out about a datum axis.

Terms of ISO 12181 (roundness), ISO 12180 (cylindricity), ISO 12780 (straightness) and ISO 1101 (run-out). Run-out is
indicator travel about the datum, not form: a round shaft that runs eccentric has a run-out of twice its eccentricity.
"""

from dataclasses import dataclass
from math import hypot, sqrt
from statistics import NormalDist
from typing import Literal

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.assumptions import K
from truestand.core.errors import BadRecipe
from truestand.form.associate import LAYOUTS, Feature, FittedFeature, associate, cylinder_at, upright
from truestand.form.upr import transmission, upr_filter
from truestand.form.zone import Distance, Kind, Zone, zone

Reference = Literal["LSC", "MZC", "MIC", "MCC"]

ROUND_FEATURES: tuple[Feature, ...] = ("circle", "cylinder")
NOISE_POINTS = 20_000
"""Points whose nearest neighbours the noise is estimated from."""
NEIGHBOURS_AMONG = 300_000


@dataclass(frozen=True, slots=True)
class Form:
    """An associated feature and how far the points depart from it: mm."""

    feature: Feature
    reference: Reference
    point: Array
    direction: Array | None
    radius: float | None
    rms: float
    """Of the orthogonal distances."""
    form: float
    """Width of the zone: roundness, cylindricity, straightness, flatness; range of the deviations for a sphere."""
    n: int
    cutoff_upr: float | None
    noise: float
    """Standard deviation of one point at most: from differences of nearest neighbours, form between them included."""
    noise_floor: float
    """Expected ``form`` of a perfect feature with that noise."""
    U: dict[str, float]
    """Expanded (k = 2), from the scatter of the points: point, radius and form in mm, direction in rad."""
    deviation: Array
    """(n,) mm from the feature."""
    certificate: Zone | None = None
    """The zone that gave the reference, proven by forces at its contacts that hold the axis in balance."""


def evaluate(points: Array, feature: Feature, reference: Reference = "LSC", cutoff_upr: float | None = None) -> Form:
    """The ``feature`` of points (n, 3) mm by its reference, and its form.

    ``cutoff_upr`` puts a circle's profile through the Gaussian filter first.

    Raises:
        BadRecipe: a reference or filter that the feature doesn't have.
        NotEnoughData: too few points, an open profile for a filter, points that don't hold the feature.
    """
    if reference != "LSC" and feature not in ROUND_FEATURES:
        raise BadRecipe(f"a {feature} has the reference LSC only, got {reference}; use --feature circle or cylinder")
    if cutoff_upr is not None and feature != "circle":
        raise BadRecipe(f"the UPR filter is for closed circular profiles, got a {feature}; leave the filter out")
    points = points[np.isfinite(points).all(axis=1)]
    fitted = associate(points, feature)
    noise = PointNoise(point_noise(points, fitted), float(len(points)))
    if cutoff_upr is not None:
        points = _filtered(points, fitted, cutoff_upr)
        fitted, noise = associate(points, feature), noise.through(cutoff_upr)
    if reference == "LSC":
        return _by_least_squares(fitted, noise, cutoff_upr)
    return _by_zone(points, fitted, reference, noise, cutoff_upr)


@dataclass(frozen=True, slots=True)
class PointNoise:
    """Standard deviation of a point, mm, and number of independent points."""

    sd: float
    count: float

    @property
    def floor(self) -> float:
        """Expected range of that many normal readings (Blom 1958), mm: form that noise alone makes."""
        n = self.count
        return 0.0 if n < 2 else 2.0 * self.sd * NormalDist().inv_cdf((n - 0.375) / (n + 0.25))

    def through(self, cutoff: float) -> "PointNoise":
        """The noise after the UPR filter: the energy that passes, in twice as many waves as pass."""
        passed = 1.0 + 2.0 * float(np.square(transmission(np.arange(1, int(6 * cutoff) + 1), cutoff)).sum())
        return self if passed >= self.count else PointNoise(self.sd * sqrt(passed / self.count), passed)


def point_noise(points: Array, fitted: FittedFeature) -> float:
    """Standard deviation of one point, mm: deviations of nearest neighbours differ by sqrt(2) times that."""
    from scipy.spatial import cKDTree

    n = len(points)
    if n < 4:
        return 0.0
    among = np.arange(n) if n <= NEIGHBOURS_AMONG else np.linspace(0, n - 1, NEIGHBOURS_AMONG).astype(np.intp)
    on_feature = points[among] - fitted.deviation[among, None] * _normals(points[among], fitted)
    asked = np.unique(np.linspace(0, among.size - 1, NOISE_POINTS).astype(np.intp))
    _, near = cKDTree(on_feature).query(on_feature[asked], k=2)
    other = np.where(near[:, 0] == asked, near[:, 1], near[:, 0])
    step = fitted.deviation[among[asked]] - fitted.deviation[among[other]]
    return float(np.sqrt(np.mean(step**2) / 2))


def _normals(points: Array, fitted: FittedFeature) -> Array:
    """Unit normals (n, 3) of the feature towards the points."""
    if fitted.feature == "plane" and fitted.direction is not None:
        return np.broadcast_to(fitted.direction, points.shape)
    away = points - fitted.point
    if fitted.direction is not None:
        away = away - np.outer(away @ fitted.direction, fitted.direction)
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None])


def _filtered(points: Array, fitted: FittedFeature, cutoff: float) -> Array:
    """The circle's points with their radial deviations filtered."""
    local = (points - fitted.point) @ fitted.frame.T
    angle = np.arctan2(local[:, 1], local[:, 0])
    passed = upr_filter(angle, fitted.deviation, cutoff)
    return np.asarray(points + (passed - fitted.deviation)[:, None] * _normals(points, fitted))


def _by_least_squares(fitted: FittedFeature, noise: PointNoise, cutoff: float | None) -> Form:
    n = fitted.deviation.size
    spatial = fitted.feature == "line" and fitted.deviation.min() >= 0
    width = 2 * float(fitted.deviation.max()) if spatial else float(np.ptp(fitted.deviation))
    U: dict[str, float] = {}
    if np.isfinite(fitted.scatter).all():
        covariance = fitted.unit_covariance * np.outer(fitted.scatter, fitted.scatter)
        position, slopes, radius = LAYOUTS[fitted.feature]
        U["point"] = _largest(covariance[position, position])
        if slopes is not None:
            U["direction"] = _largest(covariance[slopes, slopes])
        if radius is not None:
            U["radius"] = K * sqrt(covariance[radius, radius])
        U["form"] = K * sqrt(2.0) * noise.sd
    return Form(
        fitted.feature, "LSC", fitted.point, fitted.direction, fitted.radius, fitted.rms, width, n, cutoff,
        noise.sd, noise.floor, U, fitted.deviation,
    )  # fmt: skip


def _largest(covariance: Array) -> float:
    return K * float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def _by_zone(points: Array, fitted: FittedFeature, kind: Kind, noise: PointNoise, cutoff: float | None) -> Form:
    local = (points - fitted.point) @ fitted.frame.T
    circle = fitted.feature == "circle"
    distance = _about_axis(local)
    best = zone(distance, len(local), np.zeros(2 if circle else 4), kind)
    radius = {"MZC": (best.outer + best.inner) / 2, "MCC": best.outer, "MIC": best.inner}[kind]
    q = best.parameters
    direction, point = fitted.direction, fitted.point + np.array([q[0], q[1], 0.0]) @ fitted.frame
    if not circle:
        axis = np.array([q[2], q[3], 1.0]) @ fitted.frame
        direction = upright(axis / np.linalg.norm(axis))
        point = point + direction * float((points.mean(axis=0) - point) @ direction)
    deviation = distance(q, np.arange(len(local)))[0] - radius
    return Form(
        fitted.feature, kind, point, direction, radius, float(np.sqrt(np.mean(deviation**2))),
        best.outer - best.inner, len(local), cutoff, noise.sd, noise.floor,
        _zone_expanded(best, kind, noise.sd, circle), deviation, best,
    )  # fmt: skip


def _zone_expanded(best: Zone, kind: Kind, noise: float, circle: bool) -> dict[str, float]:
    """U (k = 2) by key from the noise of the contacts alone, as they hold the axis."""
    response = best.sensitivity * (K * noise)
    m = best.parameters.size
    # A one-sided reference holds one border; the other is where the farthest point happens to lie.
    outer = response[m] if kind != "MIC" else np.zeros(response.shape[1])
    inner = response[m + 1] if kind != "MCC" else np.zeros(response.shape[1])
    radius = {"MZC": (outer + inner) / 2, "MCC": outer, "MIC": inner}[kind]
    other = 0.0 if kind == "MZC" else K * noise
    U = {
        "point": float(np.linalg.norm(response[:2], 2)),
        "radius": float(np.linalg.norm(radius)),
        "form": hypot(float(np.linalg.norm(outer - inner)), other),
    }
    return U if circle else {**U, "direction": float(np.linalg.norm(response[2:4], 2))}


def _about_axis(local: Array) -> Distance:
    """Distances from an axis (x, y, slope x, slope y) near the frame's own; that of a circle (x, y) has no slopes."""

    def distance(q: Array, which: Ints) -> tuple[Array, Array]:
        length, slopes = cylinder_at(np.append(q, np.zeros(5 - q.size)), local[which])
        return length, slopes[:, : q.size]

    return distance
