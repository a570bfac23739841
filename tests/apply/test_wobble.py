"""What the shaft in view of a part's scan tells of a wobble that its calibration does not know."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from gears import SPUR, calibrated, scan_of, simulation, stand
from truestand.apply.transfer import roll, transfer, transfer_remarks
from truestand.calibration.calibrate import calibrate
from truestand.core.scan import interpret
from truestand.gear.inspect import inspect_gear
from truestand.sim import paper_shaft, simulate
from variants import tried

UM = 1e-3


def wobbling(amplitude, waves=7, scan=None):
    """A scan, the gear's, with all readings farther away and nearer, ``waves`` times a turn; mm."""
    scan = scan or scan_of()
    by = amplitude * np.cos(waves * scan.angle)[:, None]
    # along T's X, as seen by the sensor
    x, _, z = calibrated().table_from_sensor.rotation.T @ np.array([1.0, 0.0, 0.0])
    return replace(scan, x=scan.x + by * x, z=scan.z + by * z)


@pytest.mark.parametrize("waves", [7, 11])
def test_a_wobble_is_told_and_stands_in_u(waves):
    """5 um, 7 times a turn: pitch was 4 U off, *does not conform*, without a word."""
    applied = transfer(wobbling(5 * UM, waves), calibrated()).calibration
    assert applied.wobble.waves == waves and applied.wobble.amplitude == pytest.approx(5 * UM, abs=0.3 * UM)
    assert [r.code for r in transfer_remarks(applied)] == ["wobble"]


@pytest.mark.slow
def test_pitch_of_a_wobbling_scan_is_within_its_u():
    still, moved = (
        {(c.name, c.flank): c for c in inspect_gear(roll(s, replace(calibrated(), reasons=())), SPUR).characteristics
         if c.tooth is None} for s in (scan_of(), wobbling(5 * UM))
    )  # fmt: skip
    for key in (("f_p", "left"), ("f_p", "right"), ("F_p", "left"), ("F_p", "right"), ("F_r", None)):
        a, b = still[key], moved[key]
        assert abs(b.value - a.value) < b.U and b.U > a.U


@pytest.mark.slow
def test_a_bearing_moves_the_part_sideways_as_well():
    """As far as to and fro, which the round shaft does not show: f_p was off by more than its U."""
    waves, size = 7, 5 * UM
    scan = wobbling(size, waves)
    still, turned = scan_of(), scan.angle + size / (SPUR.module * SPUR.teeth / 2) * np.sin(waves * scan.angle)
    round_about = calibrated().eccentricity  # the shaft, turned as well, would show a wave of e times the angle
    assert size * round_about / (SPUR.module * SPUR.teeth / 2) < 0.3 * UM
    known = replace(calibrated(), reasons=())
    a, b = (
        {(c.name, c.flank): c for c in inspect_gear(roll(s, known), SPUR).characteristics if c.tooth is None}
        for s in (still, replace(scan, angle=turned))
    )
    for key in product(("f_p", "F_p"), ("left", "right")):
        assert abs(b[key].value - a[key].value) < b[key].U


@pytest.mark.more
@pytest.mark.parametrize(("stated", "name"), tried([(None, "sideways motion of the table (assumed)")],
                                                   (0.005, "sideways motion of the table")))  # fmt: skip
def test_what_no_shaft_shows_of_the_bearing_is_assumed_or_stated(stated, name):
    """A worm pushed the shaft across the laser plane only, 8 um: f_p was 8 U off."""
    known, scan = replace(calibrated(), reasons=()), scan_of()
    scan = replace(scan, stand=replace(scan.stand, table=replace(scan.stand.table, sideways_U=stated)))
    lines = {(c.name, c.flank): c for c in inspect_gear(roll(scan, known), SPUR).characteristics if c.tooth is None}
    part = {b.name: b.U for b in lines["f_p", "left"].budget}
    assert part[name] == pytest.approx((stated or 1 * UM) * 1.5, rel=0.4)


@pytest.mark.slow
def test_a_bearing_that_wobbled_in_the_shafts_scan_as_well_stands_in_u():
    """It passes for form of the shaft, and the part's scan shows nothing new: F_p was 5.4 U off."""
    shaft = simulate(stand(), simulation(5500), paper_shaft(), 0)
    of_both = replace(calibrate(wobbling(6 * UM, 4, interpret(shaft.recording, stand())), paper_shaft()), reasons=())
    assert [w.waves for w in of_both.shared_waves if w.amplitude > UM] == [4]
    assert not [w for w in calibrated().shared_waves if w.amplitude > 0.3 * UM]
    still, moved = (
        {(c.name, c.flank): c for c in inspect_gear(roll(scan, known), SPUR).characteristics if c.tooth is None}
        for scan, known in ((scan_of(), replace(calibrated(), reasons=())), (wobbling(6 * UM, 4), of_both))
    )
    for key in product(("f_p", "F_p"), ("left", "right")):
        assert abs(moved[key].value - still[key].value) < moved[key].U
        assert "bearing, or form of the shaft, 4 times per turn" in {b.name for b in moved[key].budget}


def test_a_still_scan_has_none():
    applied = transfer(scan_of(), calibrated()).calibration
    assert applied.wobble is None or applied.wobble.amplitude < 0.3 * UM
