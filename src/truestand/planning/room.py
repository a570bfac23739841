"""The room around a stand: where a sensor's housing may not be."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import tau

import numpy as np

from truestand.core.arrays import Array
from truestand.core.frames import Pose, about_axis
from truestand.planning.obstacles import Round
from truestand.planning.place import Place

Size = tuple[float, float, float]
"""mm of a housing along the sensor's x, y and z."""
CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
COARSE, FINE = 15.0, 0.4
"""mm: edges of the cells that a housing is first divided into, and half the diagonal of the last."""


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
        to_edge = np.where(beyond <= width, 0.0, np.minimum(beyond - width, tau - beyond))
        outwards, beside = radius * np.cos(to_edge), radius * np.sin(to_edge)  # from the nearer edge
        return np.sqrt(beside**2 + _gap(outwards, self.radius) ** 2 + _gap(points[:, 2], self.height) ** 2)


@dataclass(frozen=True, slots=True)
class Room:
    """What stands about the part, mm."""

    table_radius: float = 100.0
    table_face: float | None = None
    """Height (C) of the table's face; None: where the shaft begins."""
    keep_out: tuple[KeepOut, ...] = ()
    least_clearance: float = 5.0


def clearance(
    room_from_sensor: Pose, size: Size, bodies: Sequence[Round], room: Room, least: float = 0.0, enough: float = np.inf
) -> float:
    """mm between a sensor's housing and what turns, ``bodies`` about the axis, or what to keep out of: as much at
    least, and hardly more than a millimetre more. Of less than ``least`` or more than ``enough`` it is a rougher one.
    """

    def distance(points: Array) -> Array:
        points = room_from_sensor(points)
        radius, height = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        gaps = [np.hypot(np.maximum(radius - b.radius, 0.0), _gap(height, (b.bottom, b.top))) for b in bodies]
        return np.asarray(np.minimum.reduce([*gaps, *(area.distance(points) for area in room.keep_out)]))

    return _clear(distance, size, least, enough) if bodies or room.keep_out else 1e9


def apart(first: Place, second: Place, base_radius: float, sizes: tuple[Size, Size]) -> float:
    """mm between the housings of two sensors, as ``clearance`` has it."""
    own, other = (in_room(place, base_radius) for place in (first, second))
    x, y, z = sizes[1]
    limits = ((-x / 2, x / 2), (-y / 2, y / 2), (-z, 0.0))

    def distance(points: Array) -> Array:
        points = (other.inverse @ own)(points)
        return np.asarray(np.sqrt(sum(_gap(points[:, k], limits[k]) ** 2 for k in range(3))))

    return _clear(distance, sizes[0], 0.0, np.inf)


def _clear(distance: Callable[[Array], Array], size: Size, least: float, enough: float) -> float:
    """Least ``distance`` (mm, of points (n, 3) in the sensor's frame) of a housing from something: a bound from below.

    Cells are divided in which it may be: from their middles no distance changes by more than half their diagonal.
    Nothing is too thin to be found.
    """
    edges = np.array(size) / np.ceil(np.array(size) / COARSE)
    middles = _grid(size, edges)
    while True:
        reach, found = float(np.linalg.norm(edges)) / 2, distance(middles)
        nearest, low = float(found.min()), found - reach
        bound = max(float(low.min()), 0.0)
        if reach <= FINE or nearest <= FINE or nearest < least or bound >= enough:
            return bound
        edges = edges / 2
        middles = (middles[low < nearest][:, None] + edges / 2 * CORNERS).reshape(-1, 3)


def in_room(place: Place, base_radius: float) -> Pose:
    """room_from_sensor of a place; ``base_radius``: mm, of the shaft's base."""
    return about_axis(place.azimuth, 0.0) @ place.pose(base_radius)


def corners(size: Size) -> Array:
    """(8, 3) mm of a housing, in the sensor's frame."""
    return np.asarray((CORNERS - [0.0, 0.0, 1.0]) / 2 * size)


def _grid(size: Size, edges: Array) -> Array:
    """Middles (n, 3) mm of the cells with these ``edges`` that a housing is divided into."""
    along = [(np.arange(round(length / edge)) + 0.5) * edge for length, edge in zip(size, edges, strict=True)]
    grid = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(grid - [size[0] / 2, size[1] / 2, size[2]])


def _gap(values: Array, limits: tuple[float, float]) -> Array:
    """How far values lie outside of limits; 0 inside."""
    return np.maximum(np.maximum(limits[0] - values, values - limits[1]), 0.0)
