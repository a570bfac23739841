"""Dirt on a part of a cylinder: told from form, because form goes in waves."""

from math import radians, tau

import numpy as np
import pytest

from truestand.calibration.calibrate import calibrate
from truestand.calibration.edges import SECTORS, largest_edge
from truestand.calibration.patches import patches
from truestand.core.scan import interpret
from truestand.sim import FormWave, Patch, simulate
from truth import ABOVE, ROUND, Named, shaft
from variants import tried

UM = 1e-3
SOFT = radians(14.0)
DIRT = {
    "12 um on 37 % of the bearing": ((), (Patch("bearing", 1.0, 0.37, 12 * UM),)),
    "15 um on 38 % of the base": ((), (Patch("base", 4.0, 0.38, 15 * UM),)),
    "6 um on 30 % of the base, soft": ((), (Patch("base", 4.0, 0.30, 6 * UM, SOFT),)),
    "soft, beside waves": (
        (FormWave("bearing", 9, 4 * UM, 1.0), FormWave("bearing", 21, 2 * UM, 3.0)),
        (Patch("bearing", 0.5, 0.33, 13 * UM, SOFT),),
    ),
    "40 um on 39 % of the base": ((), (Patch("base", 2.5, 0.39, 40 * UM),)),
    "both": ((), (Patch("base", 2.5, 0.29, 18 * UM), Patch("bearing", 5.0, 0.23, 8 * UM))),
    "both, soft": ((), (Patch("base", 2.5, 0.37, 18 * UM, SOFT), Patch("bearing", 5.0, 0.22, 7 * UM, SOFT))),
    "two heights": ((), (Patch("base", 0.5, 0.10, 36 * UM), Patch("base", 3.0, 0.14, 14 * UM))),
    "with a wave of form": ((FormWave("base", 7, 5 * UM, 1.0),), (Patch("base", 3.0, 0.28, 74 * UM),)),
    "with a fast wave of form": ((FormWave("base", 14, 3 * UM, 1.0),), (Patch("base", 3.0, 0.19, 40 * UM),)),
}


def scan_under(form, dirt, phi=ABOVE):
    stand = Named(
        {"phi": phi, "plane_offset": 0.4, "plane_tilt": -0.004},
        {"eccentricity": 0.5, "eccentricity_direction": 5.7},
        {**ROUND, "form": form, "patches": dirt}, {"noise": 2 * UM}, {"profiles": 1700},
    )  # fmt: skip
    return interpret(simulate(stand.stand(), stand.simulation(), shaft(), 0).recording, stand.stand())


@pytest.mark.parametrize("name", tried(list(DIRT)[:4], *list(DIRT)[4:]))
@pytest.mark.parametrize("phi", tried([ABOVE], radians(-41.802)))
def test_dirt_is_told_from_form(name, phi):
    """Taken for form it put the laser plane up to 4 *U* off here, 12 on other shafts, *valid*."""
    found = calibrate(scan_under(*DIRT[name], phi), shaft())
    assert found.status == "valid", found.reasons
    assert found.residuals.rejected > 0.2 * sum(patch.share for patch in DIRT[name][1]) * found.residuals.points
    assert abs(1e3 * (found.eccentricity - 0.5)) < found.uncertainty["eccentricity_um"].U
    assert abs((found.plane_offset or 0.4) - 0.4) < found.uncertainty["laser_plane_offset_mm"].U
    assert abs((found.plane_tilt or -0.004) + 0.004) < radians(found.uncertainty["laser_plane_tilt_deg"].U)


def test_dirt_on_more_than_can_be_told_from_the_shaft_is_not_trusted():
    found = calibrate(scan_under((), (Patch("base", 1.0, 0.5, 20 * UM),)), shaft())
    (reason,) = (reason for reason in found.reasons if reason.code == "surface_edges")
    assert found.status == "untrusted" and "on 'base', at " in reason


ANGLE = np.linspace(0.0, 1.7 * tau, 1000)
RADIUS, TRAVEL = 12.5, 0.9


def on_shaft(angle):
    """Where the sensor reads on a shaft that travels towards it with the cosine."""
    return angle + np.arcsin(TRAVEL * np.sin(angle) / RADIUS)


def trace(*waves, of_table=(), height=0.0, middle=2.0, width=90.0, soft=10.0, seed=0):
    """Travel, ``waves`` of form (number a turn, um) or of the table's bearing, a patch, noise of 0.2 um: mm."""
    place = on_shaft(ANGLE)
    rng = np.random.default_rng(seed)
    off = np.degrees(np.abs(np.angle(np.exp(1j * (place - middle)))))
    out = 1e3 * (TRAVEL * np.cos(ANGLE) + RADIUS * np.cos(place - ANGLE)) + height * np.clip(
        ((width + soft) / 2 - off) / soft, 0.0, 1.0
    )
    for at, listed in ((place, waves), (ANGLE, of_table)):
        out = out + sum(a * np.cos(n * at + n * n) for n, a in listed)
    return (out + rng.normal(0.0, 0.2, ANGLE.size)) * UM


def told(*traces):
    return patches(ANGLE, np.stack(traces), (RADIUS,) * len(traces))


@pytest.mark.parametrize("soft", [2.0, 10.0, 20.0])
@pytest.mark.parametrize("waves", [(), ((9, 3.0), (17, 8.0))])
def test_a_patch_is_told_with_its_edges(soft, waves):
    (mask,) = told(trace(*waves, height=8.0, soft=soft))
    off = np.degrees(np.abs(np.angle(np.exp(1j * (on_shaft(np.radians(np.arange(SECTORS) + 0.5)) - 2.0)))))
    assert mask[off < 40.0 + soft / 2].all() and not mask[off > 53.0 + soft / 2].any()


@pytest.mark.parametrize(
    "sound",
    [
        trace(),
        trace((3, 20.0), (8, 5.0), (24, 8.0), (25, 4.0)),
        trace(*((n, 30.0 / n**1.5) for n in range(2, 40))),
        trace(of_table=((9, 4.0), (22, 3.0))),
        trace((11, 5.0), of_table=((11, 4.0),)),
    ],
)
def test_form_and_bearing_are_no_patches(sound):
    assert not told(sound).any()


def test_what_two_surfaces_have_at_one_angle_is_the_table_s():
    assert told(trace(height=8.0), trace(seed=1)).any(axis=1).tolist() == [True, False]
    assert not told(trace(height=8.0), trace(height=8.5, seed=1)).any()
    assert told(trace(height=8.0), trace(height=14.0, seed=1)).any(axis=1).all()


def test_the_largest_edge_is_found_where_it_is():
    place = np.radians(np.arange(0.5, SECTORS))
    rng = np.random.default_rng(0)
    sound = rng.normal(0.0, 0.2 * UM, SECTORS) + 3 * UM * np.cos(20 * place)
    rise, at = largest_edge(place, np.ones(SECTORS), sound + 6 * UM * (place > 4.0), 6)
    assert 4 * UM < rise < 7 * UM
    assert np.abs(np.sin((at - np.array([0.0, 4.0])) / 2)).min() < 0.05
    assert largest_edge(place, np.ones(SECTORS), sound, 6)[0] < 2 * UM
