"""How a positioner carries a sensor: axes one on the other, the first one on the ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, sin

import numpy as np

from truestand.core.arrays import Array
from truestand.core.frames import Pose, about_axis, sensor_parameters
from truestand.planning.place import Place

Position = tuple[float, ...]
"""Of each axis, in their order: mm or rad."""
DIGITS = 12
"""Of an azimuth, rad."""
UPRIGHT = 1e-9
"""rad by which a laser plane may lean and count as parallel to the table's axis."""


@dataclass(frozen=True, slots=True)
class Motion:
    """How an axis moves what it carries; mm and rad, in the frame of the room: z is the table's axis, upwards."""

    name: str
    linear: bool
    direction: Array
    """(3,) unit vector: along it, or about it, right-handed."""
    through: Array
    """(3,) mm: a point of a rotary axis."""
    reach: tuple[float, float]

    def pose(self, value: float) -> Pose:
        """How a point moves when the axis goes from zero to ``value``."""
        if self.linear:
            return Pose(np.eye(3), value * self.direction)
        x, y, z = self.direction
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = np.eye(3) + sin(value) * cross + (1.0 - cos(value)) * cross @ cross
        return Pose(rotation, self.through - rotation @ self.through)


@dataclass(frozen=True, slots=True)
class Kinematics:
    """A positioner: where it brings its sensor."""

    axes: tuple[Motion, ...]
    at_zero: Pose
    """room_from_sensor where all axes are at zero."""

    def pose(self, position: Sequence[float]) -> Pose:
        """room_from_sensor at a position."""
        found = self.at_zero
        for axis, value in zip(reversed(self.axes), reversed(position), strict=True):
            found = axis.pose(value) @ found
        return found

    def place(self, position: Sequence[float], base_radius: float) -> Place | None:
        """The place that a position is; None where its laser plane leans, or nothing of it points at the axis.

        ``base_radius``: mm, of the shaft's base.
        """
        return place_of(self.pose(position), base_radius)

    def farthest(self, axis: int, position: Sequence[float], points: Array) -> float:
        """By how much (mm per mm, or per rad) points (n, 3) of the sensor move at most when one axis does."""
        motion = self.axes[axis]
        if motion.linear:
            return 1.0
        carried = self.at_zero
        for k in reversed(range(axis + 1, len(self.axes))):
            carried = self.axes[k].pose(position[k]) @ carried
        arm = carried(points) - motion.through
        return float(np.linalg.norm(np.cross(arm, motion.direction), axis=1).max())


def place_of(room_from_sensor: Pose, base_radius: float) -> Place | None:
    """The place of a pose in the room; None where its laser plane leans, or nothing of it points at the axis."""
    normal, towards = room_from_sensor.rotation[:, 1], room_from_sensor.rotation[:, 2]
    if abs(normal[2]) > UPRIGHT:
        return None
    azimuth = round(atan2(-towards[1], -towards[0]), DIGITS) + 0.0
    phi, radial, height, _, offset = sensor_parameters(about_axis(-azimuth, 0.0) @ room_from_sensor)
    if abs(sin(phi)) < UPRIGHT:
        return None
    standoff = (radial - base_radius) / abs(sin(phi))
    return Place(phi, standoff, height + standoff * cos(phi), offset, azimuth)
