"""Does an old calibration still hold: moved things are named, doubt is not hidden."""

from dataclasses import replace
from functools import cache
from math import radians

import pytest

from truestand.core.calibrate import calibrate
from truestand.core.scan import interpret
from truestand.core.verify import verify
from truestand.sim import simulate
from truth import ABOVE, PLANE, TILTED, Named, shaft

BASE = Named({"phi": ABOVE, **PLANE}, TILTED, acquisition={"profiles": 4000, "columns": ("angle",)})


def scan(named, seed):
    return interpret(simulate(named.stand(), named.simulation(), shaft(), seed).recording, named.stand())


@cache
def old():
    return calibrate(scan(BASE, 0), shaft())


def changed(**parts):
    return replace(BASE, **{k: {**getattr(BASE, k), **v} for k, v in parts.items()})


def test_another_scan_of_the_same_stand_holds():
    found = verify(scan(BASE, 1), old(), shaft())
    assert found.verdict == "holds"
    assert all(c.value < 0.002 and 0 < c.U < 0.005 for c in found.changes)


@pytest.mark.parametrize(
    ("named", "what"),
    [
        (changed(mounting={"phi": ABOVE + radians(0.05)}), "sensor, radially"),
        (changed(mounting={"standoff": 95.03}), "sensor, radially"),
        (changed(mounting={"plane_offset": 0.30}), "sensor, sideways"),
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
