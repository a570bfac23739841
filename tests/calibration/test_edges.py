"""Dirt on a part of a cylinder: told from form by its edges."""

from math import radians

import numpy as np
import pytest

from truestand.calibration.calibrate import calibrate
from truestand.calibration.edges import COUNT, SECTORS, Edges
from truestand.core.scan import interpret
from truestand.sim import FormWave, Patch, simulate
from truth import ABOVE, ROUND, Named, shaft
from variants import tried

UM = 1e-3
DIRT = {
    "12 um on 37 % of the bearing": ((), (Patch("bearing", 1.0, 0.37, 12 * UM),)),
    "15 um on 38 % of the base": ((), (Patch("base", 4.0, 0.38, 15 * UM),)),
    "40 um on 39 % of the base": ((), (Patch("base", 2.5, 0.39, 40 * UM),)),
    "both": ((), (Patch("base", 2.5, 0.29, 18 * UM), Patch("bearing", 5.0, 0.23, 8 * UM))),
    "two heights": ((), (Patch("base", 0.5, 0.10, 36 * UM), Patch("base", 3.0, 0.14, 14 * UM))),
    "with a wave of form": ((FormWave("base", 7, 5 * UM, 1.0),), (Patch("base", 3.0, 0.28, 74 * UM),)),
    "with a fast wave of form": ((FormWave("base", 14, 3 * UM, 1.0),), (Patch("base", 3.0, 0.19, 40 * UM),)),
}


def scan_under(form, patches, phi=ABOVE):
    stand = Named(
        {"phi": phi, "plane_offset": 0.4, "plane_tilt": -0.004},
        {"eccentricity": 0.5, "eccentricity_direction": 5.7},
        {**ROUND, "form": form, "patches": patches}, {"noise": 2 * UM}, {"profiles": 1700},
    )  # fmt: skip
    return interpret(simulate(stand.stand(), stand.simulation(), shaft(), 0).recording, stand.stand())


@pytest.mark.parametrize("name", tried(list(DIRT)[:3], *list(DIRT)[3:]))
@pytest.mark.parametrize("phi", tried([ABOVE], radians(-41.802)))
def test_dirt_is_told_by_its_edges(name, phi):
    """Taken for form it put the laser plane up to 4 *U* off here, 10 on other shafts, *valid*."""
    found = calibrate(scan_under(*DIRT[name], phi), shaft())
    assert found.status == "valid", found.reasons
    assert found.residuals.rejected > 0.2 * sum(patch.share for patch in DIRT[name][1]) * found.residuals.points
    assert abs(1e3 * (found.eccentricity - 0.5)) < found.uncertainty["eccentricity_um"].U
    assert abs(found.plane_offset - 0.4) < found.uncertainty["laser_plane_offset_mm"].U
    assert abs(found.plane_tilt + 0.004) < radians(found.uncertainty["laser_plane_tilt_deg"].U)


def test_dirt_on_more_than_can_be_told_from_the_shaft_is_not_trusted():
    found = calibrate(scan_under((), (Patch("base", 1.0, 0.5, 20 * UM),)), shaft())
    assert found.status == "untrusted" and "surface_edges" in [reason.code for reason in found.reasons]


def edges(*risen):
    sectors, rises = zip(*risen, strict=True)
    return Edges(np.array(sectors), np.array(rises))


@pytest.mark.parametrize(
    ("found", "cut"),
    [
        (edges((10, 1.0), (40, -1.0)), range(9, 42)),  # dirt
        (edges((10, -1.0), (40, 1.0)), range(9, 42)),  # a flat
        (edges((40, -1.0), (170, 1.0)), [*range(169, COUNT), *range(42)]),  # over the zero of the angle
        (edges((10, 1.0), (20, 1.0), (30, -1.0), (40, -1.0)), range(9, 42)),  # two layers
        (edges((10, 1.0)), []),
    ],
)
def test_what_lies_between_edges_is_cut_out_with_them(found, cut):
    mask = found.cut_out().reshape(COUNT, SECTORS // COUNT)
    assert np.flatnonzero(mask.all(axis=1)).tolist() == sorted(cut)
    assert (mask.all(axis=1) == mask.any(axis=1)).all()


def test_edges_of_all_surfaces_alike_are_the_table_s():
    found = edges((10, 1.0), (40, -1.0), (80, 0.5))
    left = found.apart_from((edges((11, 0.9), (40, 1.0), (85, 0.5)),))
    assert left.sector.tolist() == [40, 80]
