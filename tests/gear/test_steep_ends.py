"""Ends of profiles that few profiles meet, read otherwise because they are seen steeply: no damage."""

from math import radians
from types import SimpleNamespace

import numpy as np
import pytest

import plan_stands
from truestand.planning.place import Place

PLACE = Place(radians(-77.0), 109.0, 19.0, 0.0, 0.0)
"""Of the spur gear's plan: with 2,000 profiles a turn, 3 to 6 of its 24 teeth show their last millimetre."""
STEEP = np.linspace(-0.5, 0.5, 13)
BEND = tuple(zip(np.radians(71.5 + 27.0 * STEEP).tolist(), (0.016 * (0.5 - 4.0 * STEEP**2)).tolist(), strict=True))
"""rad and mm: by how much flanks read farther out; 1.6 of what is known (20 um, k = 2) in standard deviations."""


@pytest.mark.more
def test_ends_that_few_teeth_show_are_no_damage(monkeypatch):
    """Five regions of a sound gear were damage, 16 to 20 um deep; the sensor is known to 20 um on steep flanks."""
    stand = plan_stands.stand()
    view = SimpleNamespace(mount=SimpleNamespace(sensor=stand.sensor, place=PLACE))
    found = SimpleNamespace(views=(view,), setting=SimpleNamespace(stand=stand))
    monkeypatch.setattr(plan_stands, "planned", lambda name, views: found)
    monkeypatch.setattr(plan_stands, "flank_bias", lambda gear, place, rng: ((0.0, 0.0), *BEND))
    monkeypatch.setattr(plan_stands, "held_against", lambda inspection, truth: inspection)
    inspection = plan_stands.try_stand("spur", None, 3606)
    assert not inspection.defects
    assert not [m for m in inspection.remarks if m.startswith("damage")]
