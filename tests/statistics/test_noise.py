"""Ranges and maxima without the noise's share."""

import numpy as np
import pytest

from truestand.statistics.noise import cleared, from_noise


def statistics(values):
    size = np.abs(values)
    rms, p95 = np.sqrt(np.mean(values**2, axis=-1)), np.quantile(size, 0.95, axis=-1)
    return np.stack([np.ptp(values, axis=-1), size.max(axis=-1), rms, p95], -1)


EXTREMES = np.array([True, True, False, False])


def test_noise_alone_is_nothing_on_average():
    """500 normal readings range over 6.1 s; the mean of 40 trials is told to 0.4 s."""
    rng = np.random.default_rng(2)
    sd = np.full(500, 0.01)
    trials = [cleared(statistics, rng.normal(0, 0.01, 500), sd, EXTREMES) for _ in range(40)]
    raw = np.mean([t.raw for t in trials], axis=0)
    left = np.mean([t.value for t in trials], axis=0)
    assert raw[0] == pytest.approx(0.061, rel=0.05)
    assert (left < 0.5 * raw).all()


@pytest.mark.parametrize("wave", [0.0, 0.002, 0.005, 0.01, 0.02, 0.1, 1.0])
def test_what_is_left_is_within_its_u(wave):
    """A round section read 1.6 um of roundness at a U of 1.3, for its noise let the raw value scatter by 0.5. Right is
    an rms of 0.5; p95 is neither an extreme nor a mean square.
    """
    rng, form = np.random.default_rng(5), wave * np.cos(np.arange(500) * 0.0613)
    found = [cleared(statistics, form + rng.normal(0, 0.01, 500), np.full(500, 0.01), EXTREMES) for _ in range(100)]
    off = np.array([(f.value - statistics(form)) / (2 * f.u) for f in found])
    assert (np.mean(np.abs(off) < 1, axis=0) > 0.75).all() and (np.sqrt(np.mean(off**2, axis=0)) < 0.75).all()


def test_what_noise_hardly_touches_stays():
    """A wave ten thousand times the noise: the range's bias is some 2 s and goes."""
    wave = np.cos(np.arange(500) * 0.0613)
    found = cleared(statistics, wave + np.random.default_rng(3).normal(0, 1e-4, 500), np.full(500, 1e-4), EXTREMES)
    assert found.value == pytest.approx(statistics(wave), abs=4e-4)


def test_the_same_seed_gives_the_same_answer_and_nan_stays():
    values = np.r_[np.nan, np.random.default_rng(4).normal(0, 1, 50)]
    nan_range = lambda v: np.stack([np.nanmax(v, -1) - np.nanmin(v, -1)], -1)  # noqa: E731
    one, other = (cleared(nan_range, values, np.full(51, 0.1), np.array([True])) for _ in range(2))
    assert one.value == other.value
    assert from_noise(nan_range, values, np.full(51, 0.1))[0] == pytest.approx(0.45, abs=0.1)
