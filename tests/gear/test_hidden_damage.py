"""Damage that no ray reaches where figures are read: another outsider's finds, each *conforms* and far wrong."""

from dataclasses import replace
from itertools import product
from math import radians

import numpy as np
import pytest

from damaged import FORM_LINES, GEAR, HELIX, PROFILE, SOUND, WILD, inspected, line, truth, verdict
from gears import SPUR, helical, scan_of, simulation, true_calibration
from truestand.apply.datum import datum_of
from truestand.core.surface import apply_calibration
from truestand.gear.damage import _damage, _Region, may_go_on
from truestand.gear.drawing import Evaluation
from truestand.gear.ends import unseen_at_ends
from truestand.gear.evaluate import VIBRATION
from truestand.gear.flanks import find_flanks, find_toothing
from truestand.gear.geometry import FLANKS, involute
from truestand.gear.grid import Grid, centres_of, grid_of, height_edges
from truestand.sim import Dent, Worn
from variants import tried

FACE = (4.0, 26.0)
HELICAL = replace(helical(10.0), accuracy_class=9)
WELL_KNOWN = simulation(4000, upright=True, noise=0.004)


def groove(teeth, above, width=0.6, depth=0.12):
    """Along the face of right flanks, so many mm of roll length above the lower end of the profile."""
    begins = involute(HELICAL).profile_range[0] + above
    return replace(SOUND, worn=tuple(Worn(t, "right", (begins, begins + width), FACE, depth, 0.1) for t in teeth))


def wrong(found, true):
    """Lines of teeth whose verdict says the opposite of the truth, farther from the limit than U."""
    return [
        (c.name, c.flank, c.tooth, c.value, c.U, true[c.name, c.flank, c.tooth])
        for c in found.characteristics
        if c.tooth
        and c.name in FORM_LINES
        and c.verdict in ("conforms", "does_not_conform")
        and (c.verdict == "conforms") != (true[c.name, c.flank, c.tooth] <= c.limits[1])
        and abs(true[c.name, c.flank, c.tooth] - c.limits[1]) > c.U
    ]


@pytest.mark.slow
@pytest.mark.parametrize("above", tried([2.0], rarely=[3.0, 4.5]))
def test_a_groove_of_all_teeth_whose_floor_no_ray_reaches_is_not_seen(above):
    """Rays that should meet its floor meet its edge: F_alpha 5.4 +- 6.1 for 120, and 304 of 304 lines decided."""
    errors = groove(range(1, 25), above)
    found = inspected(errors, HELICAL, WELL_KNOWN, 320)
    assert not wrong(found, truth(errors, HELICAL))
    sides = [c for c in found.characteristics if c.name in PROFILE and c.flank == "right"]
    assert sides and all(c.verdict != "conforms" for c in sides)


@pytest.mark.slow
def test_such_a_groove_of_one_tooth_is_told_by_the_row_that_no_ray_meets():
    errors = groove([8], 2.0)
    found = inspected(errors, HELICAL, WELL_KNOWN, 320)
    assert not wrong(found, truth(errors, HELICAL))
    others = [c.verdict for c in found.characteristics if c.tooth and (c.tooth, c.flank) != (8, "right")]
    assert others.count("conforms") > 0.88 * len(others)  # as without it


@pytest.mark.slow
def test_slopes_are_no_surer_than_the_forms_of_the_same_trace():
    """f_Halpha 7.9 +- 2.5, *conforms*, for 51.6 where F_alpha was 14.6 +- 72."""
    errors = groove(range(1, 25), 0.5, 0.96, 0.1)
    found = inspected(errors, HELICAL, WELL_KNOWN, 320)
    true = truth(errors, HELICAL)
    slopes = [c for c in found.characteristics if c.name == "f_Halpha" and c.tooth and c.verdict == "conforms"]
    assert not [c for c in slopes if abs(c.value - true[c.name, c.flank, c.tooth]) > 1.5 * c.U]


@pytest.mark.slow
def test_a_helix_that_was_not_seen_to_its_end_may_have_what_others_have_there():
    """Bands at the end of the face of a helical gear: F_beta 3.6 +- 3.0, *conforms*, for 36."""
    gear = replace(helical(18.0), accuracy_class=7)
    top = involute(gear).helix_range[1]
    bands = tuple(Worn(t, "left", (0.0, 40.0), (top - 0.3 + 0.02 * (t % 9), 30.0), 0.06, 0.3) for t in range(1, 25))
    errors = replace(SOUND, worn=bands)
    found = inspected(errors, gear, simulation(2500, upright=True), 320)
    assert not wrong(found, truth(errors, gear))


@pytest.mark.slow
def test_a_dent_between_the_profiles_beside_the_measuring_circle_is_not_seen():
    """1.5 mm of roll length lay between them: F_beta 2.3 +- 1.4, *conforms*, for 57."""
    gear = replace(SPUR, accuracy_class=9)
    roll = involute(gear).measuring_roll
    rng = np.random.default_rng(4)
    dents = tuple(
        Dent(t, "left", roll + rng.uniform(-0.5, 0.5), rng.uniform(8.0, 22.0), 0.45, 0.11) for t in range(1, 25, 3)
    )
    errors = replace(SOUND, dents=dents, phase=radians(2.0))
    found = inspected(errors, gear, simulation(850), 320)
    assert not wrong(found, truth(errors, gear))
    assert line(found, "F_beta", 2).verdict == "undecided"


@pytest.mark.parametrize("every", tried([], 1, rarely=[3, 6]))
def test_a_crater_that_runs_out_of_the_lower_end_of_the_profile_is_not_seen(every):
    """No reading returns from it, and none is missed between two others: F_alpha 0.0 +- 8.5, *conforms*, for 212."""
    gear, teeth = replace(helical(20.0), accuracy_class=10), range(1, 25, every)
    craters = tuple(Worn(t, "left", (3.6, 4.67), (15.1 + 0.03 * t, 21.8), 0.54, 0.2) for t in teeth)
    errors = replace(SOUND, worn=craters)
    found = inspected(errors, gear, simulation(upright=True), 320)
    assert not wrong(found, truth(errors, gear))
    assert {line(found, name, t).verdict for name in PROFILE for t in teeth} == {"undecided"}
    sound = [c for c in found.characteristics if c.tooth and c.tooth not in teeth and c.flank == "left"]
    assert all(c.verdict == "conforms" for c in sound)


@pytest.mark.slow
def test_many_teeth_worn_where_no_ray_reaches_leave_gaps_doubted():
    """The flank above hides the worn root, and rays return from beside the tooth: F_alpha 0.0 +- 2.4, *conforms*, for
    60.
    """
    low = involute(SPUR).profile_range[0]
    roots = tuple(Worn(t, "left", (0.5, low + 1.6), FACE, 0.06, 0.1) for t in range(1, 25, 3))
    errors, gear = replace(SOUND, worn=roots), replace(SPUR, accuracy_class=9)
    found = inspected(errors, gear, simulation(2750), 320)
    assert not wrong(found, truth(errors, gear))


@pytest.mark.more
def test_several_turns_show_no_flank_ending_before_those_beside_it():
    """Profiles, 3.3 mm apart near the root, begin anywhere: 43 of the starter's 48 flanks, all but one or two of them
    whole, were *not seen* at their lower end, and the mean F_alpha read 3 +- 605 um.
    """
    scan = scan_of(SPUR, SOUND, simulation(11000))
    surface = apply_calibration(scan, true_calibration())
    flanks = find_flanks(surface, find_toothing(surface, involute(SPUR), datum_of(true_calibration(), "base")))
    assert unseen_at_ends(flanks, grid_of(flanks), scan.step, scan.x.shape[1]) == ()


def test_damage_that_was_not_seen_whole_may_go_on_where_profiles_show_nothing():
    """A crater showed itself beyond the middle of the face only: F_alpha 3.8 +- 35, *conforms*, for 223."""
    region, seen = np.zeros((6, 9), dtype=bool), np.zeros((6, 9), dtype=bool)
    region[1:5, 5:7] = True
    seen[0], seen[5], seen[2, 3], seen[1:4, 1], seen[1:4, 8] = True, True, True, True, True
    expected = np.zeros((6, 9), dtype=bool)
    expected[1:5, 2:8] = True
    expected[2, 3] = False
    np.testing.assert_array_equal(may_go_on(region, seen), expected)


@pytest.mark.slow
@pytest.mark.parametrize("seed", tried([3], rarely=[1, 2]))
def test_a_dent_from_which_readings_got_lost_is_not_seen(seed):
    """0.9 mm wide, 120 um deep, steep walls: F_alpha 7.1 +- 8.4, *conforms*, for 44; a dent at mid-face read 6.5 +- 3.5
    for 40 where six of its readings were missing, and hardly one of a million elsewhere.
    """
    gear, rng, pits = replace(helical(14.0), accuracy_class=8), np.random.default_rng(seed), []
    nominal = involute(gear)
    low, high = nominal.profile_range
    for tooth in range(1, 25, 2):
        for flank in ("left", "right"):
            roll = rng.choice([rng.uniform(low + 1.0, high - 1.0), nominal.measuring_roll])
            height, half = nominal.middle + rng.normal(0.0, 0.25), rng.uniform(0.4, 0.5)
            where = (roll - half, roll + half), (height - half, height + half)
            pits.append(Worn(tooth, flank, *where, 0.12, 0.15))
    errors = replace(SOUND, worn=tuple(pits))
    found = inspected(errors, gear, WELL_KNOWN, 480)
    seen_well = [w for w in wrong(found, truth(errors, gear)) if w[1] == "left"]  # the right ones at up to 85 degrees
    assert not seen_well
    beside = [c.verdict for c in found.characteristics if c.tooth and c.flank == "left" and c.tooth % 2 == 0]
    assert beside.count("conforms") > 0.8 * len(beside)


@pytest.mark.slow
def test_the_land_of_an_eccentric_gear_is_no_flank():
    """24 um off its bore: f_Halpha -25.9 +- 8.4, *does not conform*, for 1.2; here F_alpha was 27 um off."""
    gear = replace(SPUR, teeth=30, module=1.0, tip_diameter=32.0, root_diameter=27.5, accuracy_class=8)
    errors = replace(SOUND, eccentricity=0.03, eccentricity_direction=1.0)
    found, true = inspected(errors, gear, simulation(4400, noise=0.005), 320), truth(errors, gear)
    profiles = [c for c in found.characteristics if c.tooth and c.name in (*PROFILE, "f_Halpha")]
    off = np.array([abs(c.value - true[c.name, c.flank, c.tooth]) for c in profiles])
    assert (off < [c.U for c in profiles]).all() and off.max() < 0.005


@pytest.mark.slow
@pytest.mark.parametrize(("inside", "points"), tried([(0.3, 160)], (0.15, 320)))
def test_a_tooth_broken_off_just_inside_the_helix_range_was_not_seen_to_its_end(inside, points):
    """No ray shows the break, readings only end a little sooner: F_beta 0.0 +- 12.3, *conforms*, for 1186."""
    top = involute(GEAR).helix_range[1]
    broken = replace(SOUND, worn=tuple(Worn(7, f, (0.0, 20.0), (top - inside, 26.0), 1.2, 0.02) for f in FLANKS))
    found = inspected(broken, points=points)
    for flank, name in product(FLANKS, HELIX):
        assert verdict(found, name, 7, flank) == "undecided" and "no reading" in line(found, name, 7, flank).reason
    doubted = {(c.tooth, c.name) for c in found.characteristics if c.tooth and c.verdict != "conforms"}
    assert {(7, name) for name in (*HELIX, "f_Hbeta")} <= doubted and {tooth for tooth, _ in doubted} == {7}


@pytest.mark.slow
def test_teeth_that_all_end_inside_the_helix_range_were_not_seen_to_its_end():
    """Beside none of them is one that goes on: f_fbeta 0.0 +- 0.5 for 494 on every flank, and the gear conformed."""
    narrow = replace(GEAR, face_width=12.0)
    bottom = involute(narrow).helix_range[0]
    short = tuple(Worn(t, f, (0.0, 20.0), (4.0, bottom + 0.5), 0.5, 0.02) for t, f in product(range(1, 25), FLANKS))
    found = inspected(replace(SOUND, worn=short), narrow, points=320)
    assert not found.reasons
    assert "conforms" not in {c.verdict for c in found.characteristics if c.name in (*HELIX, "f_Hbeta")}


@pytest.mark.slow
def test_a_pit_seen_by_a_row_of_cells_is_damage_where_many_readings_say_so():
    """Its floor is in the shadow of its rim: F_alpha 8.6 +- 3.9 for 46, and conformed."""
    fine = replace(GEAR, teeth=40, module=0.8, tip_diameter=33.6, root_diameter=30.0)
    pit = Dent(15, "right", involute(fine).measuring_roll - 0.3, 15.0, 0.35, 0.15)
    found = inspected(replace(SOUND, dents=(pit,)), fine, simulation(8000, noise=0.003), 200)
    assert {verdict(found, name, 15, "right") for name in PROFILE} <= {"undecided", "does_not_conform"}
    assert {verdict(found, name, 16, "right") for name in PROFILE} == {"conforms"}


@pytest.mark.slow
@pytest.mark.parametrize("radius", tried([0.25], 0.4))
def test_a_pit_that_returns_nothing_was_not_seen_where_readings_hardly_ever_get_lost(radius):
    """A profile or two cross it, and lack a few readings: f_p 10.5 +- 0.3 for 82, and the gear conformed."""
    middle = involute(GEAR).measuring_roll
    found = inspected(SOUND, points=640, blind=((7, "left", middle, 15.0, radius),))
    for name in (*PROFILE, *HELIX):
        assert verdict(found, name, 7) == "undecided" and verdict(found, name, 8) == "conforms", name
        assert "no reading shows the flank" in line(found, name, 7).reason, name
    assert sum(c.verdict != "conforms" for c in found.characteristics if c.tooth) == 6


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "gone"), tried([(0.3, 0.0), (0.5, 0.005)], rarely=[(1.0, 0.02)]))
def test_such_pits_on_every_flank_are_not_usual(radius, gone):
    """At one place of all of them: f_fbeta 0.5 +- 0.6 for 137, on every flank, and the gear conformed; and so another
    outsider's once readings got lost in runs elsewhere.
    """
    middle = involute(GEAR).measuring_roll
    pits = tuple((t, f, middle, 15.0, radius) for t, f in product(range(1, 25), FLANKS))
    lines = [c for c in inspected(SOUND, points=640, blind=pits, gone=gone).characteristics if c.tooth]
    assert not [(c.name, c.flank, c.tooth) for c in lines if c.name in FORM_LINES and c.verdict == "conforms"]


@pytest.mark.slow
def test_long_runs_of_lost_readings_are_usual_where_many_get_lost():
    """As long as they are on every fourth flank, chance makes them."""
    assert inspected(SOUND, how=WILD, points=320).verdict == "conforms"


@pytest.mark.slow
@pytest.mark.parametrize("share", tried([0.02], rarely=[0.005, 0.05]))
def test_readings_lost_in_runs_are_no_holes(share):
    """A run longer than single losses make was one, 0.3 by 0.3 mm at the middle of the face too: f_p 5 +- 2070."""
    assert inspected(SOUND, points=640, gone=share).verdict == "conforms"


@pytest.mark.slow
def test_a_pit_that_returns_nothing_is_told_among_readings_lost_in_runs():
    """All profiles that cross it lack theirs, four and more."""
    middle = involute(GEAR).measuring_roll
    found = inspected(SOUND, points=640, blind=((7, "left", middle, 15.0, 1.0),), gone=0.02)
    for name in (*PROFILE, *HELIX):
        assert verdict(found, name, 7) == "undecided" and verdict(found, name, 8) == "conforms", name


@pytest.mark.slow
def test_a_stand_that_shakes_makes_no_sound_gear_fail():
    """Profiles are off as a whole, those beside each other alike: f_Halpha -8.2 +- 0.8, f_falpha 6.8 +- 0.9 for 0."""
    fine = replace(GEAR, teeth=48, module=1.0, tip_diameter=50.0, root_diameter=45.5, accuracy_class=5)
    often, true = simulation(8000, noise=0.002), truth(SOUND, fine)
    still, found = (inspected(SOUND, fine, often, 200, shaking=rms) for rms in (0.0, 0.0056))
    profiles = [c for c in found.characteristics if c.tooth and c.name in (*PROFILE, "f_Halpha")]
    off = np.array([abs(c.value - true[c.name, c.flank, c.tooth]) / c.U for c in profiles])
    assert (off < 1.0).mean() > 0.95 and off.max() < 2.0
    assert "does_not_conform" not in {c.verdict for c in found.characteristics}
    of_shaking = [[b.U for c in of.characteristics for b in c.budget if b.name == VIBRATION] for of in (still, found)]
    assert 3 * np.median(of_shaking[0] or [0.0]) < np.median(of_shaking[1])


@pytest.mark.parametrize("share", tried([], rarely=[0.1, 0.2]))
def test_stray_readings_near_the_flank_make_no_sound_gear_fail(share):
    """Two or three in one cell bear each other out by chance: F_alpha 64 +- 25 for 0, and *chipped flank*."""
    fine = replace(GEAR, teeth=48, module=1.0, tip_diameter=50.0, root_diameter=45.5, accuracy_class=9)
    found, true = inspected(SOUND, fine, simulation(8000), 200, strays=share), truth(SOUND, fine)
    assert "does_not_conform" not in {x.verdict for x in (*found.characteristics, *found.defects)}
    lines = [c for c in found.characteristics if c.tooth]
    off = np.array([abs(c.value - true[c.name, c.flank, c.tooth]) / c.U for c in lines])
    assert (off > 1.5).mean() < 0.02 and off.max() < 3.0
    assert sum(c.verdict == "conforms" for c in lines) > 0.8 * len(lines)


@pytest.mark.more
@pytest.mark.parametrize(("width", "points"), [(1.0, 320), (3.0, 160)])
def test_faces_that_few_points_of_a_profile_see_are_inspected(width, points):
    """They crashed: other sections had no cell, and a bend between profiles had more stretches than the face cells."""
    found = inspected(SOUND, replace(GEAR, face_width=width, accuracy_class=None), points=points)
    for flank in FLANKS:
        pitch = line(found, "f_p", None, flank)
        assert pitch.value <= pitch.U


@pytest.mark.more
def test_a_lower_end_of_profiles_that_no_tooth_shows_is_partial():
    """An outsider's undercut teeth: f_falpha 2.5 +- 3.0 um for 43, of a range that began where no ray meets a flank."""
    low = Evaluation(control_diameter=45.13)
    spots = [(t, f, 0.75, h, 1.6) for t, f, h in product(range(1, 25), FLANKS, np.arange(5.0, 25.1, 0.5))]
    found = inspected(SOUND, replace(GEAR, evaluation=low), blind=tuple(spots))
    for flank, name in product(FLANKS, PROFILE):
        at_root = line(found, name, None, flank)
        assert at_root.status == "partial" and "without a reading" in at_root.reason
        assert at_root.verdict != "conforms"


@pytest.mark.parametrize("read_between", [False, True])
def test_what_no_reading_shows_may_go_on_where_none_was_read(read_between):
    """A root broken off all along the face was *not seen* at one end of it: F_alpha 0.5 +- 20, *conforms*, for 96."""
    nominal = involute(SPUR)
    rolls, edges = centres_of(nominal.control_roll, nominal.tip_roll, 40), height_edges(nominal, 0.25)
    count = np.ones((2, SPUR.teeth, rolls.size, edges.size - 1))
    count[0, 16, :6, :60] = 0.0
    count[0, 16, :6, 30:40] = read_between
    none = np.zeros_like(count)
    grid = Grid(nominal, none, none, none, none, count, rolls, edges, 0.002)
    not_met = np.zeros(count.shape[2:], dtype=bool)
    not_met[1:4, 5:15] = True
    found = _damage(
        _Region(0, 16, not_met, 1, np.zeros(0), 0.002, 0.0, 30.0, unseen=True, alone=False), grid, 1e-3, 1.0
    )
    assert found.heights == pytest.approx((edges[5], edges[15]), abs=1e-3)  # where rays met nothing
    reached = np.flatnonzero(found.cells[1:4].all(axis=0))
    assert (reached[0], reached[-1]) == (0, 29 if read_between else 59)
