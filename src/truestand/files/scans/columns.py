"""Columns and matrices as sensors leave them: fields that are always sent, profiles of different length."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints
from truestand.core.errors import UnreadableFile

MOST_FILLED = 100
"""Elements for each reading, beyond which a profile's length is taken for damage: short profiles are filled up."""
LARGEST_COUNT = 2**53
"""Beyond it float64 skips whole numbers."""


def drop_constant(values: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Counts (N,); None where they never change: nothing is connected, or nothing turned."""
    return values if np.any(values != values[:1]) else None


def encoder_counts(values: NDArray[np.int64] | None, name: str) -> Array | None:
    """Whole numbers (N,) as float64, to the last digit; None where there are none.

    Raises:
        UnreadableFile: a number that float64 doesn't hold.
    """
    if values is None:
        return None
    if values.size and max(-int(values.min()), int(values.max())) > LARGEST_COUNT:
        raise UnreadableFile(
            f"{name}: found an encoder count beyond 2^53, need counts; the file is damaged: export it again"
        )
    return values.astype(np.float64)


def stack_profiles(profiles: Sequence[Array], name: str) -> Array:
    """Profiles of different length as (N, M), M that of the longest; NaN at the end of the others.

    Raises:
        UnreadableFile: no point at all, or a profile so much longer than the others that it is no profile.
    """
    lengths = np.array([len(p) for p in profiles])
    if not lengths.any():
        raise UnreadableFile(f"{name}: found {len(lengths)} profiles without a point, need a scan")
    if is_uneven(lengths):
        raise UnreadableFile(
            f"{name}: found {lengths.max()} points in profile {int(lengths.argmax())} and fewer than a "
            f"{MOST_FILLED}th of it in most others, need profiles of like length; the file is damaged: export it again"
        )
    return fill_rows(np.concatenate(profiles), lengths)


def is_uneven(lengths: Ints) -> bool:
    """Whether the longest of rows (N,) is so much longer than the others that it must be damage."""
    return int(lengths.max()) * lengths.size > MOST_FILLED * max(int(lengths.sum()), MOST_FILLED**2)


def fill_rows(values: Array, lengths: Ints) -> Array:
    """The values of rows one after the other as (N, longest row), NaN at the end of the shorter ones."""
    longest = int(lengths.max())
    if (lengths == longest).all():
        return values.reshape(lengths.size, longest)
    full = np.full((lengths.size, longest), np.nan)
    full[np.arange(longest) < lengths[:, None]] = values
    return full
