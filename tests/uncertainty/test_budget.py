"""The budget: complete, confirmed by Monte Carlo, honest near zero."""

from dataclasses import replace
from math import hypot, inf

import numpy as np
import pytest

from truestand.calibration.calibrate import calibrate
from truestand.core.stand import Sensor
from truestand.uncertainty.budget import Input, budget_of, monte_carlo, sensitivities
from truestand.uncertainty.lines import linearity_name, linearity_of
from truth import scan_of, shaft

P = np.array([-0.73, 75.8, 0.1, 0.002, 0.67, 0.56, 3e-4, -2e-4])


@pytest.fixture(scope="module")
def found():
    return calibrate(scan_of("encoder"), shaft())


def test_every_quantity_names_at_least_seven_inputs_and_eccentricity_fourteen(found):
    for key, u in found.uncertainty.items():
        assert len(u.contributions) >= 7, key
        for line in u.contributions:
            assert line.value is not None
            assert line.sensitivity is not None
            assert line.distribution in ("normal", "rectangular")
            assert line.dof > 0
    assert len(found.uncertainty["eccentricity_um"].contributions) == 14
    assert len({c.name for u in found.uncertainty.values() for c in u.contributions}) >= 8


def test_the_lines_make_the_whole_and_each_is_value_times_sensitivity(found):
    for u in found.uncertainty.values():
        for line in u.contributions:
            assert 2 * line.value * line.sensitivity == pytest.approx(line.U, rel=1e-9, abs=1e-12)
        whole = float(np.sqrt(sum(c.U**2 for c in u.contributions)))
        assert u.U in (pytest.approx(whole), u.monte_carlo)


def test_a_direction_that_is_hardly_known_has_the_wider_of_both_doubts():
    """Twice the slope's share is not enough where a vector is as short as its own doubt."""
    p = P.copy()
    p[6:] = 1e-4, 0.0
    parts = {"noise": np.diag(np.square([1e-5, 1e-3, 0.02, 4e-4, 5e-4, 7e-4, 6e-5, 6e-5]))}
    found = budget_of(p, parts, (), inf, {})["tilt_direction_deg"]
    assert found.monte_carlo > 1.05 * np.degrees(2 * 0.6)
    assert found.monte_carlo == found.U


def test_monte_carlo_agrees_where_things_are_normal():
    parts = {"noise": np.diag(np.square([1e-5, 1e-3, 0.02, 4e-4, 5e-4, 7e-4, 1e-5, 2e-5]))}
    inputs = (Input("linearity", 0.01, "rectangular", {"eccentricity_um": 50.0}),)
    found = monte_carlo(P, parts, inputs, 100_000)
    for key, gradient in sensitivities(P).items():
        own = 0.5 if key == "eccentricity_um" else 0.0
        gum = 2 * hypot(float(np.sqrt(gradient @ parts["noise"] @ gradient)), own)
        assert found[key] == pytest.approx(gum, rel=0.03), key


def test_near_zero_the_magnitude_is_not_normal_and_nothing_is_nan():
    parts = {"noise": np.diag(np.square(np.full(8, 1e-4)))}
    p = P.copy()
    p[4:] = 0.0
    found = monte_carlo(p, parts, (), 100_000)
    assert found["eccentricity_um"] == pytest.approx(1000 * 1e-4 * np.sqrt(-2 * np.log(1 - 0.9545)), rel=0.02)  # Rice
    assert found["eccentricity_direction_deg"] == pytest.approx(180 * 0.9545, rel=0.02)


@pytest.mark.parametrize(("distribution", "half_width"), [("normal", 2.0), ("rectangular", 0.9545 * np.sqrt(3))])
def test_monte_carlo_draws_an_input_from_its_own_distribution(distribution, half_width):
    """95.45 % of a normal distribution lie within 2 u, of a rectangular one within 1.65 u (GUM 4.3.7)."""
    inputs = (Input("linearity", 0.01, distribution, {"eccentricity_um": 50.0}),)
    found = monte_carlo(P, {"noise": np.eye(8) * 1e-20}, inputs, 100_000)
    assert found["eccentricity_um"] == pytest.approx(half_width * 0.5, rel=0.01)  # 0.01 mm times 50 um/mm


def test_the_eccentricity_has_an_ellipse_even_where_it_has_no_direction():
    centred = calibrate(scan_of("centred"), shaft())
    ellipse = centred.eccentricity_ellipse
    assert centred.eccentricity_direction is None
    assert centred.eccentricity < ellipse.major < 0.01
    assert 0 < ellipse.minor <= ellipse.major
    eccentric = calibrate(scan_of("from above"), shaft())
    found = eccentric.eccentricity_ellipse
    along = eccentric.uncertainty["eccentricity_um"].U / 1000
    across = np.radians(eccentric.uncertainty["eccentricity_direction_deg"].U) * eccentric.eccentricity
    # An ellipse that leans holds its marginals between its axes; their squares have one sum.
    assert found.minor <= min(along, across) * 1.01
    assert found.major >= max(along, across) * 0.99
    assert hypot(found.major, found.minor) == pytest.approx(hypot(along, across), rel=0.03)


@pytest.mark.parametrize(
    ("sensor", "linearity"),
    [
        (Sensor(range=(70.0, 120.0)), 0.025),
        (Sensor(range=(70.0, 90.0)), 0.02),
        (Sensor(), 0.02),
        (Sensor(range=(70.0, 120.0), linearity_U=0.004), 0.004),
    ],
    ids=["0.05 % of 50 mm", "20 um at least", "no range", "stated"],
)
def test_a_linearity_that_nobody_states_is_assumed(sensor, linearity):
    assert sensor.linearity == pytest.approx(linearity)
    assert linearity_of(sensor, ()) == pytest.approx(linearity)
    assert linearity_name(sensor).endswith("(assumed)") is (sensor.linearity_U is None)


def test_an_assumed_linearity_stands_in_u_of_phi(found):
    """20 um stated, on the same scan 25 um assumed."""
    scan = scan_of("encoder")
    silent = replace(scan, stand=replace(scan.stand, sensors=(replace(scan.stand.sensor, linearity_U=None),)))
    assumed, stated = calibrate(silent, shaft()).uncertainty["phi_deg"], found.uncertainty["phi_deg"]
    lines = [next(c for c in u.contributions if c.name.startswith("linearity")) for u in (assumed, stated)]
    assert lines[0].name == "linearity of the sensor (assumed)"
    assert pytest.approx(25 / 20 * lines[1].U, rel=1e-6) == lines[0].U
    assert assumed.U > 1.2 * stated.U
