"""The room around a stand: where a sensor's housing may not be."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import tau

import numpy as np

from truestand.core.arrays import Array
from truestand.core.frames import Pose, about_axis
from truestand.planning.obstacles import Round
from truestand.planning.place import Place

Size = tuple[float, float, float]
"""mm of a housing along the sensor's x, y and z."""
SAMPLES = 7
"""Along each edge of a housing."""


@dataclass(frozen=True, slots=True)
class KeepOut:
    """A stretch of a ring about the table where no sensor may be; mm and rad, azimuths counter-clockwise."""

    azimuth: tuple[float, float] = (0.0, tau)
    radius: tuple[float, float] = (0.0, 1e9)
    height: tuple[float, float] = (-1e9, 1e9)
    """In C."""

    def distance(self, points: Array) -> Array:
        """mm from points (n, 3) to it."""
        radius, azimuth = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
        width = min(self.azimuth[1] - self.azimuth[0], tau)
        beyond = (azimuth - self.azimuth[0]) % tau
        round_to = np.where(beyond <= width, 0.0, np.minimum(beyond - width, tau - beyond))
        around = np.where(round_to < tau / 4, radius * np.sin(round_to), radius)
        return np.sqrt(around**2 + _gap(radius, self.radius) ** 2 + _gap(points[:, 2], self.height) ** 2)


@dataclass(frozen=True, slots=True)
class Room:
    """What stands about the part, mm."""

    table_radius: float = 100.0
    table_face: float | None = None
    """Height (C) of the table's face; None: where the shaft begins."""
    keep_out: tuple[KeepOut, ...] = ()
    least_clearance: float = 5.0


def clearance(room_from_sensor: Pose, size: Size, bodies: Sequence[Round], room: Room) -> float:
    """mm between a sensor's housing and what turns, ``bodies`` about the axis, or what to keep out of."""
    points = room_from_sensor(housing(size))
    radius, height = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    gaps = [np.hypot(np.maximum(radius - b.radius, 0.0), _gap(height, (b.bottom, b.top))).min() for b in bodies]
    gaps += [area.distance(points).min() for area in room.keep_out]
    return float(min(gaps, default=1e9))


def apart(first: Place, second: Place, base_radius: float, sizes: tuple[Size, Size]) -> float:
    """mm between the housings of two sensors."""
    poses = [in_room(place, base_radius) for place in (first, second)]
    gaps = []
    for own, other in ((0, 1), (1, 0)):
        points = (poses[other].inverse @ poses[own])(housing(sizes[own]))
        x, y, z = sizes[other]
        limits = ((-x / 2, x / 2), (-y / 2, y / 2), (-z, 0.0))
        gaps.append(np.sqrt(sum(_gap(points[:, k], limits[k]) ** 2 for k in range(3))).min())
    return float(min(gaps))


def in_room(place: Place, base_radius: float) -> Pose:
    """room_from_sensor of a place; ``base_radius``: mm, of the shaft's base."""
    return about_axis(place.azimuth, 0.0) @ place.pose(base_radius)


def housing(size: Size) -> Array:
    """Points (n, 3) mm all over a housing, in the sensor's frame."""
    x, y, z = size
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, SAMPLES)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(grid * [x, y, z] - [0.0, 0.0, z / 2])


def _gap(values: Array, limits: tuple[float, float]) -> Array:
    """How far values lie outside of limits; 0 inside."""
    return np.maximum(np.maximum(limits[0] - values, values - limits[1]), 0.0)
