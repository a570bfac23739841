"""A calibration applied: scans rolled up into the shaft's own coordinates.

One rigid chain, exact at every radius:

    p_C = shaft_from_rotor . Rz(-theta) . table_from_sensor . (x, 0, z)

For one profile it is affine in (x, z), so a whole scan costs six multiplications a point.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe
from truestand.core.frames import Pose, in_rotor, in_table, shaft_parameters
from truestand.core.scan import Scan

BLOCK = 64
"""Profiles worked on at once: their points stay in the processor's cache."""


@dataclass(frozen=True, slots=True)
class Surface:
    """The part, rolled up, in C: ``x``, ``y``, ``z`` (N, M) mm; NaN = not seen. Rows are profiles, as in the scan."""

    x: Array
    y: Array
    z: Array
    scan: Scan | None = None
    """The scan that was rolled up, and the calibration that did it: what an inspection takes its uncertainty from."""
    calibration: Calibration | None = None

    @property
    def angle(self) -> Array:
        """Polar angle (N, M) rad about the shaft axis."""
        return np.asarray(np.arctan2(self.y, self.x))

    @property
    def height(self) -> Array:
        """Height (N, M) mm above the shoulder."""
        return self.z

    @property
    def radius(self) -> Array:
        """Distance (N, M) mm from the shaft axis."""
        return np.asarray(np.hypot(self.x, self.y))

    @property
    def origin(self) -> tuple[Scan, Calibration]:
        """The scan that was rolled up and the calibration that did it.

        Raises:
            BadRecipe: the surface carries none.
        """
        if self.scan is None or self.calibration is None:
            raise BadRecipe("found a surface without its scan and calibration; make it with roll(scan, calibration)")
        return self.scan, self.calibration

    def trace(self, height: float, width: float = 0.1) -> tuple[Array, Array]:
        """Radius over polar angle at one height: angle (n,) rad, increasing, and radius (n,) mm.

        One sample a profile: the mean of its points within ``width`` mm about ``height``. Where a profile shows
        several surfaces at that height (a chamfer, a flank) the mean is of all of them.
        """
        near = np.abs(self.z - height) <= width / 2
        count = near.sum(axis=1)
        rows = count > 0
        x = np.where(near[rows], self.x[rows], 0.0).sum(axis=1) / count[rows]
        y = np.where(near[rows], self.y[rows], 0.0).sum(axis=1) / count[rows]
        angle = np.arctan2(y, x)
        order = np.argsort(angle)
        return angle[order], np.hypot(x, y)[order]


def each_of(surfaces: Surface | Sequence[Surface]) -> tuple[Surface, ...]:
    """Several surfaces, or the only one."""
    return (surfaces,) if isinstance(surfaces, Surface) else tuple(surfaces)


def stacked(surfaces: Sequence[Surface]) -> Surface:
    """The profiles of several surfaces in one C, one after the other, without their origin; a single one as it is."""
    if len(surfaces) == 1:
        return surfaces[0]
    x, y, z = (stacked_values([getattr(s, name) for s in surfaces]) for name in ("x", "y", "z"))
    return Surface(x, y, z)


def surface_of(profile: Ints | NDArray[np.int32], surfaces: Sequence[Surface]) -> Ints:
    """Which of several surfaces each profile (n,) of them ``stacked`` is of."""
    return np.searchsorted(np.cumsum([s.x.shape[0] for s in surfaces]), profile, side="right")


def stacked_values(of_views: Sequence[Array]) -> Array:
    """Values (N, M) of the readings of several scans, one scan after the other; NaN where one has fewer points."""
    points = max(values.shape[1] for values in of_views)
    out = np.empty((sum(values.shape[0] for values in of_views), points))
    first = 0
    for values in of_views:
        rows = out[first : first + values.shape[0]]
        rows[:, : values.shape[1]] = values
        rows[:, values.shape[1] :] = np.nan
        first += values.shape[0]
    return out


def apply_calibration(scan: Scan, calibration: Calibration) -> Surface:
    """The scan's points in C, by the calibration as it is: ``transfer.roll`` checks first whether it may be applied.

    The calibration's own method decides: ``stand`` moves the axis (exact), ``paper`` subtracts the published
    compensation wave from the radial coordinate (docs/theory.md, *Reading the paper*, on what that leaves).
    """
    angle = table_angle(scan, calibration)
    roll = _published if calibration.method == "paper" else _affine
    out = roll(scan, calibration.table_from_sensor, calibration.shaft_from_rotor, angle)
    if calibration.part_growth:
        out /= 1.0 + calibration.part_growth
    out.flags.writeable = False
    return Surface(out[0], out[1], out[2], scan, calibration)


def table_angle(scan: Scan, calibration: Calibration) -> Array:
    """Table angle (N,) rad with the speed that the calibration found, where the scan has no angle of its own."""
    if scan.free_speed and calibration.speed_factor != 1.0:
        return np.asarray(scan.angle[0] + (scan.angle - scan.angle[0]) * calibration.speed_factor)
    return scan.angle


def _affine(scan: Scan, table_from_sensor: Pose, shaft_from_rotor: Pose, angle: Array) -> Array:
    """Points (3, N, M) mm of C by the rigid chain."""
    directions = table_from_sensor.rotation.T
    # for each profile, what p_C gains by x and by z, and its shift: (N, 3) each
    gain_x, gain_z = (_points_in_rotor(directions[i], angle) @ shaft_from_rotor.rotation.T for i in (0, 2))
    shift = shaft_from_rotor(_points_in_rotor(table_from_sensor.translation, angle))
    out = np.empty((3, *scan.x.shape))
    buffer = np.empty((BLOCK, scan.x.shape[1]))
    for first in range(0, scan.profiles, BLOCK):
        rows = slice(first, min(first + BLOCK, scan.profiles))
        x, z = scan.x[rows], scan.z[rows]
        part = buffer[: x.shape[0]]
        for i in range(3):
            target = out[i, rows]
            np.multiply(x, gain_x[rows, i, None], out=target)
            np.multiply(z, gain_z[rows, i, None], out=part)
            part += shift[rows, i, None]
            target += part
    return out


def _points_in_rotor(points: Array, angle: Array) -> Array:
    """Points (N, 3), or one (3,), of T in R at table angles (N,) rad: (N, 3)."""
    x, y, z = points.T
    return np.stack([*in_rotor(x, y, angle), np.full_like(angle, z)], axis=-1)


def _published(scan: Scan, table_from_sensor: Pose, shaft_from_rotor: Pose, angle: Array) -> Array:
    """The same by steps 5, 8 and 9 of the paper: radial less the compensation wave, then rolled up."""
    ex, ey, _, _ = shaft_parameters(shaft_from_rotor)
    wave, _ = in_rotor(ex, -ey, angle)
    out = np.empty((3, *scan.x.shape))
    for first in range(0, scan.profiles, BLOCK):
        rows = slice(first, first + BLOCK)
        radial, out[2, rows] = in_table(table_from_sensor, scan.x[rows], scan.z[rows])
        out[0, rows], out[1, rows] = in_rotor(radial - wave[rows, None], 0.0, angle[rows, None])
    return out


def sensor_origins(calibration: Calibration, angle: Array) -> Array:
    """Origins (N, 3) mm in C of the sensor's rays at table angles (N,) rad."""
    return calibration.shaft_from_rotor(_points_in_rotor(calibration.table_from_sensor.translation, angle))


def seen_at(calibration: Calibration, points: Array) -> Array:
    """Table angle (n,) rad at which points (n, 3) mm of C come into the laser plane on the sensor's side; NaN = never.

    The plane is y = d + z tan(alpha) in T, and its x axis points from the rotation axis to the sensor.
    """
    pose = calibration.table_from_sensor
    normal = pose.rotation[:, 1]  # of the laser plane in T, square to T's X
    rotor = calibration.shaft_from_rotor.inverse(points)
    offset = float(normal @ pose.translation)
    radius = np.hypot(rotor[:, 0], rotor[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        lead = np.arcsin((offset - normal[2] * rotor[:, 2]) / (normal[1] * radius))
    return np.asarray(lead - np.arctan2(rotor[:, 1], rotor[:, 0]))


def readings_of(calibration: Calibration, points: Array, angle: Array) -> tuple[Array, Array]:
    """x and z (n,) mm that the sensor reads of points (n, 3) mm of C at table angles (n,) rad."""
    rotor = calibration.shaft_from_rotor.inverse(points)
    sensor = calibration.table_from_sensor.inverse(_points_in_rotor(rotor, -angle))
    return np.asarray(sensor[:, 0]), np.asarray(sensor[:, 2])
