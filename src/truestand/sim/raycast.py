"""Where laser rays meet the shaft: the first hit of each ray, exact to a nanometre."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.sim.shaft_surface import Face, Step

Array = NDArray[np.float64]

NEWTON_STEPS = 4
NOTHING, STEP, FACE, MESH = range(4)
"""What a ray may meet."""
NEAR = 1.0
"""mm: beyond a step's drawing, within which its surface (chamfer, form) is solved."""


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


def rays_in_shaft(origin: Array, directions: Array, angle: Array, shaft_from_rotor: Array) -> Rays:
    """Rays that stand still in T, seen from the turning shaft.

    Args:
        origin: (3,) mm in T.
        directions: (3, M) in T.
        angle: (B,) rad table angle of each profile.
        shaft_from_rotor: (4, 4).
    """
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    turn = shaft_from_rotor[:3, :3]
    back = np.stack([c * origin[0] + s * origin[1], c * origin[1] - s * origin[0], np.broadcast_to(origin[2], c.shape)])
    way = np.stack(
        [
            c * directions[0] + s * directions[1],
            c * directions[1] - s * directions[0],
            np.broadcast_to(directions[2], (angle.size, directions.shape[1])),
        ]
    )
    start = np.tensordot(turn, back, 1) + shaft_from_rotor[:3, 3, None, None]
    return Rays(start, np.tensordot(turn, way, 1))


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


def _meet_step(rays: Rays, step: Step, hits: Hits) -> None:
    """Solve |offset + s way| = radius(psi, height) for s on the rays that come near the step."""
    offset = rays.origin - step.origin[:, None, None]
    along0, along1 = np.tensordot(step.axis, offset, 1), np.tensordot(step.axis, rays.direction, 1)
    p = offset - step.axis[:, None, None] * along0
    q = rays.direction - step.axis[:, None, None] * along1
    a, b, c = (
        np.einsum("ijk,ijk->jk", q, q),
        np.einsum("ijk,ijk->jk", np.broadcast_to(p, q.shape), q),
        (p * p).sum(axis=0),
    )
    spare = b * b - a * (c - step.radius**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        s = np.where(spare > 0, (-b - np.sqrt(np.maximum(spare, 0.0))) / a, np.inf)
        height = along0 + s * along1
        near = np.isfinite(s) & (s > 0) & (height > step.bottom - NEAR) & (height < step.top + NEAR)
    row, column = np.nonzero(near)
    if not row.size:
        return
    s, a, b, c = s[near], a[near], b[near], c[row, 0]
    px, py, qx, qy = p[0][row, 0], p[1][row, 0], q[0][near], q[1][near]
    h0, h1 = along0[row, 0], along1[near]
    s, psi, height = _solved(step, s, (px, py, qx, qy), (a, b, c), (h0, h1))
    first = (height >= step.bottom) & (height <= step.top) & (s < hits.distance[row, column])
    at = row[first], column[first]
    hits.distance[at], hits.psi[at], hits.height[at], hits.surface[at] = s[first], psi[first], height[first], STEP


def _solved(
    step: Step,
    s: Array,
    flat: tuple[Array, Array, Array, Array],
    square: tuple[Array, Array, Array],
    lift: tuple[Array, Array],
) -> tuple[Array, Array, Array]:
    """Newton on distance to the axis less the surface's radius; keyways last, with their floor's radius."""
    px, py, qx, qy = flat
    a, b, c = square
    h0, h1 = lift
    deeper = np.zeros(s.shape)
    for attempt in range(2 if step.keyways else 1):
        for _ in range(0 if step.plain and not attempt else NEWTON_STEPS):
            rho = np.sqrt(np.maximum(c + s * (2 * b + s * a), 1e-12))
            radius, slope = step.surface(np.arctan2(py + s * qy, px + s * qx), h0 + s * h1)
            s = s - (rho - radius + deeper) / ((b + s * a) / rho - slope * h1)
        psi, height = np.arctan2(py + s * qy, px + s * qx), h0 + s * h1
        if step.keyways and not attempt:
            deeper = step.in_keyway(psi, height)
    return s, psi, height


def _meet_face(rays: Rays, face: Face, hits: Hits) -> None:
    down = rays.direction[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (face.height - rays.origin[2]) / down
        x, y = rays.origin[0] + s * rays.direction[0], rays.origin[1] + s * rays.direction[1]
        radius = np.hypot(x, y)
        met = (down < 0) if face.up else (down > 0)
        met &= (s > 0) & (radius >= face.inner) & (radius <= face.outer) & (s < hits.distance)
    hits.distance[met] = s[met]
    hits.psi[met] = np.arctan2(y[met], x[met])
    hits.height[met], hits.surface[met] = face.height, FACE


def hidden(points: Array, eye: Array, steps: tuple[Step, ...]) -> NDArray[np.bool_]:
    """Whether a step stands between points (3, B, M) and the camera at (3, B, 1), both in C."""
    way = eye - points
    blocked = np.zeros(points.shape[1:], dtype=np.bool_)
    for step in steps:
        offset = points - step.origin[:, None, None]
        along0, along1 = np.tensordot(step.axis, offset, 1), np.tensordot(step.axis, way, 1)
        p, q = offset - step.axis[:, None, None] * along0, way - step.axis[:, None, None] * along1
        a, b = (q * q).sum(axis=0), (p * q).sum(axis=0)
        spare = b * b - a * ((p * p).sum(axis=0) - step.radius**2)
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(np.maximum(spare, 0.0))
            for s in ((-b - root) / a, (-b + root) / a):
                height = along0 + s * along1
                blocked |= (spare > 0) & (s * np.sqrt(a) > 0.3) & (height > step.bottom) & (height < step.top)
    return blocked
