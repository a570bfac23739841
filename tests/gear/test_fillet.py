"""Steep readings of the fillet lie on the flank: sound rings had damage on many teeth."""

from dataclasses import replace
from math import radians
from types import SimpleNamespace

import pytest

import plan_stands
from truestand.planning.place import Place

PLACES = {
    "front": Place(-1.4748, 109.0, 19.0, -1.4, 0.0),
    "left": Place(-2.1031, 109.0, 3.5, -1.4, radians(120.0)),
    "right": Place(-2.4958, 109.0, 3.5, 1.4, radians(150.0)),
}
"""Of a plan for the ring by three views, the last of which sees its roots at 82 to 84 degrees."""


@pytest.mark.more
@pytest.mark.parametrize(("seed", "turns", "by"), [(1807, 1.1, tuple(PLACES)), (2231, 2.0, ("front", "right"))])
def test_sound_rings_have_no_damage_near_the_root(monkeypatch, seed, turns, by):
    """Nine regions of the first had, and F_alpha U of 0.6 mm; 81 of the second."""
    monkeypatch.setattr(plan_stands, "TURNS", turns)
    stand = plan_stands.stand()
    stand = replace(stand, sensors=tuple(replace(stand.sensor, name=name) for name in by))
    views = [
        SimpleNamespace(mount=SimpleNamespace(sensor=sensor, place=PLACES[sensor.name])) for sensor in stand.sensors
    ]
    found = SimpleNamespace(views=views, setting=SimpleNamespace(stand=stand))
    monkeypatch.setattr(plan_stands, "planned", lambda name, views: found)
    for (name, _), lines in plan_stands.try_stand("ring", None, seed).items():
        error, U = max(lines, key=lambda line: line[1])
        assert abs(error) < 1.5 * U < 0.05, name
