"""The sensor's rays in C: where the sensor stands at each table angle, seen from the turning part."""

import numpy as np
from numpy.typing import NDArray

from truestand.core.calibration import Calibration

Array = NDArray[np.float64]


def sensor_origins(calibration: Calibration, angle: Array) -> Array:
    """Origins (N, 3) mm in C of the sensor's rays at table angles (N,) rad."""
    x, y, z = calibration.table_from_sensor.translation
    c, s = np.cos(angle), np.sin(angle)
    return calibration.shaft_from_rotor(np.stack([c * x + s * y, c * y - s * x, np.full_like(c, z)], axis=-1))


def seen_at(calibration: Calibration, points: Array) -> Array:
    """Table angle (n,) rad at which points (n, 3) mm of C come into the laser plane on the sensor's side; NaN = never.

    The plane is y = d + z tan(alpha) in T, and its x axis points from the rotation axis to the sensor.
    """
    pose = calibration.table_from_sensor
    across = pose.rotation[:, 1]  # the laser plane's normal in T, which is square to T's X
    rotor = calibration.shaft_from_rotor.inverse(points)
    offset = float(across @ pose.translation)
    radius = np.hypot(rotor[:, 0], rotor[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = np.arcsin((offset - across[2] * rotor[:, 2]) / (across[1] * radius))
    return np.asarray(ahead - np.arctan2(rotor[:, 1], rotor[:, 0]))


def readings_of(calibration: Calibration, points: Array, angle: Array) -> tuple[Array, Array]:
    """x and z (n,) mm that the sensor reads of points (n, 3) mm of C at table angles (n,) rad."""
    rotor = calibration.shaft_from_rotor.inverse(points)
    c, s = np.cos(angle), np.sin(angle)
    table = np.stack([c * rotor[:, 0] - s * rotor[:, 1], s * rotor[:, 0] + c * rotor[:, 1], rotor[:, 2]], axis=-1)
    sensor = calibration.table_from_sensor.inverse(table)
    return np.asarray(sensor[:, 0]), np.asarray(sensor[:, 2])
