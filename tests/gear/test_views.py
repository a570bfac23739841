"""A gear by two sensors: inspected as one, each flank by the views that saw it."""

import json
from dataclasses import replace
from functools import cache
from math import radians

import jsonschema
import numpy as np
import pytest

from gears import UPRIGHT, WORN, helical, line, simulation
from truestand.apply.datum import datum_of
from truestand.apply.transfer import roll
from truestand.apply.views import roll_views
from truestand.calibration.views import calibrate_views
from truestand.core.calibration import ScanSummary
from truestand.core.frames import Pose
from truestand.core.inspection import Seam, contradictions
from truestand.core.scan import interpret
from truestand.core.surface import apply_calibration, stacked
from truestand.files.records.inspection_record import inspection_record
from truestand.files.records.schemas import schema_text
from truestand.gear.disagreement import disagreements
from truestand.gear.flanks import find_toothing
from truestand.gear.geometry import involute
from truestand.gear.grid import grid_of
from truestand.gear.inspect import inspect_gear
from truestand.gear.levels import levelled, levelling
from truestand.gear.rays import rays_of_views
from truestand.gear.seams import tied
from truestand.gear.views import views_of
from truestand.parts.inspect import inspect
from truestand.report.inspection import inspection_report
from truestand.sim import FlankErrors, VirtualGear, paper_shaft, simulate
from truestand.sim.gear_truth import gear_figures
from views import AZIMUTH, two_sensors

UM = 1e-3
STAND = two_sensors(points=240, incidence_U=0.005)
GEAR = helical(30.0)
FRONT = replace(simulation(2, True).mounting, **UPRIGHT)
REAR = replace(FRONT, phi=radians(-110.0), plane_offset=-0.2, azimuth=AZIMUTH)
"""Looks down where the front one looks up: it sees the flanks that a helix leans away from the other."""


@cache
def scans(part=None, rear=REAR):
    """Of the shaft, or of a part on it, by both: 1.1 turns at 2,000 profiles each."""
    base = simulation(2200, True)
    both = replace(
        base, acquisition=replace(base.acquisition, columns=("angle",)), views=(("front", FRONT), ("rear", rear))
    )
    return tuple(
        interpret(simulate(STAND.of_view(v), both.seen_from(v), paper_shaft(), k, None, part).recording, STAND, view=v)
        for k, v in enumerate(("front", "rear"))
    )


@cache
def calibrated():
    return calibrate_views(scans(), paper_shaft())


@cache
def found(gear=GEAR, rear=REAR):
    return inspect_gear(roll_views(scans(VirtualGear(gear, WORN), rear), calibrated()), gear)


@cache
def true(gear=GEAR):
    return gear_figures(VirtualGear(gear, WORN), paper_shaft(), simulation(2, True).workpiece)


@pytest.mark.parametrize("flank", ["left", "right"])
def test_pitch_of_both_sides_is_right(flank):
    """1 um: noise of 5 um over what few readings there are of a tooth."""
    for name in ("F_p", "f_p"):
        c = line(found(), name, flank)
        assert c.status == "measured" and c.value == pytest.approx(true()[name, flank, None], abs=1.0 * UM)
    assert line(found(), "F_p", flank).U < 10 * UM


def test_every_figure_is_inside_its_u():
    off = [
        (c.value - true()[key]) / c.U
        for c in found().characteristics
        if (key := (c.name, c.flank or "", c.tooth)) in true() and c.value is not None
    ]
    assert len(off) > 250 and np.mean(np.abs(off) < 1) > 0.97 and np.max(np.abs(off)) < 1.5


def test_lines_name_the_views_that_saw_them():
    assert line(found(), "s").views == ("front", "rear")
    assert line(found(), "f_falpha", "left", 3).views == ("front", "rear")
    assert all(c.views for c in found().characteristics)


MILD = helical(10.0)
"""Both views see all of its flanks, more or less steeply."""
TIP_OF_FINE = MILD.tip_diameter - 2.4


def read_otherwise(by, over=False, gear=MILD):
    """Both scans of a gear whose flanks the rear sensor reads with other slopes, and as thicker, mm."""
    slopes = FlankErrors(WORN.left.profile_slope + by, WORN.left.helix_slope), FlankErrors(
        WORN.right.profile_slope + by, WORN.right.helix_slope
    )  # fmt: skip
    as_read = replace(WORN, thickness=WORN.thickness + by, left=slopes[0], right=slopes[1])
    return tuple(scans(VirtualGear(gear, e, float(over), over))[k] for k, e in enumerate((WORN, as_read)))


@pytest.mark.slow
def test_two_views_of_a_gear_turned_over():
    """Where one view reads teeth as thicker, closure bent its calibration: helices were 10 um off. How far apart two
    views stand was taken to turn over with the part: *views contradict*.
    """
    both = (*read_otherwise(0.004), *read_otherwise(0.004, over=True))
    inspection = inspect(roll_views(both, calibrated(), clamped_again=True), MILD, (0, 0, "over", "over"))
    assert not inspection.reasons
    for flank in ("left", "right"):
        c = line(inspection, "F_p", flank)
        assert abs(c.value - true(MILD)["F_p", flank, None]) < c.U
        for tooth in (1, 9, 17):
            c = line(inspection, "f_Hbeta", flank, tooth)
            assert abs(c.value - true(MILD)["f_Hbeta", flank, tooth]) < min(c.U, 4 * UM)


@pytest.mark.slow
def test_views_that_read_steep_flanks_a_little_otherwise_make_no_steps():
    """What a sensor makes of incidence is the same on every tooth. There were steps of 14 um on 12 flanks; and 7 um of
    noise on another one, where cells hold one or two readings and most hold more.
    """
    inspection = inspect_gear(roll_views(read_otherwise(0.008), calibrated()), MILD)
    assert not inspection.reasons
    assert not [r for r in inspection.remarks if r.code in ("damage", "more_damage")]
    for flank in ("left", "right"):
        assert line(inspection, "f_falpha", flank).value < 3 * UM and line(inspection, "f_Halpha", flank).U < 0.02
        slope = line(inspection, "f_Halpha", flank, 5)
        assert abs(slope.value - true(MILD)["f_Halpha", flank, 5]) < slope.U


@pytest.mark.slow
def test_each_view_ends_at_the_tips_that_it_sees():
    """A ring of 80 teeth was read 0.1 mm nearer by one of two sensors: its readings of the lands counted as flank up
    to where the other's tips are, and forms were 28 um off at a U of 13. Here 8 um of 6.
    """
    fine = replace(MILD, teeth=48, module=1.0, tip_diameter=TIP_OF_FINE, root_diameter=TIP_OF_FINE - 4.2)
    errors = replace(WORN, pitch_left=(), pitch_right=())
    lower = replace(fine, tip_diameter=TIP_OF_FINE - 0.16)
    both = scans(VirtualGear(lower, errors))[0], scans(VirtualGear(fine, errors))[1]
    inspection = inspect_gear(roll_views(both, calibrated()), fine)
    for flank in ("left", "right"):
        assert line(inspection, "f_falpha", flank).value < 2 * UM


@pytest.mark.slow
def test_rays_meet_flanks_where_each_view_reads_them():
    """Sound rings were *not seen* in places where views read flanks some 10 um beside their mean. Here 28 um, and
    left flanks, which both see steeply.
    """
    surfaces = roll_views(read_otherwise(0.12, gear=GEAR), calibrated())
    nominal, datum = involute(GEAR), datum_of(surfaces[0].origin[1], GEAR.datum, GEAR.bore_clearance)
    views, _ = levelled(views_of(surfaces, find_toothing(stacked(surfaces), nominal, datum)))
    for view in views:
        flanks = view.borne_out()
        grid = grid_of(flanks)
        as_read, as_mean = (
            rays_of_views(grid, np.zeros_like(grid.delta), flanks, [v]).beside
            for v in (view, replace(view, level=None))
        )
        assert as_read.missed[0].sum() < 0.9 * as_mean.missed[0].sum()


def test_what_goes_once_round_the_gear_is_shared_out_too():
    """The table's angle errs once a turn, and views beside each other meet a tooth at other angles."""
    surfaces = roll_views(scans(VirtualGear(MILD, WORN)), calibrated())
    nominal, datum = involute(MILD), datum_of(surfaces[0].origin[1], MILD.datum, MILD.bore_clearance)
    grid = grid_of(views_of(surfaces, find_toothing(stacked(surfaces), nominal, datum))[0].flanks)
    around = 0.004 * np.cos(np.arange(MILD.teeth) * MILD.pitch + 0.7)[:, None, None] + np.zeros(grid.delta.shape)
    left = levelling(np.full((2, *grid.delta.shape), 0.5), "ab", grid)(np.stack([around, -around]))
    assert np.abs(left).max() < 0.01 * 0.004


def seen_by_two(incidence=None):
    """A worn gear as two views show it, whose data sheets say what ``incidence`` (mm) does to steep flanks."""
    surfaces = roll_views(scans(VirtualGear(MILD, WORN)), calibrated())
    datum = datum_of(surfaces[0].origin[1], MILD.datum, MILD.bore_clearance)
    views = views_of(surfaces, find_toothing(stacked(surfaces), involute(MILD), datum))
    if incidence is None:
        return views
    stand = two_sensors(points=240, incidence_U=incidence)
    return [
        replace(view, scan=replace(view.scan, stand=stand.of_view(name)))
        for view, name in zip(views, ("front", "rear"), strict=True)
    ]


def disagreements_where(views, apart, phase=0.0, leans=False, seen=None):
    """Why nothing is decided where the first view reads more by a wave once round the gear, in cells that are ``seen``;
    ``leans``: from one end of the face to the other.
    """
    grid = grid_of(views[0].flanks)
    along = (grid.heights - grid.nominal.middle) / (MILD.face_width / 2) if leans else np.ones(grid.heights.size)
    wave = apart * np.cos(np.arange(MILD.teeth) * MILD.pitch + phase)[:, None, None] * along
    more = wave + np.zeros(grid.delta.shape)
    more[:, ~(np.ones(MILD.teeth, dtype=bool) if seen is None else seen)] = np.nan
    return disagreements(views, [view.calibration.reader for view in views], (more, np.zeros_like(more)), grid)


@pytest.mark.parametrize(("apart", "told"), [(0.004, 0), (0.04, 2)])
def test_views_that_read_the_gear_by_far_otherwise_once_round_contradict(apart, told):
    found = disagreements_where(seen_by_two(), apart)
    assert [m.code for m in found] == told * ["views_contradict"]
    assert all("once round the gear" in str(m) for m in found)


def test_what_some_teeth_show_that_both_views_see_is_nothing_once_round():
    assert not disagreements_where(seen_by_two(), 0.04, seen=np.arange(MILD.teeth) < 0.4 * MILD.teeth)


@pytest.mark.parametrize(("incidence", "told"), [(0.005, 2), (0.06, 0)])
def test_flanks_of_an_eccentric_shaft_are_seen_more_and_less_steeply(incidence, told):
    """Two of 50 sound rings contradicted each other once round."""
    assert len(disagreements_where(seen_by_two(incidence), 0.01)) == told


@pytest.mark.parametrize(
    ("apart", "incidence", "told"), [(0.0005, 0.005, 0), (0.003, 0.005, 2), (0.006, 0.02, 2), (0.003, 0.15, 0)]
)
def test_a_gear_that_leans_more_in_one_of_two_scans_is_told(apart, incidence, told):
    """An outsider's, by 0.05 degrees: f_Hbeta was 2.7 U off, and conformed. Two of 34 sound rings were told, whose
    steep flanks read otherwise, and not in proportion to their incidence.
    """
    found = disagreements_where(seen_by_two(incidence), apart, phase=0.7, leans=True)
    assert [m.code for m in found] == told * ["views_contradict"]
    assert all("leaned" in str(m) for m in found)


@pytest.mark.more
def test_a_part_that_moved_between_the_scans_of_two_views_is_told():
    """An outsider's, by 20 um: F_p was 23.6 +- 5.3 um, of 6.4 in one scan and 44.5 in the other, and conformed."""
    moved = replace(WORN, eccentricity=np.hypot(WORN.eccentricity, 0.02), eccentricity_direction=2.0)
    both = tuple(scans(VirtualGear(MILD, e))[k] for k, e in enumerate((WORN, moved)))
    reasons = inspect_gear(roll_views(both, calibrated()), MILD).reasons
    assert any(m.code == "views_contradict" and "once round the gear" in str(m) for m in reasons)


@pytest.mark.slow
def test_views_that_read_slopes_by_far_otherwise_decide_nothing():
    inspection = inspect_gear(roll_views(read_otherwise(0.08), calibrated()), MILD)
    assert "views_contradict" in {r.code for r in inspection.reasons}


@pytest.mark.more
def test_what_one_view_hides_the_other_shows():
    alone = inspect_gear(roll(scans(VirtualGear(GEAR, WORN))[0], calibrated()), GEAR)
    for name, flank in (("F_p", "right"), ("f_p", "right"), ("s", None), ("F_r", None)):
        assert line(alone, name, flank).status == "not_measurable" and line(found(), name, flank).status == "measured"


@pytest.mark.slow
def test_where_one_sensor_is_blind_the_other_shows_the_flanks_that_it_sees():
    """The rear one sees the right flanks, and of the left ones as much as lets some of them be measured."""
    front, rear = scans(VirtualGear(GEAR, WORN))
    z = front.z.copy()
    z[:, 60:66] = np.nan
    blind = inspect_gear(roll_views((replace(front, z=z), rear), calibrated()), GEAR)
    status = {f: [c.status for c in blind.characteristics if c.name == "F_beta" and c.tooth and c.flank == f]
              for f in ("left", "right")}  # fmt: skip
    assert status["left"].count("partial") > 12 and set(status["right"]) == {"measured"}
    assert "points_blind" in {r.code for r in blind.remarks}


@pytest.mark.parametrize(("teeth", "compared"), [(6, False), (18, True)])
def test_a_few_teeth_that_views_share_are_no_seam(teeth, compared):
    """A sound ring by three views had one of 11 of 80 teeth, all at one corner: 19 um at a U of 9."""
    middle, (front, rear) = MILD.face_from + MILD.face_width / 2, (view.flanks for view in seen_by_two())
    lower = front.select((front.height < middle) | (front.flank % MILD.teeth < teeth))
    views = tuple(
        replace(view, flanks=flanks)
        for view, flanks in zip(seen_by_two(), (lower, rear.select(rear.height > middle)), strict=True)
    )
    assert bool(tied(views)[1]) == compared


def test_views_agree_within_their_seams():
    assert {s.views for s in found().seams} == {("front", "rear")}
    assert all(s.ok and abs(s.difference) < s.U for s in found().seams)
    assert found().reasons == contradictions(found().seams) == ()


def test_report_and_record_show_the_seams():
    scan = ScanSummary("", 1, 1, 1.0, 1.0)
    record = inspection_record(found(), calibrated(), (scan, scan), "", "2026-11-25")
    jsonschema.validate(record, json.loads(schema_text("inspection")))
    assert [s["views"] for s in record["seams"]] == [["front", "rear"]] * 2 and len(record["scans"]) == 2
    assert record["characteristics"][0]["views"] == ["front", "rear"]
    page = inspection_report(found(), calibrated())
    assert "<h2>Seams</h2>" in page and "sensors front, rear" in page


@pytest.mark.slow
def test_heights_that_are_a_millimetre_off_are_found_on_the_flanks():
    """On one side of helical teeth height and azimuth act alike; the figures need only what both do together."""
    first, rear = calibrated().views
    wrong = replace(calibrated(), views=(first, replace(rear, height=rear.height + 0.8)))
    again = inspect_gear(roll_views(scans(VirtualGear(GEAR, WORN)), wrong), GEAR)
    assert max(abs(s.difference) for s in again.seams) < 0.05 and not again.reasons
    for flank in ("left", "right"):
        c = line(again, "F_p", flank)
        assert c.value == pytest.approx(line(found(), "F_p", flank).value, abs=0.5 * UM)


@pytest.mark.more
def test_views_that_contradict_each_other_decide_nothing():
    """As if one had moved out where no shaft in view shows it."""
    front, rear = roll_views(scans(VirtualGear(GEAR, WORN)), calibrated())
    scan, calibration = rear.origin
    pose = calibration.table_from_sensor
    moved = replace(calibration, table_from_sensor=Pose(pose.rotation, pose.translation + np.array([0.15, 0.0, 0.0])))
    contradicting = inspect_gear((front, apply_calibration(scan, moved)), GEAR)
    assert [r.code for r in contradicting.reasons] == ["views_contradict"]
    assert "views 'front' and 'rear' differ by" in contradicting.reasons[0] and contradicting.verdict == "undecided"


def test_a_view_that_the_shaft_tells_has_moved_is_named():
    moved = roll_views(scans(VirtualGear(GEAR, WORN), replace(REAR, plane_offset=-0.05)), calibrated())
    front, rear = (s.origin[1].reasons for s in moved)
    assert front == () and rear[0].startswith("view 'rear': ")


def test_a_third_view_tells_which_one_moved():
    seams = [
        Seam(pair, "left", 0.03 * (not ok), 0.01, ok)
        for pair, ok in ((("a", "b"), False), (("b", "c"), False), (("a", "c"), True))
    ]
    assert "view 'b' has moved" in contradictions(tuple(seams))[0]
    assert "one of them has moved" in contradictions(tuple(seams[:1]))[0]
