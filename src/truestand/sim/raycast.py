"""Where laser rays meet the shaft: the first hit of each ray, exact to a nanometre."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.sim.shaft_surface import Face, Step

NEWTON_STEPS = 4
NOTHING, STEP, FACE, MESH = range(4)
"""What a ray may meet."""
SEARCH_MARGIN_MM = 1.0
"""Beyond the heights of a step's drawing, within which its surface (chamfer, form) is solved."""
OCCLUSION_START_MM = 0.3
"""From a point: a step that is met nearer by is the surface on which the point lies."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays in C: origins (3, B, 1) and directions (3, B, M)."""

    origin: Array
    direction: Array


@dataclass(frozen=True, slots=True)
class Hits:
    """First hits, (B, M) each: distance along the ray, inf where there is none; polar angle and height there."""

    distance: Array
    psi: Array
    height: Array
    surface: NDArray[np.int8]
    """NOTHING, STEP, FACE or MESH."""
    triangle: NDArray[np.int32]
    """Of the mesh, where one is met."""

    def record(self, at: Any, distance: Array, psi: Array, height: Array | float, surface: int) -> None:
        """Set the hits at the indices or mask ``at``."""
        self.distance[at], self.psi[at], self.height[at], self.surface[at] = distance, psi, height, surface


def rays_in_shaft(origin: Array, directions: Array, angle: Array, shaft_from_rotor: Array) -> Rays:
    """Rays that stand still in T, seen from the turning shaft.

    Args:
        origin: (3,) mm in T.
        directions: (3, M) in T.
        angle: (B,) rad table angle of each profile.
        shaft_from_rotor: (4, 4).
    """
    start = _in_shaft(origin[:, None], angle, shaft_from_rotor)
    return Rays(start + shaft_from_rotor[:3, 3, None, None], _in_shaft(directions, angle, shaft_from_rotor))


def _in_shaft(vectors: Array, angle: Array, shaft_from_rotor: Array) -> Array:
    """Vectors (3, M) in T as directions (3, B, M) in C."""
    x, y, z = vectors
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    in_rotor = np.stack([c * x + s * y, c * y - s * x, np.broadcast_to(z, (angle.size, z.size))])
    return np.tensordot(shaft_from_rotor[:3, :3], in_rotor, 1)


def first_hits(rays: Rays, steps: tuple[Step, ...], faces: tuple[Face, ...]) -> Hits:
    """The first surface that each ray meets."""
    shape = rays.direction.shape[1:]
    hits = Hits(
        np.full(shape, np.inf), np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int8), np.zeros(shape, np.int32)
    )
    for step in steps:
        _meet_step(rays, step, hits)
    for face in faces:
        _meet_face(rays, face, hits)
    return hits


def _split(step: Step, origin: Array, direction: Array) -> tuple[Array, Array, Array, Array]:
    """Origins and directions of rays along a step's axis, (B, 1 or M) each, and across it, (3, B, 1 or M) each."""
    offset, axis = origin - step.origin[:, None, None], step.axis[:, None, None]
    along0, along1 = np.tensordot(step.axis, offset, 1), np.tensordot(step.axis, direction, 1)
    return along0, along1, offset - axis * along0, direction - axis * along1


def _quadratic(p: Array, q: Array, radius: float) -> tuple[Array, Array, Array, Array]:
    """a, b, c of |p + s q|² = c + 2 b s + a s², and the discriminant of its reaching ``radius``; (B, M) each."""
    a = np.einsum("ijk,ijk->jk", q, q)
    b = np.einsum("ijk,ijk->jk", np.broadcast_to(p, q.shape), q)
    c = (p * p).sum(axis=0)
    return a, b, c, b * b - a * (c - radius**2)


def _meet_step(rays: Rays, step: Step, hits: Hits) -> None:
    """Solve |offset + s direction| = radius(psi, height) for s on the rays that come near the step."""
    along0, along1, p, q = _split(step, rays.origin, rays.direction)
    a, b, c, discriminant = _quadratic(p, q, step.radius)
    with np.errstate(invalid="ignore", divide="ignore"):
        s = np.where(discriminant > 0, (-b - np.sqrt(np.maximum(discriminant, 0.0))) / a, np.inf)
        height = along0 + s * along1
        near = (height > step.bottom - SEARCH_MARGIN_MM) & (height < step.top + SEARCH_MARGIN_MM)
        near &= np.isfinite(s) & (s > 0)
    row, column = np.nonzero(near)
    if not row.size:
        return
    s, psi, height = _solve(
        step,
        s[near],
        (p[0][row, 0], p[1][row, 0], q[0][near], q[1][near]),
        (a[near], b[near], c[row, 0]),
        (along0[row, 0], along1[near]),
    )
    first = (height >= step.bottom) & (height <= step.top) & (s < hits.distance[row, column])
    hits.record((row[first], column[first]), s[first], psi[first], height[first], STEP)


def _solve(
    step: Step,
    s: Array,
    across: tuple[Array, Array, Array, Array],
    square: tuple[Array, Array, Array],
    along: tuple[Array, Array],
) -> tuple[Array, Array, Array]:
    """Distance, polar angle and height (n,) of the hits, by Newton's method from ``s``.

    Newton works on the distance to the axis less the surface's radius; keyways come last, with their floor's radius.

    Args:
        step: what is met.
        s: (n,) first distance.
        across: px, py, qx, qy (n,): the ray is at p + s q across the axis.
        square: a, b, c (n,) of |p + s q|² = c + 2 b s + a s².
        along: h0, h1 (n,): its height is h0 + s h1.
    """
    px, py, qx, qy = across
    a, b, c = square
    h0, h1 = along
    depth = np.zeros(s.shape)
    for keyways in (False, True) if step.keyways else (False,):
        for _ in range(0 if step.plain and not keyways else NEWTON_STEPS):
            rho = np.sqrt(np.maximum(c + s * (2 * b + s * a), 1e-12))
            radius, slope = step.surface(np.arctan2(py + s * qy, px + s * qx), h0 + s * h1)
            s = s - (rho - radius + depth) / ((b + s * a) / rho - slope * h1)
        psi, height = np.arctan2(py + s * qy, px + s * qx), h0 + s * h1
        if step.keyways and not keyways:
            depth = step.in_keyway(psi, height)
    return s, psi, height


def _meet_face(rays: Rays, face: Face, hits: Hits) -> None:
    down = rays.direction[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (face.height - rays.origin[2]) / down
        x, y = rays.origin[0] + s * rays.direction[0], rays.origin[1] + s * rays.direction[1]
        radius = np.hypot(x, y)
        met = (down < 0) if face.up else (down > 0)
        met &= (s > 0) & (radius >= face.inner) & (radius <= face.outer) & (s < hits.distance)
    hits.record(met, s[met], np.arctan2(y[met], x[met]), face.height, FACE)


def occluded_by_steps(points: Array, camera: Array, steps: tuple[Step, ...]) -> Mask:
    """Whether a step stands between points (3, B, M) and the camera at (3, B, 1), both in C; (B, M)."""
    blocked = np.zeros(points.shape[1:], dtype=np.bool_)
    for step in steps:
        along0, along1, p, q = _split(step, points, camera - points)
        a, b, _, discriminant = _quadratic(p, q, step.radius)
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(np.maximum(discriminant, 0.0))
            for s in ((-b - root) / a, (-b + root) / a):
                height = along0 + s * along1
                met = (discriminant > 0) & (s * np.sqrt(a) > OCCLUSION_START_MM)
                blocked |= met & (height > step.bottom) & (height < step.top)
    return blocked
