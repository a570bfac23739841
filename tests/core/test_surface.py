"""A calibration applied: exact at every radius, nothing dropped."""

import numpy as np
import pytest

from poses import rotor_from_table
from truestand.core.calibration import Calibration
from truestand.core.frames import Pose
from truestand.core.scan import interpret
from truestand.core.surface import apply_calibration
from truestand.sim import FormWave, simulate
from truth import PER_TURN, STANDS, Named, scan_of, shaft, simulated


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
    surface = apply_calibration(scan, calibration)
    for row in (0, 309, 999):
        chain = calibration.shaft_from_rotor @ rotor_from_table(scan.angle[row]) @ calibration.table_from_sensor
        readings = np.column_stack([scan.x[row], np.zeros(scan.x.shape[1]), scan.z[row]])
        expected = chain(readings)
        rolled = np.column_stack([surface.x[row], surface.y[row], surface.z[row]])
        assert np.allclose(rolled, expected, atol=1e-10, equal_nan=True)


def test_with_the_true_poses_the_shaft_lies_on_its_drawing():
    """Noise-free but for 5 um and quantisation, with 20 um / n of form: everything within 0.15 mm of a cylinder."""
    name = "many harmonics"
    surface = apply_calibration(scan_of(name), truth_as_calibration(name))
    base = (surface.z < -1) & (surface.z > -15)
    assert np.abs(surface.radius[base] - 12.5).max() < 0.15
    assert abs(np.mean(surface.radius[base]) - 12.5) < 0.001


def test_what_was_not_seen_stays_not_seen():
    scan = scan_of("dirty")
    surface = apply_calibration(scan, truth_as_calibration("dirty"))
    assert np.array_equal(np.isnan(surface.x), np.isnan(scan.z))
    assert not surface.x.flags.writeable


def test_a_trace_is_radius_over_angle_at_one_height():
    surface = apply_calibration(scan_of("many harmonics"), truth_as_calibration("many harmonics"))
    angle, radius = surface.trace(-8.0, 0.5)
    assert (np.diff(angle) >= 0).all()
    assert radius.size == PER_TURN
    assert np.abs(radius - 12.5).max() < 0.1


def perfect_wheel(eccentricity):
    """Radius (n,) and polar angle of a noise-free scan of a perfect 30-lobed wheel, rolled up with the true poses."""
    named = Named(
        running={"eccentricity": eccentricity},
        workpiece={"form": (FormWave("base", 30, 0.05),)},
        optics={"noise": 0.0, "step_x": 0.0, "step_z": 0.0},
        acquisition={"profiles": 1000, "columns": ("angle",)},
    )
    made = simulate(named.stand(), named.simulation(), shaft(), 0)
    poses = (Pose.from_matrix(m) for m in (made.truth.table_from_sensor, made.truth.shaft_from_rotor))
    known = Calibration("stand", *poses, named.stand(), "angle", "index")
    surface = apply_calibration(interpret(made.recording, named.stand()), known)
    with np.errstate(invalid="ignore"):
        on = (np.abs(surface.radius - 12.5) < 0.2) & (surface.z < -1.0) & (surface.z > -15.0)
    return surface.radius[on], surface.angle[on]


@pytest.mark.parametrize("eccentricity", [0.0, 0.8789, 3.0])
def test_a_perfect_wheel_stays_perfect(eccentricity):
    """0.001 um of roundness and 0.01 um of cumulative pitch are promised; the published compensation leaves 1.75 mm."""
    radius, psi = perfect_wheel(eccentricity)
    assert np.ptp(radius - 12.5 - 0.05 * np.cos(30 * psi)) < 1e-6
    tooth = np.floor((psi + np.pi) / (2 * np.pi / 30)).astype(int) % 30
    pitch = []
    for k in range(30):
        own = psi[tooth == k]
        design = np.column_stack([np.ones(own.size), np.cos(30 * own), np.sin(30 * own)])
        _, c, s = np.linalg.lstsq(design, radius[tooth == k], rcond=None)[0]
        pitch.append(12.5 * np.arctan2(s, c) / 30)
    assert np.ptp(pitch) < 1e-5
