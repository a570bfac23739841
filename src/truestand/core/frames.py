"""Rigid transforms between the stand's frames S (sensor), T (table), R (rotor) and C (shaft).

Every transform is named by direction, ``table_from_sensor``, and neighbouring words match when two are chained:
``shaft_from_sensor = shaft_from_rotor @ rotor_from_table @ table_from_sensor``, where rotor_from_table is Rz(-theta).
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, sin

import numpy as np

from truestand.core.arrays import Array

PHI, RADIAL, PLANE_OFFSET, PLANE_TILT, ECCENTRICITY_X, ECCENTRICITY_Y, TILT_X, TILT_Y = range(8)
"""Where each unknown of the geometry stands in a parameter vector (mm and rad): what ``table_from_sensor`` and
``shaft_from_rotor`` take, the sensor's height apart, which is a convention."""
UNKNOWNS = 8
ECCENTRICITY, TILT = slice(ECCENTRICITY_X, ECCENTRICITY_Y + 1), slice(TILT_X, TILT_Y + 1)


@dataclass(frozen=True, slots=True)
class Pose:
    """A proper rigid transform: ``rotation`` (3, 3) and ``translation`` (3,) in mm."""

    rotation: Array
    translation: Array

    @classmethod
    def from_matrix(cls, matrix: Array) -> "Pose":
        """From a 4x4 homogeneous matrix."""
        matrix = np.asarray(matrix, dtype=np.float64)
        return cls(matrix[:3, :3].copy(), matrix[:3, 3].copy())

    @property
    def matrix(self) -> Array:
        """The 4x4 homogeneous matrix."""
        full = np.eye(4)
        full[:3, :3] = self.rotation
        full[:3, 3] = self.translation
        return full

    @property
    def inverse(self) -> "Pose":
        """The transform back."""
        return Pose(self.rotation.T.copy(), -self.rotation.T @ self.translation)

    def __matmul__(self, other: "Pose") -> "Pose":
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def __call__(self, points: Array) -> Array:
        """Points (..., 3) mm, transformed."""
        # a product of matrices would take threads, which fight over the cores of a busy machine
        return np.asarray(np.einsum("...j,ij->...i", points, self.rotation) + self.translation)


def facing(phi: float) -> float:
    """+1 or -1: which way T's X (from the axis to the sensor) runs along the in-plane normal of the axis.

    The sensor looks along +z of S, so X, which points back at it, has a negative z component in S.
    """
    return 1.0 if sin(phi) >= 0 else -1.0


@dataclass(frozen=True, slots=True)
class LaserPlane:
    """The sensor's own coordinates x, z turned in the laser plane until the rotation axis stands upright.

    ``u`` runs across the axis towards the sensor, ``v`` along it; the sensor's origin lies at (radial, height). All mm.
    """

    phi: float
    radial: float = 0.0
    height: float = 0.0

    @property
    def across(self) -> tuple[float, float]:
        """What u gains by x and by z."""
        side = facing(self.phi)
        return side * cos(self.phi), -side * sin(self.phi)

    @property
    def along(self) -> tuple[float, float]:
        """What v gains by x and by z."""
        return sin(self.phi), cos(self.phi)

    def to_uv(self, x: Array, z: Array) -> tuple[Array, Array]:
        """u and v of readings x, z, all of one shape."""
        (ux, uz), (vx, vz) = self.across, self.along
        return ux * x + uz * z + self.radial, vx * x + vz * z + self.height

    def from_uv(self, u: Array, v: Array) -> tuple[Array, Array]:
        """x and z of positions u, v: the inverse of ``to_uv``."""
        (ux, uz), (vx, vz) = self.across, self.along
        u, v = u - self.radial, v - self.height
        return ux * u + vx * v, uz * u + vz * v


def table_from_sensor(phi: float, radial: float, height: float, tilt: float, offset: float) -> Pose:
    """Where the sensor stands on the table.

    Args:
        phi: angle between the rotation axis and the sensor's z, rad (atan2(a_x, a_z), CONTRACT.md).
        radial: T's X of the sensor's origin, mm.
        height: position of the sensor's origin along the laser plane's upward direction, mm.
        tilt: laser plane against the rotation axis (alpha), rad: the plane is Y = offset + Z tan(tilt).
        offset: laser plane's distance from the axis at Z = 0 (d), mm.
    """
    side = facing(phi)
    across = np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, sin(tilt), cos(tilt)])
    x_axis = side * cos(phi) * across + sin(phi) * up
    z_axis = -side * sin(phi) * across + cos(phi) * up
    y_axis = np.cross(z_axis, x_axis)
    rotation = np.column_stack([x_axis, y_axis, z_axis])
    return Pose(rotation, radial * across + height * up + np.array([0.0, offset, 0.0]))


def sensor_parameters(pose: Pose) -> tuple[float, float, float, float, float]:
    """(phi, radial, height, tilt, offset) of a ``table_from_sensor``: the inverse of that function."""
    a = pose.rotation[2]
    phi = atan2(a[0], a[2])
    tilt = atan2(-facing(phi) * a[1], hypot(a[0], a[2]))
    height = float(pose.translation[2]) / cos(tilt)
    return phi, float(pose.translation[0]), height, tilt, float(pose.translation[1]) - height * sin(tilt)


def shaft_from_rotor(ex: float, ey: float, tx: float, ty: float) -> Pose:
    """Rotor to shaft: the shaft's axis passes (ex, ey, 0) mm along (tx, ty, 1); no twist about Z.

    The rotation is the smallest one that takes Z onto the axis, so its rotation vector lies in the XY plane.
    """
    axis = np.array([tx, ty, 1.0]) / np.sqrt(tx * tx + ty * ty + 1.0)
    rotor_from_shaft = Pose(_smallest_rotation_to(axis), np.array([ex, ey, 0.0]))
    return rotor_from_shaft.inverse


def shaft_parameters(pose: Pose) -> tuple[float, float, float, float]:
    """(ex, ey) mm and (tx, ty) rad of a ``shaft_from_rotor`` pose: the inverse of that function."""
    rotor_from_shaft = pose.inverse
    axis = rotor_from_shaft.rotation[:, 2]
    tx, ty = axis[0] / axis[2], axis[1] / axis[2]
    origin = rotor_from_shaft.translation
    return float(origin[0] - tx * origin[2]), float(origin[1] - ty * origin[2]), float(tx), float(ty)


def about_axis(azimuth: float, height: float) -> Pose:
    """A turn about Z by ``azimuth`` (rad) and a move along it by ``height`` (mm)."""
    c, s = cos(azimuth), sin(azimuth)
    return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, 0.0, height]))


def own_shaft_from_rotor(first: Pose, first_from_table: Pose) -> Pose:
    """The ``shaft_from_rotor`` of another view, in its own R and C, from that of the ``first`` and where it stands."""
    return shaft_from_rotor(*shaft_parameters(first @ first_from_table))


def axis_sensitivity(height: float) -> Array:
    """How the place (x, y) of the shaft's axis at a height (mm) follows the unknowns: (2, 8)."""
    rows = np.zeros((2, UNKNOWNS))
    rows[:, ECCENTRICITY], rows[:, TILT] = np.eye(2), height * np.eye(2)
    return rows


def _smallest_rotation_to(axis: Array) -> Array:
    """The rotation (3, 3) about a horizontal line that takes Z to the unit vector ``axis`` (Rodrigues)."""
    x, y, z = axis
    k = 1.0 / (1.0 + z)
    return np.array([[1 - k * x * x, -k * x * y, x], [-k * x * y, 1 - k * y * y, y], [-x, -y, z]])


def in_table(pose: Pose, x: Array, z: Array) -> tuple[Array, Array]:
    """T's X (towards the sensor) and Z (up), mm, of readings x, z by a ``table_from_sensor``."""
    r, t = pose.rotation, pose.translation
    return r[0, 0] * x + r[0, 2] * z + t[0], r[2, 0] * x + r[2, 2] * z + t[2]


def in_rotor(x: Array | float, y: Array | float, angle: Array) -> tuple[Array, Array]:
    """x and y in R of points x, y of T at table angles (rad): p_R = Rz(-angle) p_T."""
    c, s = np.cos(angle), np.sin(angle)
    return c * x + s * y, c * y - s * x
