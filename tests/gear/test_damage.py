"""Damage is measured: what the standard's traces read of a damaged flank, against the virtual stand's true surface."""

from dataclasses import replace

import numpy as np
import pytest

from damaged import (
    DAMAGED,
    FACE,
    FIGURES,
    GEAR,
    HELIX,
    MEASURED,
    PROFILE,
    SOUND,
    UM,
    UNEVEN,
    WIDE,
    WILD,
    inspected,
    line,
    truth,
    verdict,
    worn,
)
from gears import POINTS, scan_of, simulation, true_calibration
from truestand.core.calibration import ScanSummary
from truestand.core.surface import apply_calibration
from truestand.files.records.inspection_record import characteristics_from, inspection_record
from truestand.gear.inspect import inspect_gear
from truestand.sim import Chip, Dent, Worn
from variants import tried


@pytest.mark.parametrize("name", MEASURED)
def test_damage_is_measured_and_decides(name):
    """The further figures may be undecided: a groove of 60 um is within U of the limit of F_beta, 50 um."""
    tooth, *_, failing = MEASURED[name]
    found, true = inspected(DAMAGED, points=320), truth(DAMAGED)
    for figure in FIGURES:
        c = line(found, figure, tooth)
        assert abs(c.value - true[figure, "left", tooth]) < 1.5 * c.U, figure
        beyond = abs(true[figure, "left", tooth]) > c.limits[1]
        assert c.verdict in ("undecided", "does_not_conform" if beyond else "conforms"), figure
    for figure in failing:
        assert verdict(found, figure, tooth) == "does_not_conform", figure


@pytest.mark.slow
def test_flanks_beside_damage_are_as_they_are():
    found, true = inspected(DAMAGED, WIDE, points=320), truth(DAMAGED)
    damaged = {tooth for tooth, *_ in MEASURED.values()}
    beside = [c for c in found.characteristics if c.tooth and (c.flank == "right" or c.tooth not in damaged)]
    off = np.array([abs(c.value - true[c.name, c.flank, c.tooth]) / c.U for c in beside])
    assert (off < 1.0).mean() > 0.95 and off.max() < 2.5
    assert {(c.verdict, c.reason) for c in beside} == {("conforms", None)}
    assert found.verdict == "does_not_conform"


@pytest.mark.slow
def test_the_worst_section_shows_what_the_standards_traces_do_not_cross():
    """A dent of 0.09 mm beside mid-face and measuring circle; the mean of the whole flank hardly sees it."""
    found = inspected(replace(SOUND, dents=(Dent(7, "left", 10.3, 21.0, 1.2, 0.09),)), points=320)
    lines = {(c.name, c.flank): c for c in found.characteristics if c.tooth is None}
    for name, place in (("f_falpha", "height 2"), ("f_fbeta", "roll length")):
        worst, mean = lines[name + "_worst", "left"], lines[name + "_areal", "left"]
        assert 0.03 < worst.value < 0.09 and worst.reason.startswith(f"tooth 7 left, {place}"), name  # a mean of 2 mm
        assert mean.value < 0.005 and lines[name + "_worst", "right"].value < 0.005, name
        assert worst.verdict is worst.limits is mean.verdict is mean.limits is None


@pytest.mark.slow
def test_wear_over_the_pitch_point_moves_the_tooth():
    """30 um times the arc on top of 2.5 um: 34.4 um, 33 allowed. A quadratic over the flank read 22.8."""
    errors = worn((7.0, 9.5), FACE, 0.03, 1.25, UNEVEN)
    found = inspected(errors, points=320)
    c = line(found, "f_p", None)
    assert truth(errors)["f_p", "left", None] > 33 * UM
    assert abs(c.value - truth(errors)["f_p", "left", None]) < min(c.U, 2.5 * UM)
    assert c.verdict != "conforms"


@pytest.mark.slow
def test_a_deeper_groove_never_reads_less():
    """From 0.2 mm on its edge hides its bottom: what is read is what was seen, and no less than of 0.1 mm."""
    read = [line(inspected(worn((8.5, 9.8), FACE, depth)), "f_falpha").value for depth in (0.005, 0.1)]
    assert np.diff(read).min() > 0
    for depth in (0.2, 0.5):
        deeper = line(inspected(worn((8.5, 9.8), FACE, depth)), "f_falpha")
        assert deeper.value > read[-1] and deeper.verdict == "does_not_conform"


def test_lines_without_the_damage_are_told_and_judge_nothing():
    found = inspected(DAMAGED, points=320)
    without = {(c.name, c.tooth, c.flank): c for c in found.without_damage}
    c = without["f_falpha", 2, "left"]
    assert c.value < 3 * UM and c.limits is None and c.verdict is None
    assert ("f_falpha", 3, "left") not in without
    record = inspection_record(found, true_calibration(), (ScanSummary("", 1, 1, 1.0, 1.0),), "", "2026-11-23")
    flagged = [c for c in record["characteristics"] if c.get("without_damage")]
    assert len(flagged) == len(without)
    assert len(characteristics_from(record)) == len(found.characteristics)


BROKEN = replace(
    SOUND, missing=(18,), chips=(Chip(3, 15.0, 26.0, 2.0), Chip(8, 15.0, 26.0, 4.4), Chip(13, 12.0, 15.0, 0.12))
)


@pytest.mark.slow
def test_broken_teeth_do_not_conform():
    """Half a tooth, half a tooth to the root, 0.12 mm of a tip, a whole tooth."""
    found = inspected(BROKEN, points=320)
    broken = {d.tooth: d for d in found.defects if d.verdict is not None}
    kinds = {tooth: (d.kind, pytest.approx(d.depth, abs=0.05)) for tooth, d in broken.items()}
    assert kinds == {
        3: ("chipped end", 2.0),
        8: ("chipped end", 4.4),
        13: ("chipped tip", 0.12),
        18: ("missing tooth", 4.5),
    }
    for d in broken.values():
        assert d.verdict == "does_not_conform" and d.U is not None and d.U < 0.02
    assert found.verdict == "does_not_conform"


@pytest.mark.more
def test_a_broken_tooth_leaves_no_figure_of_its_flanks_conforming():
    found = inspected(BROKEN, points=320)
    for name in (*PROFILE, *HELIX):
        assert verdict(found, name, 8) != "conforms" and verdict(found, name, 10) == "conforms"
    assert verdict(found, "f_p", None) == "undecided"


@pytest.mark.slow
def test_tip_broken_by_less_than_the_limit_conforms():
    found = inspected(replace(SOUND, chips=(Chip(5, 12.0, 15.0, 0.07),)))
    assert found.verdict == "conforms" and all(d.verdict is None for d in found.defects)


@pytest.mark.parametrize(
    ("how", "points"),
    tried(
        [(None, POINTS), (simulation(outliers=0.1), 400)],
        rarely=[(WILD, 240), (WILD, 640), (simulation(speckle=0.005), 320), (simulation(noise=0.02), POINTS)],
    ),
    ids=["clean", "10 % wild", "20 % wild, 10 % lost, sparse", "the same", "speckle", "noise of 20 um"],
)
def test_sound_gears_have_no_undecided_figure(how, points):
    """Of 10 % wild readings, cells that lost theirs hung together by chance and were *not seen*: 54 undecided lines."""
    found = inspected(SOUND, GEAR, how, points)
    assert found.verdict == "conforms"
    assert all(d.verdict is None for d in found.defects)
    if points == 640 and how == WILD:
        assert found.defects == ()


@pytest.mark.slow
def test_a_stuck_point_of_the_sensor_is_no_damage():
    """Its range was a hole in 28 flanks: a sound gear failed, and 227 lines were undecided."""
    found = inspected(SOUND, points=320, stuck=((125,), 90.985))
    assert found.verdict != "does_not_conform" and not found.defects
    assert sum(c.verdict == "undecided" for c in found.characteristics) < 10


@pytest.mark.slow
@pytest.mark.parametrize(("points", "dead"), [(320, range(125, 128)), (640, range(250, 254))])
def test_dead_points_beside_each_other_leave_lines_decided(points, dead):
    """0.2 mm of the face that the sensor is blind for: a third of the lines were undecided."""
    found = inspected(SOUND, points=points, stuck=(tuple(dead), np.nan))
    assert found.verdict == "conforms" and not found.defects
    remark = next(r for r in found.remarks if r.code == "points_blind")
    assert f"points {dead[0] + 1} to {dead[-1] + 1} of the sensor see nothing: no flank is seen at heights 6." in remark


@pytest.mark.more
def test_points_that_see_nothing_beside_the_face_are_not_remarked():
    found = inspected(SOUND, points=320, stuck=(tuple(range(150, 200)), np.nan))
    assert found.verdict == "conforms" and "points_blind" not in {r.code for r in found.remarks}


@pytest.mark.slow
def test_a_pit_behind_dead_points_does_not_conform_unseen():
    """It read F_beta 0.0 ± 5.4 um for 190, and the gear conformed."""
    pitted = replace(SOUND, worn=(Worn(5, "left", (5.0, 9.0), (10.3, 10.85), 0.2, 0.05),))
    found = inspected(pitted, points=320, stuck=((98, 99, 100, 101), np.nan))
    c = line(found, "F_beta", 5)
    assert c.verdict != "conforms" and found.verdict != "conforms"
    assert c.status == "partial" and c.coverage < 0.98


@pytest.mark.slow
def test_speckle_that_two_turns_show_again_is_no_damage():
    """One cell of outliers alone hid how much all readings scatter: 100 regions."""
    found = inspected(SOUND, how=simulation(11000, speckle=0.01), points=320)
    assert found.verdict == "conforms"
    assert sum(r.code in ("damage", "more_damage") for r in found.remarks) < 5


@pytest.mark.slow
def test_with_two_readings_a_cell_and_as_many_outliers_hardly_a_line_is_doubted():
    """40 % wild, 60 % lost, one turn: two outliers side by side pass for damage now and then."""
    found = inspected(SOUND, GEAR, simulation(outliers=0.4, dropouts=0.6), 640)
    judged = [c.verdict for c in found.characteristics if c.verdict is not None]
    assert found.verdict != "does_not_conform"
    assert judged.count("undecided") < 0.6 * len(judged)  # most of them: too little was seen of their trace


@pytest.mark.slow
def test_a_groove_that_ends_in_the_middle_of_the_face_leaves_the_profile():
    """Where some of the heights of a trace end, it must not step to the mean of the others: 24 um for 0.1."""
    ends = replace(
        SOUND, worn=tuple(Worn(t, "left", (0.0, 15.0), (14.75 + t / 40, 17.8), 0.06, 0.1) for t in (3, 8, 13))
    )
    found, true = inspected(ends, WIDE, points=320), truth(ends)
    for tooth in (3, 8, 13):
        for name in (*PROFILE, "f_Halpha"):
            c = line(found, name, tooth)
            assert abs(c.value - true[name, "left", tooth]) < 1.2 * c.U and c.verdict == "conforms", (name, tooth)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "expected"),
    tried(
        [(30, {2: "undecided", 5: "does_not_conform", 9: "undecided"})],
        (20, {2: "does_not_conform", 5: "does_not_conform", 9: "undecided"}),
        rarely=[(60, {5: "does_not_conform", 9: "undecided"}), (250, {})],
    ),
)
def test_a_limit_for_defects_decides_within_their_doubt(limit, expected):
    """Dents of 0.03 and 0.1 mm, limits on either side of them and within U of them; what lies on top is undecided."""
    dents = replace(
        SOUND, worn=(Worn(9, "left", (8.0, 10.0), (13.0, 16.0), -0.06, 0.15),),
        dents=(Dent(2, "left", 10.0, 15.0, 1.5, 0.03), Dent(5, "right", 10.5, 11.0, 1.5, 0.1)),
    )  # fmt: skip
    found = inspected(dents, replace(GEAR, accuracy_class=None, defect_depth=limit * UM), points=320)
    judged = {d.tooth: d for d in found.defects if d.verdict is not None and d.kind in ("dent", "bump")}
    assert {tooth: d.verdict for tooth, d in judged.items()} == expected
    assert all(abs(abs(d.depth) - {2: 0.03, 5: 0.1, 9: 0.06}[tooth]) < d.U for tooth, d in judged.items())


@pytest.mark.slow
def test_dents_touch_only_the_figures_that_read_them():
    """One on both traces, one on neither, one on the helix trace."""
    places = ((2, 8.2, 15.0), (7, 10.6, 19.0), (9, 8.0, 20.0))
    errors = replace(SOUND, dents=tuple(Dent(tooth, "left", *place, 0.75, 0.09) for tooth, *place in places))
    found, true = inspected(errors, WIDE, points=320), truth(errors)
    assert [verdict(found, "f_falpha", tooth) for tooth in (7, 9)] == ["conforms", "conforms"]
    assert verdict(found, "f_fbeta", 7) == "conforms"
    for name, tooth in (("f_falpha", 2), ("f_fbeta", 2), ("f_fbeta", 9)):
        c = line(found, name, tooth)
        assert abs(c.value - true[name, "left", tooth]) < c.U and c.verdict != "conforms", (name, tooth)
    assert sorted((d.kind, d.tooth) for d in found.defects if d.kind == "dent") == [
        ("dent", 2),
        ("dent", 7),
        ("dent", 9),
    ]


@pytest.mark.parametrize("edge", tried([], rarely=[0.14, 0.8]))
def test_wear_on_every_tooth_breaks_none(edge):
    """25 um over the same roll lengths of all left flanks: single teeth were chipped by 130 um, beside the wear."""
    worn_all = replace(SOUND, worn=tuple(Worn(t, "left", (5.68, 9.44), FACE, 0.025, edge) for t in range(1, 25)))
    found = inspected(worn_all, GEAR, simulation(4400, noise=0.004), 400)
    assert found.verdict != "does_not_conform"
    assert not [d for d in found.defects if d.kind == "chipped flank"]
    assert max((abs(d.depth) for d in found.defects if d.depth is not None), default=0.0) < 0.04


@pytest.mark.more
@pytest.mark.parametrize(("drawn", "reasons"), tried([((18,), [])], ((3,), []), ((17, 18), ["other_teeth"])))
def test_a_sector_gear_misses_the_teeth_that_it_is_drawn_without(drawn, reasons):
    """Its drawing counts from any tooth, the record from the first one at polar angle 0. One with teeth that the
    drawing leaves out ended 0."""
    errors = replace(SOUND, missing=(18,))
    found = inspected(errors, replace(GEAR, missing_teeth=drawn))
    assert [r.code for r in found.reasons] == reasons
    assert found.verdict == ("undecided" if reasons else "conforms")


@pytest.mark.more
def test_damage_that_the_recipe_only_reports_decides_nothing():
    found = inspected(replace(SOUND, missing=(18,)), replace(GEAR, damage_decides=False))
    assert [(d.kind, d.verdict) for d in found.defects] == [("missing tooth", None)]
    assert found.verdict == "undecided"  # the flanks of a tooth that was not seen


@pytest.mark.slow
def test_a_limit_of_the_drawing_goes_before_its_class_and_decides_what_it_limits():
    gear = replace(GEAR, limits={"F_r": (None, 0.5), "f_Halpha": (-0.001, 0.02)}, classes={"F_beta": 3})
    found = inspected(SOUND, gear)
    assert line(found, "F_r", None, None).verdict == "conforms"
    assert line(found, "f_Halpha").limits == (-0.001, 0.02) and line(found, "f_Halpha").standard == "drawing"
    assert line(found, "F_beta").standard == "ISO 1328-1:2013 class 3" and not line(found, "F_beta").capable
    assert line(found, "F_alpha").standard == "ISO 1328-1:2013 class 10"


@pytest.mark.slow
def test_with_reasons_no_line_is_judged():
    scan, known = scan_of(GEAR, DAMAGED), replace(true_calibration(), reasons=("nothing ties the table's angle",))
    found = inspect_gear(apply_calibration(scan, known), GEAR)
    assert found.verdict == "undecided"
    assert {c.verdict for c in found.characteristics} == {d.verdict for d in found.defects} | {None} == {None}
