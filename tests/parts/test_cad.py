"""The CAD comparison on exact surfaces: what is off is told, what isn't isn't."""

from dataclasses import replace
from functools import cache
from math import cos, degrees, radians, sin

import numpy as np
import pytest

from solids import calibration, circle, extruded, noisy, scanned, wheel
from truestand.core.errors import BadRecipe, NotEnoughData
from truestand.core.frames import shaft_from_rotor, table_from_sensor
from truestand.core.surface import Surface, apply_calibration
from truestand.parts.cad import inspect_cad
from truestand.parts.drawings import Cad, Mesh
from truestand.parts.rays import Rays, hits_near, solid_of
from truestand.uncertainty.influence import independent_parts, unknowns_of
from variants import tried

TURNED = radians(0.7)
UM = 1e-3


def turned(angle):
    pose = np.eye(4)
    pose[:2, :2] = [[cos(angle), -sin(angle)], [sin(angle), cos(angle)]]
    return pose


def rms(deviation):
    return float(np.sqrt(np.nanmean(np.square(deviation))))


def values(inspection):
    return {c.name: c.value for c in inspection.characteristics}


def lines(inspection, name):
    return {b.name: b.U for c in inspection.characteristics if c.name == name for b in c.budget}


@cache
def exact(fit="none"):
    _, mesh, scan, known = wheel()
    pose = turned(TURNED) if fit == "none" else np.eye(4)
    return inspect_cad(apply_calibration(scan, known), Cad(mesh, pose=pose, fit=fit, limits=(-0.05, 0.05)))


def test_an_exact_involute_deviates_by_nothing():
    """0.5 um rms is asked for; what is left is the flat triangles' own 0.1 um of sagitta."""
    _, _, scan, _ = wheel()
    found = exact()
    assert found.deviation.shape == scan.x.shape
    assert rms(found.deviation) < 0.05 * UM
    assert np.nanmax(np.abs(found.deviation)) < 0.5 * UM
    lost = 1.0 - np.isfinite(found.deviation).sum() / np.isfinite(scan.z).sum()
    assert lost < 0.005  # rays that graze
    assert found.verdict == "conforms"
    assert {c.status for c in found.characteristics} == {"measured"}
    assert all(abs(v) < 0.5 * UM for v in values(found).values())  # the largest sagitta is 0.25 um


@pytest.mark.more
@pytest.mark.parametrize("fit", tried(["angle", "all"], "angle_and_height"))
def test_rotation_of_a_wheel_is_found_nearest_to_the_recipe(fit):
    found = exact(fit)
    assert degrees(found.evidence.rotation) == pytest.approx(0.7, abs=2e-5)
    assert rms(found.deviation) < 0.05 * UM
    assert any("24 angles of the model fit alike" in r for r in found.remarks)
    assert np.allclose(found.evidence.shaft_from_model, turned(TURNED), atol=1e-4)


def test_wrong_pose_gives_deviations():
    """0.05 degrees at a reference radius of 24 mm, seen along the flank's normal: 24 cos(20 deg) times that."""
    _, mesh, scan, known = wheel()
    found = inspect_cad(apply_calibration(scan, known), Cad(mesh, pose=turned(TURNED + radians(0.05)), fit="none"))
    assert values(found)["deviation_max"] == pytest.approx(radians(0.05) * 24 * cos(radians(20)), rel=0.02)
    ends = abs(values(found)["deviation_min"]), values(found)["deviation_max"]
    assert values(found)["profile"] == pytest.approx(2 * max(ends), rel=0.01)
    assert values(found)["deviation_p95"] < 1.03 * ends[1]  # beyond lie edges, which another surface's ray met


@cache
def gap_toothed():
    """A wheel that lacks a tooth, anywhere on the shaft and a bit off its place."""
    own, _, _, known = wheel()
    mesh = extruded(own.outline(40, without=(3,)), own.bottom, own.top)
    return mesh, scanned(mesh, known, None, radians(137.0), (0.05, -0.03, 0.08), 600, 240), known


def test_part_without_symmetry_is_registered_from_any_angle():
    mesh, scan, known = gap_toothed()
    found = inspect_cad(apply_calibration(scan, known), Cad(mesh, fit="all"))
    assert not any("alike" in r for r in found.remarks)
    assert degrees(found.evidence.rotation) == pytest.approx(137.0, abs=1e-4)
    assert np.allclose(found.evidence.shaft_from_model[:3, 3], (0.05, -0.03, 0.08), atol=1e-4)
    assert rms(found.deviation) < 0.05 * UM


def test_deviation_along_a_motion_outside_the_fit_remains():
    mesh, scan, known = gap_toothed()
    height = inspect_cad(apply_calibration(scan, known), Cad(mesh, fit="angle_and_height"))
    assert height.evidence.shaft_from_model[2, 3] == pytest.approx(0.08, abs=0.005)
    aside = values(height)["deviation_max"]
    assert aside == pytest.approx(np.hypot(0.05, 0.03), rel=0.15)


def dented(depth):
    """The exact wheel's scan with a patch 3 mm wide pushed in on the lower face, along the rays."""
    _, _, scan, known = wheel()
    surface = apply_calibration(scan, known)
    with np.errstate(invalid="ignore"):
        inside = (np.hypot(surface.x - 15, surface.y) < 1.5) & (surface.z < 5.0001)
    assert inside.sum() > 100
    facing = cos(radians(41.802)) * cos(radians(0.3))  # of the rays in the middle of the fan
    longer = np.where(inside, depth / facing / np.hypot(scan.x, scan.z), 0.0)
    return replace(scan, x=scan.x * (1 + longer), z=scan.z * (1 + longer)), known, inside


def test_a_dent_is_negative_and_as_deep_as_it_is():
    _, mesh, _, _ = wheel()
    scan, known, inside = dented(0.08)
    found = inspect_cad(
        apply_calibration(scan, known), Cad(mesh, pose=turned(TURNED), fit="angle", limits=(-0.05, 0.05))
    )
    # A ray at the fan's edge leans by another 12 degrees: up to a quarter more or less.
    assert np.nanmedian(found.deviation[inside]) == pytest.approx(-0.08, rel=0.25)
    assert values(found)["deviation_min"] == pytest.approx(-0.08, rel=0.25)
    assert values(found)["deviation_max"] < 0.3 * UM
    decided = {c.name: c.verdict for c in found.characteristics}
    assert decided["deviation_min"] == decided["profile"] == "does_not_conform"
    assert decided["deviation_max"] == "conforms"
    assert decided["deviation_rms"] is None
    least = next(c for c in found.characteristics if c.name == "deviation_min")  # -68 +- 115 um, limit -50
    assert "farther out within them" in least.reason
    row, column = np.unravel_index(np.nanargmin(found.evidence.deviation), found.evidence.deviation.shape)
    assert abs(found.evidence.angle[column]) < 0.15
    assert found.evidence.height[row] == pytest.approx(5.0, abs=0.6)  # a patch


def test_noise_is_no_deviation():
    """5 um on every reading; 30,000 patches of some eight would read a largest deviation of 4 * 5 / sqrt(8) = 7 um."""
    _, mesh, scan, known = wheel()
    found = inspect_cad(apply_calibration(noisy(scan, 0.005), known), Cad(mesh, pose=turned(TURNED), fit="angle"))
    raw = found.evidence.deviation
    assert np.nanmax(np.abs(raw)) > 4 * UM
    assert values(found)["deviation_rms"] < 0.35 * UM
    assert abs(values(found)["deviation_max"]) < 0.6 * np.nanmax(raw)
    assert degrees(found.evidence.rotation) == pytest.approx(0.0, abs=2e-4)


def test_outliers_are_kept_and_do_not_count():
    _, mesh, scan, known = wheel()
    rng = np.random.default_rng(8)
    wild = rng.random(scan.z.shape) < 0.2
    reach = np.where(wild, rng.uniform(70, 120, scan.z.shape) / scan.z, 1.0)
    dirty = replace(scan, x=scan.x * reach, z=scan.z * reach)
    found = inspect_cad(apply_calibration(dirty, known), Cad(mesh, fit="angle"))
    assert degrees(found.evidence.rotation) == pytest.approx(0.7, abs=1e-4)
    assert values(found)["deviation_rms"] < 2 * UM
    assert values(found)["deviation_p95"] < 0.3 * UM
    off = np.isnan(found.deviation) & np.isfinite(dirty.z)
    assert 0.1 < off.sum() / np.isfinite(dirty.z).sum() < 0.25
    assert np.nanmax(np.abs(found.deviation)) > 0.3


def test_round_part_leaves_its_angle_free():
    known = calibration()
    mesh = extruded(circle(12.5), 15.0, 45.0)
    scan = scanned(mesh, known, None, profiles=300, points=160)
    found = inspect_cad(apply_calibration(scan, known), Cad(mesh, fit="angle"))
    assert any("leave open: angle" in r for r in found.remarks)
    assert found.evidence.rotation == pytest.approx(0.0, abs=1e-9)
    assert rms(found.deviation) < 0.1 * UM


def test_a_part_scanned_in_part_is_partial_and_nothing_is_nothing():
    _, mesh, scan, known = wheel()
    rows = slice(0, 368)
    half = replace(scan, x=scan.x[rows], z=scan.z[rows], angle=scan.angle[rows])
    part = Cad(mesh, pose=turned(TURNED), fit="none", limits=(-0.05, 0.05))
    found = inspect_cad(apply_calibration(half, known), part)
    assert {c.status for c in found.characteristics} == {"partial"}
    assert found.characteristics[0].coverage == pytest.approx(368 / 700, abs=0.06)
    assert found.verdict == "undecided"
    blind = replace(scan, x=scan.x * np.nan, z=scan.z * np.nan)
    nothing = inspect_cad(apply_calibration(blind, known), part)
    assert {(c.status, c.value) for c in nothing.characteristics} == {("not_measurable", None)}
    away = np.eye(4)
    away[2, 3] = 60.0
    elsewhere = inspect_cad(apply_calibration(scan, known), replace(part, pose=away))
    assert {(c.status, c.value) for c in elsewhere.characteristics} == {("not_measurable", None)}
    assert np.isnan(elsewhere.deviation).all()


@pytest.mark.slow
def test_budget_line_of_the_calibration_equals_drawn_calibrations():
    """An exact part deviates by the calibration's error alone; 20 draws tell its mean square to a quarter."""
    own, mesh, _, known = wheel()
    scan = scanned(mesh, known, own.sharpen, TURNED, profiles=300, points=160)
    part = Cad(mesh, pose=turned(TURNED), fit="none")
    expected = lines(inspect_cad(apply_calibration(scan, known), part), "deviation_rms")["calibration"] / 2
    rng = np.random.default_rng(5)
    parts, (p, height) = independent_parts(known), unknowns_of(known)
    drawn = []
    for _ in range(20):
        q = p + rng.standard_normal(len(parts)) @ parts
        off = replace(
            known, table_from_sensor=table_from_sensor(q[0], q[1], height, q[3], q[2]),
            shaft_from_rotor=shaft_from_rotor(*q[4:8]),
        )  # fmt: skip
        drawn.append(values(inspect_cad(apply_calibration(scan, off), part))["deviation_rms"])
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(expected, rel=0.3)


@pytest.mark.more
def test_the_fit_takes_up_what_it_may_move():
    held = {fit: lines(exact(fit), "deviation_max") for fit in ("none", "angle", "all")}
    assert held["all"]["calibration"] < held["angle"]["calibration"] < held["none"]["calibration"]
    assert held["angle"]["zero of the table angle (assumed)"] < held["none"]["zero of the table angle (assumed)"]
    _, mesh, scan, known = wheel()
    for fit, counts in (("none", True), ("all", False)):
        loose = inspect_cad(
            apply_calibration(scan, known), Cad(mesh, pose=turned(TURNED), fit=fit, bore_clearance=0.01)
        )
        assert ("bore clearance" in lines(loose, "deviation_max")) is counts


def test_surfaces_facing_away_are_no_hits():
    """A ray that starts within a plate before the surface leaves it, and goes on to the surface that faces it."""

    def plate(bottom, top):
        square = np.array([[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]])
        return extruded(square, bottom, top)

    low, high = plate(-3.0, 0.0), plate(0.5, 1.5)
    both = Mesh(np.vstack([low.vertices, high.vertices]), np.vstack([low.faces, high.faces + len(low.vertices)]))
    points = np.array([[1.0, 2.0, 0.01], [1.0, 2.0, 1.52], [1.0, 2.0, 5.0]])
    rays = Rays(points, np.tile([0.0, 0.0, -1.0], (3, 1)))
    hits = hits_near(solid_of(both, np.eye(4)), rays, 1.0)
    assert hits.deviation[:2] == pytest.approx([0.01, 0.02], abs=1e-12)
    assert np.isnan(hits.deviation[2])
    assert hits.triangle[2] == -1


def test_a_surface_without_its_scan_and_a_model_without_surface_are_refused():
    _, mesh, scan, known = wheel()
    with pytest.raises(BadRecipe, match="roll"):
        inspect_cad(Surface(*np.zeros((3, 2, 2))), Cad(mesh))
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(NotEnoughData, match="without surface"):
        inspect_cad(apply_calibration(scan, known), Cad(flat))


def test_readings_beside_the_model_are_no_part_of_it():
    """The shaft under the wheel comes along in the scan; it has no deviation and does not count."""
    own, mesh, _, known = wheel()
    shaft = extruded(circle(12.5, 400), -60.0, own.bottom)
    both = Mesh(np.vstack([mesh.vertices, shaft.vertices]), np.vstack([mesh.faces, shaft.faces + len(mesh.vertices)]))
    scan = scanned(both, known, None, TURNED, profiles=300, points=160, fan=0.8)
    surface = apply_calibration(scan, known)
    with np.errstate(invalid="ignore"):
        below = surface.z < own.bottom - 1.0
    assert below.sum() > 1000
    found = inspect_cad(surface, Cad(mesh, fit="angle"))
    assert np.isnan(found.deviation[below]).all()
    assert degrees(found.evidence.rotation) == pytest.approx(0.7, abs=1e-4)
    assert values(found)["deviation_rms"] < 0.05 * UM


def bowl(depth, radius):
    """The exact wheel's scan with a smooth bowl in the lower face, along the rays."""
    _, mesh, scan, known = wheel()
    surface = apply_calibration(scan, known)
    with np.errstate(invalid="ignore"):
        away = np.hypot(surface.x - 15, surface.y) / radius
        inside = (away < 1) & (surface.z < 5.0001)
    facing = cos(radians(41.802)) * cos(radians(0.3))
    longer = np.where(inside, depth * (1 - np.minimum(away, 1) ** 2) ** 2 / facing / np.hypot(scan.x, scan.z), 0.0)
    return mesh, replace(scan, x=scan.x * (1 + longer), z=scan.z * (1 + longer)), known


@pytest.mark.parametrize("radius", tried([0.8, 2.0], 1.2))
def test_dent_smaller_than_a_patch_is_undecided(radius):
    """0.1 mm deep, limits of 0.08 mm: a mean over the patch reads less, and its U says by how much."""
    mesh, scan, known = bowl(0.1, radius)
    found = inspect_cad(apply_calibration(scan, known), Cad(mesh, pose=turned(TURNED), limits=(-0.08, 0.08)))
    low = next(c for c in found.characteristics if c.name == "deviation_min")
    assert low.verdict != "conforms" and found.verdict != "conforms"
    assert low.value - low.U < -0.09
    high = next(c for c in found.characteristics if c.name == "deviation_max")
    assert high.verdict == "conforms"


@pytest.mark.parametrize(("depth", "radius"), tried([(0.1, 0.5)], (0.06, 0.6), (0.04, 0.7), (0.15, 0.6)))
def test_a_bowl_that_few_readings_meet_may_be_deeper_than_any_of_them(depth, radius):
    """Ten readings of 5 um of noise meet it: 0 ± 86 was read of 100 and conformed, 14 ± 15 of 40."""
    mesh, scan, known = bowl(depth, radius)
    found = inspect_cad(
        apply_calibration(noisy(scan, 0.005), known), Cad(mesh, pose=turned(TURNED), limits=(-0.08, 0.08))
    )
    low, high = (next(c for c in found.characteristics if c.name == f"deviation_{end}") for end in ("min", "max"))
    assert abs(low.value + depth) < low.U
    assert low.verdict == ("undecided" if depth > 0.08 else "conforms")
    assert (high.verdict, high.U < 0.025) == ("conforms", True)


@pytest.mark.parametrize("lost", tried([False], True), ids=["read behind", "not read"])
def test_missing_tooth_never_conforms(lost):
    """The rays that should meet it go on to what lies behind, or come back with nothing."""
    own, mesh, _, known = wheel()
    broken = extruded(own.outline(40, without=(3,)), own.bottom, own.top)
    scan = scanned(broken, known, None, TURNED, profiles=700, points=240)
    if lost:
        sound = scanned(mesh, known, None, TURNED, profiles=700, points=240)
        gone = np.isfinite(scan.z) & np.isfinite(sound.z) & (np.abs(scan.z - sound.z) > 0.5)
        scan = replace(scan, x=np.where(gone, np.nan, scan.x), z=np.where(gone, np.nan, scan.z))
    found = inspect_cad(apply_calibration(scan, known), Cad(mesh, pose=turned(TURNED), limits=(-0.08, 0.08)))
    assert found.verdict != "conforms"
    assert not {c.verdict for c in found.characteristics} & {"conforms"}
    (told,) = (r for r in found.remarks if "model surface" in r)
    assert float(told.split("polar angle ")[1].split()[0]) == pytest.approx(45.7, abs=1.5)  # three pitches, turned


@pytest.mark.more
@pytest.mark.parametrize("lost", tried([True], False), ids=["not read", "read behind"])
def test_a_hole_smaller_than_three_cells_never_conforms(lost):
    """Drilled into the lower face, 1.8 mm wide, met by forty rays: it conformed."""
    _, mesh, scan, known = wheel()
    surface = apply_calibration(scan, known)
    with np.errstate(invalid="ignore"):
        hole = (np.hypot(surface.x - 15, surface.y) < 0.9) & (surface.z < 5.0001)
    beyond = np.where(hole, np.nan if lost else 1.0 + 3.0 / scan.z, 1.0)
    scan = replace(scan, x=scan.x * beyond, z=scan.z * beyond)
    found = inspect_cad(
        apply_calibration(noisy(scan, 0.005), known), Cad(mesh, pose=turned(TURNED), limits=(-0.08, 0.08))
    )
    assert {c.verdict for c in found.characteristics if c.limits} == {"undecided"}
    (told,) = (r for r in found.remarks if "model surface" in r)
    assert ("no reading confirms it" if lost else "rays went through") in told


@pytest.mark.parametrize("share", tried([0.2], 0.1))
def test_outliers_and_lost_readings_leave_no_surface_unconfirmed(share):
    _, mesh, scan, known = wheel()
    rng = np.random.default_rng(8)
    wild, lost = rng.random(scan.z.shape) < 0.2, rng.random(scan.z.shape) < share
    reach = np.where(wild, rng.uniform(70, 120, scan.z.shape) / scan.z, 1.0)
    dirty = replace(scan, x=np.where(lost, np.nan, scan.x * reach), z=np.where(lost, np.nan, scan.z * reach))
    found = inspect_cad(apply_calibration(dirty, known), Cad(mesh, fit="angle", limits=(-0.08, 0.08)))
    assert not any("model surface" in r for r in found.remarks)
