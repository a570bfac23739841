"""Where laser rays meet a mesh: embree finds the triangle in single precision, the place on it is solved in double.

On a gear's flank the place is solved on the analytic surface, so that nothing depends on how finely it is meshed.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from truestand.sim.gear_mesh import GearMesh
from truestand.sim.gear_surface import LEFT, RIGHT, GearSurface
from truestand.sim.raycast import MESH, Hits, Rays

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

SOLVED = 1e-8
"""mm along the base tangent: a place on a flank is found."""
MOST_STEPS = 12
FIRST_STEP = 1e-3
"""Of range: the second point of the secant."""
FARTHEST = 0.5
"""mm of range between the mesh and the surface that it stands for; beyond, it is another place."""
BEYOND = 0.002
"""mm: how far over its own edge a flank may be met."""
LIFTED = 0.005
"""mm that a point is lifted off its triangle before the camera looks for it."""


@dataclass(frozen=True, slots=True)
class Flanks:
    """The analytic surface for which a mesh's triangles stand."""

    real: GearSurface
    tooth: Ints
    """(F,) index from 0; -1 = none."""
    side: NDArray[np.int8]
    """(F,) +1 left, -1 right, 0 none."""


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
    """The same for embree, in single precision."""
    centre: Array
    """(3,) of a ball about the part, in its frame."""
    reach: float
    """Its radius, mm."""
    flanks: Flanks | None = None


def body(vertices: Array, faces: NDArray[np.int64], shaft_from_part: Array, flanks: Flanks | None = None) -> Body:
    """A body of triangles ``faces`` (F, 3), counter-clockwise seen from outside, of ``vertices`` (V, 3) mm."""
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32))
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    reach = float(np.linalg.norm(vertices - centre, axis=1).max())
    return Body(a, normals / np.where(size > 0, size, 1.0), shaft_from_part, scene, centre, reach, flanks)


def gear_body(real: GearSurface, mesh: GearMesh, shaft_from_part: Array) -> Body:
    """A body whose flanks are solved on the gear's own surface."""
    return body(mesh.vertices, mesh.faces, shaft_from_part, Flanks(real, mesh.tooth, mesh.side))


def meet_body(rays: Rays, of: Body, hits: Hits) -> None:
    """Put the hits on a body that are nearer than those found so far into ``hits``."""
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
    place = rays.origin[:, at[0], 0] + s * rays.direction[:, at[0], at[1]]
    hits.distance[at], hits.psi[at], hits.height[at] = s, np.arctan2(place[1], place[0]), place[2]
    hits.surface[at], hits.triangle[at] = MESH, triangle[first]


def _run(of: Body, origin: Array, direction: Array, query: str) -> Ints:
    """embree's answer for rays (n, 3): the triangle first met, -1 for none."""
    if not origin.size:
        return np.empty(0, dtype=np.intp)
    answer = of.scene.run(origin.astype(np.float32), direction.astype(np.float32), query=query)
    return np.asarray(answer, dtype=np.intp)


def _entry(origin: Array, direction: Array, of: Body) -> Array:
    """Range at which a ray enters the ball about the body (a start near it spares digits); inf where it passes by."""
    to_centre = of.centre - origin
    square = np.einsum("ij,ij->i", direction, direction)
    nearest = np.einsum("ij,ij->i", to_centre, direction) / square
    spare = of.reach**2 - np.einsum("ij,ij->i", to_centre, to_centre) + nearest**2 * square
    entry = nearest - np.sqrt(np.maximum(spare, 0.0) / square) - 1.0
    return np.where(spare > 0, np.maximum(entry, 0.0), np.inf)


def _on_plane(of: Body, triangle: Ints, origin: Array, direction: Array) -> Array:
    """Range at which rays (n, 3) meet their triangles' planes."""
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
            flank = _Flank(of.flanks.real, side, of.flanks.tooth[triangle[on]], origin[on], direction[on])
            s[on] = flank.solved(s[on])
    return s


@dataclass(frozen=True, slots=True)
class _Flank:
    """Rays (n, 3) that meet left (or right) flanks, in the gear's frame."""

    real: GearSurface
    side: int
    tooth: Ints
    origin: Array
    direction: Array

    def outside(self, s: Array, which: Ints) -> Array:
        """How far the rays are outside their flanks at range ``s``."""
        x, y, height = (self.origin[which, i] + s * self.direction[which, i] for i in range(3))
        return self.real.outside(x, y, height, self.tooth[which], self.side)

    def solved(self, start: Array) -> Array:
        """Range on the surface by the secant method; ``start`` where that lies off the flank (at its very edges)."""
        found = start.copy()
        live = np.arange(start.size)
        before, now = start - FIRST_STEP, start.copy()
        off_before, off = self.outside(before, live), self.outside(now, live)
        for _ in range(MOST_STEPS):
            slope = (off - off_before) / np.where(now == before, 1.0, now - before)
            step = np.clip(-off / np.where(slope == 0, -1.0, slope), -FARTHEST, FARTHEST)
            before, off_before, now = now, off, now + step
            off = self.outside(now, live)
            done = np.abs(off) < SOLVED
            found[live[done]] = now[done]
            keep = ~done
            live, before, now, off_before, off = live[keep], before[keep], now[keep], off_before[keep], off[keep]
            if not live.size:
                break
        return np.where(self._on_flank(found) & (np.abs(found - start) < FARTHEST), found, start)

    def _on_flank(self, s: Array) -> NDArray[np.bool_]:
        """Whether the places lie within the flanks' edges."""
        x, y, height = (self.origin[:, i] + s * self.direction[:, i] for i in range(3))
        radius, gear = np.hypot(x, y), self.real.gear
        within = (height > gear.face_from - BEYOND) & (height < gear.face_to + BEYOND)
        top = self.real.tip_radius(self.tooth, height) + BEYOND
        return np.asarray(within & (radius > self.real.circles.start - BEYOND) & (radius < top))


def hidden_by(points: Array, eye: Array, hits: Hits, of: Body) -> NDArray[np.bool_]:
    """Whether the body stands between points (3, B, M), NaN = none, and the camera at (3, B, 1), both in C."""
    turn, shift = of.shaft_from_part[:3, :3], of.shaft_from_part[:3, 3]
    row, column = np.nonzero(np.isfinite(points[0]))
    place = (points[:, row, column].T - shift) @ turn
    way = (eye[:, row, 0].T - shift) @ turn - place
    on = hits.surface[row, column] == MESH
    normal = of.normals[hits.triangle[row[on], column[on]]]
    away = np.zeros(row.size, dtype=np.bool_)
    away[on] = np.einsum("ij,ij->i", normal, way[on]) <= 0
    place[on] += LIFTED * normal
    blocked = np.zeros(points.shape[1:], dtype=np.bool_)
    blocked[row, column] = away | (_run(of, place, way, "OCCLUDED") >= 0)
    return blocked
