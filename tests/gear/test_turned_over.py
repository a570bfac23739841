"""A gear that was turned over between its scans: both of its sides by one sensor, and what nothing ties."""

from dataclasses import replace
from functools import cache
from math import radians, tau

import numpy as np
import pytest

from gears import SPUR, UPRIGHT_POINTS, WORN, helical, line, simulation, stand
from truestand.apply.views import roll_views
from truestand.calibration.calibrate import calibrate
from truestand.core.errors import BadRecipe
from truestand.core.scan import interpret
from truestand.gear.clampings import laid_together
from truestand.parts.inspect import inspect
from truestand.sim import Chip, Misalignment, VirtualGear, paper_shaft, simulate
from truestand.sim.gear_truth import gear_figures
from variants import tried

UM = 1e-3
COUNTS, ARCSEC10 = 360_000, radians(10.0 / 3600.0)
STEEP = helical(45.0)
"""One view sees one of its sides only."""
RUNNING_OUT = replace(WORN, eccentricity=0.02)
MARKED = replace(RUNNING_OUT, chips=(Chip(5, 6.5, 10.0, 0.06),))
"""One tip tells which tooth is which, and which side is up."""
TURNED = radians(100.0)
OWN = replace(stand(UPRIGHT_POINTS), counts_per_turn=COUNTS)
LINEAR = replace(OWN, sensors=(replace(OWN.sensor, linearity_U=0.001),))
"""With a sensor that can't be taken for a table that errs."""


@cache
def scan(gear, errors, turned=0.0, over=False, seed=1, error=0.0, own=OWN):
    """1.1 turns at 4,000 profiles each, of the shaft (None) or of a gear that sits so, by an encoder that errs by so
    many rad once a turn.
    """
    how = simulation(4400, True)
    how = replace(how, acquisition=replace(how.acquisition, columns=("encoder",)))
    part = None if errors is None else VirtualGear(gear, errors, turned, over)
    made = simulate(own, how, paper_shaft(), seed, None, part).recording
    off = error * COUNTS / tau * np.cos(made.encoder * (tau / COUNTS) - 0.7)
    return interpret(replace(made, encoder=made.encoder + off), own)


@cache
def stands(own=OWN):
    return calibrate(scan(None, None, seed=0, own=own), paper_shaft())


@cache
def both(gear, errors, turned=TURNED, over=True):
    scans = scan(gear, errors), scan(gear, errors, turned, over, seed=2)
    return roll_views(scans, stands(), clamped_again=True)


@cache
def found(gear, errors):
    return inspect(both(gear, errors), gear, (0, "over"))


@cache
def true(gear, errors):
    return gear_figures(VirtualGear(gear, errors), paper_shaft(), simulation(2, True).workpiece)


def codes(messages):
    return {message.code for message in messages}


def inside_u(inspection, truth):
    """Share of the figures that lie within their U, their number, and the worst in U."""
    off = [
        abs(c.value - truth[key]) / c.U
        for c in inspection.characteristics
        if (key := (c.name, c.flank or "", c.tooth)) in truth and c.value is not None
    ]
    return np.mean(np.array(off) < 1), len(off), max(off)


@pytest.mark.more
def test_one_sensor_sees_both_sides():
    inspection, truth = found(STEEP, MARKED), true(STEEP, MARKED)
    assert not inspection.reasons
    for flank in ("left", "right"):
        for name in ("f_p", "F_p"):
            c = line(inspection, name, flank)
            assert c.status == "measured" and abs(c.value - truth[name, flank, None]) < c.U < 10 * UM
    share, number, worst = inside_u(inspection, truth)
    assert number > 280 and share > 0.97 and worst < 1.5


def test_what_needs_both_sides_is_not_measurable():
    inspection = found(STEEP, MARKED)
    for name in ("s", "W_k", "M_d", "F_r"):
        assert line(inspection, name, None).status == "not_measurable"
    assert line(inspection, "d_a", None).status == "measured"
    (said,) = [str(r) for r in inspection.remarks if r.code == "part_turned_over"]
    assert "the tips tell which tooth is which" in said and "other_thickness" not in codes(inspection.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("marks", tried([(Chip(5, 13.0, 17.0, 0.06),)], rarely=[((),)]))
def test_tips_that_look_the_same_from_below_decide_nothing(marks):
    """Its figures are shown, without a verdict. Left flanks seen at a grazing angle by the other scan were damage of
    30 um.
    """
    part = replace(RUNNING_OUT, chips=marks)
    inspection, truth = found(STEEP, part), true(STEEP, part)
    assert codes(inspection.reasons) == {"turned_over_not_told"} and "damage" not in codes(inspection.remarks)
    for flank in ("left", "right"):
        for name in ("f_p", "F_p"):
            c = line(inspection, name, flank)
            assert abs(c.value - truth[name, flank, None]) < c.U and c.verdict is None


@pytest.mark.slow
def test_a_chipped_tooth_keeps_its_number():
    chipped = replace(RUNNING_OUT, chips=(Chip(5, 17.0, 20.0, 0.4),))
    inspection = found(STEEP, chipped)
    (defect,) = [d for d in inspection.defects if d.kind.startswith("chipped")]
    assert not inspection.reasons and defect.tooth == 5 and defect.depth == pytest.approx(0.4, abs=0.05)


@pytest.mark.more
def test_the_same_flanks_from_below_lay_the_scans_onto_each_other():
    """What a laser plane beside where it is taken to be does to a slope turns round with the part."""
    inspection, alone = found(SPUR, RUNNING_OUT), inspect(both(SPUR, RUNNING_OUT)[0], SPUR)
    assert not inspection.reasons and "part_turned_over" not in codes(inspection.remarks)
    share, number, worst = inside_u(inspection, true(SPUR, RUNNING_OUT))
    assert number == 2 * 24 * 6 + 4 and share > 0.97 and worst < 1.2
    for name in ("s", "F_r"):
        assert line(inspection, name, None).value == pytest.approx(line(alone, name, None).value, abs=1.5 * UM)

    def by_offset(of):
        budget = line(of, "f_Halpha", "left").budget
        return next((c.U for c in budget if c.name == "lateral offset of the laser plane"), 0.0)

    assert by_offset(inspection) < by_offset(alone) / 3


@pytest.mark.more
@pytest.mark.parametrize(("chips", "told"), tried([(MARKED.chips, True)], rarely=[((), False)]))
def test_a_marked_tip_tells_which_tooth_is_which_where_pitches_are_too_even(chips, told):
    """Flanks that both scans show say how far round; the part was refused, though both showed the mark."""
    even = replace(RUNNING_OUT, pitch_left=(), pitch_right=(), chips=chips)
    inspection = found(SPUR, even)
    assert (not inspection.reasons) == told
    if told:
        share, number, worst = inside_u(inspection, true(SPUR, even))
        assert number == 2 * 24 * 6 + 4 and share > 0.97 and worst < 1.2


@pytest.mark.slow
def test_the_table_turns_a_gear_from_below_the_other_way():
    """An encoder that errs by 10 arc seconds once a turn, of which closure is told by one gear turned over."""

    scans = [
        scan(SPUR, WORN, radians(turned), over, seed, ARCSEC10, LINEAR)
        for seed, (turned, over) in enumerate(((0.0, False), (100.0, True), (230.0, True)))
    ]
    inspection = inspect(roll_views(scans, stands(LINEAR), clamped_again=True), SPUR, (0, "over", "over"))
    (said,) = [str(r) for r in inspection.remarks if r.code == "part_clamped_again"]
    size, U = (float(text) for text in said.split("errs by ")[1].split(" um")[0].split(" +- "))
    assert size == pytest.approx(1000 * ARCSEC10 * 24.0, abs=max(U, 0.1)) and U < 1.0
    for flank in ("left", "right"):
        c = line(inspection, "F_p", flank)
        assert abs(c.value - true(SPUR, WORN)["F_p", flank, None]) < min(c.U, 0.7 * UM)


@pytest.mark.more
@pytest.mark.parametrize("gear", tried([SPUR], rarely=[STEEP]))
def test_a_part_that_was_not_turned_over_is_refused(gear):
    with pytest.raises(BadRecipe, match="the pitches say that the part was not turned over, but turned by 7 teeth"):
        inspect(both(gear, RUNNING_OUT, radians(105.0), over=False), gear, (0, "over"))


@pytest.mark.slow
def test_an_even_part_that_was_not_turned_over_decides_nothing():
    """Its left flanks were shown as right ones: a slope of 14 um was told as 0.0 +- 1.4, *conforms*."""
    even = replace(RUNNING_OUT, pitch_left=(), pitch_right=())
    inspection = inspect(both(STEEP, even, radians(105.0), over=False), STEEP, (0, "over"))
    assert codes(inspection.reasons) == {"turned_over_not_told"}
    assert {c.verdict for c in inspection.characteristics} == {None}


@pytest.mark.slow
def test_a_part_that_sits_otherwise_is_told_by_its_tips():
    """Play that nobody stated: its toothing runs out by 20 um, but in another direction."""
    seated = replace(MARKED, eccentricity_direction=MARKED.eccentricity_direction + 1.2)
    together = laid_together((both(STEEP, MARKED)[0], both(STEEP, seated)[1]), STEEP, (0, "over"))
    assert codes(together.reasons) == {"part_sits_otherwise"}


@pytest.mark.slow
def test_another_part_turned_over_is_not_tied():
    """Its tips are chipped elsewhere."""
    other = replace(MARKED, chips=(Chip(3, 7.0, 21.0, 0.3), Chip(11, 7.0, 21.0, 0.3)))
    first, second = both(STEEP, MARKED)[0], both(STEEP, other)[1]
    together = laid_together((first, second), STEEP, (0, "over"))
    assert codes(together.reasons) == {"part_not_tied"} and together.surfaces == (first,)
    assert "--part-turned" not in str(together.reasons[0])  # which was said


STEPS_APART = (-0.0015, 0.001)
"""mm: the seat's axis off the base's, within the 2 um of a ground shaft; it lays the laser plane 31 um aside."""


@cache
def on_steps_apart(part, turned, over, seed):
    how = simulation(4400, True)
    how = replace(
        how, acquisition=replace(how.acquisition, columns=("encoder",)),
        workpiece=replace(how.workpiece, misalignments=(Misalignment("bearing", *STEPS_APART),)),
    )  # fmt: skip
    gear = None if part is None else VirtualGear(SPUR, part, turned, over)
    return interpret(simulate(OWN, how, paper_shaft(), seed, None, gear).recording, OWN)


@pytest.mark.slow
@pytest.mark.parametrize("turned", tried([(0, "over")], rarely=[((0, 7, 16),)]))
def test_what_stays_with_the_stand_is_no_fault_of_the_part(turned):
    """A laser plane and a seat off within their U were *part sits otherwise*, or an error of the table that wasn't."""
    calibration = calibrate(on_steps_apart(None, 0.0, False, 0), paper_shaft())
    turns = (tau * (teeth if isinstance(teeth, int) else 6.7) / SPUR.teeth for teeth in turned)
    scans = [on_steps_apart(WORN, t, of == "over", 10 + k) for k, (t, of) in enumerate(zip(turns, turned, strict=True))]
    inspection = inspect(roll_views(scans, calibration, clamped_again=True), SPUR, turned)
    assert not inspection.reasons and "damage" not in codes(inspection.remarks)
    assert inspection.settings["datum"].startswith("the axis on which the part sat")
    share, _, worst = inside_u(inspection, true(SPUR, WORN))
    assert share > 0.97 and worst < 1.2
    (said,) = [str(r) for r in inspection.remarks if r.code == "part_clamped_again"]
    assert float(said.split("errs by ")[1].split(" +- ")[0]) < 0.5
    for flank in ("left", "right"):
        c = line(inspection, "F_p", flank)
        assert abs(c.value - true(SPUR, WORN)["F_p", flank, None]) < c.U and (turned == (0, "over") or c.U < 1.5 * UM)
