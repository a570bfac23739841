"""A film of oil in patches on both steps: what it does to the axes stands in U."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from intervals import PER_TURN, POINTS, drawn, errors_of, stand
from truestand.calibration.calibrate import calibrate
from truestand.calibration.uneven_form import SOURCE
from truestand.core.scan import interpret
from truestand.sim import simulate
from truth import scan_of, shaft
from variants import tried

SD, PATCH = 0.02, 4.0
"""mm, of a film that only adds, and the size of its patches."""


@cache
def filmed(seed):
    """The truth of a stand drawn from its papers, and its calibration by an oily shaft: sd of the film, 20 um."""
    simulated, artefact = drawn(np.random.default_rng(seed))
    made = simulate(stand(), simulated, artefact, seed)
    white = np.random.default_rng(seed + 1000).normal(size=(PER_TURN, POINTS))
    smooth = gaussian_filter(white, (PATCH / 2 / (2 * np.pi * 12.5) * PER_TURN, PATCH / 2 / 0.12), mode="wrap")
    film = np.maximum(smooth, 0.0)
    film *= SD / film.std()
    recording = made.recording
    z = recording.z - film[np.arange(recording.z.shape[0]) % PER_TURN]
    oily = replace(recording, x=recording.x * (z / recording.z), z=z)
    return made, calibrate(interpret(oily, stand()), artefact)


@pytest.mark.slow
@pytest.mark.parametrize("seed", tried([0, 7], 2, 5, 8, 15, 19))
def test_a_film_on_both_steps_is_in_u_or_doubted(seed):
    """Offset, tilt and direction were 1.1 to 4.1 U off, *valid*."""
    made, found = filmed(seed)
    errors = errors_of(found, made)
    off = {k: abs(e) / found.uncertainty[k].U for k, e in errors.items() if k not in found.not_identifiable}
    # of 60 shafts 36 are doubted, and 1.97 is the worst of the others
    assert found.reasons or max(off.values()) < 2.0
    (check,) = (c for c in found.checks if c.name.startswith("form changes along the shaft"))
    assert found.reasons or not check.ok


def test_a_clean_shaft_adds_nothing():
    found = calibrate(scan_of("many harmonics"), shaft())
    lines = found.uncertainty["eccentricity_um"].contributions
    assert sum(c.U for c in lines if c.name == SOURCE) < 0.05
    assert next(c for c in found.checks if c.code == "form_changes_along_shaft").ok
