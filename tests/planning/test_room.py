"""Where a sensor's housing may be: distances to what turns, to what is kept out of, and between housings."""

from math import pi, radians

import numpy as np
import pytest

from truestand.core.stand import Sensor
from truestand.planning.obstacles import Round
from truestand.planning.optics import optics_of
from truestand.planning.place import Place
from truestand.planning.room import KeepOut, Room, apart, clearance, in_room

OPTICS, _ = optics_of(Sensor("front", range=(70.0, 120.0), housing=(60.0, 20.0, 40.0)))
SIZE = OPTICS.housing
LEVEL = Place(radians(-90.0), 100.0, 0.0)
"""Its housing ends 100 mm before the base of 10 mm: 110 mm from the axis, from -30 to 30 mm high."""
STANDS = in_room(LEVEL, 10.0)
NEAR = 0.85
"""mm: by so much, at most, the clearance that is told is less than the true one."""


def test_a_level_sensor_is_as_far_from_a_cylinder_as_it_stands():
    assert clearance(STANDS, SIZE, [Round(30.0, -5.0, 5.0)], Room()) == pytest.approx(80.0, abs=NEAR)
    assert clearance(STANDS, SIZE, [Round(200.0, -99.0, -50.0)], Room()) == pytest.approx(20.0, abs=NEAR)


def test_the_nearest_thing_counts():
    bodies = [Round(30.0, -5.0, 5.0), Round(90.0, 40.0, 50.0)]
    # (20, 10) mm from the nearest corner of the housing, its half width of 10 mm aside.
    assert clearance(STANDS, SIZE, bodies, Room()) == pytest.approx(np.hypot(20.0, 10.0), abs=NEAR)


@pytest.mark.parametrize(
    ("area", "distance"),
    [
        (KeepOut(radius=(200.0, 300.0)), 50.0),
        (KeepOut(height=(35.0, 99.0)), 5.0),
        (KeepOut(azimuth=(radians(170.0), radians(190.0))), 110.0),
        (KeepOut(azimuth=(radians(-10.0), radians(10.0))), 0.0),
        (KeepOut(azimuth=(radians(350.0), radians(370.0))), 0.0),
    ],
)
def test_keep_out_areas_are_stretches_of_a_ring(area, distance):
    found = clearance(STANDS, SIZE, [], Room(keep_out=(area,)))
    assert found == pytest.approx(distance, abs=NEAR)


def test_housings_meet_where_sensors_stand_at_the_same_azimuth():
    opposite = Place(LEVEL.phi, LEVEL.standoff, LEVEL.height, azimuth=pi)
    beside = Place(LEVEL.phi, LEVEL.standoff, LEVEL.height, azimuth=radians(90.0))
    assert apart(LEVEL, LEVEL, 10.0, (SIZE, SIZE)) == 0.0
    assert apart(LEVEL, opposite, 10.0, (SIZE, SIZE)) == pytest.approx(220.0, abs=NEAR)
    assert apart(LEVEL, beside, 10.0, (SIZE, SIZE)) == pytest.approx(np.hypot(100.0, 100.0), abs=NEAR)


@pytest.mark.parametrize("seed", range(12))
def test_the_clearance_that_is_told_is_never_more_than_there_is(seed):
    """Thin and thick bodies about the axis, against a housing of a million points."""
    rng = np.random.default_rng(seed)
    place = Place(
        -rng.uniform(0.6, 2.5), 100.0, rng.uniform(-40.0, 40.0), rng.uniform(-5.0, 5.0), rng.uniform(0.0, 6.0)
    )
    bottom = rng.uniform(-80.0, 60.0)
    body = Round(rng.uniform(1.0, 90.0), bottom, bottom + rng.choice([0.05, 2.0, 40.0]))
    pose, size = in_room(place, 10.0), (80.0, 30.0, 50.0)
    axes = [np.linspace(-40.0, 40.0, 160), np.linspace(-15.0, 15.0, 60), np.linspace(-50.0, 0.0, 100)]
    points = pose(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
    beyond = np.maximum(np.hypot(points[:, 0], points[:, 1]) - body.radius, 0.0)
    above = np.maximum(np.maximum(body.bottom - points[:, 2], points[:, 2] - body.top), 0.0)
    true = float(np.hypot(beyond, above).min())  # a millimetre's grid: up to half a diagonal too much
    told = clearance(pose, size, [body], Room())
    assert told <= true + 1e-9 and (told > true - 1.4 or told == 0.0)
