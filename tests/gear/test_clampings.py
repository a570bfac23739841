"""A gear that was clamped again, turned by some teeth: tied by its pitches, and the table told from it by closure."""

from dataclasses import replace
from functools import cache
from math import radians, tau

import numpy as np
import pytest

from gears import SPUR, WORN, line, simulation, stand
from truestand.apply.transfer import roll
from truestand.apply.views import roll_views
from truestand.calibration.calibrate import calibrate
from truestand.core.calibration import Wobble
from truestand.core.errors import BadRecipe
from truestand.core.scan import Scan, interpret
from truestand.core.surface import Surface
from truestand.gear.clampings import laid_together
from truestand.parts.inspect import inspect
from truestand.sim import GearErrors, VirtualGear, paper_shaft, simulate
from truestand.sim.gear_truth import gear_figures
from variants import tried

UM = 1e-3
COUNTS = 360_000
OFFSETS = (0, 7, 16)
TABLE = radians(10.0 / 3600.0)
"""10 arc seconds once a turn: an amplitude of 1.2 um at the measuring circle."""
EMPTY = Surface(*np.zeros((3, 1, 1)))
PERFECT = GearErrors(phase=0.05)
STAND = replace(stand(240), counts_per_turn=COUNTS)
LINEAR = replace(STAND, sensors=(replace(STAND.sensor, linearity_U=0.001),))
"""With a sensor that can't be taken for a table that errs."""


def turned_by(errors, teeth):
    """A gear with these errors, turned by so many teeth, counter-clockwise from above."""
    return replace(
        errors, eccentricity_direction=errors.eccentricity_direction + teeth * tau / SPUR.teeth,
        pitch_left=tuple(np.roll(errors.pitch_left, teeth)), pitch_right=tuple(np.roll(errors.pitch_right, teeth)),
    )  # fmt: skip


@cache
def scan(errors, teeth, seed, own=STAND, **optics):
    """Of the shaft (None) or of a gear, with an encoder that errs once a turn."""
    how = simulation(4400, True, **optics)
    how = replace(how, acquisition=replace(how.acquisition, columns=("encoder",)))
    part = None if errors is None else VirtualGear(SPUR, turned_by(errors, teeth))
    made = simulate(own, how, paper_shaft(), seed, None, part).recording
    angle = made.encoder * (tau / COUNTS)
    return interpret(replace(made, encoder=made.encoder + COUNTS / tau * TABLE * np.cos(angle - 0.7)), own)


@cache
def calibrated():
    return calibrate(scan(None, 0, 1), paper_shaft())


@cache
def clamped(errors):
    scans = tuple(scan(errors, teeth, 10 + teeth) for teeth in OFFSETS)
    return roll_views(scans, calibrated(), clamped_again=True)


@cache
def found(errors, turned):
    return inspect(clamped(errors), SPUR, turned)


def true(errors):
    return gear_figures(VirtualGear(SPUR, errors), paper_shaft(), simulation(2, True).workpiece)


@pytest.mark.more
@pytest.mark.parametrize("flank", tried(["left"], rarely=["right"]))
def test_closure_takes_the_table_off_the_pitch(flank):
    alone = inspect(roll(scan(WORN, 0, 10), calibrated()), SPUR)
    c, truth = line(found(WORN, (None,) * 3), "F_p", flank), true(WORN)["F_p", flank, None]
    assert c.value == pytest.approx(truth, abs=0.5 * UM) and abs(c.value - truth) < c.U < 1.5 * UM
    assert c.U < line(alone, "F_p", flank).U / 3


@pytest.mark.more
def test_what_a_range_error_does_to_an_eccentric_part_is_no_error_of_the_table():
    optics = {"nonlinearity": 0.02, "nonlinearity_phase": 2.5, "faster_nonlinearity": ((2, 0.01, 4.0),)}
    calibration = calibrate(scan(None, 0, 1, **optics), paper_shaft())
    scans = tuple(scan(WORN, teeth, 10 + teeth, **optics) for teeth in OFFSETS)
    inspection = inspect(roll_views(scans, calibration, clamped_again=True), SPUR, OFFSETS)
    assert not inspection.reasons
    for flank in ("left", "right"):
        c, truth = line(inspection, "F_p", flank), true(WORN)["F_p", flank, None]
        assert abs(c.value - truth) < c.U < 1.5 * UM


@pytest.mark.more
def test_the_tables_error_is_told_where_the_sensor_is_linear():
    scans = tuple(scan(WORN, teeth, 10 + teeth, LINEAR) for teeth in OFFSETS)
    views = roll_views(scans, calibrate(scan(None, 0, 1, LINEAR), paper_shaft()), clamped_again=True)
    (said,) = [str(r) for r in inspect(views, SPUR, (None,) * 3).remarks if r.code == "part_clamped_again"]
    assert "scan 2 was turned by 7 teeth, scan 3 was turned by 16 teeth" in said
    size, U = (float(text) for text in said.split("errs by ")[1].split(" um")[0].split(" +- "))
    assert size == pytest.approx(1000 * TABLE * 24.0, abs=max(U, 0.1)) and U < 1.0


@pytest.mark.slow
def test_every_flank_is_read_by_all_clampings_alike():
    alone, together = inspect(clamped(WORN)[0], SPUR), found(WORN, OFFSETS)
    for name in ("f_falpha", "f_fbeta", "f_Halpha", "f_Hbeta"):
        one, all_three = ([c.value for c in i.characteristics if c.name == name and c.tooth] for i in (alone, together))
        assert np.allclose(one, all_three, atol=3 * UM)


@pytest.mark.more
def test_a_sound_gear_clamped_again_has_no_damage():
    """Near the root one profile meets a flank where many do at the tip: a lone reading there is no outlier."""
    assert not [r for r in found(WORN, OFFSETS).remarks if r.code == "damage"]


@pytest.mark.more
def test_a_perfect_gear_is_not_tied_and_nothing_is_decided():
    loose = found(PERFECT, (None,) * 3)
    assert "part_not_tied" in {r.code for r in loose.reasons}
    assert {c.verdict for c in loose.characteristics} == {None}


@pytest.mark.more
@pytest.mark.parametrize("turned", [OFFSETS, (0, 8, 16)])
def test_teeth_that_the_pitches_can_not_confirm_decide_nothing(turned):
    """An even gear looks the same, turned or not: closure would give its run-out to the table."""
    together = laid_together(clamped(PERFECT), SPUR, turned)
    assert [r.code for r in together.reasons] == ["part_not_tied"]
    assert together.surfaces == clamped(PERFECT)[:1]
    assert [r.code for r in together.remarks] == ["first_clamping_alone"]


@pytest.mark.more
def test_a_gear_that_was_not_turned_is_not_tied():
    scans = tuple(scan(WORN, 0, seed) for seed in (10, 11, 12))
    surfaces = roll_views(scans, calibrated(), clamped_again=True)
    for turned in (OFFSETS, (None,) * 3):
        assert [r.code for r in laid_together(surfaces, SPUR, turned).reasons] == ["part_not_tied"]


@pytest.mark.more
def test_a_table_that_errs_by_more_than_its_u_allows_is_a_contradiction():
    """Or the part sits otherwise, each time towards the same side: nothing tells one from the other."""
    scans = [scan(WORN, teeth, 10 + teeth) for teeth in OFFSETS]
    worse = tuple(replace(s, angle=s.angle + 8 * TABLE * np.cos(s.angle)) for s in scans)
    surfaces = roll_views(worse, calibrated(), clamped_again=True)
    reasons = laid_together(surfaces, SPUR, (None,) * 3).reasons
    assert [r.code for r in reasons] == ["closure_contradicts"] and "angle_U_arcsec" in str(reasons[0])


@pytest.mark.slow
def test_a_part_with_play_is_tied_wherever_it_sits():
    """How it sits moves left and right flanks in their own directions, by more than its pitches differ."""
    seated = [
        replace(WORN, eccentricity=e, eccentricity_direction=d) for e, d in ((0.012, 1.0), (0.012, 4.4), (0.004, 1.7))
    ]
    scans = tuple(scan(e, teeth, 20 + teeth) for e, teeth in zip(seated, OFFSETS, strict=True))
    surfaces = roll_views(scans, calibrated(), clamped_again=True)
    together = laid_together(surfaces, replace(SPUR, bore_clearance=0.03), (None,) * 3)
    assert not together.reasons and len(together.surfaces) == 3
    assert "scan 2 was turned by 7 teeth, scan 3 was turned by 16 teeth" in str(together.remarks[0])


@pytest.mark.slow
def test_what_differs_between_clampings_stands_in_u():
    """A table that errs eight times a turn, for which closure does not look; neighbouring teeth feel it by a quarter
    more than the wave that U assumes.
    """
    scans = [scan(WORN, teeth, 10 + teeth) for teeth in OFFSETS]
    uneven = tuple(replace(s, angle=s.angle + TABLE * np.cos(8 * s.angle)) for s in scans)
    uneven_found = inspect(roll_views(uneven, calibrated(), clamped_again=True), SPUR, OFFSETS)
    assert not uneven_found.reasons
    for name, more in (("F_p", 1.0), ("f_p", 1.25)):
        c = line(uneven_found, name, "left")
        assert abs(c.value - true(WORN)[name, "left", None]) < more * c.U
    assert c.U > 1.5 * line(found(WORN, OFFSETS), "f_p", "left").U


@pytest.mark.slow
def test_what_only_one_scan_shows_counts_in_it_alone():
    """A wave of the shaft in view that the calibration does not know, in one clamping of three."""
    first, *others = clamped(WORN)
    _, known = first.origin
    wobbling = replace(first, calibration=replace(known, wobble=Wobble(2, 0.003)))
    together = inspect((*others[:1], wobbling, *others[1:]), SPUR)
    assert any(line.name.startswith("wobble") for line in line_of(together).budget)


def line_of(inspection):
    return line(inspection, "F_p", "left")


@pytest.mark.more
def test_teeth_that_the_pitches_contradict_are_refused():
    with pytest.raises(BadRecipe, match="found --part-turned 8, the pitches say that the part was turned by 7 teeth"):
        inspect(clamped(WORN), SPUR, (0, 8, 16))


@pytest.mark.parametrize(
    ("turned", "message"),
    [((0, 7), "for 2 clampings and 3 scans"), ((3, 7, 16), "for the first scan of a view, need 0")],
)
def test_numbers_that_do_not_fit_are_refused(turned, message):
    with pytest.raises(BadRecipe, match=message):
        laid_together([EMPTY] * 3, SPUR, turned)


def test_the_same_scan_twice_is_refused():
    twice = replace(EMPTY, scan=replace(scan_of(), sha256="7"))
    with pytest.raises(BadRecipe, match="found the same scan twice"):
        inspect([twice, twice], SPUR, (0, 7))


def scan_of():
    """Nothing in it."""
    return Scan(np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(2), STAND, "encoder")
