"""Turned parts and CAD models by two sensors, one that looks down and one that looks up."""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest

from gears import UPRIGHT, simulation
from truestand.apply.transfer import roll
from truestand.apply.views import roll_views
from truestand.calibration.views import calibrate_views
from truestand.core.errors import BadRecipe
from truestand.core.scan import interpret
from truestand.core.surface import apply_calibration
from truestand.parts.cad import inspect_cad
from truestand.parts.drawings import Cad, Mesh, Section, Turned
from truestand.parts.inspect import inspect
from truestand.parts.turned import inspect_turned
from truestand.sim import FormWave, VirtualCad, VirtualTurned, Workpiece, paper_shaft, simulate
from views import AZIMUTH, two_sensors

UM = 1e-3
STAND = two_sensors(points=240, linearity_U=0.01)
FRONT = replace(simulation(2, True).mounting, **UPRIGHT)
REAR = replace(FRONT, phi=radians(-110.0), plane_offset=-0.2, azimuth=AZIMUTH)
LOWER, COLLAR, UPPER = Section("lower", 5, 10, 30.0), Section("collar", 10, 16, 44.0), Section("upper", 16, 24, 30.0)
STEPPED = Turned((LOWER, COLLAR, UPPER))
OVAL = VirtualTurned(STEPPED, Workpiece(form=(FormWave("collar", 2, 0.02, 0.3),), diameter_errors=(("upper", -0.03),)))
HIDDEN = Section("lower", 5, 10, 30.0), Section("collar", 10, 11.5, 60.0), Section("upper", 11.5, 24, 30.0)
"""A flange so wide that each sensor sees one side of it only."""


def taken(part, front=FRONT, rear=REAR):
    """Scans of the shaft, or of a part on it, by both: 1.1 turns at 2,000 profiles each."""
    base = simulation(2200, True)
    both = replace(
        base, acquisition=replace(base.acquisition, columns=("angle",)), views=(("front", front), ("rear", rear))
    )
    return tuple(
        interpret(simulate(STAND.of_view(v), both.seen_from(v), paper_shaft(), k, None, part).recording, STAND, view=v)
        for k, v in enumerate(("front", "rear"))
    )


@cache
def scans(part=None):
    return taken(part)


@cache
def calibrated():
    return calibrate_views(scans(), paper_shaft())


@cache
def surfaces(part=OVAL):
    return roll_views(scans(part), calibrated())


def line(inspection, section, name):
    return next(c for c in inspection.characteristics if (c.section, c.name) == (section, name))


def out_by(surface, by):
    """The surface as a sensor shows it that has moved away from the table's axis since it was calibrated, mm."""
    scan, calibration = surface.origin
    pose = calibration.table_from_sensor
    moved = replace(pose, translation=pose.translation + np.array([by, 0.0, 0.0]))
    return apply_calibration(scan, replace(calibration, table_from_sensor=moved))


@pytest.mark.more
def test_each_section_is_read_by_the_view_that_shows_it_best():
    found = inspect(surfaces(), STEPPED)
    assert not found.reasons and {c.status for c in found.characteristics} == {"measured"}
    for section, true in (("lower", 30.0), ("collar", 44.0), ("upper", 29.97)):
        d = line(found, section, "d")
        assert abs(d.value - true) < d.U and d.views in (("front",), ("rear",))
    roundness = line(found, "collar", "roundness")
    assert abs(roundness.value - 0.04) < roundness.U + 1 * UM
    assert {seam.section for seam in found.seams} <= {"lower", "collar", "upper"} and found.seams
    assert all(seam.ok and seam.views == ("front", "rear") for seam in found.seams)


@pytest.mark.more
def test_u_is_the_same_in_the_frame_of_another_view():
    """Points moved in a view's own frame, and normals were of the first one's: U of a diameter was 75 um for 0.3."""
    placed = inspect_turned(surfaces()[1], STEPPED)
    own = inspect_turned(roll(scans(OVAL)[1], calibrated()), STEPPED)
    for a, b in zip(placed.characteristics, own.characteristics, strict=True):
        assert pytest.approx(b.U, rel=0.25, abs=0.7 * UM) == a.U  # what is left of 1 um of noise scatters


@pytest.mark.slow
def test_sections_that_one_view_alone_sees():
    part = Turned(HIDDEN)
    both = roll_views(scans(VirtualTurned(part)), calibrated())
    alone, found = (inspect(s, part) for s in (both[0], both))
    ranks = {"measured": 2, "partial": 1, "not_measurable": 0}
    assert all(
        ranks[b.status] >= ranks[a.status] for a, b in zip(alone.characteristics, found.characteristics, strict=True)
    )
    assert {c.views for c in found.characteristics} == {("front",), ("rear",)}


def test_views_that_differ_contradict_each_other():
    front, rear = surfaces()
    found = inspect((front, out_by(rear, 0.15)), STEPPED)
    assert [r.code for r in found.reasons] == ["views_contradict"] and "section" in str(found.reasons[0])
    assert {c.verdict for c in found.characteristics} == {None}


def square_ring(half, bore, bottom, top):
    """A square block with a round bore, (Mesh)."""
    corners = [(half, -half), (half, half), (-half, half), (-half, -half)]
    edges = zip(corners, corners[1:] + corners[:1], strict=True)
    outer = np.vstack([np.linspace(a, b, 24, endpoint=False) for a, b in edges])
    inner = outer * (bore / np.hypot(*outer.T))[:, None]
    rings = [np.column_stack([ring, np.full(len(ring), h)]) for ring in (outer, inner) for h in (bottom, top)]
    n = len(outer)
    i, j = np.arange(n), (np.arange(n) + 1) % n
    low, high, low_in, high_in = (k * n for k in range(4))
    quads = ((low, i, low, j, high, j, high, i), (low_in, j, low_in, i, high_in, i, high_in, j),
             (high, i, high, j, high_in, j, high_in, i), (low, j, low, i, low_in, i, low_in, j))  # fmt: skip
    corners = [np.stack([k + at for k, at in zip(q[::2], q[1::2], strict=True)], axis=1) for q in quads]
    faces = np.vstack([c[:, pick] for c in corners for pick in ([0, 1, 2], [0, 2, 3])])
    return Mesh(np.vstack(rings), faces)


BLOCK = Cad(square_ring(17.0, 8.5, 6.0, 20.0), fit="none", limits=(-0.1, 0.1), reach=0.3)
ABOVE = replace(FRONT, phi=radians(-130.0), height=5.0)
BESIDE = replace(ABOVE, phi=radians(-122.0), plane_offset=-0.2, azimuth=AZIMUTH)
"""Both look down on the shoulder."""
PAIRS = {"both above": (ABOVE, BESIDE), "above and below": (ABOVE, replace(FRONT, azimuth=AZIMUTH))}


def test_the_second_view_alone_decides_nothing_of_a_model_where_the_pose_has_it():
    """It counts angles from its own side: a sound model was 0.7 mm off, and did not conform."""
    scan = taken(VirtualCad(BLOCK))
    front, rear = (inspect(roll(one, calibrated()), BLOCK) for one in scan)
    assert not front.reasons and "pose_of_first_view" in {r.code for r in rear.reasons}


@cache
def of_block(pair):
    """Its surfaces by two sensors."""
    return roll_views(taken(VirtualCad(BLOCK), *PAIRS[pair]), calibrate_views(taken(None, *PAIRS[pair]), paper_shaft()))


def test_two_views_of_a_model_are_one_cloud():
    both = of_block("both above")
    found = inspect(both, BLOCK)
    assert not found.reasons and "heights_between_views" not in {r.code for r in found.remarks}
    assert found.deviation.shape == (sum(s.x.shape[0] for s in both), both[0].x.shape[1])
    assert all(c.views == ("front", "rear") for c in found.characteristics)
    p95, rms = found.characteristics[:2]
    assert p95.value < p95.U < 40 * UM and rms.value < rms.U < 30 * UM
    (seam,) = found.seams
    assert seam.ok and abs(seam.difference) < seam.U < 40 * UM


@pytest.mark.more
def test_two_views_see_all_of_a_model_and_say_what_ties_them():
    """Its upper face and its lower one: nothing tells how far they are apart where only one sees the shoulder."""
    both = of_block("above and below")
    found, alone = inspect(both, BLOCK), [inspect_cad(s, BLOCK) for s in both]
    assert found.evidence.visible > max(a.evidence.visible for a in alone) + 0.15
    assert "heights_between_views" in {r.code for r in found.remarks} and found.verdict != "conforms"


@pytest.mark.more
def test_views_of_a_model_that_differ_contradict_each_other():
    front, rear = of_block("both above")
    found = inspect((front, out_by(rear, 0.15)), BLOCK)
    assert [r.code for r in found.reasons] == ["views_contradict"] and not found.seams[0].ok


def test_only_teeth_tell_how_a_part_was_clamped_again():
    with pytest.raises(BadRecipe, match="--part-turned of a part that is no gear"):
        inspect(surfaces(), STEPPED, (0, 3))
