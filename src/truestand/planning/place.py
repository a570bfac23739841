"""A place of a sensor."""

from dataclasses import dataclass
from math import cos, sin

from truestand.core.frames import Pose, table_from_sensor


@dataclass(frozen=True, slots=True)
class Place:
    """Where a sensor may stand; mm and rad. Its laser plane is parallel to the axis."""

    phi: float
    """Between the rotation axis and the sensor's z. With the other sign it is turned over about z: its camera is on the
    other side."""
    standoff: float
    """Range at which the middle of its line meets the shaft's base, standing centred,"""
    height: float
    """and the height (C) at which it does."""
    plane_offset: float = 0.0
    """Of the laser plane from the axis."""
    azimuth: float = 0.0
    """About the table, counter-clockwise."""

    def pose(self, base_radius: float) -> Pose:
        """table_from_sensor, in T of its own view; ``base_radius``: mm, of the shaft's base."""
        radial = base_radius + self.standoff * abs(sin(self.phi))
        return table_from_sensor(self.phi, radial, self.height - self.standoff * cos(self.phi), 0.0, self.plane_offset)
