"""A plan as a whole, over few places: what it promises, says and writes."""

import json
from dataclasses import replace
from functools import cache
from math import degrees, radians, tan

import jsonschema
import numpy as np
import pytest

from gears import FANS, SPUR, WORN, calibrated, helical, scan_of, simulation
from truestand.apply.transfer import roll
from truestand.core.errors import BadRecipe
from truestand.core.inspection import Characteristic
from truestand.devices.positioner import read_carrier
from truestand.files.recipes.plan import planned_stand, read_task
from truestand.files.recipes.recipes import read_simulation, read_stand, write_starters
from truestand.files.records.plan_record import plan_record
from truestand.files.records.schemas import schema_text
from truestand.gear.geometry import involute
from truestand.gear.grid import Grid, centres_of
from truestand.gear.inspect import inspect_gear
from truestand.parts.drawings import Section, Turned
from truestand.planning import carried, places, search
from truestand.planning.cast_target import turned_target
from truestand.planning.gear_target import PARTS, _in_parts, gear_target, profiles_met
from truestand.planning.optics import optics_of
from truestand.planning.place import Place
from truestand.planning.plan import Task, _expected, plan
from truestand.planning.room import Room
from truestand.planning.target import Mount, PlannedSensor, View
from truestand.planning.views import Setting, views_at
from truestand.report.plan import plan_report
from truestand.report.plan_tables import figures_of, price
from truestand.sim import paper_shaft, paper_stand
from truestand.sim.recipe import simulation_from
from truestand.station.recipe import read_devices, stops_of
from truestand.station.route import route_of

SLEEVE = Turned((
    Section("wide", 5.0, 15.0, 30.0, (29.9, 30.1), 0.02), Section("narrow", 15.0, 20.0, 26.0, (25.9, 26.1)),
))  # fmt: skip
TOLD = {"s": 0.05, "W_k": 0.05, "M_d": 0.05, "d_a": 0.1, "d_f": 0.1, "f_Halpha": 0.1, "f_p": 0.4, "F_p": 0.5}
"""By what share U may differ: that of pitch depends on which teeth are off most, and a plan doesn't know them."""
FEW = {"ANGLES": np.radians([70.0, 110.0]), "STANDOFFS": 3, "HEIGHTS": 3, "OFFSETS": (0.0, 0.2), "NEXT": ()}


def stand(**sensor):
    base = paper_stand()
    return replace(base, counts_per_turn=36000, sensors=(replace(base.sensor, **sensor),))


@pytest.fixture
def few_places(monkeypatch):
    for name, value in FEW.items():
        monkeypatch.setattr(places, name, value)
    monkeypatch.setattr(search, "POOL", 6)
    monkeypatch.setattr(carried, "TRIED", (7, 7, 3, 3))


@pytest.mark.parametrize(
    ("sensor", "found"),
    [({"range": None}, "no range_mm"), ({"range": (-70.0, 120.0)}, "range_mm = "), ({"points": 1}, "points = 1")],
)
def test_a_sensor_of_which_no_plan_can_be_made_is_refused(sensor, found):
    with pytest.raises(BadRecipe, match=rf"\[\[sensor\]\] 'front': found {found}"):
        plan(SPUR, stand(**sensor), paper_shaft())


def test_a_table_above_the_part_is_refused():
    with pytest.raises(BadRecipe, match="found table_face_mm = 50, need 5 or less"):
        plan(SPUR, stand(), paper_shaft(), Task(room=Room(table_face=50.0)))


def test_what_nothing_can_see_is_said_with_the_reason(few_places):
    found = plan(SPUR, stand(incidence_limit=radians(40.0)), paper_shaft())
    assert not found.views and not found.complete
    assert found.unseen == ("no place sees anything of the part: too steep",)
    touching = plan(SPUR, stand(range=(8.0, 20.0)), paper_shaft())
    assert "housing would touch" in touching.unseen[0]
    record = plan_record(found, "2026-11-26T00:00:00Z")
    jsonschema.validate(record, json.loads(schema_text("plan")))
    assert "Not everything is seen" in plan_report(found)


@pytest.mark.slow
def test_a_sleeve_is_planned_with_one_view(few_places, tmp_path):
    shares = []
    found = plan(SLEEVE, stand(), paper_shaft(), step=shares.append)
    assert found.complete and len(found.views) == 1 and found.coverage == {"wide": 1.0, "narrow": 1.0}
    assert shares[-1] == 1.0 and shares == sorted(shares)
    record = plan_record(found, "2026-11-26T00:00:00Z")
    jsonschema.validate(record, json.loads(schema_text("plan")))
    assert {c["section"] for c in record["characteristics"]} == {"wide", "narrow"}
    page = plan_report(found)
    assert "One view will do" in page and "What was assumed" in page


def test_u_of_a_characteristic_is_that_of_a_tooth_and_its_share_of_the_worst():
    """U of every tooth scatters: the largest of 24 was half as much again as what errors bear out."""
    limits = (None, 0.012)
    teeth = tuple(
        Characteristic("f_falpha", 0.002, U, "left", tooth, limits=limits) for tooth, U in ((1, 0.003), (2, 0.004))
    )
    mean = Characteristic("f_falpha", 0.002, 0.001, "left", limits=limits)
    alone = Characteristic("F_p", 0.01, 0.006, "left")
    f_falpha, F_p = _expected((*teeth, mean, alone), {})
    assert pytest.approx(0.005 / 2**0.5) == f_falpha.U and f_falpha.largest == 0.004
    assert f_falpha.share == pytest.approx(0.004 / 0.012)
    assert (F_p.U, F_p.largest, F_p.share) == (pytest.approx(0.006), None, None)
    assert tuple(figures_of([F_p])) == ("U (k = 2)", "limit", "of the limits")
    assert [text(f_falpha) for text in figures_of([F_p, f_falpha]).values()] == ["3.5 µm", "4.0 µm", "12 µm", "33 %"]


def test_what_a_range_that_errs_leaves_of_a_calibration_is_noise():
    """U of the laser plane's tilt was promised with 0.022 degrees where calibrations of sixteen stands had 0.028."""
    noise = {}
    for linearity in (0.0, 0.02):
        line = tuple(2 * z * tan(radians(15.0)) for z in (70.0, 120.0))
        known = stand(linearity_U=linearity, noise=0.005, points=320, line=line)
        mount = Mount(
            PlannedSensor("front", "front", optics_of(known.sensor)[0]), Place(radians(-77.0), 109.0, 19.0), 10.0
        )
        setting = Setting(known, paper_shaft(), 1.0, profiles=4000)
        (view,) = views_at((mount,), setting, turned_target(SLEEVE, setting.shaft, 1.0, 2.0, 2000.0))
        tilt = view.calibration.uncertainty["laser_plane_tilt_deg"]
        noise[linearity] = next(line.U for line in tilt.contributions if line.name == "noise")
    assert noise[0.02] > 1.5 * noise[0.0]


@pytest.mark.more
def test_a_camera_that_hides_one_side_asks_for_two_views(few_places):
    found = plan(SPUR, stand(triangulation=radians(20.0)), paper_shaft(), Task(most_views=2))
    first, second = found.views
    assert first.mount.place.phi * second.mount.place.phi < 0  # their cameras are on either side
    assert first.mount.place.azimuth != second.mount.place.azimuth
    assert min(found.coverage.values()) > 0.9 and found.fewer is not None
    assert found.rank > found.fewer.rank
    assert any(e.status != "measured" for e in found.fewer.asked)
    assert "With one view, these are not measured" in plan_report(found)


@pytest.mark.more
def test_a_further_view_is_worth_it_where_flanks_are_seen_in_part_only(few_places):
    """No place sees the last of either flank: one view was planned, and one side was not measurable."""
    found = plan(SPUR, stand(triangulation=radians(20.0), incidence_limit=radians(80.0)), paper_shaft())
    assert found.hidden_flanks == 2 and len(found.views) == 2
    assert {e.status for e in found.asked} == {"partial"}
    (sentence,) = price(found)
    assert sentence.startswith("With one view, these are not measured: ") and "F_r" in sentence


@pytest.mark.more
def test_the_stand_of_a_plan_is_one_that_the_virtual_stand_scans_from(few_places, tmp_path):
    write_starters(tmp_path)
    recipe = tmp_path / "stand.toml"
    known = read_stand(recipe)
    found = plan(SLEEVE, known, paper_shaft(), read_task(recipe), views=2)
    text = planned_stand(recipe.read_text(), found)
    recipe.write_text(text)
    again = read_stand(recipe)
    assert [s.name for s in again.sensors] == ["front", "front-2"]
    assert [s.device for s in again.sensors] == [None, "front"]
    assert again.table == known.table and again.sensors[0].linearity_U == known.sensor.linearity_U
    places = [v.mount.place for v in found.views]
    virtual = dict(simulation_from(read_simulation(recipe)).views)
    for place, (name, mounting) in zip(places, virtual.items(), strict=True):
        assert degrees(mounting.phi) == pytest.approx(degrees(place.phi), abs=1e-3), name
        assert mounting.standoff == pytest.approx(place.standoff, abs=1e-3)
        assert mounting.plane_offset == pytest.approx(place.plane_offset, abs=1e-3)
    real = recipe.read_text().split("[simulation]")[0]
    assert planned_stand(real, found).count("[[simulation.view]]") == 2, "a stand that says nothing of a virtual one"


@pytest.mark.more
def test_the_virtual_stand_of_a_plan_has_the_sensor_that_was_planned(few_places, tmp_path):
    """It had the places only: another sensor than the starter's was planned and the starter's scanned from there."""
    write_starters(tmp_path)
    recipe = tmp_path / "stand.toml"
    text = recipe.read_text().replace("mirrored = false", "line_mm = [28.0, 48.0]\nnoise_um = 2.0", 1)
    text += "\n[plan]\neccentricity_mm = 0.5\n"
    found = plan(SLEEVE, *planned_from(recipe, text))
    simulated = simulated_by(recipe, planned_stand(text, found))
    assert simulated.optics.fan == pytest.approx(2 * np.arctan(38.0 / 2 / 95.0), abs=1e-6)
    assert (simulated.optics.noise, simulated.running.eccentricity) == pytest.approx((0.002, 0.5))
    assert degrees(simulated.optics.most_incidence) == 85.0, "assumed, where [simulation] says nothing of it"
    assert simulated.acquisition.profiles == 11000, "stated, where [plan] says nothing of it"
    dirty = text.split("[simulation]")[0] + "[[simulation.dirt]]\nsurface = 'base'\nshare = 0.01\nheight_um = 9.0\n"
    simulated = simulated_by(recipe, planned_stand(dirty, found))
    assert simulated.acquisition.profiles == found.setting.profiles and simulated.workpiece.patches


def planned_from(recipe, text):
    recipe.write_text(text)
    return read_stand(recipe), paper_shaft(), read_task(recipe)


def simulated_by(recipe, text):
    recipe.write_text(text)
    return simulation_from(read_simulation(recipe))


POSITIONER = """
[devices.positioner]
position_U_um = 4.0
position_U_deg = 0.002
at_zero = { phi_deg = -90.0, radial_mm = 120.5, height_mm = -15.0 }
swept = [
  { radius_mm = 99.0, from_mm = -60.0, to_mm = 0.0 },
]
[[devices.positioner.axis]]
name = "lift"
direction = [0, 0, 1]
range_mm = [0, 80]
protocol = "zaber"
address = "127.0.0.1:5021"
[[devices.positioner.axis]]
name = "swivel"
kind = "rotary"
direction = [0, 1, 0]
through_mm = [12.5, 0, -15]
range_deg = [-30, 30]
protocol = "modbus"
address = "127.0.0.1:5022"
"""


@pytest.mark.more
def test_a_plan_with_a_positioner_takes_places_that_it_reaches(few_places, tmp_path):
    write_starters(tmp_path)
    recipe = tmp_path / "stand.toml"
    recipe.write_text(recipe.read_text() + POSITIONER)
    known = read_stand(recipe)
    carrier = read_carrier(recipe, known)
    found = plan(SLEEVE, known, paper_shaft(), replace(read_task(recipe), carrier=carrier), views=2)
    for view in found.views:
        mount = view.mount
        assert carrier.kinematics.place(mount.position, paper_shaft().base.radius) == mount.place
        assert view.scan.stand.sensor.position_U == pytest.approx(0.004)
    record = plan_record(found, "2026-11-26T00:00:00Z")
    jsonschema.validate(record, json.loads(schema_text("plan")))
    assert [set(v["position"]) for v in record["views"]] == [{"lift_mm", "swivel_deg"}] * 2
    assert f"lift {record['views'][0]['position']['lift_mm']:.1f} mm" in plan_report(found)
    recipe.write_text(planned_stand(recipe.read_text(), found))
    stand_again, devices = read_devices(recipe)
    stops = stops_of(stand_again, devices)
    assert [stop.position for stop in stops] == [pytest.approx(v.mount.position, abs=1e-6) for v in found.views]
    swept = [body.radius for body in devices.positioner.bodies]
    assert swept == [pytest.approx(r + found.setting.eccentricity) for r in (12.5, 6.97, 15.0, 13.0)]
    assert route_of(recipe, stand_again, devices, stops) is not None


def test_the_room_is_read_and_unknown_keys_are_refused(tmp_path):
    recipe = tmp_path / "stand.toml"
    write_starters(tmp_path)
    text = recipe.read_text()
    recipe.write_text(text + "\n[plan]\neccentricity_mm = 1.5\ntable_disc_mm = 150.0\n[[plan.keep_out]]\n"
                      "azimuth_deg = [80.0, 100.0]\n")  # fmt: skip
    task = read_task(recipe)
    assert task.eccentricity == 1.5 and task.room.table_radius == 75.0
    assert task.room.keep_out[0].azimuth == pytest.approx((radians(80.0), radians(100.0)))
    recipe.write_text(text + "\n[plan]\ntable_disk_mm = 150.0\n")
    with pytest.raises(BadRecipe, match="table_disc_mm"):
        read_task(recipe)
    recipe.write_text(text + "\n[plan]\n[[plan.keep_out]]\nradius_mm = [9.0, 3.0]\n")
    with pytest.raises(BadRecipe, match=r"radius_mm: found \[9.0, 3.0\], need \[from, to\]"):
        read_task(recipe)


@cache
def inspected(gear):
    """A gear as the virtual stand shows it, and as a plan would have it from the same place."""
    surface = roll(scan_of(gear, WORN, simulation(4400, True), 240), calibrated(True))
    target, view = planned_as(gear, *surface.origin)
    return inspect_gear(surface, gear), target.lines([view])


def planned_as(gear, scan, known):
    """A gear as a plan has it, and a view from the place of a scan."""
    line = tuple(2 * z * tan(FANS[True] / 2) for z in (70.0, 120.0))
    optics, _ = optics_of(replace(scan.stand.sensor, line=line, noise=0.005, incidence_limit=radians(88.0)))
    shaft = Setting(scan.stand, paper_shaft(), 0.88).shaft
    target = gear_target(gear, known, shaft, scan.revolutions, 2 * np.pi / abs(scan.step))
    view = View(Mount(PlannedSensor("front", "front", optics), Place(-1.2, 105.0, 2.0), 10.0), scan, known)
    return target, view


@pytest.mark.more
@pytest.mark.parametrize("gear", [SPUR, helical(20.0)], ids=["spur", "helical"])
def test_u_is_as_an_inspection_has_it(gear):
    found, expected = inspected(gear)
    told = {(c.name, c.flank, c.tooth): c for c in expected}
    for c in found.characteristics:
        other = told.get((c.name, c.flank, c.tooth))
        if other is None or c.U is None or c.name.endswith(("_areal", "_worst")):
            continue
        assert other.status == c.status or {other.status, c.status} == {"measured", "partial"}, c
        if c.name in TOLD and c.status == "measured":
            # Where profiles happen to cross a single tooth, so much of its range is seen.
            rel = TOLD[c.name] * (1.0 if c.tooth is None else 1.5)
            assert pytest.approx(c.U, rel=rel) == other.U, (c.name, c.flank, c.tooth)


@pytest.mark.parametrize("gear", [SPUR, helical(20.0)], ids=["spur", "helical"])
def test_turns_of_whole_profiles_meet_flanks_at_the_same_places(gear):
    """A plan took them to lie one between the other."""
    nominal, empty = involute(gear), np.zeros((2, gear.teeth, 60, 12))
    rolls, edges = centres_of(nominal.control_roll, nominal.tip_roll, 60), np.linspace(*nominal.helix_range, 13)
    grid = Grid(nominal, empty, empty, empty, empty, empty, rolls, edges, 0.001)

    def met(turns, per_turn):
        return profiles_met(grid, grid.heights, turns, per_turn, 0.38, 0.0)[0]

    one, two, between = met(1.0, 1000.0), met(2.0, 1000.0), met(2.0, 1000.5)
    assert (two == 2 * one).all() and 0.1 < (one > 0).mean() < 0.2
    assert between.sum() == pytest.approx(two.sum(), rel=0.01)
    assert (between > 0).mean() > 1.5 * (two > 0).mean()
    along_the_face = (one == one[..., :1]).all(axis=(0, 1, 3))
    assert along_the_face.all() == (gear is SPUR), "a profile crosses helical flanks at an angle"


def test_a_profile_has_whole_readings_in_parts_of_cells():
    """A helical flank's rows of cells each had all of a profile's readings, or none."""
    number = np.full((2, 1, 3, 10), 1.6)
    parts = _in_parts(number, 0.4)
    assert parts.shape == (PARTS, *number.shape) and set(np.unique(parts)) == {0.0, 1.0}
    assert parts.sum(axis=(0, 4)) == pytest.approx(16.0)
    assert (parts.sum(axis=0) < 3).all()


def test_cells_count_the_views_whose_profiles_meet_them():
    """Every cell had the same share of each view: what these still read otherwise made no form."""
    target, view = planned_as(SPUR, scan_of(SPUR, WORN, simulation(1100, True), 60), calibrated(True))
    aside = replace(view, mount=replace(view.mount, place=replace(view.mount.place, azimuth=0.1)))
    cells = target._cells([view, aside])
    readings = [target._readings(v, cells) for v in (view, aside)]
    read = target._read(target._grid(cells, readings), [view, aside], readings, np.random.default_rng(0))
    first, second = read.shares
    assert first + second == pytest.approx(1.0)
    shown = first[read.count > 0]
    assert min((shown == 1.0).mean(), (shown == 0.0).mean()) > 0.1, "one view alone meets many of them"


def test_a_room_that_leaves_no_place_says_so(few_places):
    found = plan(SPUR, stand(), paper_shaft(), Task(Room(least_clearance=500.0)))
    assert not found.views and "housing would touch" in found.unseen[0]
