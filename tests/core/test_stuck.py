"""Points of a sensor that are stuck are left out; what stands still, or turns back, is no stuck point."""

from dataclasses import replace

import numpy as np
import pytest

from gears import SPUR, helical, scanned, simulation, stand
from truestand.core.scan import interpret
from truestand.core.stuck import without_stuck
from truestand.parts.drawings import Section, Turned
from truestand.sim import Acquisition, Mounting, VirtualTurned, paper_shaft, paper_simulation, paper_stand, simulate
from truth import STANDS, simulated
from variants import tried

POINT, AT = 125, 92.0


def with_stuck(z, share, width=0.001):
    """The ranges with one point that reports the same in a share of the profiles."""
    rng = np.random.default_rng(4)
    there, z = rng.random(z.shape[0]) < share, z.copy()
    z[there, POINT] = AT + rng.normal(0.0, width, np.count_nonzero(there))
    return z, there


@pytest.mark.parametrize("points", [(125, 126, 127), range(40, 300, 13)], ids=["beside each other", "many"])
def test_several_stuck_points_are_left_out(points):
    """Three beside each other looked like a surface that stands still: a sound gear failed, F_alpha at least 300 um.

    With twenty, one or two at the end of a surface have no line through them left.
    """
    z = scanned(SPUR, points=320).recording.z.copy()
    z[:, points] = AT
    found, remarks = without_stuck(z)
    assert np.isnan(found[:, points]).all() and len(remarks) <= 1.1 * len(points)


@pytest.mark.parametrize("blind", [slice(0, None, 2), slice(1, None, 3)])
def test_no_point_is_stuck_for_blind_ones_beside_it(blind):
    """Between dead points there was no line through others: 17 to 35 points of a helical gear's scan looked stuck."""
    z = scanned(helical(15.0), how=simulation(upright=True), points=320).recording.z.copy()
    z[:, blind] = np.nan
    assert without_stuck(z)[0] is z


@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
def test_a_stuck_point_is_left_out_where_it_is_stuck(share):
    recording = scanned(SPUR, points=320).recording
    z, there = with_stuck(recording.z, share)
    scan = interpret(replace(recording, z=z), stand(320))
    assert np.isnan(scan.z[there, POINT]).all()
    lost = np.isnan(scan.z[~there, POINT]) & np.isfinite(recording.z[~there, POINT])
    assert np.count_nonzero(lost) <= 0.02 * lost.size
    others = np.arange(320) != POINT
    np.testing.assert_array_equal(scan.z[:, others], recording.z[:, others])
    (remark,) = scan.remarks
    assert remark.code == "point_stuck" and f"point {POINT + 1} of the sensor is stuck at 9" in remark


def test_a_shaft_that_stands_still_is_no_stuck_point():
    z = 90.0 + 0.4 * np.arange(64) + np.zeros((500, 1))
    assert without_stuck(z)[0] is z and without_stuck(np.full((4, 8), np.nan))[1] == ()


def test_a_face_that_few_rays_meet_steeply_is_no_stuck_point():
    """Ranges to it rise by 1.6 mm from ray to ray, less and less: one of them looked stuck in 76 % of the profiles."""
    down = np.radians(7.0) + np.radians(0.1) * np.arange(-100, 100)
    turned, below = np.linspace(0.0, 4 * np.pi, 2000)[:, None], 115.0 * np.tan(np.radians(7.0))
    wide, narrow = ((125.5 - radius - np.cos(turned)) / np.cos(down) for radius in (12.5, 7.0))
    ends = narrow * np.sin(down) > below
    face = np.where(ends, below / np.where(ends, np.sin(down), 1.0), narrow)
    z = np.where(wide * np.sin(down) > below, wide, face) * np.cos(down - np.radians(7.0))
    z += np.random.default_rng(2).normal(0.0, 0.005, z.shape)
    assert without_stuck(z)[0] is z


@pytest.mark.parametrize(("points", "phi"), [(200, -95.0), (320, -110.0), (640, -110.0)])
def test_faces_that_one_or_two_rays_meet_are_no_stuck_points(points, phi):
    """Of a stepped part seen from above: points were stuck in 16, 55 and 100 % of the profiles."""
    steps = [
        Section(name, low, low + 9.0, d) for name, low, d in (("a", 3.0, 30.0), ("b", 12.0, 24.0), ("c", 21.0, 18.0))
    ]
    paper, known = paper_simulation(), paper_stand()
    how = replace(
        paper, mounting=Mounting(np.radians(phi), 105.0, 2.0, 0.0, 0.1), acquisition=Acquisition(profiles=1500),
        optics=replace(paper.optics, fan=np.radians(32.0)),
    )  # fmt: skip
    sensors = (replace(known.sensor, points=points),)
    table = replace(known.table, speed=2 * np.pi / 6)
    made = simulate(replace(known, sensors=sensors, table=table), how, paper_shaft(), 1, None,
                    VirtualTurned(Turned(tuple(steps))))  # fmt: skip
    assert without_stuck(made.recording.z)[1] == ()


@pytest.mark.parametrize("name", tried(["paper", "eccentric 2.5 mm", "centred"], *STANDS))
def test_no_stand_has_a_stuck_point(name):
    """Nor has a sensor that counts in steps of 2 or 50 um."""
    z = simulated(name).recording.z
    for of_range in (z, 0.002 * np.rint(z / 0.002), 0.05 * np.rint(z / 0.05)):
        assert without_stuck(of_range)[0] is of_range
