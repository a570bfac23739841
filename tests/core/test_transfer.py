"""A calibration is applied only where something ties the two scans together."""

from dataclasses import replace

import pytest

from truestand.core.calibrate import calibrate
from truestand.core.stand import Table
from truestand.core.transfer import with_transfer_doubts
from truth import scan_of, shaft


@pytest.fixture(scope="module")
def by_index():
    return calibrate(scan_of("clockwise"), shaft())


def test_the_same_stand_leaves_no_doubt(by_index):
    assert with_transfer_doubts(scan_of("clockwise"), by_index).reasons == ()


def test_another_zero_of_the_angle_is_a_reason(by_index):
    scan = scan_of("mirrored, from above, clockwise")
    reasons = with_transfer_doubts(scan, by_index).reasons
    assert any("counts from an angle or encoder" in r for r in reasons)
    assert any("mirrored differently" in r for r in reasons)


def test_another_sense_of_rotation_is_a_reason(by_index):
    scan = scan_of("clockwise")
    turned = replace(scan, stand=replace(scan.stand, table=Table(scan.stand.table.speed, "ccw")))
    assert any("turns ccw" in r for r in with_transfer_doubts(turned, by_index).reasons)


def test_a_stated_start_angle_ties_an_unknown_start(by_index):
    scan = scan_of("clockwise")
    somewhere = replace(scan, stand=replace(scan.stand, table=replace(scan.stand.table, start="unknown")))
    assert with_transfer_doubts(somewhere, by_index).status == "untrusted"
    assert with_transfer_doubts(somewhere, by_index, start_stated=True).status == "valid"
