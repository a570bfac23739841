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
DIRECTIONS = 300
"""Axes that a cylinder is looked for along: about 6 degrees apart."""
SEARCHED_POINTS = 1500
BEST_STARTS = 6
MOST_STEPS = 300
STILL = 1e-15
"""Relative to the feature's size: a step that changes nothing a double can hold."""
FLAT = 1e-9
"""Relative thickness of points that lie in a plane (or on a line)."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A feature where least squares put it: ``point`` (3,) mm, unit ``direction`` (3,) or None, ``radius`` or None."""

    feature: Feature
    point: Array
    direction: Array | None
    radius: float | None
    deviation: Array
    """(n,) mm: distance from the feature, positive outwards (plane: along its direction; line: never negative)."""
    rms: float
    """mm, of the orthogonal distances that were minimised."""
    factors: Array
    """(m, m) covariance of the parameters for noise of 1 mm: the position's own, then slopes, then radius."""
    scatter: Array
    """(m,) mm: standard deviation of the distances that bear on each parameter; NaN where none is left over."""
    layout: tuple[slice, slice | None, int | None]
    """Where position, direction and radius stand among the parameters."""
    frame: Array
    """(3, 3) rows: the axes in which the parameters count, the feature's direction last."""


def associate(points: Array, feature: Feature) -> Placed:
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
    _, extent, axes = np.linalg.svd(centred, full_matrices=False) if len(points) < 5000 else _large_svd(centred)
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
        if np.all(np.abs(step) <= STILL * scale) or damping > 1e12:
            break
    return q, r, J


def _damped_step(J: Array, r: Array, damping: float) -> Array:
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    Q, R = np.linalg.qr(J / size)
    rows = np.vstack([R, np.sqrt(damping) * np.eye(R.shape[1])])
    right = np.concatenate([-(Q.T @ r), np.zeros(R.shape[1])])
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-15)[0] / size)


def _large_svd(centred: Array) -> tuple[None, Array, Array]:
    """Singular values and axes of many points from their triangular factor."""
    _, extent, axes = np.linalg.svd(np.linalg.qr(centred, mode="r"))
    return None, extent, axes


def _demand_extent(feature: Feature, extent: Array) -> None:
    """Refuse points that leave the feature open."""
    need = {"line": 1, "plane": 2, "circle": 2, "cylinder": 2, "sphere": 3}[feature]
    spread = int(np.count_nonzero(extent > FLAT * max(float(extent[0]), 1e-300))) if extent[0] > 0 else 0
    if spread < need:
        where = ("in one place", "on one line", "in one plane")[spread]
        raise NotEnoughData(f"found all points {where}, which leaves a {feature} open; measure more of it")


def _line(centred: Array, centroid: Array, axes: Array) -> Placed:
    direction = upright(axes[0])
    frame = frame_along(direction)
    local = centred @ frame.T
    flat = np.abs(centred @ axes[2]).max() <= FLAT * np.abs(local[:, 2]).max()
    distance = centred @ np.cross(axes[2], direction) if flat else np.hypot(local[:, 0], local[:, 1])
    one = np.column_stack([np.ones(len(centred)), local[:, 2]])
    factors = np.kron(_inverse(one), np.eye(2)).astype(np.float64)  # x, y, slope x, slope y
    rms = float(np.sqrt(np.mean(local[:, 0] ** 2 + local[:, 1] ** 2)))
    scatter = _scatter(4, local[:, :2], 4)
    return Placed(
        "line", centroid, direction, None, distance, rms, factors, scatter, (slice(0, 2), slice(2, 4), None), frame
    )


def _plane(centred: Array, centroid: Array, axes: Array) -> Placed:
    direction = upright(axes[2])
    frame = frame_along(direction)
    local = centred @ frame.T
    factors = _inverse(np.column_stack([np.ones(len(centred)), local[:, 0], local[:, 1]]))
    rms = float(np.sqrt(np.mean(local[:, 2] ** 2)))
    scatter = _scatter(3, local[:, 2], 3)
    return Placed(
        "plane", centroid, direction, None, local[:, 2], rms, factors, scatter, (slice(0, 1), slice(1, 3), None), frame
    )


def _circle(centred: Array, centroid: Array, axes: Array) -> Placed:
    """In three dimensions: in-plane distances and heights over the plane are minimised together."""
    frame = frame_along(upright(axes[2]))
    local = centred @ frame.T
    x, y, radius = _algebraic(local)

    def residuals(q: Array) -> tuple[Array, Array]:
        radial, radial_slopes, over, over_slopes = _circle_at(q, local)
        return np.concatenate([radial, over]), np.vstack([radial_slopes, over_slopes])

    start = np.array([x, y, 0.0, 0.0, 0.0, radius])
    scale = np.array([radius, radius, radius, 1.0, 1.0, radius])
    q, r, J = least_squares(residuals, start, scale)
    turned = _frame_tilted(frame, q[3], q[4])
    n = len(local)
    rms = float(np.sqrt(r @ r / n))
    layout = (slice(0, 3), slice(3, 5), 5)
    point = centroid + q[:3] @ frame
    in_plane, over = _scatter(1, r[:n], 3), _scatter(1, r[n:], 3)
    scatter = np.concatenate([in_plane, in_plane, over, over, over, in_plane])
    return Placed("circle", point, upright(turned[2]), float(q[5]), r[:n], rms, _inverse(J), scatter, layout, turned)


def _circle_at(q: Array, local: Array) -> tuple[Array, Array, Array, Array]:
    """Radial deviation and height over the plane (n,) with their slopes (n, 6) over x, y, z, tilts and radius."""
    length = np.sqrt(1.0 + q[3] ** 2 + q[4] ** 2)
    normal = np.array([q[3], q[4], 1.0]) / length
    away = local - q[:3]
    over = away @ normal
    level = away - over[:, None] * normal
    distance = np.maximum(np.linalg.norm(level, axis=1), 1e-300)
    outward = level / distance[:, None]
    tilts = (np.eye(3)[:2] - np.outer(normal[:2], normal)) / length  # d normal / d tilts, (2, 3)
    over_tilts = away @ tilts.T
    radial_tilts = -over[:, None] * (outward @ tilts.T)
    radial_slopes = np.column_stack([-outward, radial_tilts, -np.ones(len(local))])
    over_slopes = np.column_stack([np.broadcast_to(-normal, away.shape), over_tilts, np.zeros(len(local))])
    return distance - q[5], radial_slopes, over, over_slopes


def _cylinder(centred: Array, centroid: Array, axes: Array) -> Placed:
    best: tuple[Array, Array, Array, Array] | None = None
    few = centred[:: max(1, len(centred) // SEARCHED_POINTS)]
    for direction in _promising(few, axes):
        frame, q = _settled_cylinder(few, direction)
        frame, q, r, J = (
            _refined_cylinder(centred, frame, q) if few is not centred else (frame, q, *_both(few, frame, q))
        )
        if best is None or r @ r < best[2] @ best[2] * (1 - 1e-9):
            best = frame, q, r, J
    if best is None:
        raise NotEnoughData("found no cylinder through the points; check that they lie on one")
    frame, q, r, J = best
    turned = _frame_tilted(frame, q[2], q[3])
    direction = upright(turned[2])
    on_axis = centroid + np.array([q[0], q[1], 0.0]) @ frame
    point = on_axis + direction * float((centroid - on_axis) @ direction)
    rms = float(np.sqrt(np.mean(r**2)))
    layout = (slice(0, 2), slice(2, 4), 4)
    return Placed("cylinder", point, direction, float(q[4]), r, rms, _inverse(J), _scatter(5, r, 5), layout, turned)


def cylinder_at(q: Array, local: Array) -> tuple[Array, Array]:
    """Distance (n,) mm of points from the axis (q0, q1, 0) + s (q2, q3, 1), less q4, and its slopes (n, 5)."""
    length = np.sqrt(1.0 + q[2] ** 2 + q[3] ** 2)
    axis = np.array([q[2], q[3], 1.0]) / length
    away = local - np.array([q[0], q[1], 0.0])
    along = away @ axis
    level = away - along[:, None] * axis
    distance = np.maximum(np.linalg.norm(level, axis=1), 1e-300)
    outward = level / distance[:, None]
    tilts = (np.eye(3)[:2] - np.outer(axis[:2], axis)) / length
    slopes = np.column_stack([-outward[:, :2], -along[:, None] * (outward @ tilts.T), -np.ones(len(local))])
    return distance - q[4], slopes


def _promising(points: Array, axes: Array) -> list[Array]:
    """Directions along which the points, seen end on, lie best on a circle."""
    i = np.arange(DIRECTIONS) + 0.5
    z = i / DIRECTIONS  # a hemisphere, evenly (golden spiral)
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


def _settled_cylinder(points: Array, direction: Array) -> tuple[Array, Array]:
    """A cylinder from a start direction; its frame follows the axis so that the slopes stay small."""
    frame = frame_along(direction)
    x, y, radius = _algebraic(points @ frame.T)
    return _refined_cylinder(points, frame, np.array([x, y, 0.0, 0.0, radius]))[:2]


def _refined_cylinder(points: Array, frame: Array, q: Array) -> tuple[Array, Array, Array, Array]:
    """The least-squares cylinder about the points' centroid in a frame along its axis, residuals and Jacobian."""
    r, J = np.zeros(0), np.zeros((0, 5))
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


def _both(points: Array, frame: Array, q: Array) -> tuple[Array, Array]:
    return cylinder_at(q, points @ frame.T)


def _sphere(centred: Array, centroid: Array, axes: Array) -> Placed:
    design = np.column_stack([2.0 * centred, np.ones(len(centred))])
    solution = np.linalg.lstsq(design, (centred**2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(solution[3] + solution[:3] @ solution[:3], 1e-300)))

    def residuals(q: Array) -> tuple[Array, Array]:
        away = centred - q[:3]
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        return distance - q[3], np.column_stack([-away / distance[:, None], -np.ones(len(centred))])

    q, r, J = least_squares(residuals, np.append(solution[:3], radius), np.full(4, radius))
    rms = float(np.sqrt(np.mean(r**2)))
    layout = (slice(0, 3), None, 3)
    return Placed(
        "sphere", centroid + q[:3], None, float(q[3]), r, rms, _inverse(J), _scatter(4, r, 4), layout, np.eye(3)
    )


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


def _scatter(parameters: int, distances: Array, used: int) -> Array:
    """The distances' standard deviation for each of some parameters, less what ``used`` of them took up."""
    free = distances.size - used
    return np.full(parameters, np.sqrt((distances**2).sum() / free) if free > 0 else np.nan)


def _inverse(J: Array) -> Array:
    """(J^T J)^-1; infinite variance stays finite but huge where the points leave a parameter open."""
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    scaled = J / size
    return np.asarray(np.linalg.pinv(scaled.T @ scaled, rcond=1e-14, hermitian=True) / np.outer(size, size))


_FITS: dict[Feature, Callable[[Array, Array, Array], Placed]] = {
    "line": _line,
    "plane": _plane,
    "circle": _circle,
    "cylinder": _cylinder,
    "sphere": _sphere,
}
