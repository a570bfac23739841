"""What a calibration takes up of an error of the sensor's range, against calibrations of virtual scans with it."""

from dataclasses import replace
from functools import cache
from math import pi, radians

import numpy as np
import pytest

from gears import simulation
from truestand.calibration.calibrate import calibrate
from truestand.core.calibration import HEIGHT
from truestand.core.frames import PHI, RADIAL
from truestand.core.scan import interpret
from truestand.sim import paper_shaft, simulate
from truestand.uncertainty.influence import unknowns_of
from truestand.uncertainty.range_errors import range_errors
from truth import STANDS
from variants import tried

AMPLITUDE = 0.02
PLACES = {"from above": (-125.0, -1.0), "from below": (-60.0, 8.0), "nearly upright": (-80.0, 2.0)}


@cache
def calibrated(place, amplitude=0.0, phase=0.0):
    stand = STANDS["paper"].stand()
    stand = replace(stand, sensors=(replace(stand.sensor, points=240, linearity_U=AMPLITUDE),))
    phi, height = PLACES[place]
    how = simulation(1100, True, nonlinearity=amplitude, nonlinearity_phase=phase, noise=2e-4)
    how = replace(how, mounting=replace(how.mounting, phi=radians(phi), height=height))
    return calibrate(interpret(simulate(stand, how, paper_shaft(), 1).recording, stand), paper_shaft())


@pytest.mark.parametrize("place", tried(["from above"], "from below", "nearly upright"))
def test_what_is_taken_up_is_what_a_calibration_finds(place):
    """A cosine and a sine over the range, within a quarter of both: the static profile bends, which a slope doesn't."""
    clean = calibrated(place)
    waves = range_errors(clean)[:2]
    before, height = unknowns_of(clean)
    told, found = [], []
    for wave, phase in zip(waves, (pi / 2, 0.0), strict=True):
        after, raised = unknowns_of(calibrated(place, AMPLITUDE, phase))
        found.append([*(after - before)[[PHI, RADIAL]], raised - height])
        told.append(wave.taken_up[[PHI, RADIAL, HEIGHT]])
    off, size = np.linalg.norm(np.subtract(told, found), axis=0), np.linalg.norm(found, axis=0)
    assert (off < 0.25 * size).all()


@pytest.mark.parametrize("phase", tried([pi / 2], 0.0, pi))
def test_the_eccentricity_counts_how_a_range_error_stretches_the_travel(phase):
    """An upright line shows nothing of it: 1.7 um off where U was 1.2."""
    found = calibrated("nearly upright", AMPLITUDE, phase)
    assert abs(1000.0 * (found.eccentricity - 0.88)) < found.uncertainty["eccentricity_um"].U
