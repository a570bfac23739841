"""Checks that a scan passes or fails, on fits made by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from truestand.calibration.calibrate import calibrate
from truestand.calibration.checks import shared_form
from truestand.calibration.model import Model
from truth import scan_of, shaft


def fit_with_form(*waves, orders=4):
    """A fit of two surfaces whose harmonics are (surface, upr, cosine mm, sine mm) alone."""
    model = Model((12.5, 6.97), (-10.0, 15.0), -71.0, 0.0, orders, (0.0, 1.0), ((70.0, 95.0), (95.0, 121.0)))
    parameters = np.zeros(model.size)
    for surface, upr, cosine, sine in waves:
        start = model.form_slice(surface).start + upr - 2
        parameters[start], parameters[start + orders - 1] = cosine, sine
    return SimpleNamespace(model=model, solution=SimpleNamespace(parameters=parameters))


def test_form_of_one_size_and_phase_on_all_surfaces_is_shared():
    fit = fit_with_form((0, 3, 0.003, -0.004), (1, 3, 0.003, -0.004), (0, 2, 0.02, 0.0))
    assert shared_form(fit) == pytest.approx(0.005)


def test_form_of_one_surface_or_of_another_phase_is_not_shared():
    assert shared_form(fit_with_form((0, 2, 0.02, 0.0))) == 0.0
    assert shared_form(fit_with_form((0, 2, 0.02, 0.0), (1, 2, 0.0, 0.02))) == 0.0


def test_a_fit_without_form_shares_none():
    assert shared_form(fit_with_form(orders=1)) == 0.0


def test_a_wave_that_all_surfaces_share_is_in_u_of_the_eccentricity():
    """It may be the bearing's, whose first wave nobody can tell from eccentricity."""
    found = calibrate(scan_of("many harmonics"), shaft())
    (check,) = (c for c in found.checks if c.code.startswith("form_shared"))
    assert not check.ok
    (line,) = (c for c in found.uncertainty["eccentricity_um"].contributions if c.name.startswith("table bearing"))
    shared, known = line.U, check.value
    assert shared == pytest.approx(known, rel=1e-6)
    clean = calibrate(scan_of("encoder"), shaft()).uncertainty["eccentricity_um"].contributions
    (assumed,) = (c.U for c in clean if c.name.startswith("table bearing"))
    assert assumed == pytest.approx(0.5)
