"""Turned parts and CAD parts on the virtual stand: their readings lie on the drawing, or on the model."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
import trimesh

from sim.test_gear import EXACT, STEEP, in_shaft, scanned
from truestand.core.errors import BadRecipe
from truestand.parts.drawings import Cad, Mesh, Section, Turned
from truestand.sim import Optics, VirtualCad, Workpiece, truth_record, virtual_part_from

DRAWN = Turned((Section("collar", 5.0, 12.0, 40.0), Section("neck", 12.0, 22.0, 30.0)), "flange")


def block():
    """An octagonal block around the shaft, 50 mm across corners."""
    solid = trimesh.creation.cylinder(radius=25.0, height=20.0, sections=8)
    return Cad(Mesh(np.asarray(solid.vertices), np.asarray(solid.faces, dtype=np.int64)), pose=lifted(15.0))


def lifted(height):
    pose = np.eye(4)
    pose[2, 3] = height
    return pose


def test_a_turned_part_has_its_sections_with_their_errors():
    table = {"form": [{"surface": "collar", "upr": 3, "amplitude_um": 20.0, "phase_deg": 30.0}],
             "diameter": [{"surface": "neck", "error_um": 50.0}],
             "misalignment": [{"surface": "neck", "offset_x_um": 40.0}]}  # fmt: skip
    made = scanned(virtual_part_from(DRAWN, table))
    x, y, h = in_shaft(made)
    r, psi = np.hypot(x, y), np.arctan2(y, x)
    collar = (h > 5.1) & (h < 11.9) & (r > 19)
    assert collar.sum() > 5000
    assert np.allclose(r[collar], 20.0 + 0.02 * np.cos(3 * psi[collar] - radians(30.0)), atol=1e-6)
    neck = (h > 12.1) & (h < 21.9)
    assert neck.sum() > 5000
    assert np.allclose(np.hypot(x - 0.04, y)[neck], 15.025, atol=1e-6)
    lower_end = np.abs(h - 5.0) < 1e-6
    assert (r[lower_end] > 13).any()
    assert ((np.abs(r - 12.5) < 1e-6) & (h < 0)).sum() > 10_000
    told = truth_record(made.truth)["part"]
    assert told["sections"][0]["roundness_um"] == pytest.approx(40.0)
    assert told["sections"][1]["diameter_mm"] == pytest.approx(30.05)
    assert told["sections"][1]["offset_x_um"] == pytest.approx(40.0)


def test_unknown_errors_of_a_turned_part_are_refused():
    with pytest.raises(BadRecipe, match="did you mean 'diameter'"):
        virtual_part_from(DRAWN, {"diametre": []})


def test_readings_of_a_cad_part_lie_on_its_model():
    part = VirtualCad(block(), turned=radians(10.0), lifted=0.5)
    made = scanned(part, workpiece=Workpiece(clamped=radians(5.0)))
    x, y, h = in_shaft(made)
    on = (h > 5.51) & (h < 25.49) & (np.hypot(x, y) > 20)
    assert on.sum() > 20_000
    flat = 25.0 * np.cos(np.pi / 8)
    psi = np.arctan2(y, x)[on] - radians(15.0)
    across = np.hypot(x, y)[on] * np.cos((psi % (np.pi / 4)) - np.pi / 8)
    assert np.abs(across - flat).max() < 1e-8
    assert np.abs(truth_record(made.truth)["part"]["shaft_from_model"][2][3] - 15.5) < 1e-12


def test_a_part_hides_the_shaft_from_the_camera():
    """Between sensor and shaft stands a wall that the laser passes and the camera does not see through."""
    wall = trimesh.creation.box((4.0, 30.0, 60.0))
    pose = np.eye(4)
    pose[:3, 3] = 40.0, 26.0, -10.0
    cad = Cad(Mesh(np.asarray(wall.vertices), np.asarray(wall.faces, dtype=np.int64)), pose=pose)
    optics = replace(EXACT, triangulation=radians(25.0))
    free, walled = (scanned(VirtualCad(cad), STEEP, o, profiles=40).recording.z for o in (EXACT, optics))
    base = ~np.isnan(scanned(None, STEEP, optics, profiles=40).recording.z)
    assert np.isfinite(free).sum() > np.isfinite(walled).sum()
    assert (base & np.isfinite(free) & np.isnan(walled)).sum() > 200


def test_default_optics_are_as_they_were_without_a_part():
    """A part brings the greatest incidence in; the shaft alone is scanned as ever."""
    assert Optics().most_incidence == pytest.approx(radians(88.0))
    once, again = (scanned(None, optics=replace(Optics(), most_incidence=m), profiles=40) for m in (0.5, 1.5))
    assert np.array_equal(once.recording.z, again.recording.z, equal_nan=True)
