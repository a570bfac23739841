"""What run-out does to what a place shows: near the root of a small gear, some teeth are met steeper than others."""

from dataclasses import replace
from math import radians

import numpy as np

from gears import SPUR, calibrated
from truestand.gear.drawing import Gear
from truestand.planning.gear_target import gear_target
from truestand.planning.optics import optics_of
from truestand.planning.place import Place
from truestand.planning.room import Room
from truestand.planning.search import CAUSES, RUN_OUT, RUNNING_TRUE, Search
from truestand.planning.target import Mount, PlannedSensor, View
from truestand.planning.views import Setting, uncalibrated
from truestand.sim import paper_shaft, paper_stand

SMALL = Gear(32, 0.8, 8.0, 3.0, 28.1, 24.5, helix_angle=radians(15.0), accuracy_class=8)


def planned_sensor(limit: float, reach: tuple[float, float]) -> PlannedSensor:
    optics, _ = optics_of(replace(paper_stand().sensor, range=reach, incidence_limit=radians(limit)))
    return PlannedSensor("front", "front", optics)


def search(eccentricity: float) -> Search:
    setting = Setting(paper_stand(), paper_shaft(), eccentricity)
    target = gear_target(SMALL, uncalibrated(Place(-1.5, 65.0, 4.5), setting), (), 1.3, 4000.0)
    return Search(setting, target, Room(), (), np.zeros((len(CAUSES), len(target.surfaces.points))), 0, 0)


def test_a_place_must_show_the_teeth_that_run_out_brings_aside():
    """A plan was complete, and each gear inspected by it had teeth of which 12 % of a flank was not seen."""
    sensor = planned_sensor(85.0, (55.0, 75.0))
    one, other = (Mount(sensor, Place(radians(-102.5), 66.5, 4.5, offset), 0.0) for offset in (0.35, -0.35))
    run_out, true = search(0.8), search(0.0)
    seen = run_out.seen_from(one)
    assert seen.shape == (len(RUN_OUT), len(run_out.target.surfaces.points))
    assert min(run_out.target.surfaces.coverage(seen[RUNNING_TRUE]).values()) > 0.97
    assert true.missing(true.seen_from(one)) == 0.0 < run_out.missing(seen)
    assert run_out.missing(run_out.seen_from(other)) == 0.0


def test_cells_are_filled_as_run_out_shows_each_tooth():
    sensor = planned_sensor(85.0, (70.0, 120.0))
    known = calibrated(True)
    setting = Setting(known.stand, paper_shaft(), known.eccentricity)
    target = gear_target(SPUR, known, setting.shaft, 1.0, 1000.0)
    view = View(Mount(sensor, Place(-1.2, 105.0, 2.0), 10.0), None, known)  # type: ignore[arg-type]
    cells = target._cells([view])
    lowest = target._readings(view, cells).number[:, :, 0].any(axis=-1)
    assert lowest.any(axis=1).all() and not lowest.all(axis=1).any()
    left, right = lowest @ np.sin(SPUR.pitch * np.arange(SPUR.teeth))
    assert left * right < 0.0, "what helps the one flank of a tooth harms the other"
