"""A damaged gear must not conform: what figures leave out stands in their U, or they are undecided.

Class 10 as in the issue: limits of f_p 33, F_alpha 44, f_falpha 35, f_Halpha 27, F_beta 50, f_fbeta 37 um.
"""

from dataclasses import replace
from functools import lru_cache
from math import radians

import numpy as np
import pytest

from gears import POINTS, SPUR, helical, scan_of, simulation, true_calibration
from truestand.core.surface import apply_calibration
from truestand.gear.inspect import inspect_gear
from truestand.sim import Chip, Dent, GearErrors, Worn
from variants import tried

UM = 1e-3
GEAR = replace(SPUR, accuracy_class=10)
SOUND = GearErrors(phase=radians(3.0))
WILD = simulation(outliers=0.2, dropouts=0.1)
UNEVEN = replace(SOUND, pitch_left=(0.0,) * 4 + (0.004,) + (0.0,) * 19)
FACE = (4.0, 26.0)
PROFILE, HELIX, PITCH = ("F_alpha", "f_falpha"), ("F_beta", "f_fbeta"), ("f_p",)


def worn(rolls, heights, depth, edge=0.1, errors=SOUND, tooth=5):
    return replace(errors, worn=(*errors.worn, Worn(tooth, "left", rolls, heights, depth, edge)))


@lru_cache(maxsize=4)
def inspected(errors, gear=GEAR, how=None, points=POINTS):
    """A sensor that reads steep flanks to 5 um and a good encoder."""
    scan = scan_of(gear, errors, how or simulation(), points)
    sensor = replace(scan.stand.sensor, incidence_U=0.005)
    stand = replace(scan.stand, sensors=(sensor,), table=replace(scan.stand.table, angle_U=1e-5))
    known = replace(true_calibration(bool(gear.helix_angle)), reasons=())
    return inspect_gear(apply_calibration(replace(scan, stand=stand), known), gear)


def verdict(found, name, tooth=5, flank="left"):
    return next(c for c in found.characteristics if (c.name, c.tooth, c.flank) == (name, tooth, flank)).verdict


DAMAGE = {
    "groove across": (2, (8.5, 9.8), FACE, 0.06, PROFILE),
    "groove along": (5, (0.0, 15.0), (14.0, 16.0), 0.06, (*PROFILE, *HELIX)),
    "along, off mid-face": (8, (0.0, 15.0), (19.0, 21.0), 0.06, HELIX),
    "near the root": (11, (4.0, 5.2), FACE, 0.06, PROFILE),
    "ridge": (14, (8.5, 9.8), FACE, -0.06, PROFILE),
    "spatter": (17, (8.0, 9.3), (13.0, 16.0), -0.3, (*PROFILE, *HELIX)),
    "crater": (20, (7.0, 9.5), (13.0, 17.0), 0.4, (*PROFILE, *HELIX)),
}
"""By name: the tooth, roll lengths, heights and depth, mm, and the figures whose traces touch it."""
DAMAGED = replace(SOUND, worn=tuple(Worn(tooth, "left", *where, 0.1) for tooth, *where, _ in DAMAGE.values()))


@pytest.mark.parametrize("name", DAMAGE)
def test_figures_that_touch_damage_are_undecided(name):
    tooth, *_, touched = DAMAGE[name]
    found = inspected(DAMAGED)
    for figure in touched:
        assert verdict(found, figure, tooth) == "undecided", figure
        assert verdict(found, figure, tooth + 1) == "conforms", figure
    line = next(c for c in found.characteristics if (c.name, c.tooth, c.flank) == (touched[0], tooth, "left"))
    assert line.reason is not None and line.reason.startswith(f"tooth {tooth} left, roll length")
    assert line.capable  # which is the stand's, not the part's
    assert any(line.reason in remark for remark in found.remarks)


@pytest.mark.parametrize("name", tried(["groove across"], "along, off mid-face"))
def test_one_damaged_tooth_leaves_the_gear_undecided(name):
    tooth, *where, touched = DAMAGE[name]
    found = inspected(worn(*where, tooth=tooth))
    assert found.verdict == "undecided"
    for figure in touched:
        assert verdict(found, figure, tooth) == verdict(found, figure, None) == "undecided", figure


def test_wear_over_the_pitch_point_leaves_pitch_undecided():
    """f_p is 30 um times the arc beyond what the flank reads elsewhere: 34 um, and 4 um without the wear."""
    found = inspected(worn((7.0, 9.5), FACE, 0.03, 1.25, UNEVEN))
    line = next(c for c in found.characteristics if (c.name, c.tooth, c.flank) == ("f_p", None, "left"))
    assert line.verdict == "undecided"
    assert abs(line.value - 34.2 * UM) < line.U


BESIDE = (9.6, 11.0), (18.0, 21.0)
"""Roll lengths and heights that neither the profile's nor the helix's trace touches."""
WORN_BESIDE = worn(*BESIDE, 0.03, errors=worn(*BESIDE, 0.2, tooth=9))


def test_damage_beside_the_traces_is_listed_and_leaves_traces_decided():
    found = inspected(WORN_BESIDE)
    assert {verdict(found, n) for n in (*PROFILE, *HELIX)} == {"conforms"}
    assert any("tooth 5 left" in remark and "below the flank" in remark for remark in found.remarks)


def test_crater_beside_the_traces_leaves_the_gear_undecided():
    found = inspected(WORN_BESIDE)
    assert {verdict(found, n, 9) for n in (*PROFILE, *HELIX)} == {"conforms"}
    (chip,) = (d for d in found.defects if d.verdict is not None)
    assert (chip.tooth, chip.flank, chip.kind, chip.verdict) == (9, "left", "chipped flank", "undecided")
    assert found.verdict == "undecided"


@pytest.mark.parametrize("depth", tried([0.04], 0.01))
def test_the_depth_of_a_groove_stands_in_u(depth):
    found = inspected(worn((8.5, 9.8), FACE, depth))
    line = next(c for c in found.characteristics if (c.name, c.tooth, c.flank) == ("f_falpha", 5, "left"))
    left_out = next(b.U for b in line.budget if b.name == "damage left out")
    assert left_out == pytest.approx(2 / np.sqrt(3) * depth, rel=0.1, abs=4 * UM)
    assert (line.verdict == "conforms") is (depth < 0.03)


BROKEN = replace(
    SOUND, missing=(18,), chips=(Chip(3, 15.0, 26.0, 2.0), Chip(8, 15.0, 26.0, 4.4), Chip(13, 12.0, 15.0, 0.12))
)


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


def test_a_broken_tooth_leaves_the_figures_of_its_flanks_undecided():
    found = inspected(BROKEN, points=320)
    for name in (*PROFILE, *HELIX):
        assert verdict(found, name, 8) == "undecided" and verdict(found, name, 10) == "conforms"
    assert verdict(found, "f_p", None) == "undecided"


def test_corner_broken_off_out_of_view_leaves_the_gear_undecided():
    """The sensor looks up at 42 degrees to the axis: of the break at the upper end it sees nothing."""
    found = inspected(replace(SOUND, chips=(Chip(5, 23.5, 26.0, 1.0),)), points=320)
    assert [(d.tooth, d.kind, d.verdict) for d in found.defects] == [(5, "hidden tip", "undecided")]
    assert found.verdict == "undecided"


def test_tip_broken_by_less_than_the_limit_conforms():
    found = inspected(replace(SOUND, chips=(Chip(5, 12.0, 15.0, 0.07),)))
    assert found.verdict == "conforms" and all(d.verdict is None for d in found.defects)


@pytest.mark.parametrize(
    ("how", "points"),
    tried(
        [(None, POINTS), (WILD, 240)],
        (WILD, 640),
        (simulation(outliers=0.4, dropouts=0.6), 640),
        (simulation(speckle=0.005), 320),
        (simulation(noise=0.02), POINTS),
    ),
    ids=["clean", "20 % wild, 10 % lost, sparse", "the same", "40 % wild, 60 % lost", "speckle", "noise of 20 um"],
)
def test_sound_gears_have_no_undecided_figure(how, points):
    found = inspected(SOUND, GEAR, how, points)
    assert found.verdict == "conforms"
    assert all(d.verdict is None for d in found.defects)
    if points == 640 and how == WILD:
        assert found.defects == ()


@pytest.mark.parametrize("helix", tried([15.0], -20.0))
def test_flanks_seen_at_grazing_incidence_are_no_damage(helix):
    """Seen at up to 88 degrees: where a cell is seen on most teeth and not on all."""
    gear = replace(helical(helix), accuracy_class=10)
    found = inspected(SOUND, gear, simulation(4400, upright=True), 400)
    doubted = [c for c in found.characteristics if c.reason is not None and c.tooth is not None]
    assert len(doubted) <= 3  # of 288


def test_dents_leave_undecided_only_the_figures_that_they_touch():
    """One on both traces, one on neither, one on the helix trace."""
    places = ((2, 8.2, 15.0), (7, 10.6, 19.0), (9, 8.0, 20.0))
    dents = tuple(Dent(tooth, "left", roll, height, 0.75, 0.1) for tooth, roll, height in places)
    found = inspected(replace(SOUND, dents=dents), points=320)
    assert [verdict(found, "f_falpha", tooth) for tooth in (2, 7, 9)] == ["undecided", "conforms", "conforms"]
    assert [verdict(found, "f_fbeta", tooth) for tooth in (2, 7, 9)] == ["undecided", "conforms", "undecided"]
    assert sorted((d.kind, d.tooth) for d in found.defects) == [("dent", 2), ("dent", 7), ("dent", 9)]
