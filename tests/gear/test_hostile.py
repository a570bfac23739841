"""Scans and drawings that want a wrong number: each figure against the virtual stand's truth."""

from dataclasses import replace
from functools import lru_cache
from math import radians

import numpy as np
import pytest

from gears import SPUR, WORN, line, scan_of, simulation, true_calibration, truth_of
from truestand.core.surface import apply_calibration
from truestand.gear.inspect import inspect_gear
from truestand.sim import Chip, GearErrors
from variants import tried

UM = 1e-3
CHIPPED = replace(WORN, chips=tuple(Chip(tooth, 12.0, 17.0, 0.8) for tooth in range(1, 16)))
THIN = replace(WORN, thickness=-0.3, pitch_left=tuple(10 * p for p in WORN.pitch_left))
DIRTY = simulation(outliers=0.4, dropouts=0.6)
PHYSICAL = simulation(mixed_pixels=0.3, incidence_noise=True)


@lru_cache(maxsize=4)
def inspected(errors=WORN, how=None, gear=SPUR):
    scan = scan_of(SPUR, errors, how)
    return inspect_gear(apply_calibration(scan, replace(true_calibration(), reasons=())), gear)


def off(found, name, flank, errors=WORN):
    """um by which a pitch figure is off its truth."""
    return abs(line(found, name, flank).value / UM - truth_of(SPUR, errors)[f"{name}_{flank}_um"])


def places_off(found, errors):
    """um by which the worst tooth is off its place, right numbers taken for granted."""
    places = [truth_of(SPUR, errors)[f"position_{flank}_um"] for flank in ("left", "right")]
    apart = found.evidence.measures.index / UM - np.array(places, dtype=np.float64)
    return float(np.nanmax(np.abs(apart - np.nanmedian(apart, axis=1, keepdims=True))))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("errors", "how", "most"),
    tried([(CHIPPED, None, 1.5)], (WORN, DIRTY, 1.5), (THIN, None, 1.0), rarely=[(WORN, PHYSICAL, 5.0)]),
    ids=["15 chips", "40 % wild, 60 % lost", "thin and uneven", "physical"],
)
def test_every_tooth_is_where_it_is(errors, how, most):
    found = inspected(errors, how)
    assert places_off(found, errors) < most
    for flank in ("left", "right"):
        assert off(found, "F_p", flank, errors) < most and off(found, "f_p", flank, errors) < most


@pytest.mark.more
def test_slopes_survive_wild_and_lost_readings():
    """Cells that few teeth have compared a flank with itself: two flanks drifted off and took 4 um along."""
    truth = truth_of()
    for flank in ("left", "right"):
        for name, part in (("f_Halpha", "profile"), ("f_Hbeta", "helix")):
            expected = truth[part][f"{name}_{flank}_um"]
            assert line(inspected(how=DIRTY), name, flank).value / UM == pytest.approx(expected, abs=1.0)


@pytest.mark.more
@pytest.mark.parametrize("shift", [-3.0])
def test_a_face_drawn_too_low_or_too_high_takes_no_end_face_along(shift):
    found, truth = inspected(gear=replace(SPUR, face_from=SPUR.face_from + shift)), truth_of()
    assert places_off(found, WORN) < 1.0
    for flank in ("left", "right"):
        expected = truth["helix"][f"f_Hbeta_{flank}_um"]
        assert line(found, "f_Hbeta", flank).value / UM == pytest.approx(expected, abs=0.5)
    assert found.defects == ()
    assert any("check face_from_mm" in r for r in found.remarks)


@pytest.mark.more
@pytest.mark.parametrize("degrees", [0.0, -0.001], ids=["at 0", "a hair below"])
def test_tooth_1_at_angle_0_is_tooth_1(degrees):
    """The tooth that stands at angle 0, as near as anyone can tell, is no. 1: the simulator
    starts to count at the next one where it stands a hair below."""
    found = inspected(GearErrors(phase=radians(degrees), missing=(6 if degrees == 0.0 else 5,)))
    assert abs(found.evidence.first_tooth) < radians(0.01)
    assert [d.tooth for d in found.defects] == [6]


@pytest.mark.more
def test_any_other_phase_numbers_the_teeth_as_the_contract_says():
    errors = GearErrors(phase=radians(14.5), missing=(5,))
    assert [d.tooth for d in inspected(errors).defects] == truth_of(SPUR, errors)["missing"]
