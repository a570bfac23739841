"""Transforms: proper, named by direction, invertible, with the signs of CONTRACT.md."""

from math import atan2, cos, pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poses import is_proper, rotor_from_table
from truestand.core.frames import (
    Pose,
    sensor_parameters,
    shaft_from_rotor,
    shaft_parameters,
    table_from_sensor,
)

angles = st.floats(-3.1, 3.1).filter(lambda a: abs(sin(a)) > 1e-3)
small = st.floats(-0.05, 0.05)
lengths = st.floats(-200.0, 200.0)


@given(angles, lengths, lengths, small, st.floats(-2, 2))
def test_the_sensor_pose_is_proper_and_gives_its_parameters_back(phi, radial, height, tilt, offset):
    pose = table_from_sensor(phi, radial, height, tilt, offset)
    assert is_proper(pose)
    assert np.allclose(sensor_parameters(pose), (phi, radial, height, tilt, offset), atol=1e-9)


@given(st.floats(-3, 3), st.floats(-3, 3), small, small)
def test_the_shaft_pose_is_proper_untwisted_and_gives_its_parameters_back(ex, ey, tx, ty):
    pose = shaft_from_rotor(ex, ey, tx, ty)
    assert is_proper(pose)
    assert np.allclose(shaft_parameters(pose), (ex, ey, tx, ty), atol=1e-12)
    rotation = pose.rotation
    assert abs(rotation[0, 1] - rotation[1, 0]) < 1e-15  # the rotation vector has no part along Z


@pytest.mark.parametrize("phi_deg", [-41.802, 41.802, -138.198, 138.198, -90.0])
def test_the_signs_of_the_contract(phi_deg):
    tilt, offset = radians(0.3), 0.25
    pose = table_from_sensor(radians(phi_deg), 75.0, -70.0, tilt, offset)
    axis_in_sensor = pose.rotation[2]
    assert atan2(axis_in_sensor[0], axis_in_sensor[2]) == pytest.approx(radians(phi_deg), abs=1e-12)
    readings = np.array([[x, 0.0, z] for x in (-10.0, 0.0, 12.0) for z in (70.0, 95.0, 120.0)])
    points = pose(readings)
    assert np.allclose(points[:, 1], offset + points[:, 2] * tan(tilt), atol=1e-12)  # the laser plane
    into_the_scene = pose.rotation[:, 2]
    assert into_the_scene[0] < 0  # +X points from the axis to the sensor, so the sensor looks along -X


def test_turning_the_table_by_theta_turns_points_back_in_the_rotor():
    seen = rotor_from_table(radians(30))(np.array([[1.0, 0.0, 5.0]]))
    assert np.allclose(seen, [[cos(pi / 6), -sin(pi / 6), 5.0]])


def test_neighbouring_words_match_when_poses_are_chained():
    shaft_from_sensor = (
        shaft_from_rotor(0.5, 0.2, 1e-3, 0) @ rotor_from_table(0.3) @ table_from_sensor(-0.7, 75, -70, 0, 0)
    )
    point = np.array([1.0, 0.0, 95.0])
    by_hand = shaft_from_rotor(0.5, 0.2, 1e-3, 0)(rotor_from_table(0.3)(table_from_sensor(-0.7, 75, -70, 0, 0)(point)))
    assert np.allclose(shaft_from_sensor(point), by_hand, atol=1e-12)
    assert np.allclose(shaft_from_sensor.inverse(shaft_from_sensor(point)), point, atol=1e-12)
    assert np.allclose(Pose.from_matrix(shaft_from_sensor.matrix)(point), by_hand, atol=1e-12)
