"""The outlier rule and its companions: each is what the others say it is."""

import numpy as np
import pytest

from truestand.core.robust import (
    TUKEY,
    m_estimator_correction,
    medians,
    robust_sd,
    trimmed_means,
    tukey_cost,
    tukey_fit,
    tukey_slopes,
    tukey_weights,
)


def test_the_weight_falls_from_one_to_zero_at_the_limit():
    assert tukey_weights(np.array([0.0, 1.0, -2.0, 0.5])).tolist() == [1.0, 0.0, 0.0, 0.5625]


def test_the_score_is_the_slope_of_the_cost_and_has_the_slopes_that_are_said():
    for ratio in (-0.9, -0.2, 0.0, 0.4, 0.99, 1.3):
        step, score = 1e-6, lambda r: r * float(tukey_weights(np.array(r)))
        at, around = np.array([ratio]), (np.array([ratio + 1e-6]), np.array([ratio - 1e-6]))
        cost_slope = (tukey_cost(around[0]) - tukey_cost(around[1])) / (2 * step)
        assert cost_slope == pytest.approx(2 * TUKEY**2 * score(ratio), abs=1e-6)
        score_slope = (score(ratio + step) - score(ratio - step)) / (2 * step)
        assert float(tukey_slopes(tukey_weights(at))[0]) == pytest.approx(score_slope, abs=1e-5)


def test_the_correction_is_between_none_and_two():
    assert m_estimator_correction(100.0, 100.0) == 1.0
    assert m_estimator_correction(100.0, 10.0) == 2.0
    assert m_estimator_correction(0.0, 0.0) == 0.0


def test_a_fit_does_not_see_a_third_of_outliers():
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 1.0, 300)
    samples = 2.0 + 3.0 * t + rng.normal(0, 0.01, t.size)
    outliers = rng.random(t.size) < 1 / 3
    samples[outliers] += rng.uniform(1.0, 5.0, outliers.sum())
    solution, weights = tukey_fit(np.column_stack([np.ones(t.size), t]), samples, 1e-7)
    assert solution == pytest.approx([2.0, 3.0], abs=0.006)
    assert not weights[outliers].any()


def test_a_robust_sd_is_that_of_the_normal_noise_under_outliers():
    noise = np.random.default_rng(2).normal(0, 0.1, 20_000)
    noise[:1000] = 50.0
    assert robust_sd(noise) == pytest.approx(0.1, rel=0.08)
    assert np.isnan(robust_sd(np.zeros(0)))


def test_medians_of_cells_are_those_of_numpy():
    rng = np.random.default_rng(3)
    cell, values = rng.integers(0, 20, 500), rng.normal(0, 2, 500)
    cell[cell == 7] = 8
    middle, count = medians(cell, values, 20)
    for k in range(20):
        expected = np.median(values[cell == k]) if k != 7 else np.nan
        assert middle[k] == pytest.approx(expected, abs=1e-9, nan_ok=True)
        assert count[k] == np.count_nonzero(cell == k)


def test_trimmed_means_leave_outliers_out():
    rng = np.random.default_rng(4)
    cell = np.repeat(np.arange(10), 200)
    values = cell + rng.normal(0, 0.01, cell.size)
    values[::50] += 3.0
    means, count = trimmed_means(cell, values, 11)
    assert means[:10] == pytest.approx(np.arange(10), abs=0.004)
    assert means[10] == count[10] == 0.0
    assert (count[:10] <= 196).all() and (count[:10] > 190).all()
