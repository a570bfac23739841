"""Which input makes most of U, whether it was stated, and that no advice says to state what is stated."""

from dataclasses import replace
from functools import cache
from itertools import product

import pytest

from truestand.calibration.calibrate import calibrate
from truestand.core.assumptions import ASSUMPTIONS, ENCODER, STEADY, behind, better
from truestand.core.calibration import Contribution
from truestand.files.recipes.recipes import ShaftRecipe, StandRecipe
from truestand.uncertainty.assumed import assumptions_of
from truestand.uncertainty.causes import causes_of
from truth import scan_of, shaft

KEYS = ("phi_deg", "eccentricity_um", "laser_plane_offset_mm", "laser_plane_tilt_deg")


@cache
def found():
    return calibrate(scan_of("from above"), shaft())


def stated(linearity=0.02, coaxiality=0.002, **more):
    """The calibration's record as if its recipes had stated these; None: nobody did."""
    first = found()
    (sensor,) = first.stand.sensors
    sensor = replace(sensor, linearity_U=linearity, **more)
    base, *steps = first.artefact.cylinders
    steps = (replace(c, coaxiality_U=coaxiality) for c in steps)
    suffix = " (assumed)" if linearity is None else ""
    uncertainty = {
        key: replace(
            u, contributions=tuple(
                replace(c, name="linearity of the sensor" + suffix) if c.name.startswith("linearity") else c
                for c in u.contributions
            ),
        )
        for key, u in first.uncertainty.items()
    }  # fmt: skip
    return replace(
        first, stand=replace(first.stand, sensors=(sensor,)), static_profiles=(), uncertainty=uncertainty,
        artefact=replace(first.artefact, cylinders=(base, *steps)),
    )  # fmt: skip


def causes(calibration, lines=None):
    budgets = {key: calibration.uncertainty[key].contributions for key in KEYS} if lines is None else {"F_p": lines}
    return {c.name: c for c in causes_of(calibration, budgets)}


def line(name, U):
    return Contribution(name, U, U / 2)


def test_the_sensors_linearity_makes_phi_and_the_steps_coaxiality_the_laser_plane():
    by_name = causes(stated())
    assert by_name["linearity of the sensor"].shares["phi_deg"] > 0.9
    assert by_name["coaxiality of the steps"].shares["laser_plane_offset_mm"] > 0.9
    assert all(0.25 <= share <= 1.0 for c in by_name.values() for share in c.shares.values())
    assert list(by_name) == sorted(by_name, key=lambda name: -max(by_name[name].shares.values()))


def test_what_was_assumed_is_told_with_its_key_and_value():
    by_name = causes(stated(None, None))
    linearity, coaxiality = by_name["linearity of the sensor"], by_name["coaxiality of the steps"]
    assert (linearity.known, coaxiality.known) == ("assumed", "assumed")
    assert "state linearity_U_um" in linearity.better and "[[sensor]] in stand.toml" in linearity.better
    assert "state coaxiality_U_mm" in coaxiality.better and "clamped twice" in coaxiality.better
    assert [a.value for a in (*linearity.assumed, *coaxiality.assumed)] == [0.025, 0.002]


@pytest.mark.parametrize(("linearity", "coaxiality"), list(product((None, 0.01), repeat=2)))
def test_nothing_says_to_state_what_is_stated(linearity, coaxiality):
    by_name = causes(stated(linearity, coaxiality))
    for name, value in (("linearity of the sensor", linearity), ("coaxiality of the steps", coaxiality)):
        assert by_name[name].known == ("assumed" if value is None else "stated")
        assert ("state " in by_name[name].better) == (value is None)


def test_the_scan_counts_where_it_shows_a_worse_linearity_than_stated():
    worse = replace(stated(None), static_profiles=found().static_profiles)
    (profile, *_) = worse.static_profiles
    worse = replace(worse, static_profiles=(replace(profile, deviation=3 * profile.deviation + [0, 0.2] * 25),))
    linearity = causes(worse)["linearity of the sensor"]
    assert linearity.known == "measured"
    assert linearity.better == "use a more linear sensor"


def test_the_laser_planes_offset_and_tilt_are_stated_one_by_one():
    names = [a.name for a in assumptions_of(stated(plane_offset_U=0.1, plane_tilt_U=None), ())]
    assert "tilt of the laser plane" in names and "offset of the laser plane" not in names
    lines = (line("mounting of the laser plane", 1.0),)
    (cause,) = causes(stated(plane_offset_U=0.1, plane_tilt_U=None), lines).values()
    assert "plane_tilt_U_deg" in cause.better and "plane_offset_U_mm" not in cause.better


def test_what_the_calibration_brings_is_told_as_what_made_it_there():
    lines = (
        line("lateral offset of the laser plane", 3.0),
        line("skew of the laser line", 2.0),
        line("noise", 3.0),
    )
    by_name = causes(stated(), lines)
    assert by_name["coaxiality of the steps"].shares["F_p"] == pytest.approx(13 / 22)
    assert by_name["noise"].better == "scan more turns"


def test_nothing_asks_for_a_second_clamping_where_there_was_one():
    twice = replace(stated(coaxiality=None), positions=object())
    assert causes(twice)["coaxiality of the steps"].better.endswith("in shaft.toml")
    known = causes(replace(stated(), positions=object()))["coaxiality of the steps"]
    assert (known.known, known.better) == ("stated", "")


def test_an_encoder_is_advised_only_where_there_is_none():
    assert behind("angle, once per turn: speed of the table (assumed)") == (STEADY,)
    assert behind("angle, 6 times per turn (assumed)") == (ENCODER,)
    assert "use an encoder" in better((STEADY,)) and "use a better encoder" in better((ENCODER,), stated=True)


def test_every_key_that_is_advised_is_one_of_a_recipe():
    keys = {name for recipe in (StandRecipe, ShaftRecipe) for name in _keys(recipe.model_json_schema())}
    for a in ASSUMPTIONS:
        for word in a.key.split():
            if "_U_" in word and not word.startswith("part_"):
                assert word.strip(",") in keys, word


def _keys(schema):
    for part in (schema, *schema.get("$defs", {}).values()):
        yield from part.get("properties", {})
