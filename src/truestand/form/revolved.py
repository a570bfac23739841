"""Cylinder and cone by least squares, looked for along many directions first: nobody needs to guess the axis."""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, cos, sin, tan

import numpy as np

from truestand.core.arrays import Array
from truestand.form.axes import about_axis, frame_along, frame_tilted, hemisphere, upright
from truestand.form.least_squares import least_squares

SEARCHED_DIRECTIONS = 300
"""Of an axis: about 6 degrees apart."""
SEARCHED_POINTS = 1500
BEST_STARTS = 12
APART = 0.98
"""Cosine of the angle (11 degrees) by which starts differ at least."""
MOST_TURNS = 6
"""Of the frame after the axis."""


@dataclass(frozen=True, slots=True)
class Revolved:
    """A surface of revolution: its distances and an algebraic start, in a frame whose z axis is near its own."""

    distances: Callable[[Array, Array], tuple[Array, Array]]
    """Parameters (m,) and points (n, 3) mm: distances (n,) mm, positive outwards, and their slopes (n, m)."""
    start: Callable[[Array], Array]
    """Parameters (m,) about the frame's z direction: x, y, slopes 0, 0, radius at z = 0, half angle of a cone."""


@dataclass(frozen=True, slots=True)
class FittedRevolved:
    """Where it lies: parameters in a frame (3, 3) along its axis, which has its largest component positive."""

    frame: Array
    parameters: Array
    distances: Array
    slopes: Array

    @property
    def cost(self) -> float:
        """Sum of the squared distances."""
        return float(self.distances @ self.distances)


def cylinder_at(q: Array, local: Array) -> tuple[Array, Array]:
    """Distance (n,) mm of points from the axis (q0, q1, 0) + s (q2, q3, 1), less q4, and its slopes (n, 5)."""
    _, tilts, along, distance, outward = about_axis(local - np.array([q[0], q[1], 0.0]), q[2], q[3])
    slopes = np.column_stack([-outward[:, :2], -along[:, None] * (outward @ tilts.T), -np.ones(len(local))])
    return distance - q[4], slopes


def cone_at(q: Array, local: Array) -> tuple[Array, Array]:
    """Distance (n,) mm of points from the cone about the axis (q0, q1, 0) + s (q2, q3, 1), and its slopes (n, 6).

    Its radius is q4 at s = 0 and grows with s by the tangent of the half angle q5 (rad).
    """
    away = local - np.array([q[0], q[1], 0.0])
    axis, tilts, along, distance, outward = about_axis(away, q[2], q[3])
    c, s = cos(q[5]), sin(q[5])
    over = distance - q[4]
    slopes = np.column_stack([
        -c * outward[:, :2] + s * axis[:2],
        -c * along[:, None] * (outward @ tilts.T) - s * (away @ tilts.T),
        np.full(len(local), -c),
        -s * over - c * along,
    ])  # fmt: skip
    return c * over - s * along, slopes


def algebraic_circle(local: Array) -> Array:
    """Centre x, y and radius of the circle that minimises the squared power of the points (Kasa 1976), seen along z."""
    x, y, rest = _quadric(local, np.ones((len(local), 1)))
    return np.array([x, y, np.sqrt(max(rest + x * x + y * y, 1e-300))])


def fitted_revolved(kind: Revolved, points: Array, axes: Array) -> FittedRevolved:
    """The least-squares surface through points (n, 3) mm about their centroid with their principal ``axes`` (3, 3)."""
    few = points[:: max(1, len(points) // SEARCHED_POINTS)]
    best = None
    for direction in _promising(kind, few, axes):
        frame = frame_along(direction)
        found = _refined(kind, few, frame, kind.start(few @ frame.T))
        if best is None or found.cost < best.cost * (1 - 1e-9):
            best = found
    assert best is not None  # there is always a direction to start from
    return best if few is points else _refined(kind, points, best.frame, best.parameters)


def _quadric(local: Array, terms: Array) -> Array:
    """x, y and the factors of further ``terms`` (n, k) that make x^2 + y^2 of the points (n, 3)."""
    design = np.column_stack([2.0 * local[:, :2], terms])
    right = local[:, 0] ** 2 + local[:, 1] ** 2
    return np.asarray(np.linalg.lstsq(design, right, rcond=1e-12)[0])


def _start_of_cylinder(local: Array) -> Array:
    x, y, radius = algebraic_circle(local)
    return np.array([x, y, 0.0, 0.0, radius])


def _start_of_cone(local: Array) -> Array:
    """(X - x)^2 + (Y - y)^2 = (r + t z)^2, solved for x, y, r^2, 2 r t and t^2 as if they were free."""
    z = local[:, 2]
    x, y, rest, mixed, square = _quadric(local, np.column_stack([np.ones_like(z), z, z * z]))
    radius = np.sqrt(max(rest + x * x + y * y, 1e-300))
    slope = np.copysign(np.sqrt(square), mixed) if square > 0 else mixed / (2 * radius)
    return np.array([x, y, 0.0, 0.0, radius, atan(slope)])


def _promising(kind: Revolved, points: Array, axes: Array) -> list[Array]:
    """Directions along which the algebraic starts fit best."""
    tried = np.vstack([axes, hemisphere(SEARCHED_DIRECTIONS)])
    misfit = []
    for direction in tried:
        local = points @ frame_along(upright(direction)).T
        distances, _ = kind.distances(kind.start(local), local)
        misfit.append(float(distances @ distances))
    chosen: list[Array] = []
    for k in np.argsort(misfit):
        if all(abs(float(tried[k] @ other)) < APART for other in chosen):
            chosen.append(upright(tried[k]))
        if len(chosen) == BEST_STARTS:
            break
    return chosen


def _refined(kind: Revolved, points: Array, frame: Array, q: Array) -> FittedRevolved:
    """Levenberg-Marquardt from a start; the frame follows the axis: slopes stay small."""
    size = float(np.abs(points).max())
    for _ in range(MOST_TURNS):
        local = points @ frame.T
        lengths = np.array([1.0, 1.0, 1 / size, 1 / size, 1.0, 1 / size])[: q.size] * abs(q[4])
        q, r, J = least_squares(lambda p, local=local: kind.distances(p, local), q, lengths + 1e-300)  # type: ignore[misc]
        if np.hypot(q[2], q[3]) < 1e-9:
            break
        frame, q = _turned(frame, q)
    return FittedRevolved(frame, q, r, J)


def _turned(frame: Array, q: Array) -> tuple[Array, Array]:
    """A frame along the axis, and the parameters in it."""
    axis = frame_tilted(frame, q[2], q[3])[2]
    turned = frame_along(upright(axis))
    x, y, z = turned @ (np.array([q[0], q[1], 0.0]) @ frame)
    if q.size == 5:
        return turned, np.array([x, y, 0.0, 0.0, q[4]])
    angle = q[5] * float(np.sign(turned[2] @ axis))
    return turned, np.array([x, y, 0.0, 0.0, q[4] - z * tan(angle), angle])


CYLINDER = Revolved(cylinder_at, _start_of_cylinder)
CONE = Revolved(cone_at, _start_of_cone)
