"""Ends of profiles near the root, read otherwise because they are seen steeply: no damage."""

from dataclasses import replace
from math import radians
from types import SimpleNamespace

import numpy as np
import pytest

import plan_stands
from truestand.planning.place import Place
from truestand.sim import Worn

PLACE = Place(radians(-77.0), 109.0, 19.0, 0.0, 0.0)
"""Of the spur gear's plan: with 2,000 profiles a turn, 3 to 6 of its 24 teeth show their last millimetre."""
STEEP = np.linspace(-0.5, 0.5, 13)
FARTHER = ((0.0, 0.0), (radians(50.0), 0.0), (radians(58.0), 0.025), (radians(85.0), 0.025))
"""rad and mm: by how much flanks read farther out. The sensor sees up to 85 degrees. What a ray meets at these it reads
where it passes the flank 25 um off, which is a millimetre of roll length before, at 80."""
LESS = (*FARTHER[:2], (radians(58.0), 0.01), (radians(85.0), 0.01))
BEND = tuple(zip(np.radians(71.5 + 27.0 * STEEP).tolist(), (0.016 * (0.5 - 4.0 * STEEP**2)).tolist(), strict=True))
"""rad and mm: by how much flanks read farther out; 1.6 of what is known (20 um, k = 2) in standard deviations."""


@pytest.mark.more
def test_ends_that_few_teeth_show_are_no_damage(monkeypatch):
    """Five regions of a sound gear were damage, 16 to 20 um deep; the sensor is known to 20 um on steep flanks."""
    inspection = inspected(monkeypatch, ((0.0, 0.0), *BEND), 3606)
    assert not inspection.defects
    assert not [m for m in inspection.remarks if m.startswith("damage")]


@pytest.mark.more
@pytest.mark.parametrize(("bias", "seed"), [(FARTHER, 3900), (LESS, 3902)], ids=["25 um", "10 um"])
def test_what_is_too_steep_to_be_seen_is_not_missing(monkeypatch, bias, seed):
    """Ends of sound flanks were *not seen*, and every tooth had a U of a millimetre for what might be there: teeth that
    stand elsewhere are read at the same incidence on another radius.
    """
    inspection = inspected(monkeypatch, bias, seed)
    assert not [c for c in inspection.characteristics if c.reason and "no reading shows" in c.reason]
    forms = [c for c in inspection.characteristics if c.name == "F_alpha" and c.tooth]
    assert len(forms) == 48 and max(c.U for c in forms) < 0.04


@pytest.mark.more
def test_what_is_missing_there_on_one_tooth_alone_is_told(monkeypatch):
    """It was taken for too steep, though other teeth are read as steeply: a root 0.3 mm deep *conforms*."""
    real_part, broken = plan_stands.real_part, Worn(17, "left", (0.0, 4.2), (0.0, 30.0), 0.3, 0.05)

    def damaged(part, rng):
        gear = real_part(part, rng)
        return replace(gear, errors=replace(gear.errors, worn=(broken,)))

    monkeypatch.setattr(plan_stands, "real_part", damaged)
    monkeypatch.setattr(plan_stands, "PER_TURN", 4000)
    inspection = inspected(monkeypatch, ((0.0, 0.0), (radians(85.0), 0.0)), 3902)
    lines = {c.tooth: c for c in inspection.characteristics if c.name == "F_alpha" and c.flank == "left" and c.tooth}
    assert "no reading shows the flank" in (lines[17].reason or "")
    assert [tooth for tooth, c in lines.items() if c.U > 1.0] == [17]


def inspected(monkeypatch, bias, seed):
    """The spur gear on a stand about its plan, whose sensor reads steep flanks farther out."""
    stand = plan_stands.stand()
    view = SimpleNamespace(mount=SimpleNamespace(sensor=stand.sensor, place=PLACE))
    found = SimpleNamespace(views=(view,), setting=SimpleNamespace(stand=stand))
    monkeypatch.setattr(plan_stands, "planned", lambda name, views: found)
    monkeypatch.setattr(plan_stands, "flank_bias", lambda gear, place, rng: bias)
    monkeypatch.setattr(plan_stands, "held_against", lambda inspection, truth: inspection)
    return plan_stands.try_stand("spur", None, seed)
