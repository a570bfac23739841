"""Damaged gears as they are inspected, and as they truly are.

Class 10 as in the issue: limits of f_p 33, F_alpha 44, f_falpha 35, f_Halpha 27, F_beta 50, f_fbeta 37 um.
"""

from dataclasses import replace
from functools import lru_cache
from math import radians

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gears import POINTS, SPUR, scanned, simulation, stand, true_calibration
from truestand.apply.datum import datum_of
from truestand.core.scan import interpret
from truestand.core.surface import apply_calibration
from truestand.gear.flanks import find_flanks, find_toothing
from truestand.gear.geometry import FLANKS, involute
from truestand.gear.inspect import inspect_gear
from truestand.sim import GearErrors, VirtualGear, Worn, paper_shaft
from truestand.sim.gear_truth import gear_figures

UM = 1e-3
GEAR = replace(SPUR, accuracy_class=10)
WIDE = replace(GEAR, evaluation=replace(GEAR.evaluation, narrowest_damage=4.0))
"""Of which the drawing says that no narrower damage matters: none is suspected between profiles."""
SOUND = GearErrors(phase=radians(3.0))
WILD = simulation(outliers=0.2, dropouts=0.1)
UNEVEN = replace(SOUND, pitch_left=(0.0,) * 4 + (-0.0025,) + (0.0,) * 19)
FACE = (4.0, 26.0)
PROFILE, HELIX, PITCH = ("F_alpha", "f_falpha"), ("F_beta", "f_fbeta"), ("f_p",)
FORM_LINES = (*PROFILE, *HELIX)
FIGURES = (*PROFILE, "f_Halpha", *HELIX, "f_Hbeta")


def worn(rolls, heights, depth, edge=0.1, errors=SOUND, tooth=5):
    return replace(errors, worn=(*errors.worn, Worn(tooth, "left", rolls, heights, depth, edge)))


@lru_cache(maxsize=4)
def inspected(errors, gear=GEAR, how=None, points=POINTS, blind=(), shaking=0.0, strays=0.0, stuck=None, gone=0.0):
    """A sensor that reads steep flanks to 5 um and a good encoder; ``blind``: spots without a reading, (tooth, flank,
    roll length, height, radius) each; ``shaking``: mm rms by which whole profiles are off, those beside each other
    alike; ``strays``: share of the readings that are half a millimetre off, one way or the other; ``stuck``: points of
    the sensor and the range that they report, NaN: none; ``gone``: share of the readings that get lost in runs of 3
    to 12.
    """
    recording = scanned(gear, errors, how or simulation(), points).recording
    scan = interpret(replace(recording, z=_stuck(recording.z, *stuck)) if stuck else recording, stand(points))
    scan = replace(scan, z=scan.z + shaking * _shaken(scan.z.shape[0])[:, None]) if shaking else scan
    scan = replace(scan, z=scan.z + _strayed(scan.z.shape, strays)) if strays else scan
    scan = replace(scan, z=np.where(_in_runs(scan.z.shape, gone), np.nan, scan.z)) if gone else scan
    sensor = replace(scan.stand.sensor, incidence_U=0.005)
    stated = replace(scan.stand, sensors=(sensor,), table=replace(scan.stand.table, angle_U=1e-5))
    known = replace(true_calibration(bool(gear.helix_angle)), reasons=())
    surface = apply_calibration(replace(scan, stand=stated), known)
    return inspect_gear(without_readings(surface, gear, blind) if blind else surface, gear)


def _stuck(z, stuck, at):
    """Ranges (profiles, points) mm of which some points report the same all the time."""
    return np.where(np.isin(np.arange(z.shape[1]), stuck), at, z)


def _shaken(profiles):
    """Noise (profiles,) of standard deviation 1, alike over two profiles or three."""
    noise = gaussian_filter1d(np.random.default_rng(6).standard_normal(profiles), 1.7, mode="wrap")
    return noise / noise.std()


def _strayed(shape, share):
    """mm (profiles, points) by which a share of the readings is off, 0.5 rms."""
    rng = np.random.default_rng(8)
    return np.where(rng.random(shape) < share, rng.normal(0.0, 0.5, shape), 0.0)


def _in_runs(shape, share):
    """Which readings (profiles, points) get lost: about this share, 3 to 12 points of a profile at a time."""
    rng, (profiles, points) = np.random.default_rng(9), shape
    number = rng.poisson(share * profiles * points / 7.5)
    row, first, length = (rng.integers(*bounds, number) for bounds in ((0, profiles), (-12, points), (3, 13)))
    begins, ends = np.zeros((2, profiles, points + 1), dtype=np.int64)
    np.add.at(begins, (row, np.maximum(first, 0)), 1)
    np.add.at(ends, (row, np.clip(first + length, 0, points)), 1)
    return np.cumsum(begins - ends, axis=1)[:, :-1] > 0


def without_readings(surface, gear, spots):
    """The surface as if nothing had come back from some spots."""
    nominal, z = involute(gear), surface.z.copy()
    flanks = find_flanks(surface, find_toothing(surface, nominal, datum_of(surface.origin[1], gear.datum, 0.0)))
    for tooth, flank, roll, height, radius in spots:
        own = flanks.flank == FLANKS.index(flank) * gear.teeth + tooth - 1
        gone = own & (np.hypot(flanks.roll - roll, flanks.height - height) < radius)
        z.reshape(-1)[flanks.index[gone]] = np.nan
    seen = np.isfinite(z)
    scan = replace(surface.scan, z=np.where(seen, surface.scan.z, np.nan))
    return apply_calibration(scan, surface.calibration)


@lru_cache(maxsize=4)
def truth(errors, gear=GEAR):
    return gear_figures(VirtualGear(gear, errors), paper_shaft(), simulation().workpiece)


def line(found, name, tooth=5, flank="left"):
    return next(c for c in found.characteristics if (c.name, c.tooth, c.flank) == (name, tooth, flank))


def verdict(found, name, tooth=5, flank="left"):
    return line(found, name, tooth, flank).verdict


MEASURED = {
    "groove across": (2, (8.5, 9.8), FACE, 0.06, 0.1, PROFILE),
    "groove along, off mid-face": (5, (0.0, 15.0), (19.0, 21.0), 0.06, 0.1, ("f_fbeta",)),
    "groove along": (8, (0.0, 15.0), (13.0, 17.0), 0.06, 0.1, ("f_fbeta",)),
    "wear": (11, (7.0, 9.5), FACE, 0.05, 1.25, ("f_falpha",)),
    "step at the tip": (14, (10.0, 15.0), FACE, 0.09, 0.3, PROFILE),
    "shallow": (17, (8.0, 10.5), FACE, 0.012, 0.3, ()),
    "end of the face": (20, (0.0, 15.0), (21.0, 26.0), 0.08, 0.5, ("f_fbeta",)),
}
"""By name: tooth, roll lengths, heights, depth and width of the edges, mm, and what does not conform for it."""
DAMAGED = replace(SOUND, worn=tuple(Worn(tooth, "left", *where) for tooth, *where, _ in MEASURED.values()))
