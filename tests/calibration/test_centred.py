"""Shafts that hardly run out: their scan hardly tells the laser plane, and all else follows it in a curve."""

from dataclasses import replace
from math import degrees, radians

import pytest

from truestand.calibration.calibrate import calibrate
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.frames import Pose, sensor_parameters
from truestand.core.scan import interpret
from truestand.sim import FormWave, simulate
from truth import Named
from variants import tried

UM = 1e-3
STANDS = {
    "plane far aside": (
        (18.6, 10.0), 0.058, (-39.4, -0.65, 0.43),
        (("base", 4, 7.4), ("base", 5, 5.2), ("bearing", 17, 4.8), ("bearing", 20, 7.5)), (0.11, 1.9),
    ),
    "seen from above": (
        (16.4, 8.8), 0.064, (131.0, -0.21, 0.55),
        (("base", 9, 4.8), ("base", 16, 5.4), ("bearing", 15, 4.9), ("bearing", 17, 2.2)), (0.23, 1.32),
    ),
    "more than a turn": (
        (19.5, 10.6), 0.077, (-39.4, -0.41, 0.43),
        (("base", 9, 6.5), ("base", 13, 1.1), ("bearing", 19, 3.1), ("bearing", 18, 7.6)), (0.33, 1.43),
    ),
    "in many steps": (
        (17.1, 9.4), 0.188, (-95.0, 0.46, -0.59),
        (("base", 10, 5.4), ("base", 14, 5.7), ("bearing", 16, 5.8), ("bearing", 19, 1.9)), (0.34, 2.01),
    ),
}  # fmt: skip
"""Radii and eccentricity in mm; the laser plane's phi (degrees), offset (mm) and tilt (degrees); waves of form in um;
noise in um, and turns."""


def calibrated(name):
    """The truth of a stand, and its calibration by a sensor of 2 um of linearity."""
    radii, eccentricity, (phi, offset, tilt), waves, (noise, turns) = STANDS[name]
    base, bearing = radii
    artefact = Artefact(
        (Cylinder("base", 2 * base, -60.0, 0.0, 0.002), Cylinder("bearing", 2 * bearing, 0.0, 40.0, 0.002, 0.002)), "S"
    )
    named = Named(
        {"phi": radians(phi), "plane_offset": offset, "plane_tilt": radians(tilt)},
        {"eccentricity": eccentricity, "eccentricity_direction": 2.7, "tilt": 0.00045, "tilt_direction": 0.6},
        {"form": tuple(FormWave(surface, n, a * UM, float(n)) for surface, n, a in waves)},
        {"noise": noise * UM, "step_z": 0.0, "step_x": 0.0, "fan": 0.55},
        {"profiles": int(turns * 1000), "columns": ("angle",)}, points=390,
    )  # fmt: skip
    stand = named.stand()
    stand = replace(stand, sensors=(replace(stand.sensor, linearity_U=0.002, range=(50.0, 160.0)),))
    made = simulate(stand, named.simulation(), artefact, 0)
    return made.truth, calibrate(interpret(made.recording, stand), artefact)


@pytest.mark.parametrize("name", tried(list(STANDS)[:1], *list(STANDS)[1:]))
def test_what_follows_a_plane_that_is_not_told_is_in_u(name):
    """Carried along slopes, phi was up to 2.0 U off here, *valid*; one fit did not settle."""
    truth, found = calibrated(name)
    assert found.status == "valid" and not found.residuals.rejected
    U = found.uncertainty
    assert abs(degrees(found.phi - truth.simulation.mounting.phi)) < U["phi_deg"].U < 0.1
    _, radial, *_ = sensor_parameters(found.table_from_sensor)
    _, true_radial, *_ = sensor_parameters(Pose.from_matrix(truth.table_from_sensor))
    assert abs(radial - true_radial) < U["radial_position_mm"].U < 0.1
