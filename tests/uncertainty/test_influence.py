"""The calibration's unknowns and the points that follow them."""

from dataclasses import replace

import numpy as np

from solids import calibration
from truestand.core.scan import Scan
from truestand.core.surface import apply_calibration, readings_of, seen_at, sensor_origins
from truestand.uncertainty.influence import independent_parts, influence, points_of, unknowns_of

RNG = np.random.default_rng(1)
X, Z, ANGLE = RNG.uniform(-15, 15, 50), RNG.uniform(75, 115, 50), RNG.uniform(0, 20, 50)


def test_the_chain_is_the_one_that_rolls():
    known = calibration()
    scan = Scan(X[:, None], Z[:, None], ANGLE, known.stand, "angle")
    surface = apply_calibration(scan, known)
    rolled = np.column_stack([surface.x[:, 0], surface.y[:, 0], surface.z[:, 0]])
    assert np.allclose(points_of(*unknowns_of(known), X, Z, ANGLE), rolled, atol=1e-10)


def test_points_follow_a_large_step_of_each_unknown():
    known = calibration()
    follow, (p, height) = influence(known, X, Z, ANGLE), unknowns_of(known)
    here = points_of(p, height, X, Z, ANGLE)
    for i, step in enumerate([1e-4, 1e-2, 1e-2, 1e-4, 1e-2, 1e-2, 1e-4, 1e-4]):
        there = points_of(p + step * np.eye(8)[i], height, X, Z, ANGLE)
        assert np.allclose(there - here, step * follow[i], atol=2e-6)


def test_the_parts_are_the_covariance():
    root = RNG.normal(size=(8, 8)) * [1e-6, 1e-3, 1e-3, 1e-5, 1e-3, 1e-3, 1e-5, 1e-5]
    known = calibration(root.T @ root)
    parts = independent_parts(known)
    scale = np.sqrt(np.diag(known.covariance))
    assert np.allclose(parts.T @ parts / np.outer(scale, scale), known.covariance / np.outer(scale, scale), atol=1e-9)
    none = replace(known, covariance=np.zeros((0, 0)))
    assert independent_parts(none) is None


def test_rays_start_at_the_sensor_and_meet_their_points():
    known = calibration()
    p, height = unknowns_of(known)
    at = points_of(p, height, X, Z, ANGLE)
    origin = points_of(p, height, 0 * X, 0 * Z, ANGLE)
    assert np.allclose(sensor_origins(known, ANGLE), origin, atol=1e-10)
    x, z = readings_of(known, at, ANGLE)
    assert np.allclose(x, X, atol=1e-9)
    assert np.allclose(z, Z, atol=1e-9)


def test_a_point_is_seen_when_it_comes_into_the_plane_before_the_sensor():
    known = calibration()
    at = points_of(*unknowns_of(known), X, Z, ANGLE)
    before = np.hypot(at[:, 0], at[:, 1]) > 3.0
    outside = readings_of(known, at, ANGLE)[1] < 105.0  # nearer than the axis: the sensor's side
    both = before & outside
    assert both.sum() > 20
    off = (seen_at(known, at[both]) - ANGLE[both] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-9
    assert np.isnan(seen_at(known, np.array([[0.65, -0.6, 1e3]]))).all()
