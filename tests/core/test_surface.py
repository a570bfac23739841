"""A calibration applied: exact at every radius, nothing dropped."""

import numpy as np
import pytest

from truestand.core.calibration import Calibration
from truestand.core.frames import Pose, rotor_from_table
from truestand.core.surface import roll
from truth import STANDS, scan_of, simulated


def truth_as_calibration(name: str) -> Calibration:
    truth = simulated(name).truth
    return Calibration(
        "stand",
        Pose.from_matrix(truth.table_from_sensor),
        Pose.from_matrix(truth.shaft_from_rotor),
        STANDS[name].stand(),
        "angle",
        "index",
    )


@pytest.mark.parametrize("name", ["mirrored, from above, clockwise", "any start angle", "dirty"])
def test_rolling_is_the_one_rigid_chain_of_the_contract(name):
    scan, calibration = scan_of(name), truth_as_calibration(name)
    surface = roll(scan, calibration)
    for row in (0, 1234, 3999):
        chain = calibration.shaft_from_rotor @ rotor_from_table(scan.angle[row]) @ calibration.table_from_sensor
        readings = np.column_stack([scan.x[row], np.zeros(scan.x.shape[1]), scan.z[row]])
        expected = chain(readings)
        rolled = np.column_stack([surface.x[row], surface.y[row], surface.z[row]])
        assert np.allclose(rolled, expected, atol=1e-10, equal_nan=True)


def test_with_the_true_poses_the_shaft_lies_on_its_drawing():
    """Noise-free but for 5 um and quantisation, with 20 um / n of form: everything within 0.15 mm of a cylinder."""
    name = "many harmonics"
    surface = roll(scan_of(name), truth_as_calibration(name))
    base = (surface.z < -1) & (surface.z > -15)
    assert np.abs(surface.radius[base] - 12.5).max() < 0.15
    assert abs(np.mean(surface.radius[base]) - 12.5) < 0.001


def test_what_was_not_seen_stays_not_seen():
    scan = scan_of("dirty")
    surface = roll(scan, truth_as_calibration("dirty"))
    assert np.array_equal(np.isnan(surface.x), np.isnan(scan.z))
    assert not surface.x.flags.writeable


def test_a_trace_is_radius_over_angle_at_one_height():
    surface = roll(scan_of("many harmonics"), truth_as_calibration("many harmonics"))
    angle, radius = surface.trace(-8.0, 0.5)
    assert (np.diff(angle) >= 0).all()
    assert radius.size == 4000
    assert np.abs(radius - 12.5).max() < 0.1
