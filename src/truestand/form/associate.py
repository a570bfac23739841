"""Ideal features associated with measured points by least squares of the orthogonal distances (ISO 17450, LSC).

Line and plane are exact by singular values. Circle, sphere, cylinder and cone are found by Levenberg-Marquardt from
algebraic starts. Every fit works about the points' centroid: offsets of 1e5 mm cost nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import NotEnoughData
from truestand.form.axes import about_axis, frame_along, frame_tilted, upright
from truestand.form.least_squares import inverse_normal, least_squares
from truestand.form.revolved import CONE, CYLINDER, Revolved, algebraic_circle, fitted_revolved

Feature = Literal["line", "plane", "circle", "cylinder", "sphere", "cone"]

LEAST_POINTS: dict[Feature, int] = {"line": 2, "plane": 3, "circle": 3, "cylinder": 5, "sphere": 4, "cone": 6}
LEAST_DIMENSIONS: dict[Feature, int] = {"line": 1, "plane": 2, "circle": 2, "cylinder": 2, "sphere": 3, "cone": 3}
"""In which the points must extend."""
MANY_POINTS = 5000
FLATNESS = 1e-9
"""Relative thickness of points that lie in a plane (or on a line)."""


@dataclass(frozen=True, slots=True)
class FittedFeature:
    """A least-squares feature: ``point`` (3,) mm, unit ``direction`` (3,) or None, ``radius`` in mm or None."""

    feature: Feature
    point: Array
    direction: Array | None
    radius: float | None
    deviation: Array
    """(n,) mm: distance from the feature, positive outwards (plane: along its direction; line: never negative)."""
    rms: float
    """mm, of the orthogonal distances that were minimised."""
    unit_covariance: Array
    """(m, m) covariance of the parameters for noise of 1 mm, in the order of ``LAYOUTS``."""
    scatter: Array
    """(m,) mm: standard deviation of the distances that bear on each parameter; NaN without redundant points."""
    frame: Array
    """(3, 3) rows: the axes in which the parameters count, the feature's direction last."""
    half_angle: float | None = None
    """rad, of a cone: positive where its radius grows along ``direction``; ``radius`` is that at ``point``."""
    spatial: bool = False
    """Whether it is a line whose points lie in no plane, and depart from it all round."""
    slopes: Array | None = None
    """(n, m) of a round feature: how the deviations follow the parameters."""


def associate(points: Array, feature: Feature) -> FittedFeature:
    """The least-squares ``feature`` of points (n, 3) mm.

    Raises:
        NotEnoughData: too few points, or points that leave the feature open (all on a line, all the same).
    """
    points = np.asarray(points, dtype=np.float64)
    need = LEAST_POINTS[feature]
    if len(points) < need:
        raise NotEnoughData(f"found {len(points)} points, need {need} for a {feature}; measure more")
    centroid = points.mean(axis=0)
    centred = points - centroid
    # Many points have the singular values and axes of their triangular factor.
    factor = centred if len(points) < MANY_POINTS else np.linalg.qr(centred, mode="r")
    factor = np.pad(factor, ((0, max(3 - len(factor), 0)), (0, 0)))  # two points have three axes, too
    _, extent, axes = np.linalg.svd(factor, full_matrices=False)
    _demand_extent(feature, extent)
    return _FITS[feature](centred, centroid, axes)


def _demand_extent(feature: Feature, extent: Array) -> None:
    """Refuse points that leave the feature open."""
    need = LEAST_DIMENSIONS[feature]
    spread = int(np.count_nonzero(extent > FLATNESS * max(float(extent[0]), 1e-300))) if extent[0] > 0 else 0
    if spread < need:
        where = ("in one place", "on one line", "in one plane")[spread]
        raise NotEnoughData(f"found all points {where}, which leaves a {feature} open; measure more of it")


def _line(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
    direction = upright(axes[0])
    frame = frame_along(direction)
    local = centred @ frame.T
    flat = np.abs(centred @ axes[2]).max() <= FLATNESS * np.abs(local[:, 2]).max()
    distance = centred @ np.cross(axes[2], direction) if flat else np.hypot(local[:, 0], local[:, 1])
    design = np.column_stack([np.ones(len(centred)), local[:, 2]])
    covariance = np.kron(inverse_normal(design), np.eye(2)).astype(np.float64)  # x, y, slope x, slope y
    rms = float(np.sqrt(np.mean(local[:, 0] ** 2 + local[:, 1] ** 2)))
    scatter = _scatter(4, distance, 2) if flat else _scatter(4, local[:, :2], 4)
    return FittedFeature("line", centroid, direction, None, distance, rms, covariance, scatter, frame, spatial=not flat)


def _plane(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
    direction = upright(axes[2])
    frame = frame_along(direction)
    x, y, distance = (centred @ frame.T).T
    covariance = inverse_normal(np.column_stack([np.ones(len(centred)), x, y]))
    return FittedFeature(
        "plane", centroid, direction, None, distance, _rms(distance), covariance, _scatter(3, distance, 3), frame
    )


def _circle(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
    """In three dimensions: in-plane distances and heights over the plane are minimised together."""
    frame = frame_along(upright(axes[2]))
    local = centred @ frame.T
    x, y, radius = algebraic_circle(local)

    def residuals(q: Array) -> tuple[Array, Array]:
        """Radial deviations, then heights over the plane; slopes over x, y, z, tilts and radius."""
        away = local - q[:3]
        normal, tilts, over, distance, outward = about_axis(away, q[3], q[4])
        radial_slopes = np.column_stack([-outward, -over[:, None] * (outward @ tilts.T), -np.ones(len(local))])
        over_slopes = np.column_stack([np.broadcast_to(-normal, away.shape), away @ tilts.T, np.zeros(len(local))])
        return np.concatenate([distance - q[5], over]), np.vstack([radial_slopes, over_slopes])

    start = np.array([x, y, 0.0, 0.0, 0.0, radius])
    scale = np.array([radius, radius, radius, 1.0, 1.0, radius])
    q, r, J = least_squares(residuals, start, scale)
    turned = frame_tilted(frame, q[3], q[4])
    n = len(local)
    rms = float(np.sqrt(r @ r / n))
    point = centroid + q[:3] @ frame
    in_plane, over = _scatter(1, r[:n], 3), _scatter(1, r[n:], 3)
    scatter = np.concatenate([in_plane, in_plane, over, over, over, in_plane])
    return FittedFeature(
        "circle", point, upright(turned[2]), float(q[5]), r[:n], rms, inverse_normal(J), scatter, turned, slopes=J[:n]
    )


def _revolved(feature: Feature, kind: Revolved) -> Callable[[Array, Array, Array], FittedFeature]:
    """The fit of a cylinder or a cone."""

    def fit(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
        found = fitted_revolved(kind, centred, axes)
        q, r, m = found.parameters, found.distances, found.parameters.size
        turned = frame_tilted(found.frame, q[2], q[3])
        direction = upright(turned[2])
        on_axis = centroid + np.array([q[0], q[1], 0.0]) @ found.frame
        point = on_axis + direction * float((centroid - on_axis) @ direction)
        return FittedFeature(
            feature, point, direction, float(q[4]), r, _rms(r), inverse_normal(found.slopes), _scatter(m, r, m),
            turned, None if m == 5 else float(q[5]), slopes=found.slopes,
        )  # fmt: skip

    return fit


def _sphere(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
    design = np.column_stack([2.0 * centred, np.ones(len(centred))])
    solution = np.linalg.lstsq(design, (centred**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(solution[3] + solution[:3] @ solution[:3], 1e-300)))

    def residuals(q: Array) -> tuple[Array, Array]:
        away = centred - q[:3]
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        return distance - q[3], np.column_stack([-away / distance[:, None], -np.ones(len(centred))])

    q, r, J = least_squares(residuals, np.append(solution[:3], radius), np.full(4, radius))
    scatter = _scatter(4, r, 4)
    return FittedFeature(
        "sphere", centroid + q[:3], None, float(q[3]), r, _rms(r), inverse_normal(J), scatter, np.eye(3), slopes=J
    )


def _rms(distances: Array) -> float:
    return float(np.sqrt(np.mean(distances**2)))


def _scatter(parameters: int, distances: Array, used: int) -> Array:
    """The distances' standard deviation for each of some parameters, less what ``used`` of them took up."""
    free = distances.size - used
    return np.full(parameters, np.sqrt((distances**2).sum() / free) if free > 0 else np.nan)


@dataclass(frozen=True, slots=True)
class Layout:
    """Where position, direction, radius and half angle stand among a feature's parameters."""

    position: slice | None
    slopes: slice | None = None
    radius: int | None = None
    half_angle: int | None = None


LAYOUTS: dict[Feature, Layout] = {
    "line": Layout(slice(0, 2), slice(2, 4)),
    "plane": Layout(slice(0, 1), slice(1, 3)),
    "circle": Layout(slice(0, 3), slice(3, 5), 5),
    "cylinder": Layout(slice(0, 2), slice(2, 4), 4),
    "sphere": Layout(slice(0, 3), None, 3),
    "cone": Layout(slice(0, 2), slice(2, 4), 4, 5),
}
_FITS: dict[Feature, Callable[[Array, Array, Array], FittedFeature]] = {
    "line": _line,
    "plane": _plane,
    "circle": _circle,
    "cylinder": _revolved("cylinder", CYLINDER),
    "sphere": _sphere,
    "cone": _revolved("cone", CONE),
}
