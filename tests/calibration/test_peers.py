"""The comparison is fair: peers tie where their assumptions hold, and the exact model is right where they don't."""

from dataclasses import replace
from math import hypot

import numpy as np
import pytest

from gears import stand
from truestand.calibration import peers as peers_module
from truestand.calibration.peers import MOST_POINTS, Finding, base_in_rotor, peers
from truestand.core.frames import Pose, shaft_parameters
from truestand.core.scan import interpret
from truestand.sim import Keyway, paper_shaft, paper_simulation, simulate
from truth import scan_of, shaft, simulated


def errors(**workpiece):
    """Axis error in mm by peer, or why it found nothing, on a round shaft under a plane through the axis."""
    base = paper_simulation()
    simulation = replace(
        base,
        workpiece=replace(base.workpiece, form=(), **workpiece),
        acquisition=replace(base.acquisition, profiles=4000),
    )
    made = simulate(stand(), simulation, paper_shaft(), 1)
    ex, ey, tx, ty = shaft_parameters(Pose.from_matrix(made.truth.shaft_from_rotor))
    found = {}
    for peer in peers(interpret(made.recording, stand()), paper_shaft()):
        result = peer.tried()
        if isinstance(result, Finding):
            h = result.height
            result = hypot(result.axis[0] - ex - tx * h, result.axis[1] - ey - ty * h)
        found[peer.name, peer.library] = result
    return found


@pytest.fixture(scope="module")
def clean():
    return errors()


@pytest.fixture(scope="module")
def with_keyway():
    return errors(keyways=tuple(Keyway(s, 1.0, 6.0, 2.5) for s in ("base", "bearing")))


def test_on_a_perfect_scan_cylinder_fits_tie(clean):
    """20,000 points of 3.4 um leave 3.4 um sqrt(2 / 20,000) = 0.03 um a coordinate; the axis is extrapolated 10 mm."""
    for library in ("scipy", "engeom"):
        if not isinstance(clean["cylinder fit", library], str):
            assert clean["cylinder fit", library] < 5e-4
    assert clean["exact model", "truestand"] < 2e-4
    assert clean["published method", "truestand"] < 1e-3


def test_a_keyway_hurts_who_does_not_expect_it(with_keyway):
    assert with_keyway["exact model", "truestand"] < 2e-4
    assert with_keyway["published method", "truestand"] > 0.1
    assert with_keyway["sine fit", "scipy"] > 0.1


def test_the_base_of_a_single_turn_lies_on_its_cylinder_in_the_rotor():
    """A thousand profiles, all of them used: form of 85 um, noise, and a plane angle known from the line alone."""
    given = base_in_rotor(scan_of("tilted 5 mrad"), shaft())
    ex, ey, tx, ty = shaft_parameters(Pose.from_matrix(simulated("tilted 5 mrad").truth.shaft_from_rotor))
    x, y, z = given.points.T
    assert np.abs(np.hypot(x - ex - tx * z, y - ey - ty * z) - shaft().base.radius).max() < 0.15
    assert len(given.points) <= MOST_POINTS
    assert np.unique(given.angle).size == 1000


def test_a_peer_that_is_not_installed_says_so(clean, monkeypatch):
    monkeypatch.setattr(peers_module, "find_spec", lambda name: None)
    absent = errors()
    assert "pip install" in absent["circle fit", "circle_fit"]
    assert "pip install" in absent["cylinder fit", "engeom"]
    assert isinstance(absent["cylinder fit", "scipy"], float)
