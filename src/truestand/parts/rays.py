"""The sensor's rays on a model of triangles: which one each reading belongs to, and how far it lies from its plane.

embreex finds the triangle in float32; the distance is then computed from the triangle's plane in float64. A triangle is
looked for along a reading's own ray only, from a reach before it to a reach behind it, so that rounding counts at the
part's size and not at the sensor's distance. Surfaces that face away from the sensor are no hits.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.errors import NotEnoughData
from truestand.core.frames import Pose
from truestand.parts.drawings import Mesh

LEAST_FACING = 0.03
"""Cosine of incidence: a ray that grazes (beyond 88 degrees) hits nothing."""
BEHIND = 1e-3
"""mm behind a surface that faces away from which the ray goes on."""
MOST_PASSED = 3
"""Such surfaces that a ray passes."""
LEAST_AREA = 1e-14
"""mm^2, twice the area: a smaller triangle has no plane."""


@dataclass(frozen=True, slots=True)
class Solid:
    """A model ready for rays, in the frame of the datum axis."""

    scene: Any
    """embreex's fast scene: a ray may slip through between two triangles, one in a hundred thousand."""
    tight: Any
    """Its watertight one, which takes twice as long."""
    normal: Array
    """(F, 3) outward units."""
    level: Array
    """(F,) mm: normal times corner."""
    corners: Array
    """(F, 3, 3) mm."""
    area: Array
    """(F,) mm^2."""
    low: Array
    """(3,) mm: the box around the model."""
    high: Array
    outer: float
    """mm: how far it reaches from the axis."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Readings (n, 3) mm and unit directions (n, 3) from the sensor to them, in one frame."""

    points: Array
    directions: Array

    def sample(self, count: int) -> "Rays":
        """About ``count`` of them, evenly picked."""
        pick = np.unique(np.linspace(0, len(self.points) - 1, count).astype(np.intp))
        return Rays(self.points[pick], self.directions[pick])

    def moved(self, pose: Pose) -> "Rays":
        """The same through a pose."""
        return Rays(pose(self.points), self.directions @ pose.rotation.T)


@dataclass(frozen=True, slots=True)
class Hits:
    """Where the model was hit by the rays of readings (n,)."""

    triangle: Ints
    """-1 = no part of the model."""
    deviation: Array
    """mm from the triangle's plane, positive outwards; NaN = no part of the model."""


def solid_of(mesh: Mesh, pose: Array) -> Solid:
    """The model, moved by ``pose`` (4, 4); triangles without area are left out.

    Raises:
        NotEnoughData: no triangle with an area.
    """
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    vertices = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    corners = vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(across, axis=1)
    whole = twice > LEAST_AREA
    if not whole.any():
        raise NotEnoughData("found a model without surface, need triangles; export the model again")
    corners, normal = corners[whole], across[whole] / twice[whole, None]
    scenes = [rtcore_scene.EmbreeScene(robust=robust) for robust in (False, True)]
    for scene in scenes:
        TriangleMesh(scene, np.ascontiguousarray(corners, dtype=np.float32))
    level = np.einsum("ij,ij->i", normal, corners[:, 0])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    outer = float(np.hypot(corners[:, :, 0], corners[:, :, 1]).max())
    return Solid(scenes[0], scenes[1], normal, level, corners, twice[whole] / 2, low, high, outer)


def hits_near(solid: Solid, rays: Rays, reach: float, tight: bool = True) -> Hits:
    """The triangle that each reading's ray hits first within ``reach`` mm of it, and how far it lies from its plane.

    ``rays`` in the model's frame. ``tight``: rays that hit nothing are cast again, watertight.
    """
    near = np.all((rays.points > solid.low - reach) & (rays.points < solid.high + reach), axis=1)
    if not near.all():  # the shaft, the table: far from the model
        of_near = hits_near(solid, Rays(rays.points[near], rays.directions[near]), reach, tight)
        triangle, deviation = np.full(near.size, -1, dtype=np.intp), np.full(near.size, np.nan)
        triangle[near], deviation[near] = of_near.triangle, of_near.deviation
        return Hits(triangle, deviation)
    directions, start = rays.directions, rays.points - reach * rays.directions
    triangle = _first(solid.scene, start, directions, np.full(len(start), 2 * reach))
    missed = np.flatnonzero(triangle < 0) if tight else np.zeros(0, dtype=np.intp)
    triangle[missed] = _first(solid.tight, start[missed], directions[missed], np.full(missed.size, 2 * reach))
    facing = np.einsum("ij,ij->i", solid.normal[triangle], directions)
    away = np.flatnonzero((triangle >= 0) & (facing >= 0))
    for _ in range(MOST_PASSED):
        if not away.size:
            break
        normal, direction = solid.normal[triangle[away]], directions[away]
        to_plane = solid.level[triangle[away]] - np.einsum("ij,ij->i", normal, start[away])
        along = to_plane / np.maximum(np.einsum("ij,ij->i", normal, direction), 1e-6)
        passed = np.clip(along, 0.0, 2 * reach) + BEHIND
        further = np.maximum(2 * reach - passed, 0.0)
        triangle[away] = _first(solid.scene, start[away] + passed[:, None] * direction, direction, further)
        facing[away] = np.einsum("ij,ij->i", solid.normal[triangle[away]], direction)
        away = away[(triangle[away] >= 0) & (facing[away] >= 0)]
    triangle[facing > -LEAST_FACING] = -1
    deviation = np.einsum("ij,ij->i", solid.normal[triangle], rays.points) - solid.level[triangle]
    deviation[triangle < 0] = np.nan
    return Hits(triangle, deviation)


def _first(scene: Any, start: Array, directions: Array, far: Array) -> Ints:
    """The first triangle (n,) along each ray, -1 for none within ``far`` (n,) mm."""
    if not len(start):
        return np.zeros(0, dtype=np.intp)
    found = scene.run(
        start.astype(np.float32), directions.astype(np.float32), dists=far.astype(np.float32), query="INTERSECT"
    )
    return np.asarray(found, dtype=np.intp)


def first_hits(solid: Solid, start: Array, directions: Array) -> tuple[Ints, Array]:
    """The first triangle (n,) along each whole ray, -1 for none, and how far (n,) mm away its plane is there.

    ``start`` (n, 3) mm outside the model, ``directions`` (n, 3) units.
    """
    middle = (solid.low + solid.high) / 2
    reach = float(np.linalg.norm(solid.high - solid.low)) / 2 + 1.0
    near = np.maximum(np.einsum("ij,ij->i", middle - start, directions) - reach, 0.0)  # float32 is for the model's size
    triangle = _first(solid.scene, start + near[:, None] * directions, directions, np.full(len(start), 2 * reach))
    normal = solid.normal[triangle]
    with np.errstate(invalid="ignore", divide="ignore"):
        distance = (solid.level[triangle] - np.einsum("ij,ij->i", normal, start)) / np.einsum(
            "ij,ij->i", normal, directions
        )
    return triangle, np.where(triangle >= 0, distance, np.nan)


def clear_view(solid: Solid, origins: Array, points: Array, near: float) -> Mask:
    """Whether nothing stands between origins (n, 3) and points (n, 3) of the surface, but for the last ``near`` mm."""
    between = points - origins
    length = np.linalg.norm(between, axis=1)
    return np.asarray(_first(solid.tight, origins, between / length[:, None], length - near) < 0)
