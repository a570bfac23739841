"""Columns of cells read at one roll length, and traces between them, where little or nothing was seen."""

import numpy as np

from truestand.gear.column_reading import reading_at
from truestand.gear.interpolation import interpolation

NOTHING = np.full((2, 3, 8), np.nan)
"""(flanks, heights, roll lengths)."""


def test_columns_of_which_nothing_was_seen_read_0_and_say_so():
    zeros = np.zeros(NOTHING.shape)
    reading = reading_at(zeros, NOTHING, zeros + 1e-6, zeros, [1.0], 0.1)
    assert not reading.seen.any()
    assert np.array_equal(reading(np.zeros((2, 1, 8, 3))), np.zeros((2, 3)))


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
