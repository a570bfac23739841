"""Ranges and maxima without the noise's share."""

import numpy as np
import pytest

from truestand.statistics.noise import cleared, from_noise


def statistics(values):
    return np.stack([np.ptp(values, axis=-1), np.abs(values).max(axis=-1), np.sqrt(np.mean(values**2, axis=-1))], -1)


def test_noise_alone_is_nothing_on_average():
    """500 normal readings range over 6.1 s; the mean of 40 trials is told to 0.4 s."""
    rng = np.random.default_rng(2)
    sd = np.full(500, 0.01)
    trials = [cleared(statistics, rng.normal(0, 0.01, 500), sd) for _ in range(40)]
    raw = np.mean([t.raw for t in trials], axis=0)
    left = np.mean([t.value for t in trials], axis=0)
    assert raw[0] == pytest.approx(0.061, rel=0.05)
    assert (left < 0.5 * raw).all()


def test_what_noise_hardly_touches_stays():
    """A wave ten thousand times the noise: the range's bias is some 2 s and goes."""
    wave = np.cos(np.arange(500) * np.pi / 50)
    found = cleared(statistics, wave + np.random.default_rng(3).normal(0, 1e-4, 500), np.full(500, 1e-4))
    assert found.value == pytest.approx([2.0, 1.0, np.sqrt(0.5)], abs=4e-4)


def test_the_same_seed_gives_the_same_answer_and_nan_stays():
    values = np.r_[np.nan, np.random.default_rng(4).normal(0, 1, 50)]
    nan_range = lambda v: np.stack([np.nanmax(v, -1) - np.nanmin(v, -1)], -1)  # noqa: E731
    one, other = (cleared(nan_range, values, np.full(51, 0.1)) for _ in range(2))
    assert one.value == other.value
    assert from_noise(nan_range, values, np.full(51, 0.1))[0] == pytest.approx(0.45, abs=0.1)
