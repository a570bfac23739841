"""The table's angle without an encoder: turns free it of what doesn't repeat; clean scans stay as they are."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gears import SPUR, WORN, scan_of, simulation, true_calibration, truth_of
from truestand.core.surface import apply_calibration
from truestand.gear.inspect import inspect_gear
from variants import tried

UM = 1e-3
TURNS = simulation(8800)


@lru_cache(maxsize=4)
def turned(name, how=TURNS):
    """The inspection of a scan whose table really stood elsewhere than its index says."""
    scan = scan_of(SPUR, WORN, how)
    few = replace(scan, angle=scan.angle + ERRORS[name](scan.angle))
    return inspect_gear(apply_calibration(few, replace(true_calibration(), reasons=())), SPUR)


ERRORS = {
    "steady": lambda a: 0 * a,
    "line": lambda a: 2e-3 * np.sin(7.3 * a),
    "drift": lambda a: 4e-3 * (a / a[-1]) ** 2,
    "two lines": lambda a: 2e-3 * np.sin(7.3 * a) + 1e-3 * np.sin(3.62 * a + 1),
    "wander": lambda a: np.cumsum(np.random.default_rng(3).normal(0.0, 2e-5, a.size)),
}


def pitch(found, flank):
    return next(c.value for c in found.characteristics if (c.name, c.flank) == ("F_p", flank)) / UM


@pytest.mark.slow
@pytest.mark.parametrize("name", tried(["two lines"], "line", "drift"))
def test_several_turns_correct_an_angle_error_that_does_not_repeat(name):
    """Before: more than 25 um of F_p too much, whatever was repeated; 8800 profiles are 2.2 turns."""
    found = turned(name)
    for flank in ("left", "right"):
        assert pitch(found, flank) == pytest.approx(truth_of()[f"F_p_{flank}_um"], abs=1.5)
    assert not found.reasons
    assert any("freed it of" in r for r in found.remarks)


@pytest.mark.more
def test_steady_table_needs_no_correction():
    found = turned("steady")
    assert not any("freed" in r for r in found.remarks) and not found.reasons
    for flank in ("left", "right"):
        assert pitch(found, flank) == pytest.approx(truth_of()[f"F_p_{flank}_um"], abs=0.6)


@pytest.mark.more
def test_unexplained_unevenness_leaves_the_gear_undecided():
    """Its mean over the turns stays open, and looks like pitch."""
    found = turned("wander")
    assert any("turned unevenly" in r for r in found.reasons) and found.verdict == "undecided"


@pytest.mark.slow
def test_too_few_turns_are_reported_as_uneven():
    """A turn and a half: half of the flanks came by twice, too few to correct by, enough to see it."""
    found = turned("line", simulation(6000))
    assert any("turned unevenly" in r for r in found.reasons) and found.verdict == "undecided"


@pytest.mark.more
def test_measured_angle_is_not_corrected():
    scan = scan_of(SPUR, WORN, TURNS)
    few = replace(scan, angle_source="angle")
    found = inspect_gear(apply_calibration(few, replace(true_calibration(), reasons=())), SPUR)
    assert not any("steady speed" in r for r in found.remarks) and not found.reasons


@pytest.mark.more
@pytest.mark.parametrize(
    ("error", "told"),
    [(lambda a: 9e-4 * (a > 3.3), "um (rms) apart, 6.1 at most"), (lambda a: 1.1e-4 * a, "um (rms) apart"),
     (lambda a: 3e-5 * np.sin(0.7 * a), None)],
    ids=["a jump by five counts", "other counts per turn", "within its U"],
)  # fmt: skip
def test_a_measured_angle_that_turns_contradict_decides_nothing(error, told):
    """A pitch that jumped by 21 um was *does not conform*, at U 1.9, on a gear that does."""
    scan = scan_of(SPUR, WORN, simulation(5600))
    off = replace(scan, angle_source="angle", angle=scan.angle + error(scan.angle))
    found = inspect_gear(apply_calibration(off, replace(true_calibration(), reasons=())), SPUR)
    assert [r.code for r in found.reasons] == (["turns_contradict"] if told else [])
    assert told is None or told in found.reasons[0]


@pytest.mark.more
@pytest.mark.parametrize("source", ["index", "angle"])
def test_flanks_that_are_not_found_again_are_no_damage(source):
    """A table 0.3 % faster: flanks of the second turn lay beyond the gate, and were chipped by 0.4 mm."""
    scan = scan_of(SPUR, WORN, simulation(4800))
    faster = replace(scan, angle_source=source, angle=scan.angle * 1.003)
    found = inspect_gear(apply_calibration(faster, replace(true_calibration(), reasons=())), SPUR)
    assert "turns_contradict" in [r.code for r in found.reasons] and found.verdict == "undecided"
