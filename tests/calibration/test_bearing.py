"""A table whose bearing moves the shaft to and fro, some times a turn, while it is scanned for the calibration."""

from dataclasses import replace
from functools import cache
from math import degrees

import numpy as np
import pytest

from truestand.calibration.calibrate import calibrate
from truestand.core.frames import Pose
from truestand.core.scan import interpret
from truestand.sim import simulate
from truth import ROUND, Named, scan_of, shaft, simulated
from variants import tried

UM, ON = 1e-3, "eccentric 2.5 mm"
"""On so eccentric a shaft waves of the table are none of form: 20 a turn run ahead by 4 rad on the base."""


LITTLE = Named(
    {"plane_offset": -0.1, "plane_tilt": 0.004}, {"eccentricity": 0.1, "tilt": 0.001, "tilt_direction": 2.0}, ROUND,
    {"noise": 0.002}, {"profiles": 1470, "columns": ("angle",)},
)  # fmt: skip


def moved(scan, truth, amplitude, waves):
    """A scan whose shaft moves towards the sensor and away, some ``waves`` a turn; mm."""
    by = amplitude * np.cos(waves * scan.angle + 1.0)[:, None]
    x, _, z = Pose.from_matrix(truth.table_from_sensor).rotation.T @ np.array([1.0, 0.0, 0.0])
    return replace(scan, x=scan.x + by * x, z=scan.z + by * z)


def twisted(scan, truth, amplitude, waves, degrees_per_mm):
    """A scan of a shaft whose form, some ``waves`` a turn, turns along it; mm."""
    pose = Pose.from_matrix(truth.table_from_sensor)
    x, _, z = pose.rotation.T @ np.array([1.0, 0.0, 0.0])
    height = pose.rotation[2, 0] * scan.x + pose.rotation[2, 2] * scan.z + pose.translation[2]
    by = amplitude * np.cos(waves * (scan.angle[:, None] + np.radians(degrees_per_mm) * height) + 1.0)
    return replace(scan, x=scan.x + by * x, z=scan.z + by * z)


@cache
def calibrated(name, amplitude, waves):
    """Of a named stand."""
    return calibrate(moved(scan_of(name), simulated(name).truth, amplitude, waves), shaft())


def off(found, name):
    """Laser plane's tilt (degrees) and offset (mm) from the truth."""
    true = simulated(name).truth.simulation.mounting
    return degrees(found.plane_tilt - true.plane_tilt), found.plane_offset - true.plane_offset


@pytest.mark.parametrize("waves", tried([9, 19], 4, 6, 13, 16, 25))
@pytest.mark.parametrize("name", tried(["encoder"], ON, "any start angle", "clockwise"))
def test_a_wave_of_the_bearing_draws_the_laser_plane_nowhere(name, waves):
    """Taken for form of the shaft, it tilted the plane by up to 8 U, *valid*."""
    still, found = calibrate(scan_of(name), shaft()), calibrated(name, 4 * UM, waves)
    assert found.status == "valid"
    U = [found.uncertainty[f"laser_plane_{key}"].U for key in ("tilt_deg", "offset_mm")]
    assert np.all(np.abs(np.subtract(off(found, name), off(still, name))) < 0.1 * np.array(U))
    assert found.uncertainty["laser_plane_tilt_deg"].U < 1.1 * still.uncertainty["laser_plane_tilt_deg"].U
    strongest = max(found.shared_waves, key=lambda wave: wave.amplitude)
    assert strongest.waves == waves and strongest.amplitude == pytest.approx(4 * UM, abs=0.5 * UM)


@pytest.mark.parametrize("waves", tried([13], 5, 9, 20, 28))
def test_a_wave_that_nothing_tells_from_form_says_nothing_of_the_laser_plane(waves):
    """On a shaft that hardly runs out, coaxial to 0.2 um: not turned along it, the wave said that nothing is tilted."""
    base, step = shaft().cylinders
    made = simulate(LITTLE.stand(), LITTLE.simulation(), shaft(), 0)
    scan = moved(interpret(made.recording, LITTLE.stand()), made.truth, 5 * UM, waves)
    found = calibrate(scan, replace(shaft(), cylinders=(base, replace(step, coaxiality_U=2e-4))))
    U = found.uncertainty["laser_plane_tilt_deg"].U
    assert found.status == "valid" and abs(degrees(found.plane_tilt - 0.004)) < U < 0.1


@pytest.mark.parametrize(("waves", "form"), tried([(3, 40)], (5, 32)))
def test_form_that_is_twisted_along_the_shaft_says_nothing_of_the_laser_plane(waves, form):
    """By a degree in 10 mm, of 30 um and more: the plane's tilt was up to 48 U off, *valid*, and sound gears failed."""
    stand = replace(LITTLE, running={**LITTLE.running, "eccentricity": 0.5})
    made = simulate(stand.stand(), stand.simulation(), shaft(), 0)
    found = calibrate(twisted(interpret(made.recording, stand.stand()), made.truth, form * UM, waves, 0.1), shaft())
    U = found.uncertainty
    assert found.status == "valid"
    assert abs(degrees(found.plane_tilt - 0.004)) < 0.2 * U["laser_plane_tilt_deg"].U < 0.09
    assert abs(found.plane_offset + 0.1) < U["laser_plane_offset_mm"].U < 0.16
