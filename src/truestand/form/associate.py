"""Ideal features associated with measured points by least squares of the orthogonal distances (ISO 17450, LSC).

Line and plane are exact by singular values. Circle, cylinder and sphere are found by Levenberg-Marquardt from algebraic
starts; a cylinder is looked for along many directions first, so that no guess of its axis is needed. Every fit works
about the points' centroid: offsets of 1e5 mm cost nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import NotEnoughData

Feature = Literal["line", "plane", "circle", "cylinder", "sphere"]
Residuals = Callable[[Array], tuple[Array, Array]]
"""Parameters (m,) to residuals (n,) and their Jacobian (n, m)."""

LEAST_POINTS: dict[Feature, int] = {"line": 2, "plane": 3, "circle": 3, "cylinder": 5, "sphere": 4}
MANY_POINTS = 5000
SEARCHED_DIRECTIONS = 300
"""Of a cylinder's axis: about 6 degrees apart."""
SEARCHED_POINTS = 1500
BEST_STARTS = 6
MOST_STEPS = 300
SETTLED = 1e-15
"""Relative to the feature's size: a step that changes nothing a double can hold."""
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
    """(m, m) covariance of the parameters for noise of 1 mm: position, then slopes, then radius."""
    scatter: Array
    """(m,) mm: standard deviation of the distances that bear on each parameter; NaN without redundant points."""
    frame: Array
    """(3, 3) rows: the axes in which the parameters count, the feature's direction last."""


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
    _, extent, axes = np.linalg.svd(factor, full_matrices=False)
    _demand_extent(feature, extent)
    return _FITS[feature](centred, centroid, axes)


def upright(direction: Array) -> Array:
    """The same axis with its largest component positive."""
    sign = np.sign(direction[int(np.argmax(np.abs(direction)))])
    return np.asarray(direction * (sign or 1.0))


def frame_along(direction: Array) -> Array:
    """Rows (3, 3): a right-handed orthonormal frame whose last axis is ``direction``."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first), direction])


def least_squares(residuals: Residuals, start: Array, scale: Array) -> tuple[Array, Array, Array]:
    """Levenberg-Marquardt with Marquardt's scaling to the last digit: parameters, residuals, Jacobian.

    ``scale`` (m,): size of each parameter, against which a step is still.
    """
    q = start.copy()
    r, J = residuals(q)
    damping = 1e-6
    for _ in range(MOST_STEPS):
        step = _damped_step(J, r, damping)
        tried, (r_new, J_new) = q + step, residuals(q + step)
        if r_new @ r_new <= (r @ r) * (1.0 + 1e-14):
            q, r, J = tried, r_new, J_new
            damping = damping / 10.0 if damping > 1e-14 else 0.0
        else:
            damping = max(10.0 * damping, 1e-12)
        if np.all(np.abs(step) <= SETTLED * scale) or damping > 1e12:
            break
    return q, r, J


def _damped_step(J: Array, r: Array, damping: float) -> Array:
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    Q, R = np.linalg.qr(J / size)
    rows = np.vstack([R, np.sqrt(damping) * np.eye(R.shape[1])])
    right = np.concatenate([-(Q.T @ r), np.zeros(R.shape[1])])
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-15)[0] / size)


def _demand_extent(feature: Feature, extent: Array) -> None:
    """Refuse points that leave the feature open."""
    need = {"line": 1, "plane": 2, "circle": 2, "cylinder": 2, "sphere": 3}[feature]
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
    one_side = _inverse(np.column_stack([np.ones(len(centred)), local[:, 2]]))
    covariance = np.kron(one_side, np.eye(2)).astype(np.float64)  # x, y, slope x, slope y
    rms, scatter = float(np.sqrt(np.mean(local[:, 0] ** 2 + local[:, 1] ** 2))), _scatter(4, local[:, :2], 4)
    return FittedFeature("line", centroid, direction, None, distance, rms, covariance, scatter, frame)


def _plane(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
    direction = upright(axes[2])
    frame = frame_along(direction)
    x, y, distance = (centred @ frame.T).T
    covariance = _inverse(np.column_stack([np.ones(len(centred)), x, y]))
    return FittedFeature(
        "plane", centroid, direction, None, distance, _rms(distance), covariance, _scatter(3, distance, 3), frame
    )


def _circle(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
    """In three dimensions: in-plane distances and heights over the plane are minimised together."""
    frame = frame_along(upright(axes[2]))
    local = centred @ frame.T
    x, y, radius = _algebraic(local)

    def residuals(q: Array) -> tuple[Array, Array]:
        """Radial deviations, then heights over the plane; slopes over x, y, z, tilts and radius."""
        away = local - q[:3]
        normal, tilts, over, distance, outward = _about_axis(away, q[3], q[4])
        radial_slopes = np.column_stack([-outward, -over[:, None] * (outward @ tilts.T), -np.ones(len(local))])
        over_slopes = np.column_stack([np.broadcast_to(-normal, away.shape), away @ tilts.T, np.zeros(len(local))])
        return np.concatenate([distance - q[5], over]), np.vstack([radial_slopes, over_slopes])

    start = np.array([x, y, 0.0, 0.0, 0.0, radius])
    scale = np.array([radius, radius, radius, 1.0, 1.0, radius])
    q, r, J = least_squares(residuals, start, scale)
    turned = _frame_tilted(frame, q[3], q[4])
    n = len(local)
    rms = float(np.sqrt(r @ r / n))
    point = centroid + q[:3] @ frame
    in_plane, over = _scatter(1, r[:n], 3), _scatter(1, r[n:], 3)
    scatter = np.concatenate([in_plane, in_plane, over, over, over, in_plane])
    return FittedFeature("circle", point, upright(turned[2]), float(q[5]), r[:n], rms, _inverse(J), scatter, turned)


def _about_axis(away: Array, a: float, b: float) -> tuple[Array, Array, Array, Array, Array]:
    """Points (n, 3) mm, counted from a point of the axis along (a, b, 1): the axis as a unit vector, its slopes (2, 3)
    over a and b, how far along it the points lie, their distances (n,) mm and unit vectors (n, 3) away from it.
    """
    length = np.sqrt(1.0 + a**2 + b**2)
    axis = np.array([a, b, 1.0]) / length
    tilts = (np.eye(3)[:2] - np.outer(axis[:2], axis)) / length
    along = away @ axis
    level = away - along[:, None] * axis
    distance = np.maximum(np.linalg.norm(level, axis=1), 1e-300)
    return axis, tilts, along, distance, level / distance[:, None]


def _cylinder(centred: Array, centroid: Array, axes: Array) -> FittedFeature:
    few = centred[:: max(1, len(centred) // SEARCHED_POINTS)]
    fits = [_cylinder_along(centred, few, direction) for direction in _promising(few, axes)]
    frame, q, r, J = fits[0]
    for fit in fits[1:]:
        if fit[2] @ fit[2] < (r @ r) * (1 - 1e-9):
            frame, q, r, J = fit
    turned = _frame_tilted(frame, q[2], q[3])
    direction = upright(turned[2])
    on_axis = centroid + np.array([q[0], q[1], 0.0]) @ frame
    point = on_axis + direction * float((centroid - on_axis) @ direction)
    scatter = _scatter(5, r, 5)
    return FittedFeature("cylinder", point, direction, float(q[4]), r, _rms(r), _inverse(J), scatter, turned)


def cylinder_at(q: Array, local: Array) -> tuple[Array, Array]:
    """Distance (n,) mm of points from the axis (q0, q1, 0) + s (q2, q3, 1), less q4, and its slopes (n, 5)."""
    _, tilts, along, distance, outward = _about_axis(local - np.array([q[0], q[1], 0.0]), q[2], q[3])
    slopes = np.column_stack([-outward[:, :2], -along[:, None] * (outward @ tilts.T), -np.ones(len(local))])
    return distance - q[4], slopes


def _promising(points: Array, axes: Array) -> list[Array]:
    """Directions along which the points, seen end on, lie best on a circle."""
    i = np.arange(SEARCHED_DIRECTIONS) + 0.5
    z = i / SEARCHED_DIRECTIONS  # a hemisphere, evenly (golden spiral)
    around = np.pi * (1.0 + np.sqrt(5.0)) * i
    level = np.sqrt(1.0 - z * z)
    spread = np.column_stack([level * np.cos(around), level * np.sin(around), z])
    tried = np.vstack([axes, spread])
    misfit = []
    for direction in tried:
        local = points @ frame_along(direction).T
        x, y, radius = _algebraic(local)
        misfit.append(float(np.mean((np.hypot(local[:, 0] - x, local[:, 1] - y) - radius) ** 2)))
    chosen: list[Array] = []
    for k in np.argsort(misfit):
        if all(abs(float(tried[k] @ other)) < 0.98 for other in chosen):
            chosen.append(tried[k])
        if len(chosen) == BEST_STARTS:
            break
    return chosen


def _cylinder_along(points: Array, few: Array, direction: Array) -> tuple[Array, Array, Array, Array]:
    """The cylinder through the points from a start direction, first through ``few`` of them."""
    frame = frame_along(direction)
    x, y, radius = _algebraic(few @ frame.T)
    frame, q, _, _ = _refined_cylinder(few, frame, np.array([x, y, 0.0, 0.0, radius]))
    return _refined_cylinder(points, frame, q)


def _refined_cylinder(points: Array, frame: Array, q: Array) -> tuple[Array, Array, Array, Array]:
    """Frame along the axis, parameters, residuals and Jacobian; the frame follows the axis: slopes stay small."""
    size = float(np.abs(points).max())
    for _ in range(6):
        local = points @ frame.T
        scale = np.array([q[4], q[4], q[4] / size, q[4] / size, q[4]]) + 1e-300
        q, r, J = least_squares(lambda p, local=local: cylinder_at(p, local), q, np.abs(scale))  # type: ignore[misc]
        if np.hypot(q[2], q[3]) < 1e-9:
            break
        turned = _frame_tilted(frame, q[2], q[3])
        on_axis = turned @ (np.array([q[0], q[1], 0.0]) @ frame)
        frame, q = turned, np.array([on_axis[0], on_axis[1], 0.0, 0.0, q[4]])
    return frame, q, r, J


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
    return FittedFeature("sphere", centroid + q[:3], None, float(q[3]), r, _rms(r), _inverse(J), scatter, np.eye(3))


def _algebraic(local: Array) -> tuple[float, float, float]:
    """Centre x, y and radius of the circle that minimises the squared power of the points (Kasa 1976), seen along z."""
    design = np.column_stack([2.0 * local[:, 0], 2.0 * local[:, 1], np.ones(len(local))])
    right = local[:, 0] ** 2 + local[:, 1] ** 2
    x, y, rest = np.linalg.lstsq(design, right, rcond=1e-12)[0]
    return float(x), float(y), float(np.sqrt(max(rest + x * x + y * y, 1e-300)))


def _frame_tilted(frame: Array, a: float, b: float) -> Array:
    """The frame whose last axis is (a, b, 1) in the old one."""
    axis = np.array([a, b, 1.0]) @ frame
    return frame_along(axis / np.linalg.norm(axis))


def _rms(distances: Array) -> float:
    return float(np.sqrt(np.mean(distances**2)))


def _scatter(parameters: int, distances: Array, used: int) -> Array:
    """The distances' standard deviation for each of some parameters, less what ``used`` of them took up."""
    free = distances.size - used
    return np.full(parameters, np.sqrt((distances**2).sum() / free) if free > 0 else np.nan)


def _inverse(J: Array) -> Array:
    """(J^T J)^-1; infinite variance stays finite but huge where the points leave a parameter open."""
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    scaled = J / size
    return np.asarray(np.linalg.pinv(scaled.T @ scaled, rcond=1e-14, hermitian=True) / np.outer(size, size))


LAYOUTS: dict[Feature, tuple[slice, slice | None, int | None]] = {
    "line": (slice(0, 2), slice(2, 4), None),
    "plane": (slice(0, 1), slice(1, 3), None),
    "circle": (slice(0, 3), slice(3, 5), 5),
    "cylinder": (slice(0, 2), slice(2, 4), 4),
    "sphere": (slice(0, 3), None, 3),
}
"""Where position, direction and radius stand among the parameters."""
_FITS: dict[Feature, Callable[[Array, Array, Array], FittedFeature]] = {
    "line": _line,
    "plane": _plane,
    "circle": _circle,
    "cylinder": _cylinder,
    "sphere": _sphere,
}
