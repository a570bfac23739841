"""The involute's closed forms against figures from textbooks and against their own definitions."""

from dataclasses import replace
from math import acos, atan, cos, pi, radians, tan

import numpy as np
import pytest

from gears import SPUR, helical
from truestand.core.errors import BadRecipe
from truestand.gear.drawing import Evaluation, Gear
from truestand.gear.geometry import angle_from_inv, inv, involute
from truestand.gear.undercut import undercut_roll


def test_the_involute_function_and_its_inverse():
    assert inv(radians(20.0)) == pytest.approx(0.0149043839, abs=1e-10)  # any gear handbook
    for degrees in (0.5, 10.0, 20.0, 45.0):
        assert angle_from_inv(inv(radians(degrees))) == pytest.approx(radians(degrees), abs=1e-12)


def test_a_spur_gear_of_24_teeth():
    """Base tangent length over 3 teeth of z = 24, m = 1: 7.7165 (handbook tables); thickness pi m / 2."""
    nominal = involute(SPUR)
    assert nominal.base_radius == pytest.approx(24 * cos(radians(20)), abs=1e-12)
    assert nominal.span_teeth == 3
    assert nominal.span == pytest.approx(2 * 7.71646, abs=2e-5)
    assert nominal.thickness == pytest.approx(pi, abs=1e-12)
    assert nominal.twist == 0.0


def test_over_balls_is_where_a_ball_touches_both_flanks():
    """Straight from the definition: the ball's centre is D/2 from both flanks, along their normals."""
    nominal = involute(replace(SPUR, evaluation=Evaluation(ball_diameter=3.5)))
    centre = (nominal.over_balls(3.5) - 3.5) / 2
    tangent = np.sqrt(centre**2 - nominal.base_radius**2)  # along the base tangent through the centre
    roll = tangent - 3.5 / 2
    psi = nominal.half_angle(nominal.radius(np.asarray(roll)))
    touching = np.sqrt(nominal.base_radius**2 + roll**2)
    point = touching * np.array([np.cos(psi), np.sin(psi)])
    middle = centre * np.array([np.cos(pi / 24), np.sin(pi / 24)])
    assert np.hypot(*(middle - point)) == pytest.approx(3.5 / 2, abs=1e-9)


def test_a_helix_turns_as_its_hand_says():
    right, left = involute(helical(15.0)), involute(helical(-15.0))
    assert right.twist == pytest.approx(tan(radians(15.0)) / (24 / cos(radians(15.0))))
    assert left.twist == -right.twist
    transverse = atan(tan(radians(20.0)) / cos(radians(15.0)))
    assert right.base_helix == pytest.approx(atan(tan(radians(15.0)) * cos(transverse)))


@pytest.mark.parametrize("gear", [SPUR, helical(15.0), replace(SPUR, profile_shift=0.4, tip_diameter=53.5)])
def test_a_flank_lies_where_the_tooth_is_as_thick_as_stated(gear):
    nominal = involute(gear)
    r = nominal.measuring_radius
    assert 2 * r * float(nominal.half_angle(np.asarray(r))) == pytest.approx(nominal.thickness, abs=1e-12)
    alpha = acos(nominal.base_radius / r)
    assert nominal.measuring_roll == pytest.approx(nominal.base_radius * tan(alpha))


def test_a_drawing_that_is_no_gear_is_refused():
    with pytest.raises(BadRecipe, match="need a tip above the root"):
        replace(SPUR, root_diameter=60.0)
    with pytest.raises(BadRecipe, match="face_width_mm 0"):
        replace(SPUR, face_width=0.5)
    with pytest.raises(BadRecipe, match="check teeth"):
        replace(SPUR, teeth=48)


@pytest.mark.parametrize(("teeth", "module", "roll"), [(9, 3.0, 1.90), (12, 2.5, 1.20), (24, 2.0, 0.0)])
def test_few_teeth_are_undercut_as_far_up_as_another_generator_makes_them(teeth, module, roll):
    """An outsider's trochoids, of a rack whose tip is rounded by a quarter of a module."""
    reference = teeth * module / 2
    assert undercut_roll(reference, radians(20.0), 1.25 * module, module) == pytest.approx(roll, abs=0.05)


def test_a_profile_starts_above_an_undercut_and_away_from_the_base_circle():
    few = Gear(9, 3.0, 14.0, 5.0, 33.0, 19.5)
    assert involute(few).control_roll == pytest.approx(1.90, abs=0.05)
    seventeen = Gear(17, 2.5, 14.0, 5.0, 47.5, 36.25)
    assert involute(seventeen).control_roll == pytest.approx(0.1 * involute(seventeen).base_radius)
