"""Where laser rays meet a mesh: embree finds the triangle in single precision, the hit on it is solved in double.

On a gear's flank the hit is solved on the analytic surface, so that nothing depends on how finely it is meshed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints, Mask
from truestand.sim.gear_mesh import Flanks
from truestand.sim.gear_surface import LEFT, RIGHT, GearSurface
from truestand.sim.raycast import MESH, Hits, Rays

TOLERANCE_MM = 1e-8
"""Along the base tangent: a hit on a flank is found."""
MAX_SECANT_STEPS = 12
FIRST_STEP_MM = 1e-3
"""Of range: the second point of the secant."""
MAX_CORRECTION_MM = 0.5
"""Of range between the mesh and the surface that it stands for; beyond, it is another place."""
EDGE_MARGIN_MM = 0.002
"""By how much a hit may lie beyond the edge of its flank."""
CAMERA_OFFSET_MM = 0.005
"""From its triangle, of a point whose sight of the camera is tested."""


@dataclass(frozen=True, slots=True)
class Body:
    """A meshed part on the shaft."""

    corners: Array
    """(F, 3) mm: the first corner of every triangle, in the part's own frame."""
    normals: Array
    """(F, 3) outwards, unit, in the part's frame."""
    shaft_from_part: Array
    """(4, 4)."""
    scene: Any
    """The mesh for embree, in single precision."""
    centre: Array
    """(3,) mm: centre of a sphere about the part, in its frame."""
    radius: float
    """Of that sphere, mm."""
    flanks: Flanks | None = None


def body(vertices: Array, faces: NDArray[np.int64], shaft_from_part: Array, flanks: Flanks | None = None) -> Body:
    """A body of triangles ``faces`` (F, 3), counter-clockwise seen from outside, of ``vertices`` (V, 3) mm."""
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32))
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    return Body(a, normals / np.where(size > 0, size, 1.0), shaft_from_part, scene, centre, radius, flanks)


def meet_body(rays: Rays, of: Body, hits: Hits) -> None:
    """Record the hits on a body that are nearer than those in ``hits``."""
    turn, shift = of.shaft_from_part[:3, :3], of.shaft_from_part[:3, 3]
    shape = rays.direction.shape[1:]
    row, column = (index.ravel() for index in np.indices(shape))
    origin = (rays.origin[:, :, 0].T - shift) @ turn
    direction = np.tensordot(turn.T, rays.direction, 1).reshape(3, -1).T
    start = _entry(origin[row], direction, of)
    near = np.flatnonzero(np.isfinite(start))
    row, column, direction, start = row[near], column[near], direction[near], start[near]
    origin = origin[row]
    found = _run(of, origin + start[:, None] * direction, direction, "INTERSECT")
    met = np.flatnonzero(found >= 0)
    triangle, direction, origin = found[met], direction[met], origin[met]
    s = _on_flanks(of, triangle, origin, direction, _on_plane(of, triangle, origin, direction))
    at = row[met], column[met]
    first = (s < hits.distance[at]) & (s > 0)
    at, s = (at[0][first], at[1][first]), s[first]
    x, y, height = rays.origin[:, at[0], 0] + s * rays.direction[:, at[0], at[1]]
    hits.record(at, s, np.arctan2(y, x), height, MESH)
    hits.triangle[at] = triangle[first]


def _run(of: Body, origin: Array, direction: Array, query: str) -> Ints:
    """embree's result for rays (n, 3): the triangle first met, -1 for none."""
    if not origin.size:
        return np.empty(0, dtype=np.intp)
    triangle = of.scene.run(origin.astype(np.float32), direction.astype(np.float32), query=query)
    return np.asarray(triangle, dtype=np.intp)


def _entry(origin: Array, direction: Array, of: Body) -> Array:
    """Range at which rays enter the sphere about the body (a start near it saves digits); inf where they miss it."""
    to_centre = of.centre - origin
    square = np.einsum("ij,ij->i", direction, direction)
    nearest = np.einsum("ij,ij->i", to_centre, direction) / square
    discriminant = of.radius**2 - np.einsum("ij,ij->i", to_centre, to_centre) + nearest**2 * square
    entry = nearest - np.sqrt(np.maximum(discriminant, 0.0) / square) - 1.0
    return np.where(discriminant > 0, np.maximum(entry, 0.0), np.inf)


def _on_plane(of: Body, triangle: Ints, origin: Array, direction: Array) -> Array:
    """Range at which rays (n, 3) meet the planes of their triangles."""
    normal = of.normals[triangle]
    across = np.einsum("ij,ij->i", normal, direction)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.einsum("ij,ij->i", normal, of.corners[triangle] - origin) / across
    return np.where(np.isfinite(s), s, np.inf)


def _on_flanks(of: Body, triangle: Ints, origin: Array, direction: Array, s: Array) -> Array:
    """The same range, where a ray meets a flank solved on the analytic surface."""
    if of.flanks is None:
        return s
    for side in (LEFT, RIGHT):
        on = np.flatnonzero((of.flanks.side[triangle] == side) & np.isfinite(s))
        if on.size:
            rays = _FlankRays(of.flanks.surface, side, of.flanks.tooth[triangle[on]], origin[on], direction[on])
            s[on] = rays.solve(s[on])
    return s


@dataclass(frozen=True, slots=True)
class _FlankRays:
    """Rays (n, 3) that meet left (or right) flanks, in the gear's frame."""

    surface: GearSurface
    side: int
    tooth: Ints
    origin: Array
    direction: Array

    def distance(self, s: Array, which: Ints) -> Array:
        """Of the rays ``which`` from their flanks at range ``s``, along the base tangent; positive outside; mm."""
        x, y, height = (self.origin[which, i] + s * self.direction[which, i] for i in range(3))
        return self.surface.distance(x, y, height, self.tooth[which], self.side)

    def solve(self, start: Array) -> Array:
        """Range on the surface by the secant method; ``start`` where that lies off the flank (at its very edges)."""
        found = start.copy()
        active = np.arange(start.size)
        before, now = start - FIRST_STEP_MM, start.copy()
        off_before, off = self.distance(before, active), self.distance(now, active)
        for _ in range(MAX_SECANT_STEPS):
            slope = (off - off_before) / np.where(now == before, 1.0, now - before)
            step = np.clip(-off / np.where(slope == 0, -1.0, slope), -MAX_CORRECTION_MM, MAX_CORRECTION_MM)
            before, off_before, now = now, off, now + step
            off = self.distance(now, active)
            done = np.abs(off) < TOLERANCE_MM
            found[active[done]] = now[done]
            keep = ~done
            active, before, now, off_before, off = active[keep], before[keep], now[keep], off_before[keep], off[keep]
            if not active.size:
                break
        return np.where(self._on_flank(found) & (np.abs(found - start) < MAX_CORRECTION_MM), found, start)

    def _on_flank(self, s: Array) -> Mask:
        """Whether the hits lie within the edges of their flanks."""
        x, y, height = (self.origin[:, i] + s * self.direction[:, i] for i in range(3))
        radius, gear = np.hypot(x, y), self.surface.gear
        within = (height > gear.face_from - EDGE_MARGIN_MM) & (height < gear.face_to + EDGE_MARGIN_MM)
        top = self.surface.tip_radius(self.tooth, height) + EDGE_MARGIN_MM
        return np.asarray(within & (radius > self.surface.circles.start - EDGE_MARGIN_MM) & (radius < top))


def occluded_by_body(points: Array, camera: Array, hits: Hits, of: Body) -> Mask:
    """Whether the body stands between points (3, B, M), NaN = none, and the camera at (3, B, 1), both in C; (B, M)."""
    turn, shift = of.shaft_from_part[:3, :3], of.shaft_from_part[:3, 3]
    row, column = np.nonzero(np.isfinite(points[0]))
    point = (points[:, row, column].T - shift) @ turn
    to_camera = (camera[:, row, 0].T - shift) @ turn - point
    on = hits.surface[row, column] == MESH
    normal = of.normals[hits.triangle[row[on], column[on]]]
    away = np.zeros(row.size, dtype=np.bool_)
    away[on] = np.einsum("ij,ij->i", normal, to_camera[on]) <= 0
    point[on] += CAMERA_OFFSET_MM * normal
    blocked = np.zeros(points.shape[1:], dtype=np.bool_)
    blocked[row, column] = away | (_run(of, point, to_camera, "OCCLUDED") >= 0)
    return blocked
