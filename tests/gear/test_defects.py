"""Defects that the virtual gear has are found where they are, and only those."""

import re
from dataclasses import replace
from functools import lru_cache
from math import radians

import pytest

from gears import DENTED, POINTS, SPUR, scan_of, simulation, true_calibration
from truestand.core.surface import apply_calibration
from truestand.gear.geometry import involute
from truestand.gear.inspect import inspect_gear
from truestand.sim import Chip, Dent, GearErrors, Worn

PERFECT = GearErrors(phase=radians(3.0))
BROKEN = replace(
    PERFECT,
    missing=(12,),
    chips=(Chip(7, 20.0, 25.0, 0.8), Chip(17, 10.0, 15.0, 0.5)),
    dents=(Dent(2, "left", 8.5, 15.0, 0.8, -0.04),),
    eccentricity=0.1,
)


@lru_cache(maxsize=4)
def inspected(errors, how=None, gear=SPUR, points=POINTS):
    return inspect_gear(apply_calibration(scan_of(SPUR, errors, how, points), true_calibration()), gear)


def is_at(defect, dent):
    same = (defect.kind, defect.tooth, defect.flank) == ("dent", dent.tooth, dent.flank)
    return same and abs(defect.roll_length - dent.roll_length) < 0.5 and abs(defect.height - dent.height) < 0.5


def test_a_chipped_edge_of_the_tip_that_reaches_little_into_the_range_does_not_conform():
    """An outsider's, 0.35 mm deep at the tip: four cells of it lay in one row of the range, *conforms*."""
    end = involute(SPUR).profile_range[1]
    found = inspected(replace(PERFECT, worn=(Worn(9, "right", (end - 0.1, end + 2.0), (14.0, 15.3), 0.2, 0.05),)))
    (chip,) = [d for d in found.defects if d.kind == "chipped flank"]
    assert (chip.tooth, chip.flank, chip.verdict) == (9, "right", "does_not_conform")
    assert chip.depth == pytest.approx(0.2, abs=0.01)


EDGE = involute(SPUR).profile_range[1], 99.0
"""Roll lengths (mm) from the range of profiles to beyond the tip."""
CHIPPED_EDGE = Worn(9, "right", EDGE, (13.6, 15.2), 0.4, 0.6)


def test_a_chipped_edge_of_the_tip_beyond_the_range_does_not_conform():
    """An outsider's find: no line reads the last 5 % at the tip, and the gear conformed."""
    (chip,) = inspected(replace(PERFECT, worn=(CHIPPED_EDGE,))).defects
    assert (chip.kind, chip.tooth, chip.flank, chip.verdict) == ("chipped flank", 9, "right", "does_not_conform")
    assert 14.0 < chip.height < 14.8 and 0.1 < chip.depth < 0.4


@pytest.mark.more
def test_chamfered_tips_are_no_chips_and_hide_none():
    chamfer = Worn(None, "right", EDGE, (4.0, 26.0), 0.2, 0.6)
    assert inspected(replace(PERFECT, worn=(chamfer,))).defects == ()
    (chip,) = inspected(replace(PERFECT, worn=(chamfer, CHIPPED_EDGE))).defects
    assert (chip.kind, chip.tooth, chip.verdict) == ("chipped flank", 9, "does_not_conform")


@pytest.mark.more
def test_a_chamfer_that_reaches_into_the_range_on_one_tooth_is_no_chip():
    """An outsider's: chamfers of 0.2 mm, a third more or less from tooth to tooth; one tooth of 30 failed by 226 um."""
    chamfers = tuple(Worn(n, "right", (EDGE[0] + 0.1 * (n != 10) - 0.12, 99.0), (4.0, 26.0), 0.25, 0.6)
                     for n in range(1, 25))  # fmt: skip
    found = inspected(replace(PERFECT, worn=chamfers))
    assert not [d for d in found.defects if d.verdict]
    assert "chamfered_tips" not in [r.code for r in found.remarks]


@pytest.mark.more
def test_chamfers_of_most_teeth_that_reach_into_the_range_are_told():
    begins = EDGE[0] - 0.4
    chamfer = Worn(None, "right", (begins, 99.0), (4.0, 26.0), 0.25, 0.6)
    (remark,) = (r for r in inspected(replace(PERFECT, worn=(chamfer,))).remarks if r.code == "chamfered_tips")
    assert "right" in str(remark) and "tip_form_diameter_mm" in str(remark)
    (diameter,) = re.findall(r"from diameter ([\d.]+) mm", str(remark))
    begins = 2 * float(involute(SPUR).radius(begins))
    assert begins - 0.3 < float(diameter) < begins + 0.02  # no higher, or the range would hold a part of it


@pytest.mark.slow
def test_dents_of_30_to_100_um_are_found_with_no_false_alarm():
    found = [d for d in inspected(DENTED, points=400).defects if d.kind != "chipped flank"]
    hits = [(dent, d) for dent in DENTED.dents for d in found if is_at(d, dent)]
    assert len({dent.tooth for dent, _ in hits}) >= 7
    assert len(found) == len(hits)
    for dent, d in hits:
        assert d.depth == pytest.approx(dent.depth, rel=0.2)  # of the deepest cell
        assert d.extent == pytest.approx(dent.radius, rel=0.5)


@pytest.mark.slow
def test_teeth_that_miss_parts():
    """On a toothing that runs 0.1 mm off the datum: tips that are low on one side are no chips."""
    found = sorted((d.kind, d.tooth) for d in inspected(BROKEN, points=320).defects)
    assert found == [("bump", 2), ("chipped end", 7), ("chipped tip", 17), ("missing tooth", 12)]
    chip = next(d for d in inspected(BROKEN, points=320).defects if d.tooth == 7)
    assert chip.depth == pytest.approx(0.8, abs=0.05) and chip.height == pytest.approx(22.4, abs=0.5)


@pytest.mark.parametrize(
    ("broken", "kind", "verdict"),
    [
        (Worn(7, "right", (6.5, 14.0), (4.0, 5.9), 0.15), "chipped flank", "does_not_conform"),
        (Worn(7, "left", (6.5, 14.0), (24.1, 26.0), 0.4), "hidden end", "undecided"),
        (Worn(7, "left", (7.5, 11.0), (24.1, 26.0), 0.4), "hidden end", "undecided"),
    ],
)
def test_a_flank_broken_beyond_the_range_of_helices_is_told(broken, kind, verdict):
    """An outsider's find: no line reads the last millimetre of a face, and the gear conformed. Seen at a grazing angle,
    the floor of a break may show nothing.
    """
    (found,) = (d for d in inspected(replace(PERFECT, worn=(broken,))).defects if d.kind not in ("dent", "bump"))
    assert (found.kind, found.tooth, found.flank, found.verdict) == (kind, 7, broken.flank, verdict)
    low, high = broken.heights
    assert low < found.height < high
    assert found.depth is None or found.depth == pytest.approx(broken.depth, abs=found.U)


@pytest.mark.more
@pytest.mark.parametrize("heights", [(4.0, 5.9), (24.1, 26.0)])
def test_edges_that_are_rounded_on_all_teeth_are_no_chips(heights):
    found = inspected(replace(PERFECT, worn=(Worn(None, "left", (6.5, 14.0), heights, 0.4),))).defects
    assert not [d for d in found if d.kind not in ("dent", "bump")]


@pytest.mark.more
def test_half_of_the_teeth_missing():
    found = inspected(replace(PERFECT, missing=tuple(range(1, 13))))
    assert sorted((d.kind, d.tooth) for d in found.defects) == [("missing tooth", n) for n in range(1, 13)]
    tip = next(c for c in found.characteristics if c.name == "d_a")
    assert tip.value == pytest.approx(52.0, abs=0.02)


@pytest.mark.more
def test_a_tip_that_is_lower_than_drawn_is_no_defect():
    found = inspected(PERFECT, None, replace(SPUR, tip_diameter=52.3))
    assert found.defects == ()
    assert next(c for c in found.characteristics if c.name == "d_a").value == pytest.approx(52.0, abs=0.01)


@pytest.mark.more
def test_a_rough_tip_is_no_row_of_defects():
    assert inspected(PERFECT, simulation(noise=0.05)).defects == ()
