"""What is true of a virtual scan, with the keys of calibration.json.

Signs (CONTRACT.md), worked out here on their own: T has Z up along the rotation axis and X in the laser plane towards
the sensor; the laser plane's upward direction is w = (0, sin a, cos a). The sensor's z looks into the scene: it has
a negative part along X; phi = atan2(Z . x_S, Z . z_S) up to the factor cos a. Hence

    z_S = -|sin phi| X + cos phi w,   x_S = sgn(sin phi) cos phi X + sin phi w,   y_S = z_S x x_S.
"""

from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.artefact import Artefact
from truestand.core.stand import Stand
from truestand.sim.part_truth import part_record
from truestand.sim.parts import VirtualPart
from truestand.sim.simulation import Mounting, Running, Simulation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Truth:
    """The true poses and the numbers that they come from."""

    stand: Stand
    simulation: Simulation
    table_from_sensor: Array
    """(4, 4)."""
    shaft_from_rotor: Array
    """(4, 4)."""
    rad_per_profile: float
    angle: Array
    """(N,) rad: the true table angle of every profile that is in the scan."""
    artefact: Artefact
    part: VirtualPart | None = None
    """What sat on the shaft."""


def sensor_pose(mounting: Mounting, artefact: Artefact) -> Array:
    """table_from_sensor (4, 4): the middle of the fan meets the centred base at the stated height and range."""
    phi, alpha = mounting.phi, mounting.plane_tilt
    towards = np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, sin(alpha), cos(alpha)])
    side = np.sign(sin(phi)) or 1.0
    z = -abs(sin(phi)) * towards + cos(phi) * up
    x = side * cos(phi) * towards + sin(phi) * up
    met = artefact.base.radius * towards + (mounting.height / cos(alpha)) * up + np.array([0, mounting.plane_offset, 0])
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = x, np.cross(z, x), z
    pose[:3, 3] = met - mounting.standoff * z
    return pose


def rotor_from_shaft(running: Running, azimuth: float) -> Array:
    """The shaft in R (4, 4): the axis leans by the smallest rotation, about a horizontal line."""
    e, t = running.eccentricity, running.tilt
    toward_e, toward_t = running.eccentricity_direction - azimuth, running.tilt_direction - azimuth
    k = np.array([-sin(toward_t), cos(toward_t), 0.0])
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3) + sin(t) * cross + (1 - cos(t)) * cross @ cross
    pose[:2, 3] = e * cos(toward_e), e * sin(toward_e)
    return pose


def truth_record(truth: Truth) -> dict[str, Any]:
    """truth.json; ``part`` is there where a part sat on the shaft."""
    record = _stand_record(truth)
    if truth.part is not None:
        record["part"] = part_record(truth.part, truth.artefact, truth.simulation.workpiece)
    return record


def _stand_record(truth: Truth) -> dict[str, Any]:
    """What calibration.json tells, as it is."""
    s, stand = truth.simulation, truth.stand
    back = np.linalg.inv(truth.shaft_from_rotor)
    ex, ey = back[0, 3], back[1, 3]
    lean = back[:3, 2]
    return {
        "format": "truestand.truth",
        "version": 1,
        "table": {
            "direction": stand.table.direction,
            "angle_source": next((c for c in ("encoder", "angle", "time") if c in s.acquisition.columns), "index"),
            "rad_per_profile": truth.rad_per_profile,
        },
        "sensor": {
            "name": stand.sensor.name,
            "table_from_sensor": truth.table_from_sensor.tolist(),
            "phi_deg": degrees(s.mounting.phi),
            "laser_plane_tilt_deg": degrees(s.mounting.plane_tilt),
            "laser_plane_offset_mm": s.mounting.plane_offset,
        },
        "shaft": {
            "shaft_from_rotor": truth.shaft_from_rotor.tolist(),
            "eccentricity_um": 1e3 * hypot(ex, ey),
            "eccentricity_direction_deg": degrees(atan2(ey, ex)),
            "tilt_mrad": 1e3 * float(np.arctan2(hypot(lean[0], lean[1]), lean[2])),
            "tilt_direction_deg": degrees(atan2(lean[1], lean[0])),
        },
        "harmonics": [
            {"surface": f.surface, "upr": f.upr, "amplitude_um": 1e3 * f.amplitude, "phase_deg": degrees(f.phase)}
            for f in s.workpiece.turned().form
        ],
    }
