"""Traces as series: exact for any arc, where the nearest Fourier bin leaks."""

from math import pi, tau

import numpy as np
import pytest

from truestand.core.errors import NotEnoughData
from truestand.core.harmonics import fit_harmonics, nearest_bin, wrap


@pytest.mark.parametrize("turns", np.arange(0.9, 10.01, 0.05).round(2))
def test_amplitude_and_phase_are_exact_for_any_arc(turns):
    angle = tau * turns * np.arange(2000) / 2000
    trace = 12.0 + 0.8789 * np.cos(angle - 1.1) + 0.085 * np.cos(2 * angle + 0.4)
    fit = fit_harmonics(angle, trace, (1, 2))
    assert fit.amplitude(1) == pytest.approx(0.8789, abs=1e-9)
    assert fit.phase(1) == pytest.approx(1.1, abs=1e-9)


def test_the_nearest_bin_of_275_turns_reads_the_paper_s_026_pi_and_too_little_amplitude():
    angle = tau * 2.75 * np.arange(11000) / 11000
    found = nearest_bin(0.8789 * np.cos(angle + 0.3), 2.75)
    assert found.index == 3
    assert wrap(-found.phase - 0.3) / pi == pytest.approx(-0.25, abs=0.02)
    assert 0.86 < found.amplitude / 0.8789 < 0.94


def test_a_whole_number_of_turns_does_not_leak():
    angle = tau * 3 * np.arange(6000) / 6000
    found = nearest_bin(0.5 * np.cos(angle + 0.3), 3.0)
    assert found.amplitude == pytest.approx(0.5, abs=1e-12)
    assert -found.phase == pytest.approx(0.3, abs=1e-12)


def test_gaps_and_drift_are_no_obstacle():
    angle = tau * 1.3 * np.arange(3000) / 3000
    trace = 1.0 + 0.2 * np.cos(angle) + 0.01 * np.linspace(-0.5, 0.5, 3000)
    trace[500:900] = np.nan
    fit = fit_harmonics(angle, trace, (1,), drift=True)
    assert fit.amplitude(1) == pytest.approx(0.2, abs=1e-12)
    assert fit.drift == pytest.approx(0.01, abs=1e-12)


def test_too_few_samples_are_refused():
    with pytest.raises(NotEnoughData, match="need 5"):
        fit_harmonics(np.zeros(3), np.zeros(3), (1, 2))
