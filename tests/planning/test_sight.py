"""What a place shows of a part, against what the virtual stand reads from there: another ray caster, without a grid."""

from dataclasses import replace
from functools import cache
from math import degrees, radians, tan

import numpy as np
import pytest

from gears import SPUR, helical
from truestand.apply.transfer import roll
from truestand.calibration.calibrate import calibrate
from truestand.core.scan import interpret
from truestand.gear.flanks import find_flanks, find_toothing
from truestand.gear.geometry import involute
from truestand.planning.gear_target import gear_target
from truestand.planning.optics import optics_of
from truestand.planning.place import Place
from truestand.planning.sight import CAUSES, look
from truestand.planning.views import Setting, shaft_in_view, shows_shaft, uncalibrated
from truestand.sim import GearErrors, Mounting, VirtualGear, paper_shaft, paper_simulation, paper_stand, simulate

FAN, LIMIT = radians(30.0), radians(82.0)
RANGE = (70.0, 120.0)
PLACES = {
    "from above": (helical(20.0), Place(radians(-115.0), 96.0, 12.0), 0.0),
    "from below": (helical(20.0), Place(radians(-70.0), 100.0, 6.0), 0.0),
    "beside the axis": (SPUR, Place(radians(-95.0), 105.0, 4.0, 2.0), 0.0),
    "camera on one side": (SPUR, Place(radians(-100.0), 105.0, 4.0, 1.0), radians(20.0)),
    "camera on the other": (helical(-20.0), Place(radians(100.0), 105.0, 4.0, -1.0), radians(20.0)),
}


@cache
def stand():
    base = paper_stand()
    sensor = replace(
        base.sensor,
        points=200,
        profile_rate=70.0,
        line=(2 * RANGE[0] * tan(FAN / 2), 2 * RANGE[1] * tan(FAN / 2)),
        incidence_limit=LIMIT,
    )
    return replace(base, counts_per_turn=36000, sensors=(sensor,))


def simulation(place, triangulation, profiles):
    base = paper_simulation()
    mounting = Mounting(place.phi, place.standoff, place.height, 0.0, place.plane_offset)
    return replace(
        base, mounting=mounting, workpiece=replace(base.workpiece, form=()),
        optics=replace(base.optics, fan=FAN, triangulation=triangulation, most_incidence=LIMIT, noise=0.002),
        acquisition=replace(base.acquisition, profiles=profiles, columns=("encoder",)),
    )  # fmt: skip


def read_from(place, gear, triangulation):
    """Readings (2, cells, cells) that the virtual stand has of the flanks of all teeth, on cells of their ranges."""
    seen = simulation(place, triangulation, 1600)
    recordings = (simulate(stand(), seen, paper_shaft(), 1, None, part).recording
                  for part in (None, VirtualGear(gear, GearErrors())))  # fmt: skip
    shaft, part = (interpret(recording, stand()) for recording in recordings)
    surface = roll(part, calibrate(shaft, paper_shaft()))
    target = gear_target(gear, surface.calibration, (), 1.0, 1000.0)
    flanks = find_flanks(surface, find_toothing(surface, involute(gear), target.toothing.datum))
    nominal = involute(gear)
    edges = [np.linspace(*r, 7) for r in (nominal.profile_range, nominal.helix_range)]
    return np.array([
        np.histogram2d(flanks.roll[on], flanks.height[on], edges)[0]
        for on in (flanks.flank < gear.teeth, flanks.flank >= gear.teeth)
    ])  # fmt: skip


@pytest.mark.more
@pytest.mark.parametrize("name", PLACES)
def test_flanks_are_seen_where_the_virtual_stand_reads_them(name):
    gear, place, triangulation = PLACES[name]
    optics, _ = optics_of(replace(stand().sensor, triangulation=triangulation or None))
    setting = Setting(stand(), paper_shaft(), 0.9)
    view = uncalibrated(place, setting)
    target = gear_target(gear, view, setting.shaft, 1.0, 1000.0)
    nominal = involute(gear)
    rolls, heights = (np.linspace(*r, 13)[1::2] for r in (nominal.profile_range, nominal.helix_range))
    side, i, j = np.indices((2, 6, 6)).reshape(3, -1)
    points = target.toothing.points((side, np.zeros_like(side)), rolls[i], heights[j], np.zeros(side.size))
    normals = target.toothing.gradient(points, np.array([1.0, -1.0])[side])
    seen = look(points, normals, view, optics, (*target.bodies, *setting.shaft)).seen.reshape(2, 6, 6)
    read = read_from(place, gear, triangulation)
    often = read > 0.1 * np.median(read[read > 0])
    assert 0.2 < seen.mean() < 1.0 or name == "beside the axis"
    # Cells through which the edge of what is seen goes. The virtual camera sees its spot at up to 90 degrees.
    assert (seen & ~often).mean() < 0.08 and (often & ~seen).mean() < (0.15 if triangulation else 0.08)


def test_each_cause_is_named():
    setting = Setting(stand(), paper_shaft(), 0.9)
    optics, _ = optics_of(stand().sensor)
    view = uncalibrated(Place(radians(-90.0), 95.0, -20.0), setting)
    points = np.array([[12.5, 0, -20.0], [40.0, 0, -20.0], [12.5, 0, -55.0], [12.5, 0, -21.0], [7.0, 0, -20.0]])
    normals = np.array([[1.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0], [0.0, 0, 1.0], [1.0, 0, 0]])
    sight = look(points, normals, view, optics, setting.shaft)
    causes = ["" if seen else CAUSES[int(np.argmax([h[k] for h in sight.hidden]))] for k, seen in enumerate(sight.seen)]
    assert causes == ["", CAUSES[0], CAUSES[1], CAUSES[2], CAUSES[3]]
    assert degrees(np.arccos(sight.facing[0])) == pytest.approx(0.0, abs=0.01)


def test_the_cameras_view_is_hidden_where_the_lasers_is_not():
    setting = Setting(stand(), paper_shaft(), 0.9)
    sideways, _ = optics_of(replace(stand().sensor, triangulation=radians(30.0), incidence_limit=radians(89.0)))
    view = uncalibrated(Place(radians(-90.0), 95.0, 20.0), setting)
    target = gear_target(SPUR, view, setting.shaft, 1.0, 1000.0)
    surfaces = target.surfaces
    seen = {name: look(surfaces.points, surfaces.normals, view, optics, target.bodies).seen
            for name, optics in (("laser", optics_of(stand().sensor)[0]), ("camera", sideways))}  # fmt: skip
    left, right = (surfaces.coverage(seen["camera"])[name] for name in ("left", "right"))
    assert min(left, right) == 0.0 < max(left, right)


def test_the_shaft_is_in_view_as_far_as_line_and_range_reach():
    setting = Setting(stand(), paper_shaft(), 0.9)
    optics, _ = optics_of(stand().sensor)
    base, bearing = shaft_in_view(uncalibrated(Place(radians(-90.0), 95.0, 0.0), setting), optics, setting.shaft)
    # Half of the line at the base's 95 mm, and at the 100.5 mm of the bearing; half a millimetre at each end.
    assert np.ptp(base) == pytest.approx(95.0 * tan(FAN / 2) - 1.0, abs=0.6)
    assert np.ptp(bearing) == pytest.approx(100.5 * tan(FAN / 2) - 1.0, abs=0.6)
    assert shows_shaft((base, bearing), setting.shaft)


def test_a_shaft_whose_shoulder_is_hidden_is_not_shown():
    """From below the base hides 2 mm of the bearing: a shaft that stands so much higher looks the same."""
    setting = Setting(stand(), paper_shaft(), 0.9)
    optics, _ = optics_of(stand().sensor)
    base, bearing = shaft_in_view(uncalibrated(Place(radians(-67.0), 95.0, 10.0), setting), optics, setting.shaft)
    assert base[-1] > -1.5 and bearing[0] >= 2.0 and min(np.ptp(base), np.ptp(bearing)) > 5.0
    assert not shows_shaft((base, bearing), setting.shaft)
