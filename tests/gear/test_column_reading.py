"""Columns of cells read at one roll length, and traces between them, where little or nothing was seen."""

import numpy as np
import pytest

from truestand.gear.column_reading import reading_at
from truestand.gear.interpolation import interpolation
from truestand.gear.traces import _bends_of_columns

NOTHING = np.full((2, 3, 8), np.nan)
"""(flanks, heights, roll lengths)."""


def test_columns_of_which_nothing_was_seen_read_0_and_say_so():
    zeros = np.zeros(NOTHING.shape)
    reading = reading_at(zeros, NOTHING, zeros + 1e-6, zeros, zeros, [1.0], 0.1)
    assert not reading.seen.any()
    assert np.array_equal(reading(np.zeros((2, 1, 8, 3))), np.zeros((2, 3)))


@pytest.mark.parametrize(("own", "known", "within"), [(0.0, True, 0.006), (0.004, True, 0.012), (0.0, False, 0.021)])
def test_between_two_cells_a_flank_stands_about_as_the_shape_that_all_teeth_share(own, known, within):
    """It rises by 20 um from one cell to the next and bulges by 3: without knowing that, it may lie anywhere between
    them. A flank with a slope of its own may stand as much farther off.
    """
    x = np.array([-1.8, -0.6, 0.6, 1.8]) * np.ones((1, 1, 1))
    shape = 0.02 * x / 1.2 - 0.003 * x**2 / 0.36
    values = shape + own * x / 1.2
    reading = reading_at(values, x, np.full(x.shape, 1e-8), np.zeros(x.shape), shape if known else 0.0 * x, [], 0.1)
    read = float(reading(values.reshape(1, 1, 4, 1))[0, 0])
    low, high = read - reading.below[0, 0], read + reading.above[0, 0]
    assert low - 1e-12 <= 0.0 <= high + 1e-12
    assert high - low < within


def test_lines_between_values_end_with_them():
    """One flank with a gap, one of a single value, one of none."""
    at = np.array([[0.0, np.nan, 2.0, 5.0], [np.nan, 1.0, np.nan, np.nan], [np.nan] * 4])
    places = np.array([-1.0, -0.2, 0.0, 1.0, 4.0, 5.1, 6.0])
    read = interpolation(at, places, np.full(at.shape, 0.25), widest=2.5)
    values = np.array([[10.0, np.nan, 14.0, 20.0], [np.nan, 3.0, np.nan, np.nan], [np.nan] * 4])
    expected = np.full((3, places.size), np.nan)
    expected[0] = [np.nan, 10.0, 10.0, 12.0, np.nan, 20.0, np.nan]
    expected[1, 3] = 3.0
    np.testing.assert_allclose(read(np.nan_to_num(values)), expected)
    assert read.inside.tolist()[0] == [False, False, True, True, True, False, False]


def test_noise_of_single_columns_is_no_bend_of_a_profile():
    """Averaged with its sign, it falls by the root of their number; what all of them bend by stays."""
    columns, rolls = 16, np.linspace(5.0, 12.0, 36)
    noise = np.random.default_rng(3).standard_normal((columns, rolls.size))
    at, points = np.broadcast_to(rolls, noise.shape), rolls[1:-1]
    of_all = _bends_of_columns(noise, at, points, (5.0, 12.0))
    of_each = np.mean([_bends_of_columns(one[None], at[:1], points, (5.0, 12.0)) for one in noise], axis=0)
    assert 0.5 < np.mean(of_all) / np.mean(of_each) * np.sqrt(columns) < 1.5
    step = rolls[1] - rolls[0]
    bent = _bends_of_columns(noise * 0.0 + np.square(rolls), at, points, (5.0, 12.0))
    np.testing.assert_allclose(bent, step**2 / 4, rtol=1e-9)  # by which x^2 lies below its chord in the middle
