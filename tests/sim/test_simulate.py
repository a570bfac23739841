"""The virtual stand against geometry worked out by hand: truth's own matrices put its points on the drawing."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from truestand.core.errors import BadRecipe
from truestand.sim import (
    Acquisition,
    FormWave,
    Keyway,
    Misalignment,
    Mounting,
    Optics,
    Running,
    Simulation,
    Workpiece,
    paper_shaft,
    paper_stand,
    simulate,
    simulation_from,
    truth_record,
)
from truestand.sim.raycast import occluded_by_steps
from truestand.sim.shaft_surface import steps_of

EXACT = Optics(noise=0.0, step_z=0.0, step_x=0.0)
SHORT = Acquisition(profiles=400)


def stand(mirrored=False, direction="ccw", rate=20.0):
    base = paper_stand()
    return replace(
        base,
        table=replace(base.table, direction=direction),
        sensors=(replace(base.sensor, mirrored=mirrored, profile_rate=rate),),
        counts_per_turn=36000,
    )


def in_shaft(made, mirrored):
    """The recording mapped by the truth's matrices, written out here once more."""
    x = -made.recording.x if mirrored else made.recording.x
    points = np.stack([x, np.zeros_like(x), made.recording.z, np.ones_like(x)])
    in_table = np.einsum("ij,jnm->inm", made.truth.table_from_sensor, points)
    c, s = np.cos(made.truth.angle)[:, None], np.sin(made.truth.angle)[:, None]
    in_rotor = np.stack(
        [c * in_table[0] + s * in_table[1], c * in_table[1] - s * in_table[0], in_table[2], in_table[3]]
    )
    return np.einsum("ij,jnm->inm", made.truth.shaft_from_rotor, in_rotor)[:3]


@pytest.mark.parametrize("phi", [-41.802, 41.802, -138.198, 138.198])
@pytest.mark.parametrize(("mirrored", "direction"), [(False, "ccw"), (True, "cw")])
def test_every_point_lies_on_the_drawing(phi, mirrored, direction):
    simulation = Simulation(
        Mounting(phi=radians(phi), plane_tilt=0.01, plane_offset=0.4),
        Running(0.9, 1.0, 0.003, 2.0),
        Workpiece(),
        EXACT,
        SHORT,
    )
    made = simulate(stand(mirrored, direction), simulation, paper_shaft())
    x, y, z = in_shaft(made, mirrored)
    radius = np.hypot(x, y)
    seen = np.isfinite(z)
    off = np.minimum(np.abs(radius - 12.5), np.abs(radius - 6.97))
    face = np.abs(z)  # the shoulder
    assert np.minimum(off, face)[seen].max() < 1e-6
    assert (np.abs(radius - 12.5) < 1e-6)[seen].sum() > 10_000
    assert (np.abs(radius - 6.97) < 1e-6)[seen].sum() > 10_000
    above = np.cos(radians(phi)) < 0
    assert ((face < 1e-6) & (off > 0.1))[seen].any() == above


def test_form_harmonics_are_where_the_truth_says():
    form = (FormWave("base", 3, 0.02, 0.7),)
    simulation = Simulation(workpiece=Workpiece(form=form), optics=EXACT, acquisition=SHORT)
    made = simulate(stand(), simulation, paper_shaft())
    x, y, z = in_shaft(made, False)
    on = (z < -2) & (z > -15)
    psi, off = np.arctan2(y[on], x[on]), np.hypot(x[on], y[on]) - 12.5
    assert np.abs(off - 0.02 * np.cos(3 * psi - 0.7)).max() < 1e-6


def test_chamfer_keyway_diameter_and_misalignment():
    work = Workpiece(
        keyways=(Keyway("base", 0.5, 5.0, 2.0),),
        misalignments=(Misalignment("bearing", 0.01, -0.02),),
        diameter_errors=(("base", 0.1),),
        chamfer=0.5,
    )
    below = Mounting(phi=radians(-138.198))
    made = simulate(stand(), Simulation(below, workpiece=work, optics=EXACT, acquisition=SHORT), paper_shaft())
    x, y, z = in_shaft(made, False)
    radius, psi = np.hypot(x, y), np.arctan2(y, x)
    inside = (z < -2) & (z > -10) & (np.abs(psi - 0.5) < 0.15)
    assert np.allclose(radius[inside], 12.55 - 2.0, atol=1e-6)
    outside = (z < -2) & (z > -10) & (np.abs(psi - 0.5) > 0.4)
    assert np.allclose(radius[outside], 12.55, atol=1e-6)
    bearing = (z > 3) & (z < 20)
    assert np.allclose(np.hypot(x - 0.01, y + 0.02)[bearing], 6.97, atol=1e-6)
    chamfered = (z > -0.45) & (z < -0.05) & (radius > 11.5) & (np.abs(psi - 0.5) > 0.4)
    assert np.allclose(radius[chamfered], 12.55 - (z[chamfered] + 0.5), atol=1e-6)


def test_turns_repeat_without_noise_and_with_speckle_that_repeats():
    for optics in (EXACT, replace(EXACT, speckle=0.01)):
        made = simulate(stand(), Simulation(optics=optics, acquisition=Acquisition(profiles=800)), paper_shaft())
        z = made.recording.z
        assert np.allclose(z[:400], z[400:], atol=1e-7, equal_nan=True)
    assert np.nanstd(z - simulate(stand(), Simulation(optics=EXACT, acquisition=Acquisition(profiles=800)),
                                  paper_shaft()).recording.z) == pytest.approx(0.01, rel=0.05)  # fmt: skip


def test_the_same_seed_gives_the_same_scan():
    simulation = Simulation(acquisition=SHORT, optics=Optics(outliers=0.1, dropouts=0.1, ghosts=0.1, patches=3))
    first, again, other = (simulate(stand(), simulation, paper_shaft(), seed).recording for seed in (1, 1, 2))
    assert np.array_equal(first.z, again.z, equal_nan=True)
    assert not np.array_equal(first.z, other.z, equal_nan=True)


def test_noise_range_error_and_quantisation():
    def reading(optics):
        return simulate(stand(), Simulation(optics=optics, acquisition=SHORT), paper_shaft()).recording.z

    true = reading(EXACT)
    assert np.nanstd(reading(replace(EXACT, noise=0.01)) - true) == pytest.approx(0.01, rel=0.02)
    correlated = reading(replace(EXACT, correlated_noise=0.01, correlation=8)) - true
    assert np.nanstd(correlated) == pytest.approx(0.01, rel=0.05)
    assert np.nanmean(correlated[:, 1:] * correlated[:, :-1]) > 0.8 * np.nanvar(correlated)
    bent = reading(replace(EXACT, nonlinearity=0.025)) - true
    inside = np.isfinite(bent)  # a range error also moves readings over the limits
    assert np.allclose(bent[inside], (0.025 * np.sin(2 * np.pi * (true - 70) / 50 + 1.0))[inside], atol=1e-9)
    faster = reading(replace(EXACT, faster_nonlinearity=((2, 0.01, 0.3),))) - true
    inside = np.isfinite(faster)
    assert np.allclose(faster[inside], (0.01 * np.sin(4 * np.pi * (true - 70) / 50 + 0.3))[inside], atol=1e-9)
    scaled = reading(replace(EXACT, scale_error=1e-4)) - true
    assert np.allclose(scaled[np.isfinite(scaled)], (1e-4 * (true - 95))[np.isfinite(scaled)], atol=1e-9)
    steps = reading(Optics(noise=0.0))
    assert np.array_equal(np.round(steps, 3), steps, equal_nan=True)
    assert np.allclose(steps / 0.004, np.round(steps / 0.004), atol=1e-6, equal_nan=True)


def test_shares_of_outliers_and_dropouts_and_the_range_limits():
    optics = replace(EXACT, outliers=0.2, dropouts=0.3)
    clean = simulate(stand(), Simulation(optics=EXACT, acquisition=SHORT), paper_shaft()).recording
    made = simulate(stand(), Simulation(optics=optics, acquisition=SHORT), paper_shaft()).recording
    seen = np.isfinite(clean.z)
    assert np.isfinite(made.z[seen]).mean() == pytest.approx(0.7, abs=0.01)
    moved = np.abs(made.z - clean.z)[seen & np.isfinite(made.z)] > 0.1
    assert moved.mean() == pytest.approx(0.2, abs=0.01)
    assert np.nanmin(made.z) >= 70
    assert np.nanmax(made.z) <= 120
    assert np.isnan(clean.z).any()  # the bearing's far end is out of range


def test_camera_sees_the_near_side_only():
    steps = steps_of(paper_shaft(), Workpiece())
    around = np.linspace(-np.pi, np.pi, 73)
    points = np.stack([12.5 * np.cos(around), 12.5 * np.sin(around), np.full(73, -5.0)])[:, None, :]
    eye = np.array([300.0, 0.0, -5.0])[:, None, None]
    seen = ~occluded_by_steps(points, eye, steps)[0]
    assert seen[np.abs(around) < np.arccos(12.5 / 300) - 0.05].all()
    assert not seen[np.abs(around) > np.arccos(12.5 / 300) + 0.05].any()
    behind_the_base = np.array([6.97, 0.0, 3.0])[:, None, None]
    low = np.array([30.0, 0.0, -60.0])[:, None, None]
    assert occluded_by_steps(behind_the_base, low, steps).all()


def test_occluded_readings_are_lost_and_no_others_change():
    keyway = Workpiece(keyways=(Keyway("base", 0.0, 6.0, 4.0),))
    all_seen, some = (
        simulate(stand(), Simulation(workpiece=keyway, optics=o, acquisition=SHORT), paper_shaft()).recording.z
        for o in (EXACT, replace(EXACT, triangulation=radians(40)))
    )
    assert np.isfinite(some).sum() < np.isfinite(all_seen).sum()  # the keyway's floor lies in shadow
    both = np.isfinite(some)
    assert np.array_equal(some[both], all_seen[both])


def test_columns_follow_ripple_ramp_and_dropped_profiles():
    acquisition = Acquisition(
        profiles=400, start_angle=1.0, columns=("angle", "time", "encoder", "counter"), ripple=0.05, ramp=2.0, dropped=7
    )
    made = simulate(stand(direction="cw"), Simulation(optics=EXACT, acquisition=acquisition), paper_shaft())
    r = made.recording
    assert np.diff(r.counter).sum() == 399 + 7
    assert np.allclose(r.time, r.counter / 20.0)
    assert np.allclose(-r.angle, made.truth.angle)
    assert r.angle[0] == pytest.approx(-1.0)
    assert np.abs(r.encoder / 36000 * 2 * np.pi - r.angle).max() <= np.pi / 36000 * 1.0001
    assert np.diff(r.angle)[0] < 0.1 * np.diff(r.angle)[-1]  # the ramp


def test_the_truth_has_the_keys_and_signs_of_a_calibration():
    made = simulate(stand(), Simulation(Mounting(azimuth=0.3), Running(0.9, 1.0, 0.002, 2.0), acquisition=SHORT),
                    paper_shaft())  # fmt: skip
    record = truth_record(made.truth)
    assert record["shaft"]["eccentricity_um"] == pytest.approx(900)
    assert record["shaft"]["eccentricity_direction_deg"] == pytest.approx(np.degrees(0.7))
    assert record["shaft"]["tilt_mrad"] == pytest.approx(2.0)
    assert record["shaft"]["tilt_direction_deg"] == pytest.approx(np.degrees(1.7))
    for key, group in (("table_from_sensor", "sensor"), ("shaft_from_rotor", "shaft")):
        rotation = np.array(record[group][key])[:3, :3]
        assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-12
        assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-12)


def test_recipes_are_checked():
    assert simulation_from({}).mounting.phi == pytest.approx(radians(-41.802))
    with pytest.raises(BadRecipe, match="did you mean 'noise_um'"):
        simulation_from({"nois_um": 3.0})
    with pytest.raises(BadRecipe, match="outliers"):
        simulation_from({"outliers": 1.5})


def test_a_shaft_turned_in_its_clamping_is_a_centred_shaft_turned_by_the_table():
    """Form, keyway and the step's axis go along; without eccentricity and tilt nothing tells the two apart."""
    workpiece = Workpiece(
        form=(FormWave("base", 3, 0.05, 0.4),), keyways=(Keyway("base", 0.5, 3.0, 1.0),),
        misalignments=(Misalignment("bearing", 0.1, 0.05, 0.001, -0.002),),
    )  # fmt: skip
    short = Acquisition(profiles=40)
    seen = [
        simulate(stand(), Simulation(running=Running(0.0), workpiece=w, optics=EXACT, acquisition=a), paper_shaft())
        for w, a in ((replace(workpiece, clamped=np.pi / 2), short), (workpiece, replace(short, start_angle=np.pi / 2)))
    ]
    assert np.allclose(*(s.recording.z for s in seen), atol=1e-9, equal_nan=True)
