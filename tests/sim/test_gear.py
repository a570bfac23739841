"""Gears on the virtual stand against the involute written out once more: every reading must lie where it was put."""

import json
from dataclasses import replace
from math import radians

import numpy as np
import pytest

from command import run
from truestand.core.errors import BadRecipe
from truestand.gear.drawing import Gear, Modification
from truestand.sim import (
    Acquisition,
    Chip,
    Dent,
    FlankErrors,
    GearErrors,
    Misalignment,
    Mounting,
    Optics,
    Running,
    Simulation,
    VirtualGear,
    Workpiece,
    paper_shaft,
    paper_stand,
    simulate,
    simulation_from,
    truth_record,
    virtual_part_from,
)
from truestand.sim.gear_mesh import gear_mesh
from truestand.sim.gear_surface import GearSurface

UM = 1e-3
EXACT = Optics(noise=0.0, step_z=0.0, step_x=0.0, fan=radians(30.0))
STEEP = Mounting(phi=radians(-70.0), plane_offset=0.1, height=0.0, standoff=105.0)
"""A sensor that looks more squarely at the teeth: both flanks of a helical gear are lit."""
HELIX = {0: (52.0, 43.0), 15: (53.7, 44.6), -15: (53.7, 44.6)}
LEFT, RIGHT = 1, -1


def gear(beta=0, **changes):
    tip, root = HELIX[beta]
    return Gear(24, 2.0, 20.0, 5.0, tip, root, helix_angle=radians(beta), **changes)


def scanned(part, mounting=STEEP, optics=EXACT, workpiece=None, profiles=300):
    """One turn."""
    base = paper_stand()
    stand = replace(base, sensors=(replace(base.sensor, profile_rate=profiles / 20.0),))
    simulation = Simulation(mounting, Running(0.5, 1.0, 0.001, 2.0), workpiece or Workpiece(), optics,
                            Acquisition(profiles))  # fmt: skip
    return simulate(stand, simulation, paper_shaft(), 1, part=part)


def in_shaft(made):
    """The readings that were seen, (3, n) in C, by the truth's matrices."""
    x, z = made.recording.x, made.recording.z
    fixed = np.einsum("ij,jnm->inm", made.truth.table_from_sensor, np.stack([x, 0 * x, z, np.ones_like(x)]))
    c, s = np.cos(made.truth.angle)[:, None], np.sin(made.truth.angle)[:, None]
    turned = np.stack([c * fixed[0] + s * fixed[1], c * fixed[1] - s * fixed[0], fixed[2], fixed[3]])
    return np.einsum("ij,jnm->inm", made.truth.shaft_from_rotor, turned)[:3, np.isfinite(z)]


def deviations(points, drawn, phase_deg=3.0):
    """tooth (from 1), delta (mm), roll length, height of the readings nearest each flank's surface: {side: (4, n)}."""
    x, y, h = points
    beta, z = drawn.helix_angle, drawn.teeth
    d = z * drawn.module / np.cos(beta)
    alpha_t = np.arctan(np.tan(drawn.pressure_angle) / np.cos(beta))
    rb = d / 2 * np.cos(alpha_t)
    r = np.hypot(x, y)
    on = (r > rb + 0.02) & (r < drawn.tip_diameter / 2 - 0.003) & (h > 5.003) & (h < 24.997)
    x, y, h, r = x[on], y[on], h[on], r[on]
    psi_b = np.pi / (2 * z) + np.tan(alpha_t) - alpha_t
    alpha = np.arccos(rb / r)
    found = {}
    for side in (LEFT, RIGHT):
        u = np.arctan2(y, x) - np.radians(phase_deg) - (h - 15.0) * 2 * np.tan(beta) / d
        u = u - side * (psi_b - np.tan(alpha) + alpha)
        tooth = np.rint(u / (2 * np.pi / z))
        delta = side * rb * (u - tooth * 2 * np.pi / z)
        near = np.abs(delta) < 0.4
        found[side] = np.stack([tooth % z + 1, delta, np.sqrt(r * r - rb * rb), h])[:, near]
    return found, rb / (d / 2), rb


@pytest.mark.parametrize("beta", [0, 15, -15])
def test_the_mesh_is_watertight_and_faces_outwards(beta):
    errors = GearErrors(
        pitch=0.02, dents=(Dent(3, "left", 5.0, 12.0, 0.6, 0.05),), chips=(Chip(4, 5.0, 9.0, 1.5),), missing=(1, 24, 7)
    )
    vertices, triangles, _ = gear_mesh(GearSurface(gear(beta), errors), 7.0)
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there, back = (np.sort(e @ [len(vertices), 1]) for e in (edges, edges[:, ::-1]))
    assert np.all(np.diff(there) > 0) and np.array_equal(there, back)  # each edge once, and once the other way
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    full = np.pi * 20.0 * (23.9**2 - 7.0**2)
    assert 0.8 * full < np.sum(a * np.cross(b, c)) / 6 < 1.1 * full


def test_the_fillet_leaves_the_flank_in_its_direction():
    """A radial wall below the flank was seen at 84 degrees, far more steeply than any fillet that a rack cuts."""
    ring = Gear(80, 1.0, 20.0, 5.0, 82.0, 77.5)
    vertices, triangles, flanks = gear_mesh(GearSurface(ring, GearErrors()), 20.0)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    middles = corners.mean(axis=1)
    of_flank = np.flatnonzero((flanks.tooth == 3) & (flanks.side == 1))
    lowest = of_flank[np.argmin(np.linalg.norm(middles[of_flank, :2], axis=1))]
    others = np.flatnonzero(flanks.side == 0)
    next_one = others[np.argmin(np.linalg.norm(middles[others] - middles[lowest], axis=1))]
    assert np.degrees(np.arccos(normals[lowest] @ normals[next_one])) < 5.0


@pytest.mark.parametrize("beta", [0, 15, -15])
def test_readings_of_a_perfect_gear_lie_on_the_involute(beta):
    found, _, _ = deviations(in_shaft(scanned(VirtualGear(gear(beta)))), gear(beta))
    for side in (LEFT, RIGHT):
        tooth, delta, roll, height = found[side]
        assert np.abs(delta).max() < 0.01 * UM
        assert set(tooth) == set(range(1, 25))
        assert roll.min() < 4.0
        assert roll.max() > 12.0
        assert np.ptp(height) > 15.0


def test_every_simulated_error_is_found_in_the_readings():
    left = tuple(1e-3 * np.cos(np.arange(24)))
    errors = GearErrors(
        pitch_left=left, thickness=0.012, left=FlankErrors(0.010, -0.008), right=FlankErrors(-0.006, 0.004),
        profile_wave=0.003, profile_waves=2.0, profile_crowning=0.005, helix_crowning=0.007,
    )  # fmt: skip
    drawn = gear(15, modification=Modification(tip_relief=0.02, tip_relief_from=51.0))
    found, ratio, rb = deviations(in_shaft(scanned(VirtualGear(drawn, errors))), drawn)
    reference, sine = drawn.teeth / np.cos(drawn.helix_angle), np.sqrt(1 - ratio**2)
    form = reference * sine - 2.0 / sine  # where a rack of addendum 1 starts to cut
    tip, relieved = np.sqrt(26.85**2 - rb**2), np.sqrt(25.5**2 - rb**2)
    for side, slope, rise, moved in ((LEFT, 0.010, -0.008, np.array(left)), (RIGHT, -0.006, 0.004, np.zeros(24))):
        tooth, delta, roll, height = found[side]
        s, t = np.clip((roll - form) / (tip - form), 0, 1), (height - 15.0) / 20.0
        put_in = (side * moved[tooth.astype(int) - 1] + 0.006) * ratio + slope * (s - 0.5) + rise * t
        put_in += 0.003 * np.sin(4 * np.pi * s) - 0.005 * (2 * s - 1) ** 2 - 0.007 * (2 * t) ** 2
        put_in -= 0.02 * np.clip((roll - relieved) / (tip - relieved), 0, 1)
        assert delta.size > 1000
        assert np.abs(delta - put_in).max() < 0.01 * UM


def test_eccentric_toothing_is_an_exact_shift():
    points = in_shaft(scanned(VirtualGear(gear(), GearErrors(eccentricity=0.2, eccentricity_direction=0.7))))
    back = points - np.array([[0.2 * np.cos(0.7)], [0.2 * np.sin(0.7)], [0.0]])
    found, _, _ = deviations(back, gear())
    assert max(np.abs(found[s][1]).max() for s in (LEFT, RIGHT)) < 0.01 * UM
    assert np.abs(deviations(points, gear())[0][LEFT][1]).max() > 0.15


def test_a_dent_is_as_deep_as_it_was_made():
    dent = Dent(5, "right", 8.0, 12.0, 1.5, 0.040)
    found, _, _ = deviations(in_shaft(scanned(VirtualGear(gear(), GearErrors(dents=(dent,))), profiles=1500)), gear())
    tooth, delta, roll, height = found[RIGHT]
    away = np.hypot(roll - 8.0, height - 12.0) / 1.5
    inside = (tooth == 5) & (away < 1)
    assert inside.sum() > 50
    assert delta[inside].min() < -0.035
    assert np.abs(delta + np.where(inside, 0.040 * (1 - np.minimum(away, 1) ** 2) ** 2, 0.0)).max() < 0.01 * UM
    assert np.abs(found[LEFT][1]).max() < 0.01 * UM


def test_missing_and_chipped_teeth():
    errors = GearErrors(missing=(7,), chips=(Chip(10, 5.0, 12.0, 1.5),))
    x, y, h = in_shaft(scanned(VirtualGear(gear(), errors)))
    r, off = np.hypot(x, y), np.degrees(np.arctan2(y, x)) - 3.0
    on_face = (h > 5.01) & (h < 24.99) & (r > 13)
    gone = on_face & (np.abs((off - 6 * 15 + 180) % 360 - 180) < 4.0)
    assert gone.sum() > 100
    assert r[gone].max() < 21.5 + 1e-3
    broken = on_face & (np.abs((off - 9 * 15 + 180) % 360 - 180) < 2.0)
    assert r[broken & (h < 11.9)].max() < 24.5 + 1e-3
    assert r[broken & (h > 12.1)].max() > 25.99


@pytest.mark.parametrize(("camera", "hidden"), [(25.0, LEFT), (-25.0, RIGHT)])
def test_the_camera_sees_one_flank_of_each_tooth(camera, hidden):
    mounting = Mounting(phi=radians(-41.802))
    points = in_shaft(scanned(VirtualGear(gear()), mounting, replace(EXACT, triangulation=radians(camera))))
    found, _, _ = deviations(points, gear())
    assert found[hidden].shape[1] == 0
    assert found[-hidden].shape[1] > 3000
    below = (np.abs(np.hypot(points[0], points[1]) - 12.5) < 1e-6) & (points[2] < 0)
    assert below.sum() > 20_000  # the base stays in view


@pytest.mark.more
def test_steep_incidence_loses_biases_and_blurs_readings():
    part, flat = VirtualGear(gear()), Mounting(phi=radians(-41.802))
    clean = scanned(part, flat).recording
    fewer = scanned(part, flat, replace(EXACT, most_incidence=radians(78.0))).recording
    assert np.isfinite(fewer.z).sum() < np.isfinite(clean.z).sum() - 5000
    both = np.isfinite(fewer.z)
    assert np.array_equal(fewer.z[both], clean.z[both])
    biased = scanned(part, flat, replace(EXACT, incidence_bias=0.002)).recording.z - clean.z
    middle = biased[:, 318:322]  # on the base, at 90 - 41.8 degrees
    assert np.allclose(middle, 0.002 * (1 / np.sin(radians(41.802)) - 1), rtol=0.05)
    assert np.nanmax(biased) > 0.002 * 4
    outward = replace(EXACT, flank_bias=((0.0, 0.0), (radians(60.0), 0.006)))
    nearer = clean.z - scanned(part, flat, outward).recording.z
    assert np.allclose(nearer[:, 318:322], 0.006 * (48.198 / 60.0) / np.sin(radians(41.802)), rtol=0.05)
    noisy = scanned(part, flat, replace(EXACT, noise=0.004, incidence_noise=True)).recording.z - clean.z
    steep = biased > 0.002 * 4
    assert np.nanstd(noisy[steep]) > 4 * 0.004
    blurred = scanned(part, flat, replace(EXACT, mixed_pixels=0.3)).recording.z - clean.z
    moved = np.abs(blurred[np.isfinite(blurred)]) > 1e-9
    assert 0.001 < moved.mean() < 0.2


def test_the_truth_of_a_perfect_gear_is_zero():
    told = truth_record(scanned(VirtualGear(gear(15)), profiles=2).truth)["part"]
    assert told["phase_deg"] == pytest.approx(3.0)
    assert np.abs(told["position_left_um"] + told["position_right_um"]).max() < 1e-6
    for key in ("F_p_left_um", "F_p_right_um", "f_p_left_um", "f_p_right_um", "F_r_um", "thickness_um"):
        assert abs(told[key]) < 1e-6
    for name in ("left", "right"):
        assert abs(told["profile"][f"f_Halpha_{name}_um"]) < 1e-6
        assert abs(told["helix"][f"f_Hbeta_{name}_um"]) < 1e-6
    assert (told["dents"], told["chips"], told["missing"]) == ([], [], [])


def test_truth_reports_the_simulated_errors():
    rng = np.random.default_rng(3)
    left, right = rng.normal(0, 0.005, (2, 24))
    errors = GearErrors(pitch_left=tuple(left), pitch_right=tuple(right), thickness=0.01,
                        left=FlankErrors(0.009), right=FlankErrors(0.0, 0.005), missing=(7,))  # fmt: skip
    told = truth_record(scanned(VirtualGear(gear(), errors), profiles=2).truth)["part"]
    assert told["missing"] == [7]
    assert told["position_left_um"][6] is None
    assert np.delete(told["position_right_um"], 6).astype(float) == pytest.approx(
        1e3 * np.delete(right, 6) - 5.0, abs=1e-6
    )
    assert told["F_p_right_um"] == pytest.approx(1e3 * np.ptp(np.delete(right, 6)), abs=1e-6)
    steps = np.diff(right, append=right[0])
    assert told["f_p_right_um"] == pytest.approx(1e3 * np.abs(np.delete(steps, [5, 6])).max(), abs=1e-6)
    assert told["profile"]["f_Halpha_left_um"] == pytest.approx(9.0, abs=1e-6)
    assert told["helix"]["f_Hbeta_right_um"] == pytest.approx(5.0, abs=1e-6)
    assert told["helix"]["f_Hbeta_left_um"] == pytest.approx(0.0, abs=1e-6)


def test_truth_contains_eccentricity_of_toothing_and_seat():
    """F_p of a shifted toothing is 2 e / cos alpha on each flank to first order, F_r 2 e (GEAR.md)."""
    seat = Workpiece(misalignments=(Misalignment("bearing", 0.02, 0.0),))
    for part, workpiece in (
        (VirtualGear(gear(), GearErrors(eccentricity=0.02)), None),
        (VirtualGear(gear()), seat),
    ):
        told = truth_record(scanned(part, workpiece=workpiece, profiles=2).truth)["part"]
        assert told["F_p_left_um"] == pytest.approx(40 / np.cos(radians(20)), rel=0.02)
        assert told["F_p_right_um"] == pytest.approx(40 / np.cos(radians(20)), rel=0.02)
        assert told["F_r_um"] == pytest.approx(40.0, rel=0.02)


def test_a_gear_turned_with_its_shaft_takes_its_errors_along_to_other_numbers():
    errors = GearErrors(pitch_left=(0.01, *[0.0] * 23), missing=(3,))
    clamped = Workpiece(clamped=radians(40.0))
    made = scanned(VirtualGear(gear(), errors), workpiece=clamped)
    told = truth_record(made.truth)["part"]
    assert told["phase_deg"] == pytest.approx(13.0)  # 43 degrees is the third tooth from there
    assert told["position_left_um"][2] == pytest.approx(10.0)
    assert told["missing"] == [5]
    found, ratio, _ = deviations(in_shaft(made), gear(), 13.0)
    tooth, delta, _, _ = found[LEFT]
    assert np.abs(delta - np.where(tooth == 3, 0.01 * ratio, 0.0)).max() < 0.01 * UM
    assert 5 not in tooth


def test_errors_and_optics_are_checked():
    with pytest.raises(BadRecipe, match="did you mean 'pitch_um'"):
        virtual_part_from(gear(), {"pich_um": 3.0})
    with pytest.raises(BadRecipe, match=r"\[dent\[1\]\] unknown key 'deep_um'"):
        virtual_part_from(gear(), {"dent": [{"tooth": 1, "flank": "left", "roll_length_mm": 5.0, "height_mm": 9.0,
                                             "radius_mm": 1.0, "depth_um": 5.0, "deep_um": 3.0}]})  # fmt: skip
    with pytest.raises(BadRecipe, match=r"tooth 25, need one of 1\.\.24"):
        virtual_part_from(gear(), {"missing": [25]})
    with pytest.raises(BadRecipe, match="found 2 values, need 24"):
        virtual_part_from(gear(), {"pitch_left_um": [1.0, 2.0]})
    made = virtual_part_from(gear(), {"phase_deg": 5.0, "pitch_um": 4.0, "helix_slope_um": 6.0,
                                      "helix_slope_right_um": 1.0})  # fmt: skip
    assert made.errors == GearErrors(
        radians(5.0), pitch=0.004, left=FlankErrors(0.0, 0.006), right=FlankErrors(0.0, 0.001)
    )
    assert simulation_from({"incidence_bias_um": 2.0}).optics.incidence_bias == 0.002
    with pytest.raises(BadRecipe, match="root diameter"):
        scanned(VirtualGear(Gear(12, 1.0, 10.0, 5.0, 14.0, 9.6)), profiles=2)
    with pytest.raises(BadRecipe, match="come to a point"):
        scanned(VirtualGear(replace(gear(), tip_diameter=58.0)), profiles=2)


def test_simulate_part_writes_scan_and_truth(tmp_path):
    assert run("init", tmp_path).returncode == 0
    stand, drawn = tmp_path / "stand.toml", tmp_path / "gear.toml"
    stand.write_text(stand.read_text().replace("profiles = 11000", "profiles = 60"))
    recipe = drawn.read_text().split("# Only `truestand simulate`")[0]
    drawn.write_text(recipe + "\n[simulation]\npitch_um = 5.0\n")
    command = ("simulate", stand, "--part", drawn, "-o", tmp_path / "g.h5", "--truth", tmp_path / "t.json")
    assert run(*command).returncode == 0
    told = json.loads((tmp_path / "t.json").read_text())
    assert told["part"]["kind"] == "gear"
    assert len(told["part"]["position_left_um"]) == 24
    assert 5.0 < told["part"]["F_p_left_um"] < 50.0
    drawn.write_text(recipe + "\n[simulation]\npich_um = 5.0\n")
    refused = run(*command, "--force")
    assert refused.returncode == 2
    assert "gear.toml: [simulation]: unknown key 'pich_um'; did you mean 'pitch_um'" in refused.stderr
