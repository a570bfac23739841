"""Scans of one part by two sensors in one cloud."""

from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from math import cos, pi, sin

import numpy as np
import pytest

from gears import SPUR, STEEP, WORN, simulation
from truestand.apply.datum import datum_of
from truestand.apply.transfer import roll
from truestand.apply.verify import NOT_COMPARED, SENSOR_MOVED, VIEWS_TURNED, verify_views
from truestand.apply.views import roll_views
from truestand.calibration.calibrate import calibrate
from truestand.calibration.views import calibrate_views
from truestand.core.errors import BadRecipe
from truestand.core.frames import Pose, shaft_from_rotor, shaft_parameters
from truestand.core.message import UNTIED, Message
from truestand.core.scan import interpret
from truestand.files.records.calibration_record import write_calibration
from truestand.files.shapes.clouds import Cloud, open_cloud, write_clouds
from truestand.gear.flanks import find_toothing
from truestand.gear.geometry import involute
from truestand.parts.inspect import demand_right_views, inspect
from truestand.sim import Misalignment, VirtualGear, paper_shaft, simulate
from truestand.station.pipeline import Inputs, Outputs, inspect_job
from views import AZIMUTH, two_sensors

UM = 1e-3
MOUNTING = replace(simulation().mounting, **STEEP)
REAR = replace(MOUNTING, plane_offset=-0.2, azimuth=AZIMUTH)
STAND = two_sensors()
GEAR = VirtualGear(SPUR, WORN)
LARGEST_SEEN = max(c.radius for c in paper_shaft().cylinders)


@cache
def scans(part=None, columns=("angle",), start_angle=0.0, profiles=1100, off_coaxial=0.0, seed=2, turned=0.0):
    """Both views of the shaft, or of a gear on it; 1.1 turns at 1,000 profiles each. One step ``off_coaxial`` (mm), the
    second view ``turned`` (rad) about the axis.
    """
    base = simulation(profiles)
    base = replace(base, workpiece=replace(base.workpiece, misalignments=(Misalignment("bearing", off_coaxial),)))
    acquisition = replace(base.acquisition, columns=columns, start_angle=start_angle)
    rear = replace(REAR, azimuth=REAR.azimuth + turned)
    both = replace(base, acquisition=acquisition, views=(("front", MOUNTING), ("rear", rear)))
    return tuple(
        interpret(
            simulate(STAND.of_view(v), both.seen_from(v), paper_shaft(), seed, None, part).recording, STAND, view=v
        )
        for v in ("front", "rear")
    )


@cache
def calibrated():
    return calibrate_views(scans(), paper_shaft())


def first_teeth(surfaces):
    """Where each view has the first tooth: mm along the measuring circle, and its flanks' offsets (2 teeth,) mm."""
    nominal = involute(SPUR)
    found = [find_toothing(s, nominal, datum_of(calibrated(), SPUR.datum, SPUR.bore_clearance)) for s in surfaces]
    return [t.first_tooth * nominal.measuring_radius for t in found], [t.offsets for t in found]


def test_both_views_have_the_flanks_at_the_same_places():
    surfaces = roll_views(scans(GEAR), calibrated())
    places, offsets = first_teeth(surfaces)
    U = calibrated().of_view("rear").uncertainty["azimuth_deg"].U * pi / 180 * involute(SPUR).measuring_radius
    assert abs(places[0] - places[1]) < U < 0.05
    both = np.isfinite(offsets[0]) & np.isfinite(offsets[1])
    assert both.sum() > 40 and np.std((offsets[0] - offsets[1])[both]) < 5 * UM


def test_each_surface_knows_its_view_and_why_nothing_may_be_decided():
    surfaces = roll_views(scans(GEAR), calibrated())
    assert [s.calibration.name for s in surfaces] == ["front", "rear"]
    assert all(s.calibration.status == "valid" for s in surfaces)
    why = Message("azimuth_unknown", "nobody knows")
    doubted = roll_views(scans(GEAR), replace(calibrated(), reasons=(UNTIED, why)))
    assert all(s.calibration.reasons == (why,) for s in doubted)  # each scan has an angle that its own view ties


@pytest.mark.slow
def test_a_view_is_inspected_in_the_frame_of_the_first_as_in_its_own():
    """But for the numbers of its teeth; U of a calibration is what moves points, whichever way they are turned."""
    placed, own = (
        inspect(s, SPUR) for s in (roll_views(scans(GEAR), calibrated())[1], roll(scans(GEAR)[1], calibrated()))
    )
    for a in own.characteristics:
        if a.tooth is None and a.value is not None:
            b = next(b for b in placed.characteristics if (b.name, b.flank, b.tooth) == (a.name, a.flank, None))
            assert b.value == pytest.approx(a.value, abs=0.5 * UM)
            assert abs(b.U - a.U) < 0.15 * a.U + 0.3 * UM


def test_the_same_view_twice_is_refused():
    front, _ = scans(GEAR)
    with pytest.raises(BadRecipe, match="found scans of the views front, front"):
        roll_views((front, front), calibrated())


def test_the_cloud_tells_the_view_of_each_point(tmp_path):
    surfaces = roll_views(scans(GEAR), calibrated())
    clouds = [Cloud(s.x, s.y, s.z, view=s.calibration.name) for s in surfaces]
    count = write_clouds(tmp_path / "both.ply", clouds)
    points = open_cloud(tmp_path / "both.ply")
    seen = [int(np.count_nonzero(c.seen)) for c in clouds]
    assert points.size == count == sum(seen) and points.dtype["view"] == np.uint8
    assert np.bincount(points["view"]).tolist() == seen
    assert b"comment view 1 rear" in (tmp_path / "both.ply").read_bytes()[:400]
    write_clouds(tmp_path / "both.npz", clouds)
    with np.load(tmp_path / "both.npz") as data:
        assert np.bincount(data["view"]).tolist() == seen
    write_clouds(tmp_path / "one.ply", clouds[:1])
    assert "view" not in open_cloud(tmp_path / "one.ply").dtype.names


def test_a_view_that_moved_is_named_and_the_others_hold():
    known = calibrated()
    found = verify_views(scans(), known, paper_shaft(), 0.1)
    assert found.verdict == "holds" and {c.view for c in found.changes} == {"front", "rear"} and len(found.scans) == 2
    rear = known.of_view("rear")
    out = Pose(rear.table_from_sensor.rotation, rear.table_from_sensor.translation + np.array([0.3, 0.0, 0.0]))
    first, other = known.views
    moved = verify_views(
        scans(), replace(known, views=(first, replace(other, table_from_sensor=out))), paper_shaft(), 0.1
    )
    assert moved.verdict == "does_not_hold"
    assert {c.view for c in moved.changes if c.verdict == "does_not_hold"} == {"rear"}
    assert [str(r) for r in moved.reasons] == [f"view 'rear': sensor, radially: {SENSOR_MOVED}"]
    with pytest.raises(BadRecipe, match="need another view for each"):
        verify_views((scans()[0], scans()[0]), known, paper_shaft())


def test_views_are_verified_as_they_were_calibrated():
    """A step off coaxial is read otherwise by one view than by both: sound stands *did not hold*, on the very scans
    that they had been calibrated by (an outsider's: 44 and 76 um sideways).
    """
    first, again = (scans(off_coaxial=8 * UM, seed=seed) for seed in (2, 3))
    known = calibrate_views(first, paper_shaft())
    same, new, alone = (verify_views(now, known, paper_shaft(), 0.06) for now in (first, again, again[:1]))
    assert max(c.value for c in same.changes) < 0.01 * UM
    assert new.verdict == "holds" and all(c.value < c.U for c in new.changes)
    sideways, by_one = (
        next(c for c in found.changes if c.code == "sensor_moved_sideways" and c.view in ("front", None))
        for found in (new, alone)
    )
    assert sideways.value < by_one.value < by_one.U and by_one.U > sideways.U
    near = verify_views(again[:1], known, paper_shaft(), 0.02)
    assert near.verdict == "undecided" and "by every view of the calibration" in str(near.reasons[0])


def test_a_view_that_has_turned_about_the_axis_is_told():
    """Its own scan shows a turn as eccentricity times angle (some um): it was said to hold (an outsider's, 8 mrad)."""
    known = calibrated()
    now = scans(seed=3), scans(seed=3, turned=0.008)[::-1]  # in any order
    sound, moved = (verify_views(taken, known, paper_shaft(), 0.06) for taken in now)
    for found, turned in ((sound, 0.0), (moved, 0.008)):
        (about,) = (c for c in found.changes if c.code == "sensor_moved_about")
        assert about.view == "rear" and 0 < about.U < 0.03
        assert about.value == pytest.approx(turned * LARGEST_SEEN, abs=about.U)
        for shaft in (c for c in found.changes if c.code == "shaft_moved"):
            assert shaft.value < shaft.U < 4 * UM, shaft  # it stood still; the rear sees it 7 um elsewhere
    assert sound.verdict == "holds" and moved.verdict == "does_not_hold"
    assert [str(r) for r in moved.reasons] == [f"view 'rear': sensor, about the axis: {VIEWS_TURNED}"]


def test_of_one_sensor_of_two_only_its_own_scan_is_verified():
    """The rear one was 19.5 mm from where the front stands, and *had moved* (an outsider's)."""
    front, rear = scans(seed=3)
    alone = calibrate(front, paper_shaft())
    assert verify_views((front,), alone, paper_shaft(), 0.06).verdict == "holds"
    with pytest.raises(BadRecipe, match="a scan of view 'rear', the calibration has 'front'"):
        verify_views((rear,), alone, paper_shaft(), 0.06)


@pytest.mark.parametrize("left_out", ["uncertainty", "repeatability", "azimuth_repeats", "harmonics"])
def test_a_record_that_tells_less_is_verified(left_out):
    """Its U of the azimuth was looked up without being there (an outsider's crash)."""
    known = calibrated()
    empty = {"uncertainty": {}, "repeatability": np.zeros((0, 0)), "azimuth_repeats": None, "harmonics": ()}
    cut = tuple(replace(view, **{left_out: empty[left_out]}) for view in known.views)
    found = verify_views(scans(seed=3), replace(known, views=cut), paper_shaft(), 0.06)
    assert found.verdict == "holds" and {c.view for c in found.changes} == {"front", "rear"}


def test_of_two_views_the_first_may_have_turned():
    """The other sees the shaft where it was: the shaft *did not hold* for the first (an outsider's, 12 mrad)."""
    known = calibrated()
    front, rear = known.views
    ex, ey, tx, ty = shaft_parameters(front.shaft_from_rotor)
    (ex, tx), (ey, ty) = np.array([[cos(0.02), -sin(0.02)], [sin(0.02), cos(0.02)]]) @ [[ex, tx], [ey, ty]]
    before = (
        replace(front, shaft_from_rotor=shaft_from_rotor(ex, ey, tx, ty)),
        replace(rear, azimuth=rear.azimuth + 0.02),
    )
    found = verify_views(scans(seed=3), replace(known, views=before), paper_shaft(), 0.06)
    assert {(c.view, c.code) for c in found.changes if c.verdict != "holds"} == {("rear", "sensor_moved_about")}
    assert all(c.value < c.U < 4 * UM for c in found.changes if c.code == "shaft_moved")


def test_views_that_are_not_compared_about_the_axis_are_undecided():
    """Two of three: each is judged by its own scan, which shows no turn."""
    known = calibrated()
    _, rear = known.views
    far = Pose(rear.table_from_sensor.rotation, rear.table_from_sensor.translation + np.array([9.0, 0.0, 0.0]))
    top = replace(rear, stand=two_sensors().of_view("rear"), table_from_sensor=far)
    top = replace(top, stand=replace(top.stand, sensors=(replace(top.stand.sensor, name="top"),)))
    found = verify_views(scans(seed=3), replace(known, views=(*known.views, top)), paper_shaft(), 0.06)
    assert found.by == "calibration" and {c.verdict for c in found.changes} == {"holds"}
    assert found.verdict == "undecided" and found.reasons == (NOT_COMPARED,)


def test_nothing_is_no_part():
    with pytest.raises(BadRecipe, match="found no surface"):
        inspect([], SPUR)


def given_to_the_other(part=None):
    """The scans of both, each called that of the other."""
    front, rear = scans(part)
    return replace(front, stand=STAND.of_view("rear")), replace(rear, stand=STAND.of_view("front"))


def without_shaft(scan):
    """The scan without what shows the shaft beside the gear."""
    surface = roll(scan, calibrated())
    return replace(scan, z=np.where(np.hypot(surface.x, surface.y) > 20.0, scan.z, np.nan))


@pytest.mark.parametrize("part", [None, GEAR], ids=["shaft", "gear"])
def test_a_scan_given_to_the_wrong_view_is_refused_with_the_name_of_the_right_one(part):
    """The sensors stand alike but for their azimuth: the direction of the shaft's axis tells them apart."""
    wrong = given_to_the_other(part)
    for act in (lambda: roll(wrong[0], calibrated()), lambda: verify_views(wrong, calibrated(), paper_shaft())):
        with pytest.raises(BadRecipe, match="a scan of view 'rear' that fits where 'front' stands"):
            act()


def test_a_view_that_moved_is_not_taken_for_another():
    first, rear = calibrated().views
    moved = replace(rear, table_from_sensor=rear.table_from_sensor @ Pose(np.eye(3), np.array([0.0, 0.0, 0.5])))
    assert roll(scans(GEAR)[1], replace(calibrated(), views=(first, moved))).calibration.reasons


@pytest.mark.more
def test_a_scan_given_to_the_wrong_view_that_shows_no_shaft_is_found_by_the_part():
    front, _ = scans(GEAR)
    front = without_shaft(front)
    demand_right_views((front,), calibrated(), SPUR, False)
    with pytest.raises(BadRecipe, match="a scan of view 'rear' that fits where 'front' stands"):
        demand_right_views((replace(front, stand=STAND.of_view("rear")),), calibrated(), SPUR, False)


def test_one_scan_given_for_two_views_is_refused():
    front = roll(replace(scans(GEAR)[0], sha256="1" * 64), calibrated())
    with pytest.raises(BadRecipe, match="the same scan twice, need one scan of each view"):
        inspect((front, front), SPUR)


@pytest.mark.more
def test_a_scan_of_another_gear_is_given_to_no_other_view():
    """Rolled up as another view's it was untrusted, and yet that view was named the right one."""
    other = replace(SPUR, teeth=17, module=2.5, profile_shift=0.3, tip_diameter=49.0, root_diameter=37.75)
    demand_right_views(scans(VirtualGear(other)), calibrated(), SPUR, False)


@pytest.mark.more
def test_an_inspection_names_the_right_view(tmp_path):
    front, _ = scans(GEAR)
    wrong = replace(without_shaft(front), stand=STAND.of_view("rear"))
    write_calibration(tmp_path / "calibration.json", calibrated())
    (tmp_path / "gear.toml").write_text(
        'kind = "gear"\nteeth = 24\nmodule_mm = 2.0\nface_width_mm = 20.0\nface_from_mm = 5.0\n'
        "tip_diameter_mm = 52.0\nroot_diameter_mm = 43.0\n"
    )
    scan = tmp_path / "a.h5"
    inputs = Inputs((scan,), None, calibration=tmp_path / "calibration.json", part=tmp_path / "gear.toml")
    with pytest.raises(BadRecipe, match="a scan of view 'rear' that fits where 'front' stands"):
        inspect_job(inputs, Outputs(None), lambda stand: (wrong,), lambda step: nullcontext())
