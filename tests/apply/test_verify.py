"""Whether an old calibration still holds: what moved is named, what is not known well enough is undecided."""

from dataclasses import replace
from functools import cache
from math import radians

import pytest

from truestand.apply.verify import verify
from truestand.calibration.calibrate import calibrate
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.message import Message
from truestand.core.scan import interpret
from truestand.sim import FormWave, Misalignment, simulate
from truth import ABOVE, PLANE, TILTED, Named, shaft
from variants import tried

BASE = Named(
    {"phi": ABOVE, **PLANE}, TILTED, acquisition={"profiles": 2000, "columns": ("angle",)}, points=320, per_turn=2000
)
"""Sideways, noise counts 18-fold: limits of 10 um want a quarter of a scan, not a sixteenth."""


def waves(*phases):
    """Form of base and bearing, which begin at these phases."""
    return tuple(
        FormWave(surface, n, 0.5e-3, n + phase)
        for surface, phase in zip(("base", "bearing"), phases, strict=True)
        for n in (2, 3, 4)
    )


def scan(named, seed):
    return interpret(simulate(named.stand(), named.simulation(), shaft(), seed).recording, named.stand())


@cache
def old():
    return calibrate(scan(BASE, 0), shaft())


def changed(named=BASE, **parts):
    return replace(named, **{k: {**getattr(named, k), **v} for k, v in parts.items()})


def test_another_scan_of_the_same_stand_holds():
    found = verify(scan(BASE, 1), old(), shaft())
    assert found.verdict == "holds"
    assert all(c.value < 0.002 and 0 < c.U < 0.007 for c in found.changes)


@pytest.mark.parametrize(
    ("named", "what"),
    [
        (changed(mounting={"phi": ABOVE + radians(0.05)}), "sensor, radially"),
        (changed(mounting={"standoff": 95.03}), "sensor, radially"),
        (changed(mounting={"plane_offset": 0.30}), "sensor, sideways"),
        (changed(mounting={"height": -0.97}), "sensor, along the axis"),
        (changed(running={"eccentricity": 0.92}), "shaft on the table"),
        (changed(running={"eccentricity_direction": 0.75}), "shaft on the table"),
        (changed(running={"tilt": 0.003}), "shaft on the table"),
    ],
)
def test_what_moved_is_named(named, what):
    found = verify(scan(named, 1), old(), shaft())
    assert found.verdict == "does_not_hold"
    assert what in {c.name for c in found.changes if c.verdict == "does_not_hold"}
    assert any(what in reason and "calibrate again" in reason for reason in found.reasons)


@pytest.mark.parametrize("eccentricity", [0.88, 0.02])
def test_a_height_that_an_edge_tells_is_as_good_as_its_readings_lie_on_the_edge(eccentricity):
    """The sensor looks from below, where the face is hidden: readings lie 0.15 mm apart, and the shaft's eccentricity
    moves them over the edge, or doesn't. A rough edge says nothing of a sensor that has not moved.
    """
    below = {"phi": radians(-41.802)}
    stand = changed(mounting=below, running={"eccentricity": eccentricity})
    known = calibrate(scan(stand, 0), shaft())
    assert "height" in known.not_identifiable and known.height_repeats is not None
    assert 0.002 < known.height_repeats < 0.045
    for up in (0.0, 0.07, 0.15, 0.3):
        now = changed(mounting={**below, "height": -1.0 + up}, running={"eccentricity": eccentricity})
        found = verify(scan(now, 1), known, shaft())
        along = [c for c in found.changes if c.code == "sensor_moved_along"]
        assert len(along) == (up > 0.0)
        assert all(abs(c.value - up) < 1.5 * c.U for c in along)
        assert next(c for c in found.changes if c.name == "sensor, radially").verdict == "holds"
        assert found.verdict == ("does_not_hold" if up else "holds" if eccentricity > 0.5 else "undecided")


def test_a_shaft_that_was_clamped_again_moves_no_sensor():
    """Its steps' axes have turned with it, and no longer cancel: the sensor was said to have moved sideways."""
    off = {"misalignments": (Misalignment("bearing", 1.5e-3, 0.0),)}
    known = calibrate(scan(changed(workpiece=off), 0), shaft())
    turned = changed(workpiece={**off, "clamped": 2.0}, running={"eccentricity_direction": 2.5})
    found = verify(scan(turned, 1), known, shaft())
    assert found.verdict == "does_not_hold"
    assert [c.code for c in found.changes if c.verdict == "does_not_hold"] == ["shaft_moved"]
    assert all(c.value < c.U for c in found.changes if c.code != "shaft_moved")


@pytest.mark.parametrize(
    ("form", "now"),
    [
        (waves(0.0, 1.0), {"clamped": 2.0}),
        (waves(0.0, 0.0), {"clamped": 2.0}),
        (waves(0.0, 1.0), {"misalignments": (Misalignment("bearing", 4e-3, 0.0),), "form": waves(0.0, 0.0)}),
    ],
    ids=["turned in its clamp", "turned, all surfaces alike", "dirty since"],
)
def test_a_shaft_whose_form_is_another_is_undecided(form, now):
    """It runs as it did, but its steps' axes lie elsewhere: the sensor was said to have moved sideways."""
    off = {"misalignments": (Misalignment("bearing", 1.5e-3, 0.0),), "form": form}
    known = calibrate(scan(changed(workpiece=off), 0), shaft())
    found = verify(scan(changed(workpiece={**off, **now}), 1), known, shaft())
    assert "sensor_moved_sideways" in {c.code for c in found.changes if c.verdict == "does_not_hold"}
    assert found.verdict == "undecided" and [r.code for r in found.reasons] == ["form_changed"]


@pytest.mark.parametrize(("turn", "decided"), [(0.003, set()), (0.3, {"shaft_moved"})])
def test_another_zero_of_the_angle_is_no_other_form(turn, decided):
    """Shaft and eccentricity have turned together, under 120 um of ovality, which went by 0.7 um for 3 mrad."""
    oval = {"form": (FormWave("base", 2, 0.12, 0.4), FormWave("bearing", 3, 0.012, -1.0))}
    known = calibrate(scan(changed(workpiece=oval), 0), shaft())
    direction = BASE.simulation().running.eccentricity_direction + turn
    turned = changed(workpiece={**oval, "clamped": turn}, running={"eccentricity_direction": direction})
    found = verify(scan(turned, 1), known, shaft())
    assert found.verdict == ("does_not_hold" if decided else "holds")
    assert {c.code for c in found.changes if c.verdict == "does_not_hold"} == decided


def test_a_sensor_that_moved_is_named_though_form_is_another():
    now = changed(workpiece={"form": waves(0.0, 1.0)}, mounting={"standoff": 95.03})
    found = verify(scan(now, 1), old(), shaft())
    assert found.verdict == "does_not_hold" and "sensor_moved_radially" in {r.code for r in found.reasons}


def test_nothing_is_held_against_an_untrusted_calibration():
    doubtful = replace(old(), reasons=(Message("dirt", "form is dirt"),))
    found = verify(scan(BASE, 1), doubtful, shaft())
    assert found.verdict == "undecided"
    assert found.reasons == ("the old calibration is untrusted: form is dirt",)


@pytest.mark.parametrize(("eccentricity", "turns"), [(0.88, (1.2, 1.45)), (0.3, (2.0, 1.25))])
def test_scans_of_other_lengths_weigh_a_steps_axis_otherwise(eccentricity, turns):
    """A step off coaxial cancels where both scans show the same of it; else a sensor that stood still had moved by
    2.7 um with a U of 0.02, which is what noise leaves. Along the axis 0.4 um of it are not in U.
    """
    certified = Artefact(tuple(replace(c, coaxiality_U=0.02) for c in shaft().cylinders))
    still = changed(
        workpiece={"misalignments": (Misalignment("bearing", 8e-3, -5e-3),)},
        optics={"noise": 0.0003, "step_z": 0.0, "step_x": 0.0},
        running={"eccentricity": eccentricity},
    )
    before, now = (changed(still, acquisition={"profiles": int(2000 * n), "start_angle": n}) for n in turns)
    found = verify(scan(now, 1), calibrate(scan(before, 0), certified), certified)
    assert all(c.value < c.U + 0.0005 * (c.code == "sensor_moved_along") for c in found.changes)
    assert next(c for c in found.changes if c.name == "sensor, radially").U < 0.005


@pytest.mark.parametrize("sideways", [0.0, 0.15])
def test_a_plane_that_the_scans_dont_tell_is_undecided(sideways):
    """A shaft that runs true looks alike from wherever the plane stands: a sensor moved by 0.15 mm was said to hold."""
    true = {"eccentricity": 0.02}
    known = calibrate(scan(changed(running=true), 0), shaft())
    now = changed(running=true, mounting={"plane_offset": BASE.mounting["plane_offset"] + sideways})
    found = verify(scan(now, 1), known, shaft())
    assert "laser_plane_offset_mm" in known.not_identifiable
    assert found.verdict == "undecided" and [r.code for r in found.reasons] == ["sensor_moved_sideways_undecided"]
    assert "runs half a millimetre or more off centre" in found.reasons[0]
    moved = next(c for c in found.changes if c.code == "sensor_moved_sideways")
    assert moved.U > 0.3 and {c.verdict for c in found.changes if c is not moved} == {"holds"}


def test_a_record_from_before_heights_had_a_repeatability_is_held_against_the_new_scans():
    now = scan(changed(mounting={"height": -0.97}), 1)
    found = verify(now, replace(old(), height_repeats=None), shaft())
    along = next(c for c in found.changes if c.code == "sensor_moved_along")
    assert along.verdict == "does_not_hold" and along.value == pytest.approx(0.03, abs=along.U)
    hidden = replace(old(), height_repeats=None, not_identifiable=("height",))
    assert "sensor_moved_along" not in {c.code for c in verify(now, hidden, shaft()).changes}


def test_at_the_limit_it_is_undecided():
    """A shaft moved by just the limit can't be decided: U is not zero."""
    found = verify(scan(changed(running={"eccentricity": 0.8889}), 1), old(), shaft(), limit=0.01)
    assert next(c for c in found.changes if c.name == "shaft on the table").verdict == "undecided"
    assert found.verdict == "undecided"


def test_the_published_method_is_not_enough_to_verify_with():
    paper = calibrate(scan(BASE, 0), shaft(), "paper")
    found = verify(scan(BASE, 1), paper, shaft())
    assert found.verdict == "undecided"
    assert "published method" in found.reasons[0]


def wheel_scan(start=0.0, zero="home", **running):
    """The wheel of the transfer's tests on this stand, the shaft in view below it."""
    base, seat = shaft().cylinders
    parts = (base, Cylinder("seat", seat.diameter, 0.0, 5.0), Cylinder("wheel", 47.0, 5.0, 25.0))
    named = changed(
        mounting={"phi": radians(-41.802)}, running=running, acquisition={"columns": (), "start_angle": start}
    )
    stand = replace(named.stand(), table=replace(named.stand().table, start=zero))
    lobes = (FormWave("wheel", 24, 2.0),)
    simulation = replace(named.simulation(), workpiece=replace(named.simulation().workpiece, form=lobes))
    return interpret(simulate(stand, simulation, Artefact(parts), 4).recording, stand)


@cache
def old_from_below():
    named = changed(mounting={"phi": radians(-41.802)}, acquisition={"columns": ()}, workpiece={"form": ()})
    return calibrate(scan(named, 0), shaft())


@pytest.mark.more
@pytest.mark.parametrize(
    ("now", "verdict"),
    tried(
        [({"start": 1.0, "zero": "unknown"}, "holds"), ({"eccentricity": 0.92}, "does_not_hold")],
        ({}, "holds"),
        ({"eccentricity_direction": 0.75}, "does_not_hold"),
    ),
)
def test_a_part_with_shaft_in_view_verifies_as_well(now, verdict):
    found = verify(wheel_scan(**now), old_from_below(), shaft())
    assert found.by == "witness"
    assert found.verdict == verdict, found.reasons


@pytest.mark.more
def test_a_shaft_scan_that_starts_elsewhere_is_tied_by_itself():
    """Two turns: of one, the sideways move has U 6 um, and 4 um are too near the limit of 10 to decide."""
    named = changed(acquisition={"columns": (), "start_angle": 1.0, "profiles": 4000})
    stand = replace(named.stand(), table=replace(named.stand().table, start="unknown"))
    again = interpret(simulate(stand, named.simulation(), shaft(), 1).recording, stand)
    first = calibrate(scan(changed(acquisition={"columns": (), "profiles": 4000}), 0), shaft())
    found = verify(again, first, shaft())
    assert (found.verdict, found.by) == ("holds", "calibration"), found.reasons
