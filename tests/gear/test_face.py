"""A recipe with another face, tip or root than the part's decides nothing: figures of the wrong stretch mislead."""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest

from gears import SPUR, scan_of, simulation, true_calibration
from truestand.apply.datum import datum_of
from truestand.core.surface import Surface, apply_calibration
from truestand.gear.face import other_diameters, other_face
from truestand.gear.flanks import find_toothing
from truestand.gear.geometry import involute
from truestand.gear.inspect import inspect_gear
from truestand.gear.teeth import fold

NARROW_FAN = simulation(fan=radians(12.0))
"""Sees the lower 12 mm of the face."""


@cache
def surface_of(how=None) -> Surface:
    return apply_calibration(scan_of(how=how), true_calibration())


def found(face_from: float, face_width: float, surface: Surface | None = None, height_U: float = 0.0) -> list[str]:
    drawn = replace(SPUR, face_from=face_from, face_width=face_width)
    surface = surface or surface_of()
    datum = datum_of(true_calibration(), drawn.datum, drawn.bore_clearance)
    return [m.code for m in other_face(surface, find_toothing(surface, involute(drawn), datum), height_U)]


@pytest.mark.parametrize(
    ("face_from", "face_width"), [(4.0, 20.0), (6.0, 20.0), (5.9, 18.2), (5.0, 22.0), (4.0, 22.0), (2.0, 20.0)]
)
def test_another_face_is_found(face_from, face_width):
    assert found(face_from, face_width) == ["other_face"]


@pytest.mark.parametrize(("face_from", "face_width"), [(5.0, 20.0), (5.4, 20.0), (4.7, 20.6), (5.3, 19.5)])
def test_seats_chamfers_and_tolerances_are_no_other_face(face_from, face_width):
    assert found(face_from, face_width) == []


def test_heights_that_are_not_known_move_a_face_but_make_none_longer():
    """Without the shoulder in view they are 0.5 mm unsure."""
    assert found(6.0, 20.0, height_U=0.5) == []
    assert found(5.9, 18.2, height_U=0.5) == found(6.3, 20.0, height_U=0.5) == ["other_face"]


def test_a_face_that_leaves_the_fan_is_no_other_face():
    assert found(5.0, 20.0, surface_of(NARROW_FAN)) == []


def test_a_shoulder_beside_the_toothing_is_no_toothing():
    """Turned down to the measuring circle: some of its points lie where flanks would."""
    surface = surface_of()
    radius, beyond = SPUR.teeth * SPUR.module / 2, surface.z > SPUR.face_to
    shrunk = radius / np.hypot(surface.x, surface.y)
    seen = np.where(beyond, [shrunk * surface.x, shrunk * surface.y], [surface.x, surface.y])
    assert found(5.0, 20.0, replace(surface, x=seen[0], y=seen[1])) == []


@pytest.mark.parametrize(
    ("drawn", "code"),
    [
        (replace(SPUR, root_diameter=46.0), "other_root"),
        (replace(SPUR, tip_diameter=50.8), "other_tip"),
        (replace(SPUR, tip_diameter=53.2), "other_tip"),
        (replace(SPUR, root_diameter=43.6, tip_diameter=51.8), None),
    ],
)
def test_another_tip_or_root_is_found(drawn, code):
    nominal, datum = involute(drawn), datum_of(true_calibration(), drawn.datum, drawn.bore_clearance)
    toothing = find_toothing(surface_of(), nominal, datum)
    found = other_diameters(fold(surface_of(), toothing), surface_of(), toothing)
    assert [m.code for m in found] == ([code] if code else [])


@pytest.mark.more
def test_of_another_face_nothing_is_decided():
    inspection = inspect_gear(surface_of(), replace(SPUR, face_width=22.0, root_diameter=42.0))
    assert [r.code for r in inspection.reasons] == ["other_face"]
    assert inspection.verdict == "undecided" and all(c.verdict is None for c in inspection.characteristics)
    assert "check root_diameter_mm" in next(r for r in inspection.remarks if r.code == "other_diameter")
