"""Where a positioner brings a sensor, and by which ways."""

from math import cos, pi, radians, sin

import numpy as np
import pytest

from truestand.core.errors import BadRecipe
from truestand.core.frames import table_from_sensor
from truestand.planning.corridor import Corridors
from truestand.planning.kinematics import Kinematics, Motion, place_of
from truestand.planning.obstacles import Round
from truestand.planning.place import Place
from truestand.planning.room import KeepOut, Room, in_room

LEVEL = table_from_sensor(-pi / 2, 120.0, 0.0, 0.0, 0.0)
"""It looks at the axis from 120 mm away."""
LIFT = Motion("lift", True, np.array([0.0, 0.0, 1.0]), np.zeros(3), (-100.0, 200.0))
SLIDE = Motion("slide", True, np.array([1.0, 0.0, 0.0]), np.zeros(3), (0.0, 150.0))
SWIVEL = Motion("swivel", False, np.array([0.0, 1.0, 0.0]), np.array([20.0, 0.0, 0.0]), (-1.0, 1.0))
SIZE = (60.0, 20.0, 40.0)
"""It reaches from -30 to 30 mm high, 10 mm to either side."""
SHAFT = Round(10.0, -60.0, 40.0)


@pytest.mark.parametrize(("phi", "azimuth", "offset"), [(-1.2, 0.7, 0.4), (1.9, -2.0, -0.4)])
def test_a_place_is_told_from_its_pose(phi, azimuth, offset):
    place = Place(phi, 90.0, -3.0, offset, azimuth)
    found = place_of(in_room(place, 12.5), 12.5)
    for name in ("phi", "standoff", "height", "plane_offset", "azimuth"):
        assert getattr(found, name) == pytest.approx(getattr(place, name), abs=1e-9)


def test_a_laser_plane_that_leans_is_no_place():
    assert place_of(table_from_sensor(-pi / 2, 120.0, 0.0, radians(1.0), 0.0), 10.0) is None


def test_the_first_axis_carries_the_others():
    """Swivelled by 30 degrees about a point 100 mm before it, then lifted with its swivel by 50 mm."""
    pose = Kinematics((LIFT, SWIVEL), LEVEL).pose((50.0, radians(30.0)))
    assert pose.translation == pytest.approx([20.0 + 100.0 * cos(pi / 6), 0.0, 50.0 - 100.0 * sin(pi / 6)])
    assert pose.rotation[:, 2] == pytest.approx([-cos(pi / 6), 0.0, sin(pi / 6)])


def test_a_rotary_axis_moves_what_is_farthest_from_it_most():
    kinematics = Kinematics((LIFT, SWIVEL), LEVEL)
    assert kinematics.farthest(0, (0.0, 0.0), np.zeros((1, 3))) == 1.0
    assert kinematics.farthest(1, (0.0, 0.0), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -40.0]])) == pytest.approx(140.0)


def corridors(axes, room=None, bodies=(SHAFT,)):
    return Corridors(Kinematics(axes, LEVEL), SIZE, bodies, room or Room())


def test_a_clear_way_moves_one_axis_at_a_time():
    way = corridors((LIFT, SLIDE)).way((0.0, 0.0), (30.0, 20.0), "there")
    assert way == ((0.0, 0.0), (30.0, 0.0), (30.0, 20.0))


def test_the_order_is_one_that_meets_nothing():
    """Between two places to either side of a disc the sensor is drawn back, moved along, and brought near again."""
    disc, near = Round(150.0, 50.0, 60.0), (-30.0, 0.0)
    beyond = (140.0, 0.0)
    way = corridors((LIFT, SLIDE), bodies=(SHAFT, disc)).way(near, beyond, "there")
    assert way == (near, (-30.0, 150.0), (140.0, 150.0), beyond)


@pytest.mark.parametrize(
    ("room", "bodies"),
    [(Room(keep_out=(KeepOut(height=(60.0, 65.0)),)), (SHAFT,)), (Room(), (SHAFT, Round(400.0, 60.0, 65.0)))],
)
def test_a_barred_way_is_refused(room, bodies):
    with pytest.raises(BadRecipe, match="found no clear way to there on which the housing stays 5 mm away"):
        corridors((LIFT, SLIDE), room, bodies).way((0.0, 0.0), (150.0, 0.0), "there")


def test_no_way_is_needed_to_where_it_is():
    assert corridors((LIFT, SLIDE)).way((0.0, 0.0), (0.0, 0.0), "there") == ((0.0, 0.0),)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((201.0, 0.0), "lift at 201.000 mm, it goes from -100 to 200;"),
        ((0.0, radians(60.0)), "swivel at 60.000 deg, it goes from -57"),
    ],
)
def test_a_place_beyond_an_axis_is_refused(place, words):
    with pytest.raises(BadRecipe, match=words):
        corridors((LIFT, SWIVEL)).way((0.0, 0.0), place, "the place of rear")


@pytest.mark.parametrize(("start", "end", "words"), [(55.0, 0.0, "where it is now"), (0.0, 55.0, "there")])
def test_an_end_that_is_too_near_something_is_named(start, end, words):
    """The housing reaches 30 mm up."""
    room = Room(keep_out=(KeepOut(height=(80.0, 90.0)),))
    with pytest.raises(BadRecipe, match=f"no clear way to there: {words} the housing is nearer than 5 mm"):
        corridors((LIFT,), room).way((start,), (end,), "there")


@pytest.mark.parametrize("height", np.linspace(-12.0, 12.0, 7))
@pytest.mark.parametrize("thin", ["flange", "bar"])
def test_nothing_is_too_thin_to_be_met(thin, height):
    """Between two points of a coarse grid over the housing, anything may lie."""
    flange = Round(130.0, height, height + 0.1)
    bar = KeepOut((radians(9.7), radians(10.3)), (90.0, 300.0), (height, height + 0.1))
    if thin == "flange":
        start, axis, room = (50.0,), SLIDE, Room(least_clearance=0.2)
    else:
        ring = Motion("ring", False, np.array([0.0, 0.0, 1.0]), np.zeros(3), (0.0, 1.0))
        start, axis, room = (0.5,), ring, Room(keep_out=(bar,), least_clearance=0.2)
    with pytest.raises(BadRecipe, match="no clear way"):
        corridors((axis,), room, (SHAFT, flange) if thin == "flange" else (SHAFT,)).way(start, (0.0,), "there")


def test_thin_obstacles_are_not_jumped_over():
    """2 mm thick, half a metre of travel."""
    long = Motion("lift", True, np.array([0.0, 0.0, 1.0]), np.zeros(3), (-300.0, 300.0))
    with pytest.raises(BadRecipe, match="no clear way"):
        corridors((long,), bodies=(SHAFT, Round(130.0, 100.0, 102.0))).way((-250.0,), (250.0,), "there")
