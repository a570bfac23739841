"""What a sensor sees of surface points: in its range and line, not too steeply, and nothing in between.

The laser ray comes from the sensor's origin, the camera looks from beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import tan

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.calibration import Calibration
from truestand.core.frames import Pose, in_rotor
from truestand.core.surface import readings_of, seen_at, sensor_origins
from truestand.planning.obstacles import Body, clear
from truestand.planning.optics import Optics

CAUSES = (
    "out of the sensor's range",
    "beyond the laser line",
    "too steep",
    "hidden from the laser",
    "hidden from the camera",
)
"""Why a point may not be seen, in the order in which it is asked."""
LEAST_FACING = 0.035
"""Cosine of the steepest angle (88 degrees) at which the camera sees a spot of the laser."""


@dataclass(frozen=True, slots=True)
class Sight:
    """What is seen of points (n,)."""

    z: Array
    """mm of range; NaN: never in the laser plane."""
    facing: Array
    """Cosine of the laser's incidence."""
    hidden: tuple[Mask, ...]
    """By each of ``CAUSES``."""

    @property
    def seen(self) -> Mask:
        """Points that are seen."""
        return np.asarray(~np.logical_or.reduce(self.hidden))

    def cause(self, of: Mask) -> str:
        """Why most of some points (n,) are not seen."""
        first = np.argmax(np.stack(self.hidden), axis=0)
        return CAUSES[int(np.bincount(first[of & ~self.seen], minlength=len(CAUSES)).argmax())]


def centred(view: Calibration, aside: float = 0.0) -> Calibration:
    """A view with a shaft that runs true. Parts of one that runs out are seen as if the sensor stood ``aside`` (mm), to
    one way or the other: no shadow changes, but near the root of a small gear, flanks are met steeper by degrees.
    """
    pose = view.table_from_sensor
    moved = replace(pose, translation=pose.translation + aside * pose.rotation[:, 1])
    return replace(view, table_from_sensor=moved, shaft_from_rotor=Pose(np.eye(3), np.zeros(3)))


def look(points: Array, normals: Array, view: Calibration, optics: Optics, bodies: Sequence[Body]) -> Sight:
    """What a calibrated view sees of surface points (n, 3) mm in C with outward ``normals`` (n, 3)."""
    angle = seen_at(view, points)
    met = np.isfinite(angle)
    angle = np.where(met, angle, 0.0)
    x, z = readings_of(view, points, angle)
    laser, camera = sensor_origins(view, angle), _cameras(view, angle, optics)
    facing, to_camera = _facing(points, normals, laser), _facing(points, normals, camera)
    low, high = optics.range
    out_of_range = ~met | (z < low) | (z > high)
    beyond_line = np.abs(x) > optics.half_line(z)
    steep = (facing < optics.least_facing) | (to_camera < LEAST_FACING)
    worth_asking = ~(out_of_range | beyond_line | steep)
    from_laser, from_camera = (np.zeros(z.size, dtype=bool) for _ in range(2))
    from_laser[worth_asking] = ~clear(points[worth_asking], laser[worth_asking], bodies)
    if optics.triangulation:
        from_camera[worth_asking] = ~clear(points[worth_asking], camera[worth_asking], bodies)
    return Sight(np.where(met, z, np.nan), facing, (out_of_range, beyond_line, steep, from_laser, from_camera))


def _cameras(view: Calibration, angle: Array, optics: Optics) -> Array:
    """Where the camera stands (n, 3) mm in C at table angles (n,) rad: beside the sensor's origin, along its y."""
    pose = view.table_from_sensor
    x, y, z = pose.translation + optics.middle * tan(optics.triangulation) * pose.rotation[:, 1]
    return view.shaft_from_rotor(np.stack([*in_rotor(x, y, angle), np.full(angle.size, z)], axis=-1))


def _facing(points: Array, normals: Array, eyes: Array) -> Array:
    """Cosine (n,) between normals and the way to the eyes; negative: seen from behind."""
    towards = eyes - points
    length = np.linalg.norm(towards, axis=1) * np.linalg.norm(normals, axis=1)
    return np.asarray((towards * normals).sum(axis=1) / length)
