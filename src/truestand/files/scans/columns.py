"""Columns and matrices as sensors leave them: fields that are always sent, profiles of different length."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import UnreadableFile

Array = NDArray[np.float64]

MOST_FILLED = 100
"""Cells for each point, beyond which a profile's length is taken for damage: short profiles are filled up."""
LARGEST = 2**53
"""Beyond it float64 skips whole numbers."""


def running(values: NDArray[np.int64]) -> NDArray[np.int64] | None:
    """Counts (N,) that count something; None where they never change: nothing is connected, or nothing turned."""
    return values if np.any(values != values[:1]) else None


def counts(values: NDArray[np.int64], what: str, name: str) -> Array:
    """Whole numbers (N,) as float64, to the last digit.

    Raises:
        UnreadableFile: a number that float64 doesn't hold.
    """
    if values.size and max(-int(values.min()), int(values.max())) > LARGEST:
        raise UnreadableFile(f"{name}: found {what} beyond 2^53, need counts; the file is damaged: export it again")
    return values.astype(np.float64)


def matrix(profiles: Sequence[NDArray[np.float64]], name: str) -> Array:
    """Profiles of different length as (N, M), M that of the longest; NaN at the end of the others.

    Raises:
        UnreadableFile: no point at all, or a profile so much longer than the others that it is no profile.
    """
    lengths = np.array([len(p) for p in profiles])
    longest, points = int(lengths.max(initial=0)), int(lengths.sum())
    if longest == 0:
        raise UnreadableFile(f"{name}: found {len(lengths)} profiles without a point, need a scan")
    if longest * lengths.size > MOST_FILLED * max(points, MOST_FILLED**2):
        raise UnreadableFile(
            f"{name}: found {longest} points in profile {int(lengths.argmax())} and fewer than a {MOST_FILLED}th of it "
            "in most others, need profiles of like length; the file is damaged: export it again"
        )
    full = np.full((lengths.size, longest), np.nan)
    full[np.arange(longest) < lengths[:, None]] = np.concatenate(profiles)
    return full
