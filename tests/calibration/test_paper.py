"""The published method reproduces the paper's figures, and its traps are where theory says."""

from dataclasses import replace
from functools import cache
from math import cos, degrees, pi, radians, sin

import numpy as np
import pytest

from truestand.calibration import paper
from truestand.calibration.calibrate import calibrate
from truestand.calibration.segment import Segments, segment
from truestand.core.calibration import Calibration
from truestand.core.frames import LaserPlane
from truestand.core.harmonics import nearest_bin
from truestand.core.scan import Scan, interpret
from truestand.core.surface import apply_calibration
from truestand.sim import simulate
from truth import STANDS, Named, scan_of, shaft, simulated, truth_of

ROUND = Named(
    workpiece={"form": ()}, optics={"noise": 0.0, "step_z": 0.0, "step_x": 0.0}, acquisition={"profiles": 1000}
)


@cache
def published() -> Calibration:
    return calibrate(scan_of("paper"), shaft(), "paper")


@cache
def segments() -> Segments:
    return segment(scan_of("paper"), shaft())


def printed_matrix(phi):
    """Eq. 4 as printed, reduced to the XZ plane."""
    return np.array([[cos(phi), -sin(phi)], [sin(phi), -cos(phi)]])


def rotation_matrix(phi):
    """Eq. 1 and 4 as they must be meant: they bring the axis parallel to Z of C."""
    plane = LaserPlane(phi)
    return np.array([plane.across, plane.along])


def printed_arcsine_shift(angle, trace, wave, nearest):
    """Step 7 as printed: differences (N,) rad of the two arcsines; NaN where the measured one is undefined."""
    with np.errstate(invalid="ignore"):
        measured = np.arcsin((trace - wave.mean) / nearest.amplitude)
    return np.arcsin(np.cos(np.abs(angle - angle[0]) - nearest.phase)) - measured


def test_the_figures_of_the_paper():
    found = published()
    assert degrees(found.phi) == pytest.approx(-41.802, abs=0.01)
    assert 1000 * found.eccentricity == pytest.approx(878.9, abs=12)
    assert found.paper.bin == 3
    assert -0.264 < found.paper.phase_error_pi < -0.236
    assert 0.085 < found.residuals.p90 < 0.115
    assert found.plane_offset is None
    assert found.plane_tilt is None


def test_the_shift_by_arcsines_agrees_when_like_is_compared_with_like_and_folds_when_not():
    scan = scan_of("paper")
    base = paper.base_surface(scan, shaft(), segments())
    radial = paper.radial_coordinate(base, paper.axis_angle(paper.base_line(base), segments().phi))
    trace = paper.radial_signal(radial)
    wave, nearest = paper.compensation_wave(scan.angle, trace), nearest_bin(trace, scan.revolutions)
    assert paper.arcsine_shift(scan.angle, trace, wave, nearest) / pi == pytest.approx(-0.25, abs=0.015)
    printed = printed_arcsine_shift(scan.angle, trace, wave, nearest) / pi
    assert abs(np.nanmean(printed)) < 0.05
    assert 0.15 < np.nanmean(np.abs(printed)) < 0.27
    assert 0.1 < np.mean(np.isnan(printed)) < 0.4


def test_equation_4_as_printed_is_no_rotation():
    phi = radians(-41.802)
    printed, proper = printed_matrix(phi), rotation_matrix(phi)
    assert np.linalg.det(printed) == pytest.approx(-cos(2 * phi), abs=1e-12)
    assert np.abs(printed @ printed.T - np.eye(2)).max() > 0.5
    assert np.abs(proper @ proper.T - np.eye(2)).max() < 1e-15


def test_one_bad_point_moves_the_displacement_of_equation_6():
    scan = scan_of("paper")
    base = paper.base_surface(scan, shaft(), segments())
    before = paper.displacement(base)
    z = base.z.copy()
    z[17, 40] = 71.0
    assert paper.displacement(replace(base, z=z)) != before


def test_in_one_heap_the_eccentricity_turns_the_line_but_pooled_over_profiles_it_does_not():
    scan = scan_of("paper")
    base = paper.base_surface(scan, shaft(), segments())
    on = np.isfinite(base.z)
    x, z = base.x[on], base.z[on]
    heap = float(np.cov(x, z)[0, 1] / np.var(x))
    assert abs(degrees(paper.axis_angle(heap, segments().phi)) + 41.802) > 0.3
    assert abs(degrees(paper.axis_angle(paper.base_line(base), segments().phi)) + 41.802) < 0.005


@cache
def round_shaft() -> tuple[Scan, Calibration, Calibration]:
    scan = interpret(simulate(ROUND.stand(), ROUND.simulation(), shaft()).recording, ROUND.stand())
    return scan, calibrate(scan, shaft()), calibrate(scan, shaft(), "paper")


def second_harmonic(scan: Scan, calibration: Calibration) -> float:
    surface = apply_calibration(scan, calibration)
    on = (surface.z > -15) & (surface.z < -3)
    radius = np.where(on, surface.radius, 0).sum(axis=1) / on.sum(axis=1)
    return float(2 * abs(np.mean(radius * np.exp(2j * scan.angle))))


def test_subtracting_a_sinusoid_leaves_e2_over_4r_and_moving_the_axis_leaves_nothing():
    scan, exact, subtracted = round_shaft()
    assert second_harmonic(scan, subtracted) == pytest.approx(0.8789**2 / (4 * 12.5), rel=0.01)  # 15.4 um
    assert second_harmonic(scan, exact) < 1e-6


def test_subtracting_a_sinusoid_leaves_polar_angles_wrong_by_e_over_r():
    """On a pitch circle of 30 mm that is e = 0.88 mm either way: 1.75 mm of cumulative pitch."""
    scan, exact, subtracted = round_shaft()
    angles = [apply_calibration(scan, c) for c in (exact, subtracted)]
    off = np.angle(np.exp(1j * (angles[0].angle - angles[1].angle)))
    on = (angles[0].z > -15) & (angles[0].z < -3)
    assert np.abs(off[on]).max() == pytest.approx(0.8789 / 12.5, rel=0.02)
    assert 2 * np.abs(off[on]).max() * 12.5 == pytest.approx(1.75, rel=0.03)


def test_the_published_angle_has_both_signs():
    for name in ("other side", "from above"):
        found = calibrate(scan_of(name), shaft(), "paper")
        assert degrees(found.phi) == pytest.approx(truth_of(name)["sensor"]["phi_deg"], abs=0.1)
    assert simulated("other side").recording.angle is None
    assert "other side" in STANDS
