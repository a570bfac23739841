"""The sensor's rays on a model of triangles: which one each reading belongs to, and how far it lies from its plane.

embreex finds the triangle in float32; the distance is then told from the triangle's plane in float64. A reading is
looked for along its own ray only, from a reach before it to a reach behind it, so that rounding counts at the part's
size and not at the sensor's distance. Surfaces that turn their back to the sensor are no hits.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import NotEnoughData
from truestand.parts.drawings import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

LEAST_FACING = 0.03
"""Cosine of incidence: a ray that grazes (beyond 88 degrees) tells nothing."""
PAST = 1e-3
"""mm behind a turned-away surface from which the ray goes on."""
TURNED_AWAY = 3
"""Times that a ray goes on."""
FLAT = 1e-14
"""mm^2: a triangle of no area has no plane."""


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


@dataclass(frozen=True, slots=True)
class Met:
    """What readings (n,) belong to."""

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
    whole = twice > FLAT
    if not whole.any():
        raise NotEnoughData("found a model without surface, need triangles; export the model again")
    corners, normal = corners[whole], across[whole] / twice[whole, None]
    scenes = [rtcore_scene.EmbreeScene(robust=robust) for robust in (False, True)]
    for scene in scenes:
        TriangleMesh(scene, np.ascontiguousarray(corners, dtype=np.float32))
    level = np.einsum("ij,ij->i", normal, corners[:, 0])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    return Solid(scenes[0], scenes[1], normal, level, corners, twice[whole] / 2, low, high)


def meet(solid: Solid, points: Array, ways: Array, reach: float, tight: bool = True) -> Met:
    """The triangle that each reading's ray meets first within ``reach`` mm of it, and how far it lies from its plane.

    ``points`` (n, 3) mm and ``ways`` (n, 3), units from the sensor to the reading, in the model's frame. ``tight``:
    rays that met nothing are cast again, watertight.
    """
    near = np.all((points > solid.low - reach) & (points < solid.high + reach), axis=1)
    if not near.all():  # the shaft, the table: far from the model
        return _spread(near, meet(solid, points[near], ways[near], reach, tight))
    first = points - reach * ways
    triangle = _first(solid.scene, first, ways, np.full(len(points), 2 * reach))
    missed = np.flatnonzero(triangle < 0) if tight else np.zeros(0, dtype=np.intp)
    triangle[missed] = _first(solid.tight, first[missed], ways[missed], np.full(missed.size, 2 * reach))
    facing = np.einsum("ij,ij->i", solid.normal[triangle], ways)
    away = np.flatnonzero((triangle >= 0) & (facing >= 0))
    for _ in range(TURNED_AWAY):
        if not away.size:
            break
        hit, way = triangle[away], ways[away]
        along = (solid.level[hit] - np.einsum("ij,ij->i", solid.normal[hit], first[away])) / np.maximum(
            np.einsum("ij,ij->i", solid.normal[hit], way), 1e-6
        )
        gone = np.clip(along, 0.0, 2 * reach) + PAST
        triangle[away] = _first(solid.scene, first[away] + gone[:, None] * way, way, np.maximum(2 * reach - gone, 0.0))
        facing[away] = np.einsum("ij,ij->i", solid.normal[triangle[away]], way)
        away = away[(triangle[away] >= 0) & (facing[away] >= 0)]
    triangle[(facing > -LEAST_FACING)] = -1
    deviation = np.einsum("ij,ij->i", solid.normal[triangle], points) - solid.level[triangle]
    deviation[triangle < 0] = np.nan
    return Met(triangle, deviation)


def _spread(near: NDArray[Any], met: Met) -> Met:
    """What some readings met, among all."""
    triangle, deviation = np.full(near.size, -1, dtype=np.intp), np.full(near.size, np.nan)
    triangle[near], deviation[near] = met.triangle, met.deviation
    return Met(triangle, deviation)


def _first(scene: Any, start: Array, ways: Array, far: Array) -> Ints:
    """The first triangle (n,) along each ray, -1 for none within ``far`` (n,) mm."""
    if not len(start):
        return np.zeros(0, dtype=np.intp)
    found = scene.run(
        start.astype(np.float32), ways.astype(np.float32), dists=far.astype(np.float32), query="INTERSECT"
    )
    return np.asarray(found, dtype=np.intp)


def first_met(solid: Solid, start: Array, ways: Array) -> tuple[Ints, Array]:
    """The first triangle (n,) along each whole ray, -1 for none, and how far (n,) mm away its plane is met there.

    ``start`` (n, 3) mm outside the model, ``ways`` (n, 3) units.
    """
    middle = (solid.low + solid.high) / 2
    reach = float(np.linalg.norm(solid.high - solid.low)) / 2 + 1.0
    near = np.maximum(np.einsum("ij,ij->i", middle - start, ways) - reach, 0.0)  # float32 is for the model's size
    triangle = _first(solid.scene, start + near[:, None] * ways, ways, np.full(len(start), 2 * reach))
    normal = solid.normal[triangle]
    with np.errstate(invalid="ignore", divide="ignore"):
        distance = (solid.level[triangle] - np.einsum("ij,ij->i", normal, start)) / np.einsum("ij,ij->i", normal, ways)
    return triangle, np.where(triangle >= 0, distance, np.nan)


def clear_view(solid: Solid, eyes: Array, points: Array, near: float) -> NDArray[np.bool_]:
    """Whether nothing stands between eyes (n, 3) and points (n, 3) of the surface, but for the last ``near`` mm."""
    way = points - eyes
    length = np.linalg.norm(way, axis=1)
    return np.asarray(_first(solid.tight, eyes, way / length[:, None], length - near) < 0)
