"""Uncertainty of gear figures: sensitivities against closed forms, and U against errors put in."""

from dataclasses import replace
from functools import cache
from math import cos, hypot, pi, radians, sqrt

import numpy as np
import pytest

from gears import POINTS, SPUR, UPRIGHT_POINTS, calibrated, line, scan_of, simulation, stand, true_calibration
from truestand.apply.datum import datum_of
from truestand.apply.transfer import roll
from truestand.calibration.calibrate import calibrate
from truestand.core.calibration import ScanSummary
from truestand.core.frames import sensor_parameters, shaft_from_rotor, shaft_parameters, table_from_sensor
from truestand.core.scan import interpret
from truestand.core.surface import apply_calibration
from truestand.gear.budget import Influence, expanded
from truestand.gear.evaluate import evaluate, figures_of
from truestand.gear.flanks import find_flanks, find_toothing
from truestand.gear.geometry import SIGMA, involute
from truestand.gear.inspect import evaluate_flanks, inspect_gear
from truestand.gear.seen_flanks import seen_flanks
from truestand.sim import GearErrors, VirtualGear, paper_shaft, simulate
from truestand.uncertainty.influence import unknowns_of
from variants import tried

UM = 1e-3
PERFECT = GearErrors(phase=radians(3.0))
QUIET = simulation(noise=0.0, step_x=0.0, step_z=0.0)
ALPHA = radians(20.0)


def figures(radial=0.0, offset=0.0, tilt=0.0, shaft=(0.0, 0.0)):
    """Mean figures (mm) of a perfect gear, the true calibration off by as much."""
    c = true_calibration()
    phi, u, height, alpha, d = sensor_parameters(c.table_from_sensor)
    ex, ey, tx, ty = shaft_parameters(c.shaft_from_rotor)
    moved = replace(
        c,
        table_from_sensor=table_from_sensor(phi, u + radial, height, alpha + tilt, d + offset),
        shaft_from_rotor=shaft_from_rotor(ex + shaft[0], ey + shaft[1], tx, ty),
    )
    found = inspect_gear(apply_calibration(scan_of(SPUR, PERFECT, QUIET), moved), SPUR)
    return {(c.name, c.flank): c.value for c in found.characteristics if c.tooth is None} | {"remarks": found.remarks}


def test_perfect_gear_with_the_true_calibration_has_no_deviations():
    found = figures()
    for name in ("F_p", "f_p", "f_Halpha", "f_Hbeta"):
        assert abs(found[name, "left"]) < 0.1 * UM
    assert not any("sides" in r for r in found["remarks"])


def slope_of(deviation):
    """f_Halpha of a deviation over the pressure angle: its line over the evaluation range, on the control length."""
    nominal = involute(SPUR)
    roll_length = np.linspace(*nominal.profile_range, 400)
    alpha = np.arctan(roll_length / nominal.base_radius)
    return np.polyfit(roll_length, deviation(alpha), 1)[0] * nominal.control_length


@pytest.mark.slow
def test_radial_zero_error_gives_equal_profile_slopes():
    """delta = dr sin(alpha). GEAR.md: 3.6 um for 10 um from a roll length of 3 mm on; our control length is longer."""
    found = figures(radial=10 * UM)
    for flank in ("left", "right"):
        assert found["f_Halpha", flank] == pytest.approx(slope_of(lambda a: 10 * UM * np.sin(a)), abs=0.1 * UM)
    assert found["s", None] - np.pi == pytest.approx(2 * 10 * UM * np.tan(ALPHA), abs=0.3 * UM)  # 7 um
    assert any("a radial zero 10 um off" in r for r in found["remarks"])


@pytest.mark.more
def test_lateral_offset_gives_opposite_profile_slopes():
    """delta = +-h cos(alpha): 6.5 um for 50 um; what is alike on both sides is second order, h d / r.

    Below the lowest profile, which is half a step of 2 mm at most, a trace goes on level: 2 % of the slope.
    """
    found = figures(offset=50 * UM)
    left, right = found["f_Halpha", "left"], found["f_Halpha", "right"]
    assert abs(left - right) / 2 == pytest.approx(abs(slope_of(lambda a: 50 * UM * np.cos(a))), rel=0.02)
    assert abs(left + right) / 2 < 0.4 * UM
    assert any("a laser plane 51 um beside" in r for r in found["remarks"])


@pytest.mark.more
def test_line_skew_gives_opposite_helix_slopes():
    """+-eps b cos(alpha): 18.8 um for 1 mrad over 20 mm."""
    found = figures(tilt=1e-3)
    left, right = found["f_Hbeta", "left"], found["f_Hbeta", "right"]
    assert abs(left - right) / 2 == pytest.approx(1e-3 * 20 * cos(ALPHA), rel=0.01)
    assert abs(left + right) / 2 < 0.2 * UM
    assert any("skew by 1.00 mrad" in r for r in found["remarks"])


@pytest.mark.more
def test_residual_eccentricity_gives_pitch_and_runout():
    found = figures(shaft=(10 * UM, 0.0))
    for flank in ("left", "right"):
        assert found["F_p", flank] == pytest.approx(20 * UM / cos(ALPHA), rel=0.03)
    assert found["F_r", None] == pytest.approx(20 * UM, rel=0.03)


@pytest.mark.slow
def test_u_covers_calibrations_drawn_from_their_covariance():
    """Monte Carlo: calibrations drawn from the covariance, each used on the same scan. U (k = 2) of the lines that the
    calibration makes must cover about 95 % of what comes out.
    """
    c = true_calibration()
    parameters, height = unknowns_of(c)
    scale = np.sqrt(np.diag(c.covariance))
    root = np.linalg.cholesky(c.covariance / np.outer(scale, scale) + 1e-12 * np.eye(8)) * scale[:, None]
    rng = np.random.default_rng(4)
    scan = scan_of(SPUR, PERFECT, QUIET)
    few = replace(scan, x=scan.x[:, ::2], z=scan.z[:, ::2])
    names = [("f_Halpha", "left"), ("f_Hbeta", "left"), ("s", None), ("W_k", None)]
    stated = {
        (line.name, line.flank): np.sqrt(sum(b.U**2 for b in line.budget if b.name in FROM_CALIBRATION))
        for line in inspect_gear(apply_calibration(few, c), SPUR).characteristics
        if line.tooth is None
    }
    off = {name: [] for name in names}
    for _ in range(40):
        phi, u, d, alpha, *shaft = parameters + root @ rng.standard_normal(8)
        drawn = replace(
            c, table_from_sensor=table_from_sensor(phi, u, height, alpha, d), shaft_from_rotor=shaft_from_rotor(*shaft)
        )
        surface = apply_calibration(few, drawn)
        flanks = find_flanks(surface, find_toothing(surface, involute(SPUR), datum_of(drawn, "base")))
        found = figures_of(evaluate_flanks(flanks, few.step)[1], involute(SPUR))
        for name in names:
            nominal = {"s": np.pi, "W_k": 15.432923}.get(name[0], 0.0)
            value = found[name[0]] if name[1] is None else found[f"{name[0]} mean"][0]
            off[name].append(float(value) - nominal)
    for name in names:
        ratio = np.std(off[name]) / (stated[name] / 2)
        assert 0.7 < ratio < 1.35, (name, ratio)  # 40 draws tell a standard deviation to 11 %


def by_range_error(upright, amplitude, phase):
    """A gear by a sensor whose range errs by a sine, at the calibration as at the inspection."""
    how = simulation(4400, upright, nonlinearity=amplitude, nonlinearity_phase=phase, noise=5e-4)
    own, shaft = stand(UPRIGHT_POINTS), paper_shaft()
    seen, part = (
        interpret(simulate(own, how, shaft, k, None, on_it).recording, own)
        for k, on_it in enumerate((None, VirtualGear(SPUR, PERFECT)))
    )
    return inspect_gear(roll(part, calibrate(seen, shaft)), SPUR)


@pytest.mark.slow
@pytest.mark.parametrize("upright", tried([True], rarely=[False]))
def test_linearity_reaches_the_figures_through_the_calibration_too(upright):
    """A range that errs by 20 um, in and out of step with the range: a tip diameter was 56 um off at a line of 24 um,
    s 21 at 9, a helix slope 11 at 7. The budget has a wave of half the size more.
    """
    before, *after = (by_range_error(upright, *wave) for wave in ((0.0, 0.0), (0.02, pi / 2), (0.02, 0.0)))
    for name, flank in (("s", None), ("d_a", None), ("f_Halpha", "left"), ("f_Hbeta", "left"), ("f_Hbeta", "right")):
        true = hypot(*(line(found, name, flank).value - line(before, name, flank).value for found in after))
        c = line(before, name, flank)
        (stated,) = (b.U for b in c.budget if b.name.startswith("linearity"))
        assert 0.75 * stated / 1.5 < true < 1.2 * stated, (name, flank, true, stated)


FROM_CALIBRATION = (
    "lateral offset of the laser plane", "skew of the laser line", "angle and radial zero of the sensor",
    "axis of the shaft",
)  # fmt: skip


@pytest.mark.slow
def test_incidence_u_of_the_recipe_replaces_the_assumed_one():
    scan = scan_of(SPUR, PERFECT, QUIET)
    sensor = replace(scan.stand.sensor, incidence_U=0.001)
    better = replace(scan, stand=replace(scan.stand, sensors=(sensor,)))
    found = [inspect_gear(apply_calibration(s, true_calibration()), SPUR) for s in (scan, better)]
    s = [next(c for c in f.characteristics if c.name == "s") for f in found]
    of_incidence = [next(b.U for b in c.budget if b.name.startswith("incidence")) for c in s]
    assert of_incidence[1] == pytest.approx(of_incidence[0] / 20, rel=0.01) and s[1].U < 0.6 * s[0].U


@pytest.mark.slow
def test_bore_clearance_is_in_the_budget_of_pitch():
    """A seat whose axis is known to c adds up to 2 c / cos(alpha) to F_p (GEOMETRY.md)."""
    scan = scan_of(SPUR, PERFECT, QUIET)
    surface = apply_calibration(scan, replace(true_calibration(), covariance=np.zeros((0, 0))))
    on_base, on_seat = (inspect_gear(surface, replace(SPUR, datum=d, bore_clearance=b))
                        for d, b in (("base", 0.0), ("base", 0.020)))  # fmt: skip
    lines = [next(c for c in f.characteristics if c.name == "F_p") for f in (on_base, on_seat)]
    clearance = next(b.U for b in lines[1].budget if b.name == "bore clearance")
    u = 0.010 / np.sqrt(3)  # rectangular within half the clearance
    assert clearance == pytest.approx(2 * 2 * u / cos(ALPHA) * np.sqrt(2), rel=0.05)
    assert lines[1].U > lines[0].U


@pytest.mark.slow
def test_a_sensor_that_moved_where_no_shaft_shows_it_stands_in_u():
    """12 um: d_a was 24 um off at U 3. Shaft in view tells, and so does a scan that is the calibration's own."""
    c, scan = true_calibration(), replace(scan_of(SPUR, PERFECT, QUIET), sha256="of this scan")
    warm = replace(c.table_from_sensor, translation=c.table_from_sensor.translation + np.array([0.012, 0.0, 0.0]))
    moved = replace(c, table_from_sensor=warm)
    found = [
        next(line for line in inspect_gear(apply_calibration(scan, known), SPUR).characteristics if line.name == "d_a")
        for known in (moved, replace(moved, followed=True), replace(moved, scan=ScanSummary.of(scan)))
    ]
    assert abs(found[0].value - 52.0) < 1.3 * found[0].U  # 12 of 10 um assumed
    assert [any(b.name == "stability of the sensor (assumed)" for b in f.budget) for f in found] == [True, False, False]
    assert np.sqrt(found[0].U ** 2 - found[1].U ** 2) == pytest.approx(0.02, rel=0.01)  # of the radius, twice
    assert found[2].U == found[1].U


@pytest.mark.more
def test_record_without_covariance_decides_nothing():
    """Cut down to the keys that a record must have: its U would leave out what the calibration doesn't know."""
    bare = replace(calibrated(), covariance=np.zeros((0, 0)))
    found = inspect_gear(apply_calibration(scan_of(), bare), replace(SPUR, accuracy_class=10))
    assert [r.code for r in found.reasons] == ["no_covariance"]
    assert found.verdict == "undecided" and {c.verdict for c in found.characteristics} == {None}


@cache
def evaluated():
    surface = apply_calibration(scan_of(), true_calibration())
    flanks = find_flanks(surface, find_toothing(surface, involute(SPUR), datum_of(true_calibration(), "base")))
    return evaluate_flanks(flanks, scan_of().step)


def test_u_of_an_input_is_the_same_for_either_sign_of_its_field():
    """Both ways count: ranges grow one way and shrink the other."""
    by, _ = evaluated()
    field = 3 * UM * np.square(by.grid.heights / by.grid.heights.max()) + np.zeros(by.grid.delta.shape)
    U = [expanded((Influence("bend", s * field, 0.0, UM),), by)["bend"] for s in (1.0, -1.0)]
    assert np.nanmax(U[0]["F_beta"]) > UM
    for name in U[0]:
        assert U[0][name] == pytest.approx(U[1][name], rel=1e-9, nan_ok=True), name


def test_flanks_moved_alike_move_position_and_areal_mean_alike():
    by, measures = evaluated()
    moved = evaluate(by.grid.delta + 7 * UM, by)
    for name in ("position", "area"):
        assert getattr(moved, name) - getattr(measures, name) == pytest.approx(7 * UM, abs=1e-12, nan_ok=True), name


def test_u_of_a_range_is_the_root_mean_square_of_both_ways():
    """A helix that leans by half of what it may: one way its range grows by all of that, the other way by nothing."""
    by, _ = evaluated()
    leaning = 10 * UM * by.grid.heights / np.ptp(by.grid.heights) + np.zeros(by.grid.delta.shape)
    U = [
        expanded((Influence("lean", leaning, 0.0, UM),), replace(by, grid=replace(by.grid, delta=share * leaning)))
        for share in (0.0, 0.5)
    ]
    level, half = (found["lean"]["F_beta"] for found in U)
    assert np.nanmin(level) > 5 * UM
    assert half == pytest.approx(level / sqrt(2.0), rel=1e-3, nan_ok=True)


def test_u_of_the_pitch_of_several_gears_is_their_root_mean_square():
    """An axis that is off moves teeth that face each other apart, and neighbours hardly: which are extreme matters."""
    by, _ = evaluated()
    teeth, nominal = by.grid.delta.shape[1], by.grid.nominal
    leaning = 5 * UM * np.cos(nominal.gear.pitch * np.arange(teeth))[None, :, None, None] + np.zeros(
        by.grid.delta.shape
    )
    otherwise = 20 * UM * np.random.default_rng(3).standard_normal((2, 2, teeth))
    axis = (Influence("axis", leaning, 0.0, UM),)

    def of(gear):
        delta = by.grid.delta + (SIGMA[:, None] * gear / nominal.arc_per_delta)[:, :, None, None]
        return expanded(axis, replace(by, grid=replace(by.grid, delta=delta)))["axis"]

    each, together = [of(gear) for gear in otherwise], expanded(axis, by, otherwise)["axis"]
    for name in ("F_p", "f_p", "F_pk", "f_u"):
        a, b = (gear[name] for gear in each)
        assert together[name] == pytest.approx(np.sqrt((a**2 + b**2) / 2), rel=1e-9), name
    assert (np.abs(each[0]["F_p"] - each[1]["F_p"]) > 0.2 * each[0]["F_p"]).any()
    assert together["F_r"] == pytest.approx(expanded(axis, by)["axis"]["F_r"])


@pytest.mark.more
def test_incidence_out_of_proportion_stands_in_u():
    """An outsider's sine over the incidence, within what is stated: f_falpha of teeth was 2.3 U off, decided."""
    stated, angles = 8 * UM, np.radians(np.arange(0.0, 90.0, 3.0))
    sine = np.where(angles < radians(40.0), 0.0, stated * np.sin((angles - radians(40.0)) / radians(45.0) * 2 * pi))
    how = replace(QUIET, optics=replace(QUIET.optics, noise=0.002, flank_bias=tuple(zip(angles, sine, strict=True))))
    own = stand(POINTS)
    own = replace(own, sensors=tuple(replace(s, incidence_U=stated) for s in own.sensors))
    scan = replace(scan_of(SPUR, PERFECT, how), stand=own)
    found = inspect_gear(apply_calibration(scan, true_calibration()), SPUR)
    lines = [c for c in found.characteristics if c.name in ("f_falpha", "F_alpha") and c.tooth and c.verdict]
    assert len(lines) > 40
    assert max(c.value / c.U for c in lines) < 1.5  # all that is read of a perfect gear is the sensor's


def test_what_steep_flanks_do_is_the_same_wherever_it_is_asked_for():
    """It was scaled by the places looked at: some near the tip had all the slope of a whole flank."""
    calibration = true_calibration()
    surface = apply_calibration(scan_of(SPUR, PERFECT, QUIET), calibration)
    nominal = involute(SPUR)
    toothing = find_toothing(surface, nominal, datum_of(calibration, SPUR.datum, 0.0))

    def incidence(rolls):
        shape = (2, SPUR.teeth, len(rolls), 2)
        roll, height = np.broadcast_to(rolls[:, None], shape), np.broadcast_to(nominal.helix_range, shape)
        seen = seen_flanks(*surface.origin, toothing, roll, height)
        return np.stack([i.field for i in seen.of_sensor if i.name.startswith("incidence")])

    rolls = np.linspace(*nominal.profile_range, 9)
    whole = incidence(rolls)
    assert incidence(rolls[6:]) == pytest.approx(whole[:, :, :, 6:], rel=1e-9)
    level, *others = whole  # a slope and a bend of U from the least to the most incidence, and a wave of half of it
    assert [np.ptp(by) for by in others] == pytest.approx([level.mean(), level.mean(), level.mean() / 2], rel=0.01)
