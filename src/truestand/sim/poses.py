"""Rigid transforms of the virtual stand: where the sensor stands and how the shaft runs. (4, 4), mm, rad.

Signs (CONTRACT.md), worked out here apart from ``core.frames``, to check each other: T has Z up along the rotation axis
and X in the laser plane towards the sensor; the laser plane's upward direction is w = (0, sin a, cos a). The sensor's z
looks into the scene: it has a negative part along X; phi = atan2(Z . x_S, Z . z_S) up to the factor cos a. Hence

    z_S = -|sin phi| X + cos phi w,   x_S = sgn(sin phi) cos phi X + sin phi w,   y_S = z_S x x_S.
"""

from math import cos, sin

import numpy as np
from numpy.typing import ArrayLike

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.sim.simulation import Mounting, Running


def rigid(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """The transform (4, 4) of a rotation (3, 3) and a translation (3,) mm."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def shifted(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """A translation by x, y, z mm, as transform (4, 4)."""
    return rigid(np.eye(3), (x, y, z))


def turned(angle: float) -> Array:
    """A rotation about Z by ``angle`` (rad, ccw from above), as transform (4, 4)."""
    return rigid([[cos(angle), -sin(angle), 0.0], [sin(angle), cos(angle), 0.0], [0.0, 0.0, 1.0]], np.zeros(3))


def sensor_pose(mounting: Mounting, artefact: Artefact) -> Array:
    """table_from_sensor (4, 4): the middle of the fan meets the centred base at the stated height and range."""
    phi, alpha = mounting.phi, mounting.plane_tilt
    towards = np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, sin(alpha), cos(alpha)])
    side = np.sign(sin(phi)) or 1.0
    z = -abs(sin(phi)) * towards + cos(phi) * up
    x = side * cos(phi) * towards + sin(phi) * up
    met = artefact.base.radius * towards + (mounting.height / cos(alpha)) * up + np.array([0, mounting.plane_offset, 0])
    return rigid(np.column_stack([x, np.cross(z, x), z]), met - mounting.standoff * z)


def mounting_of(room_from_sensor: Array, artefact: Artefact) -> Mounting:
    """The mounting of a sensor that stands so in the room: ``sensor_pose`` and azimuth, turned round."""
    x, y, z = room_from_sensor[:3, :3].T
    towards = np.cross(y, [0.0, 0.0, 1.0])
    towards = towards / np.linalg.norm(towards) * (1.0 if towards @ z < 0 else -1.0)
    sideways = np.cross([0.0, 0.0, 1.0], towards)
    up = np.cross(y, towards) * (1.0 if np.cross(y, towards)[2] > 0 else -1.0)
    alpha, phi = float(np.arctan2(up @ sideways, up[2])), float(np.arctan2(x @ up, z @ up))
    origin = room_from_sensor[:3, 3]
    along = origin[2] / cos(alpha)
    standoff = (origin @ towards - artefact.base.radius) / abs(sin(phi))
    return Mounting(
        phi, float(standoff), float(cos(alpha) * (along + standoff * cos(phi))), alpha,
        float(origin @ sideways - along * sin(alpha)), float(np.arctan2(towards[1], towards[0])),
    )  # fmt: skip


def shaft_from_rotor(running: Running, azimuth: float) -> Array:
    """The transform (4, 4) from R to C: the shaft axis leans by the smallest rotation, about a horizontal line.

    ``azimuth`` (rad) of the sensor is where the directions of ``running`` count from.
    """
    e, t = running.eccentricity, running.tilt
    toward_e, toward_t = running.eccentricity_direction - azimuth, running.tilt_direction - azimuth
    k = np.array([-sin(toward_t), cos(toward_t), 0.0])
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    rotor_from_shaft = np.eye(3) + sin(t) * cross + (1 - cos(t)) * cross @ cross
    return rigid(rotor_from_shaft.T, -rotor_from_shaft.T @ [e * cos(toward_e), e * sin(toward_e), 0.0])
