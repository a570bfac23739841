"""What the shaft in view of a part's scan tells of a wobble that its calibration does not know."""

from dataclasses import replace

import numpy as np
import pytest

from gears import SPUR, calibrated, scan_of
from truestand.apply.transfer import roll, transfer, transfer_remarks
from truestand.gear.inspect import inspect_gear

UM = 1e-3


def wobbling(amplitude, waves=7):
    """The gear's scan with all readings farther away and nearer, ``waves`` times a turn; mm."""
    scan = scan_of()
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


def test_pitch_of_a_wobbling_scan_is_within_its_u():
    still, moved = (
        {(c.name, c.flank): c for c in inspect_gear(roll(s, replace(calibrated(), reasons=())), SPUR).characteristics
         if c.tooth is None} for s in (scan_of(), wobbling(5 * UM))
    )  # fmt: skip
    for key in (("f_p", "left"), ("f_p", "right"), ("F_p", "left"), ("F_p", "right"), ("F_r", None)):
        a, b = still[key], moved[key]
        assert abs(b.value - a.value) < b.U and b.U > a.U


def test_a_still_scan_has_none():
    applied = transfer(scan_of(), calibrated()).calibration
    assert applied.wobble is None or applied.wobble.amplitude < 0.3 * UM
