"""The axis a part is judged about: base, seat, or both, with what is open on it."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest

from poses import is_proper
from truestand.apply.datum import CLEARANCE, datum_of
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.assumptions import COAXIALITY_U
from truestand.core.calibration import Calibration, Positions, StepAxis
from truestand.core.errors import BadRecipe
from truestand.core.frames import Pose
from truestand.core.stand import Stand

BASE = Cylinder("base", 25.0, -60.0, 0.0)
SEAT = Cylinder("bearing", 13.94, 0.0, 35.0, coaxiality_U=0.004)
AXIS = StepAxis("bearing", 0.02, -0.01, 5e-4, 1e-4, 10.0, 0.001)
"""At height 10; the seat's middle is at 17.5."""


def calibration(*cylinders, axes=()):
    still = Pose.from_matrix(np.eye(4))
    positions = Positions((0.0, np.pi), ("", ""), axes, (), (), ()) if axes else None
    artefact = Artefact(cylinders) if cylinders else None
    return Calibration("stand", still, still, Stand(), "angle", "index", artefact=artefact, positions=positions)


def axis_at(datum, height):
    """Where the datum axis passes a height of C: x, y."""
    way = datum.pose.inverse.rotation[:, 2]
    point = datum.pose.inverse.translation
    return (point + way * (height - point[2]) / way[2])[:2]


def test_the_base_is_c_itself():
    datum = datum_of(calibration(BASE, SEAT), "base")
    assert np.array_equal(datum.pose.matrix, np.eye(4))
    assert (datum.U_offset, datum.U_slope, datum.contributions) == (0.0, 0.0, ())
    assert datum.expanded(30.0) == 0.0


def test_a_seat_is_as_coaxial_as_its_certificate_says():
    datum = datum_of(calibration(BASE, SEAT), "seat")
    assert np.allclose(datum.pose.matrix, np.eye(4))
    assert datum.U_offset == datum.expanded(17.5) == pytest.approx(0.004)
    assert datum.expanded(35.0) == pytest.approx(hypot(0.004, 0.004 / 35 * 17.5))


def test_what_no_certificate_says_is_assumed_and_said():
    for found in (calibration(BASE, replace(SEAT, coaxiality_U=None)), calibration()):
        datum = datum_of(found, "seat")
        assert datum.U_offset == COAXIALITY_U
        assert "(assumed)" in datum.contributions[0].name
        assert any("(assumed)" in c.name for c in datum.lines(60.0))


def test_a_measured_axis_is_taken_as_found():
    datum = datum_of(calibration(BASE, SEAT, axes=(AXIS,)), "seat")
    for height in (0.0, 10.0, 35.0):
        expected = (0.02 + 5e-4 * (height - 10.0), -0.01 + 1e-4 * (height - 10.0))
        assert np.allclose(axis_at(datum, height), expected, atol=1e-12)
    assert is_proper(datum.pose)
    assert datum.U_offset == 0.001
    assert datum.U_slope == pytest.approx(0.001 * sqrt(12) / 35)


def test_the_common_axis_goes_through_both_middles():
    datum = datum_of(calibration(BASE, SEAT, axes=(AXIS,)), "common")
    assert np.allclose(axis_at(datum, -30.0), 0.0, atol=1e-12)
    assert np.allclose(axis_at(datum, 17.5), (0.02 + 5e-4 * 7.5, -0.01 + 1e-4 * 7.5), atol=1e-12)
    assert datum.expanded(-30.0) == 0.0
    assert datum.expanded(17.5) == pytest.approx(0.001)


def test_clearance_lets_the_part_sit_anywhere_within_its_half():
    datum = datum_of(calibration(BASE, SEAT), "base", 0.02)
    assert [c.name for c in datum.contributions] == [CLEARANCE]
    assert datum.U_offset == datum.expanded(50.0) == pytest.approx(0.02 / sqrt(3))
    both = datum_of(calibration(BASE, SEAT), "seat", 0.02)
    assert both.expanded(17.5) == pytest.approx(hypot(0.004, 0.02 / sqrt(3)))
    assert [c.name for c in both.lines(17.5)] == [CLEARANCE, "coaxiality of the datum"]


def test_a_cylinder_named_seat_is_the_seat():
    collar = Cylinder("collar", 20.0, 0.0, 5.0, coaxiality_U=0.5)
    seat = Cylinder("seat", 13.94, 5.0, 35.0, coaxiality_U=0.003)
    assert datum_of(calibration(BASE, collar, seat), "seat").U_offset == 0.003


def test_a_shaft_without_seat_is_refused():
    with pytest.raises(BadRecipe, match="one cylinder only"):
        datum_of(calibration(BASE), "common")
