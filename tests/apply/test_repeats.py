"""How far two calibrations of one artefact may differ where nothing has moved."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truestand.apply.repeats import least_difference

SEEDS = st.integers(0, 10_000)


def covariance(seed, causes=3, size=4):
    influence = np.random.default_rng(seed).normal(size=(size, causes))
    return influence @ influence.T


@given(SEEDS, st.floats(1e-3, 1e3))
def test_causes_that_act_alike_cancel(seed, size):
    one = covariance(seed)
    left = least_difference(one, size**2 * one)
    assert left == pytest.approx((size - 1.0) ** 2 * one, abs=1e-9 * max(1.0, size**2) * np.abs(one).max())


@given(SEEDS)
def test_it_is_a_covariance_and_of_no_more_than_what_the_causes_leave(seed):
    rng = np.random.default_rng(seed)
    one, other = rng.normal(size=(2, 4, 3))
    left = least_difference(one @ one.T, other @ other.T)
    assert np.linalg.eigvalsh(left)[0] > -1e-9
    scale = np.maximum(np.square(one).sum(axis=1), np.square(other).sum(axis=1))
    assert np.sum(np.diag(left) / scale) <= np.sum(np.square(one - other).sum(axis=1) / scale) * (1 + 1e-9)


@given(SEEDS)
def test_units_do_not_matter(seed):
    units = np.outer([1.0, 1e3, 1e-3, 57.3], [1.0, 1e3, 1e-3, 57.3])
    one, other = covariance(seed), covariance(seed + 1)
    of_units = least_difference(units * one, units * other)
    assert of_units / units == pytest.approx(least_difference(one, other), abs=1e-7 * np.abs(one).max())


def test_of_nothing_all_is_left():
    assert least_difference(covariance(1), np.zeros((4, 4))) == pytest.approx(covariance(1))
