"""Turned parts on the virtual stand: what is put in comes out, with honest U and nothing invented."""

from dataclasses import replace
from functools import cache
from math import hypot, pi, radians, sqrt

import numpy as np
import pytest

from gears import simulation, stand
from truestand.apply.transfer import roll
from truestand.calibration.calibrate import calibrate
from truestand.core.calibration import Calibration, Positions, StaticProfile, StepAxis, Wobble
from truestand.core.errors import BadRecipe
from truestand.core.frames import Pose, shaft_from_rotor, table_from_sensor
from truestand.core.scan import interpret
from truestand.core.surface import Surface, apply_calibration
from truestand.form.upr import UprFilter, filtered_evenly
from truestand.parts.drawings import Section, Turned
from truestand.parts.rings import Rings, read_rings
from truestand.parts.turned import inspect_turned
from truestand.sim import FormWave, Keyway, Misalignment, VirtualTurned, Workpiece, paper_shaft, simulate
from truestand.uncertainty.influence import independent_parts, unknowns_of
from truth import PLANE, TILTED, Named, shaft
from variants import tried

UM, NOISE = 1e-3, 0.005
COVARIANCE = np.diag(np.square([2e-6, 5e-4, 2e-3, 3e-5, 3e-4, 3e-4, 2e-5, 2e-5]))
BASE, SEAT = Section("base", -14.0, -0.5, 25.0), Section("seat", 8.0, 13.0, 13.94)
PART = Turned((BASE, SEAT))
ANGLE = {"profiles": 1000, "columns": ("angle",)}
OFF = 0.05
WAVES = (FormWave("base", 2, 0.030, 0.4), FormWave("base", 30, 0.002))
SHAPES = {
    "round": {"form": ()},
    "oval": {"form": WAVES[:1]},
    "wavy": {"form": WAVES[1:]},
    "eccentric": {"form": (), "misalignments": (Misalignment("bearing", 0.03, 0.04),)},
    "leaning": {"form": (), "misalignments": (Misalignment("base", 0.0, 0.0, 2e-3, 0.0),)},
    "small": {"form": (), "diameter_errors": (("base", -0.010),)},
    "keyway": {"form": (), "keyways": (Keyway("base", 1.0, 6.0, 2.5, -30.0, 0.0),)},
    "slot": {"form": (), "keyways": (Keyway("base", 2.5, 0.5, 0.3),)},
}


@cache
def scanned(shape, **changes):
    """A scan of 1000 profiles a turn by 320 points, and the calibration that is true."""
    optics = {"noise": NOISE, **{k: changes[k] for k in ("outliers", "dropouts") if k in changes}}
    acquisition = {**ANGLE, "profiles": changes.get("profiles", 1000)}
    named = Named(PLANE, TILTED, SHAPES[shape], optics, acquisition)
    stand = named.stand()
    stand = replace(stand, sensors=(replace(stand.sensor, profile_rate=50.0, points=320),))
    made = simulate(stand, named.simulation(), shaft(), changes.get("seed", 3))
    poses = (Pose.from_matrix(m) for m in (made.truth.table_from_sensor, made.truth.shaft_from_rotor))
    known = Calibration("stand", *poses, stand, "angle", "index", artefact=shaft(), covariance=COVARIANCE)
    return interpret(made.recording, stand), known


def inspected(shape, part=PART, known=None, **changes):
    scan, true = scanned(shape, **changes)
    return inspect_turned(apply_calibration(scan, known or true), part)


def line(inspection, section, name):
    return next(c for c in inspection.characteristics if (c.section, c.name) == (section, name))


def budget(c):
    return {b.name: b.U for b in c.budget}


@pytest.mark.parametrize("face", [True, False], ids=["its end face in view", "hidden"])
def test_a_part_that_ends_before_its_section_has_its_diameter(face):
    """Readings of the end face made it 36 um too small, *does not conform*."""
    scan, known = scanned("round")
    surface = apply_calibration(scan, known)
    radius, rng = np.hypot(surface.x, surface.y), np.random.default_rng(1)
    at_end = (surface.z > -0.6) & (surface.z < 0.0) & (np.abs(radius - 12.5) < 0.5)
    shrunk = np.where(at_end & face, rng.uniform(0.93, 1.0, radius.shape), 1.0)  # all over the rim of the face
    z = np.where(at_end & face, rng.normal(-0.02, 0.005, radius.shape), surface.z)
    ended = replace(surface, x=surface.x * shrunk, y=surface.y * shrunk, z=z)
    drawn = Section("base", -14.0, 3.0, 25.0, diameter_limits=(24.99, 25.01))
    d = line(inspect_turned(ended, Turned((drawn,))), "base", "d")
    assert d.value == pytest.approx(25.0, abs=d.U) and d.verdict != "does_not_conform"


def test_a_round_shaft_has_its_diameter_and_no_form():
    """A hundred thousand readings of 5 um: 0.1 um in d at k = 4; form stays below what noise alone reads as such."""
    found = inspected("round")
    floor = found.evidence.sections[0].floor
    assert 0.001 < floor < 0.003
    assert line(found, "base", "d").value == pytest.approx(25.0, abs=2e-4)
    assert line(found, "seat", "d").value == pytest.approx(13.94, abs=4e-4)
    for name in ("roundness", "cylindricity", "runout", "total_runout"):
        assert line(found, "base", name).value < floor
    assert all(c.status == "measured" for c in found.characteristics)


def test_oval_has_a_roundness_of_twice_its_filtered_amplitude():
    found = inspected("oval", replace(PART, upr=5))
    expected = 2 * 0.030 * float(UprFilter(5).transmission(np.array([2]))[0])
    assert line(found, "base", "roundness").value == pytest.approx(expected, abs=0.001)
    assert line(found, "base", "runout").value == pytest.approx(expected, abs=0.001)


def test_a_wave_of_the_bearing_is_no_form_beyond_u():
    """What the shaft shows beside the part, or showed at the calibration, was not in U: 10 um of roundness +- 1."""
    known = replace(scanned("oval")[1], wobble=Wobble(2, 0.030))
    roundness = line(inspected("oval", known=known), "base", "roundness")
    assert roundness.value - roundness.U < 0.001 and "table bearing" in budget(roundness)


@pytest.mark.more
def test_filter_attenuates_short_waves():
    passed = 2 * 0.002 * float(UprFilter(50).transmission(np.array([30]))[0])
    assert line(inspected("wavy"), "base", "roundness").value == pytest.approx(passed, abs=0.0012)
    assert line(inspected("wavy", replace(PART, upr=15)), "base", "roundness").value < 0.0012


def test_runout_is_twice_the_eccentricity_about_the_datum_and_no_form():
    found = inspected("eccentric")
    assert line(found, "seat", "runout").value == pytest.approx(2 * OFF, abs=0.002)
    assert line(found, "seat", "roundness").value < 0.002
    assert line(found, "base", "runout").value < 0.002
    x, y = found.evidence.sections[1].centres.mean(axis=0)
    assert (x, y) == (pytest.approx(0.03, abs=3e-4), pytest.approx(0.04, abs=3e-4))


def test_about_its_own_measured_axis_nothing_runs_out():
    scan, known = scanned("eccentric")
    axis = StepAxis("bearing", 0.03, 0.04, 0.0, 0.0, 17.5, 0.001)
    known = replace(known, positions=Positions((0.0, pi), ("", ""), (axis,), (), (), ()))
    found = inspect_turned(apply_calibration(scan, known), replace(PART, datum="seat"))
    assert line(found, "seat", "runout").value < 0.0015
    assert line(found, "base", "runout").value == pytest.approx(2 * OFF, abs=0.001)
    assert "measured" in found.settings["datum"]


def test_a_leaning_section_is_a_cylinder_that_runs_out_the_more_the_farther():
    """The base's axis passes its middle at -30 mm: at -0.8 mm it is 58.4 um aside, at -13.7 mm 32.6."""
    found = inspected("leaning")
    assert line(found, "base", "cylindricity").value < 0.002
    assert line(found, "base", "runout").value == pytest.approx(2 * 2e-3 * (30 - 0.8), abs=0.001)
    assert line(found, "base", "roundness").value < 0.0015


def test_too_small_a_diameter_does_not_conform():
    limits = (24.992, 25.002)
    part = Turned((replace(BASE, diameter_limits=limits, runout_limit=0.02),))
    small, right = inspected("small", part), inspected("round", part)
    assert line(small, "base", "d").value == pytest.approx(24.990, abs=2e-4)
    d = line(right, "base", "d")
    assert (d.limits, d.size) == (limits, True)
    assert d.verdict == ("conforms" if abs(25.0 - 25.002) > 0.825 * d.U else "undecided")
    assert line(right, "base", "runout").verdict == "conforms"
    wide = Turned((replace(BASE, diameter_limits=(24.9, 24.95)),))
    assert inspected("small", wide).verdict == "does_not_conform"


@pytest.mark.more
def test_a_fifth_of_outliers_changes_nothing():
    """0.2 um in d, the promise; the lost readings alone cost 0.02."""
    clean, dirty = inspected("oval"), inspected("oval", outliers=0.2)
    for section in ("base", "seat"):
        moved = line(dirty, section, "d").value - line(clean, section, "d").value
        assert abs(moved) < 2e-4
    assert line(dirty, "base", "roundness").value == pytest.approx(line(clean, "base", "roundness").value, abs=0.001)
    kept = np.abs(dirty.deviation[np.isfinite(dirty.deviation)])
    assert kept.max() > 0.5  # never dropped in the record


def test_deviations_stand_at_their_readings_positive_outwards():
    scan, _ = scanned("small")
    found = inspected("small")
    assert found.deviation.shape == scan.x.shape
    assert not found.deviation.flags.writeable
    surface = apply_calibration(*scanned("small"))
    with np.errstate(invalid="ignore"):
        base = (surface.z > -13) & (surface.z < -1)
    assert np.nanmean(found.deviation[base]) == pytest.approx(-0.005, abs=1e-4)
    with np.errstate(invalid="ignore"):
        outside = surface.z < -15
    assert np.isnan(found.deviation[outside]).all()


def test_half_a_circumference_is_partial_and_a_quarter_is_no_number():
    half = inspected("oval", profiles=500)
    assert line(half, "base", "roundness").status == "partial"
    assert line(half, "base", "d").status == "partial"
    quarter = inspected("oval", profiles=250)
    for c in quarter.characteristics:
        assert (c.status, c.value, c.U) == ("not_measurable", None, None)
    decided = inspect_turned(
        apply_calibration(*scanned("oval", profiles=250)), Turned((replace(BASE, diameter_limits=(24.0, 26.0)),))
    )
    assert decided.verdict == "undecided"


def test_a_section_seen_in_part_is_not_measured_however_high_its_cells():
    """Few readings make one cell of the whole height: half a section hidden behind a larger one was covered by 1.0."""
    scan, known = scanned("round")
    sparse = replace(scan, x=scan.x[:, ::8], z=scan.z[:, ::8])
    surface = apply_calibration(sparse, known)
    top = float(np.nanmax(np.where(np.hypot(surface.x, surface.y) < 7.5, surface.z, np.nan)))
    for part_seen, status in ((1.0, "measured"), (0.6, "partial"), (0.2, "not_measurable")):
        section = Section("seat", 8.0, 8.0 + (top - 8.5) / part_seen, 13.94, roundness_limit=0.05)
        found = inspect_turned(surface, Turned((section,)))
        lines = [c for c in found.characteristics if c.name in ("d", "roundness")]
        assert {c.status for c in lines} == {status}
        assert all(abs(c.coverage - part_seen) < 0.2 for c in lines)
        assert {c.verdict for c in lines if c.limits} == {"conforms" if status == "measured" else "undecided"}


def test_a_keyway_leaves_the_diameter_and_makes_form_partial():
    part = Turned((replace(BASE, roundness_limit=0.1, diameter_limits=(24.9, 25.1)),))
    found = inspected("keyway", part)
    assert line(found, "base", "d").value == pytest.approx(25.0, abs=3e-4)
    assert line(found, "base", "d").status == "measured"
    roundness = line(found, "base", "roundness")
    assert (roundness.status, roundness.verdict) == ("partial", "undecided")
    assert roundness.value < 0.003


def test_section_that_is_not_there_is_not_measurable():
    found = inspected("round", Turned((Section("collar", -14.0, -0.5, 30.0), Section("far", 50.0, 60.0, 25.0))))
    assert {c.status for c in found.characteristics} == {"not_measurable"}
    assert all(c.value is None for c in found.characteristics)
    assert any("collar" in r for r in found.remarks)
    assert np.isnan(found.deviation).all()


@pytest.mark.slow
def test_budget_line_of_the_calibration_equals_drawn_calibrations():
    """40 draws tell a standard deviation to 11 %: within 30 %."""
    scan, known = scanned("eccentric")
    rng = np.random.default_rng(5)
    parts, (p, height) = independent_parts(known), unknowns_of(known)
    thin = replace(scan, x=scan.x[:, ::4], z=scan.z[:, ::4])
    part = Turned((SEAT,))
    own = {
        c.name: budget(c).get("calibration", 0.0)
        for c in inspect_turned(apply_calibration(scan, known), part).characteristics
    }
    values = {name: [] for name in ("d", "runout")}
    for _ in range(40):
        q = p + rng.standard_normal(len(parts)) @ parts
        drawn = replace(
            known, table_from_sensor=table_from_sensor(q[0], q[1], height, q[3], q[2]),
            shaft_from_rotor=shaft_from_rotor(*q[4:8]),
        )  # fmt: skip
        found = inspect_turned(apply_calibration(thin, drawn), part)
        for name in values:
            values[name].append(line(found, "seat", name).value)
    for name, v in values.items():
        assert own[name] == pytest.approx(2 * np.std(v), rel=0.3)


@pytest.mark.more
def test_the_datum_adds_to_run_out_only():
    sure, loose = inspected("round"), inspected("round", replace(PART, datum="seat", bore_clearance=0.01))
    assert "bore clearance" not in budget(line(loose, "seat", "roundness"))
    lines = budget(line(loose, "seat", "runout"))
    assert lines["bore clearance"] == pytest.approx(2 * 0.01 / sqrt(3))
    # The certificate's 2 um at the seat's middle (17.5 mm), and what it may lean down to here.
    assert lines["coaxiality of the datum"] == pytest.approx(2 * 0.002 * hypot(1.0, 7 / 35))
    assert line(sure, "base", "d").U == line(loose, "base", "d").U


def test_linearity_grows_with_the_distance_from_the_shaft():
    """The calibration takes up what is wrong where it saw the base: here, over all that is read of it."""
    _, known = scanned("round")
    seen = replace(known, static_profiles=(StaticProfile("base", np.linspace(-14.0, -0.5, 50), np.zeros(50)),))
    found = inspected("round", known=seen)
    of_base, of_seat = (budget(line(found, name, "d")) for name in ("base", "seat"))
    assert of_base["linearity of the sensor"] < 1 * UM
    assert of_seat["linearity of the sensor"] > 20 * UM
    assert of_base["diameter of the artefact"] == 0.002


OBLIQUE = Turned((Section("wide", 5.5, 10.5, 36.0), Section("narrow", 16.0, 24.0, 30.0)))


@pytest.mark.more
@pytest.mark.parametrize("phase", tried([0.0], 1.6, rarely=[0.8, 3.2, 4.0]))
def test_what_turned_an_oblique_sensor_counts_along_its_sections(phase):
    """A range that errs by a sine of 14 um has the rms that 20 um (k = 2) state. Of 20 um, an outsider's sound section
    had a diameter 31 um off at U 22, a cylindricity 5 um off at 4, and did not conform.
    """
    form = FormWave("wide", 3, 0.003, 0.0)
    own = stand(240)
    own = replace(own, sensors=(replace(own.sensor, linearity_U=0.02),))
    how = simulation(4400, True, nonlinearity=0.02 / sqrt(2.0), nonlinearity_phase=phase, most_incidence=radians(89.0))
    how = replace(how, mounting=replace(how.mounting, phi=radians(-60.0), height=8.0))
    on_shaft, on_part = (
        interpret(simulate(own, how, paper_shaft(), k, None, part).recording, own)
        for k, part in enumerate((None, VirtualTurned(OBLIQUE, Workpiece(form=(form,)))))
    )
    found = inspect_turned(roll(on_part, calibrate(on_shaft, paper_shaft())), OBLIQUE)
    for section, diameter, shape in (("wide", 36.0, 0.006), ("narrow", 30.0, 0.0)):
        for name, true in (("d", diameter), ("cylindricity", shape), ("total_runout", shape)):
            c = line(found, section, name)
            assert c.status == "measured" and abs(c.value - true) < c.U


def test_a_calibration_without_covariance_decides_nothing():
    scan, known = scanned("round")
    part = Turned((replace(BASE, diameter_limits=(24.0, 26.0)),))
    found = inspect_turned(apply_calibration(scan, replace(known, covariance=np.zeros((0, 0)))), part)
    d = line(found, "base", "d")
    assert (d.U, d.verdict) == (None, "undecided")
    assert any("covariance" in r for r in found.remarks)


def test_an_untrusted_calibration_decides_nothing():
    scan, known = scanned("round")
    part = Turned((replace(BASE, diameter_limits=(24.0, 24.5)),))
    found = inspect_turned(apply_calibration(scan, replace(known, reasons=("the sensor moved",))), part)
    assert found.verdict == "undecided"
    assert found.reasons == ("the sensor moved",)


def test_a_surface_without_its_scan_is_refused():
    with pytest.raises(BadRecipe, match="roll"):
        inspect_turned(Surface(*np.zeros((3, 2, 2))), PART)


def test_settings_name_filter_reference_and_datum():
    settings = inspected("round").settings
    assert "50 UPR" in settings["filter"]
    assert "ISO 14253-1" in settings["decision rule"]
    assert "0.3 mm" in settings["heights"]


def test_errors_are_within_u_of_a_found_calibration():
    """The whole chain: the shaft calibrates the stand and is then inspected as a part."""
    scan, _ = scanned("oval")
    own = calibrate(scan, shaft())
    found = inspect_turned(apply_calibration(scan, own), PART)
    true = {
        ("base", "d"): 25.0, ("base", "roundness"): 0.06 * float(UprFilter(50).transmission(np.array([2]))[0]),
        ("seat", "d"): 13.94, ("seat", "roundness"): 0.0, ("base", "runout"): 0.06, ("seat", "runout"): 0.0,
    }  # fmt: skip
    for (section, name), value in true.items():
        c = line(found, section, name)
        assert abs(c.value - value) < c.U


@pytest.mark.parametrize("length", [2.0, 3.0, 5.0])
def test_a_dent_no_longer_than_the_cells_are_high_is_not_flattened(length):
    """Few readings make high cells, in which dents were outliers: 1, 21 and 116 um were read of 192."""
    scan, known = scanned("round")
    surface = apply_calibration(replace(scan, x=scan.x[:, ::3], z=scan.z[:, ::3]), known)
    depth, arc = 0.2, 0.6
    off = np.hypot((surface.height + 7.3) / (length / 2), np.angle(np.exp(1j * (surface.angle - 1.0))) / arc)
    scale = 1 - depth * np.cos(pi / 2 * np.minimum(np.nan_to_num(off, nan=1.0), 1.0)) ** 2 / surface.radius
    found = inspect_turned(replace(surface, x=surface.x * scale, y=surface.y * scale), Turned((BASE,)))
    circle = np.linspace(-pi, pi, 3600, endpoint=False)
    dent = -depth * np.cos(pi / 2 * np.minimum(np.abs(circle - 1.0) / arc, 1.0)) ** 2
    design = np.column_stack([np.cos(circle), np.sin(circle), np.ones(circle.size)])
    true = np.ptp(filtered_evenly(dent - design @ np.linalg.lstsq(design, dent, rcond=None)[0], UprFilter(50.0)))
    roundness = line(found, "base", "roundness")
    assert abs(roundness.value - true) < roundness.U < 0.5 * true


@pytest.mark.parametrize(("step", "shape"), tried([(8, "cone")], (3, "cone"), (3, "crown"), (8, "crown")))
def test_ends_that_were_not_seen_stand_in_u(step, shape):
    """0.6 mm of either end are hidden, and cells of a few readings are high: a cone of 85 um read 39 ± 4, a crown 0."""
    scan, known = scanned("round")
    surface = apply_calibration(replace(scan, x=scan.x[:, ::step], z=scan.z[:, ::step]), known)
    low, high = BASE.bottom + 0.3, BASE.top - 0.3
    along = (2 * surface.height - low - high) / (high - low)
    scale = 1 + 0.085 * (along / 2 if shape == "cone" else -np.square(along)) / surface.radius
    with np.errstate(invalid="ignore"):
        scale = np.where((surface.z > low + 0.6) & (surface.z < high - 0.6), scale, np.nan)
    shaped = replace(surface, x=surface.x * scale, y=surface.y * scale, z=np.where(scale > 0, surface.z, np.nan))
    part = Turned((replace(BASE, cylindricity_limit=0.05, total_runout_limit=0.05),))
    found = inspect_turned(shaped, part)
    for name in ("cylindricity", "total_runout"):
        c = line(found, "base", name)
        assert abs(c.value - 0.085) < c.U < 0.55 * 0.085
        assert "ends not seen" in budget(c)
        assert c.verdict != "conforms"
    level = inspect_turned(replace(surface, z=np.where(scale > 0, surface.z, np.nan)), part)
    for name in ("cylindricity", "total_runout"):
        assert line(level, "base", name).verdict == "conforms"
        assert budget(line(level, "base", name)).get("ends not seen", 0.0) < 3e-4


@pytest.mark.parametrize("length", tried([1.5], 0.05))
def test_a_ramp_or_step_reads_what_it_rises(length):
    """A parabola through it reached beyond both sides: 36 um read 48 ± 4 and did not conform to 40."""
    scan, known = scanned("round")
    surface = apply_calibration(scan, known)
    scale = 1 + 0.036 * np.clip((surface.z + 7.0) / length, 0, 1) / surface.radius
    part = Turned((replace(BASE, cylindricity_limit=0.045, total_runout_limit=0.045),))
    found = inspect_turned(replace(surface, x=surface.x * scale, y=surface.y * scale), part)
    for name in ("cylindricity", "total_runout"):
        c = line(found, "base", name)
        assert abs(c.value - 0.036) < c.U and c.verdict != "does_not_conform", name


@pytest.mark.parametrize(("depth", "width"), tried([(0.12, 1.3)], (0.03, 0.8), (0.1, 0.4)))
def test_a_groove_all_round_is_no_form_of_its_circles(depth, width):
    """An eccentric shaft brings other readings of a height to either side of its edge: roundness read 118 +- 84."""
    scan, known = scanned("round")
    surface = apply_calibration(scan, known)
    scale = 1 - depth * (np.abs(surface.z + 7.3) < width / 2) / surface.radius
    part = Turned((replace(BASE, roundness_limit=0.015, runout_limit=0.02),))
    found = inspect_turned(replace(surface, x=surface.x * scale, y=surface.y * scale), part)
    for name in ("roundness", "runout"):
        c = line(found, "base", name)
        assert c.value < 1.2 * c.U and c.verdict != "does_not_conform", name
    c = line(found, "base", "cylindricity")
    assert abs(c.value - depth) < 1.2 * c.U


@pytest.mark.more
def test_a_slot_of_few_profiles_is_as_wide_as_the_next_profile_says_or_not():
    """Half a millimetre are six profiles: where its edges run between two of them makes 16 um of 181 (2.7 U)."""
    found = inspected("slot", Turned((replace(BASE, roundness_limit=0.19),)))
    circle = np.linspace(-pi, pi, 36_000, endpoint=False)
    slot = np.where(np.abs(circle) * 12.5 < 0.25, -0.3, 0.0)
    whole = Rings(12.5, circle, np.zeros(1), np.ones((1, circle.size), dtype=bool), 50.0)
    _, true, _, runout, _ = read_rings(whole, slot[None]).statistics
    for name, value in (("roundness", true), ("runout", runout)):
        c = line(found, "base", name)
        assert abs(c.value - value) < c.U < 0.2 * value
    assert line(found, "base", "roundness").verdict == "undecided"
    for c in inspected("oval").characteristics:
        assert "edges between readings" not in budget(c)


def test_sections_that_are_drawn_over_each_other_are_refused():
    with pytest.raises(BadRecipe, match=r"'base' and 'step': found both from -3 to -0\.5 mm"):
        Turned((BASE, Section("step", -3.0, 3.0, 20.0)))
    assert Turned((BASE, Section("end", -3.0, -0.5, 25.0))), "two stretches of one cylinder"
    assert Turned((BASE, Section("step", -0.5, 3.0, 20.0)))
