"""Traces as series: exact for any arc, where the nearest Fourier bin leaks."""

from math import atan2, pi, tau

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
    assert atan2(fit.sin[0], fit.cos[0]) == pytest.approx(1.1, abs=1e-9)


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


def test_gaps_are_no_obstacle():
    angle = tau * 1.3 * np.arange(3000) / 3000
    trace = 1.0 + 0.2 * np.cos(angle)
    trace[500:900] = np.nan
    fit = fit_harmonics(angle, trace)
    assert fit.amplitude(1) == pytest.approx(0.2, abs=1e-12)
    assert fit.mean == pytest.approx(1.0, abs=1e-12)


def test_too_few_samples_are_refused():
    with pytest.raises(NotEnoughData, match="need 5"):
        fit_harmonics(np.zeros(3), np.zeros(3), (1, 2))


def test_fits_reach_the_cramer_rao_bound():
    """60 noisy waves of 2.75 turns: rms errors reach the best that can be had, which 60 tell to 9 %."""
    n, sd, amplitude, phase = 250, 0.01, 0.9, 0.4
    angle = tau * 2.75 * np.arange(n) / n
    c, s = np.cos(angle - phase), np.sin(angle - phase)
    errors = []
    for seed in range(60):
        fit = fit_harmonics(angle, amplitude * c + np.random.default_rng(seed).normal(0, sd, n))
        errors.append((fit.amplitude(1) - amplitude, atan2(fit.sin[0], fit.cos[0]) - phase))
    design = np.column_stack([np.ones(n), c, amplitude * s])
    bound = sd * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))[1:3]
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(rms / bound < 1.3)
