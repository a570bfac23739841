"""Profiles that the sensor gave again: a held image, a buffer read twice, a copied line."""

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.scan import Scan

MOST_LAG = 12
"""Profiles back among which a profile is looked for."""
SAMPLED_PROFILES = 100
"""For the points that are seen."""
FIRST_POINTS = 16
"""Points of each profile that are compared first: those seen most."""
BLOCK = 500
"""Profiles compared whole at a time."""
MOST_SHARE = 0.001
"""Share of the profiles: noise makes no two alike,"""
MOST_SHARE_QUIET = 0.05
"""but for a sensor of large steps and little noise, over a surface that stands still."""
LEAST_CHANCE = 1e-6
"""That two profiles are alike by chance; a smaller one is taken for none."""
STRETCHES = 20
"""Of the scan, in each of which the chance is looked for: a trace stands still where it turns back."""


def repeated_share(scan: Scan) -> tuple[float, float]:
    """Share of the profiles that are one of the few before them again, and the share that is allowed."""
    sample = scan.z[scan.spread(SAMPLED_PROFILES)]
    seen = np.count_nonzero(np.isfinite(sample), axis=0)
    first = scan.z[:, np.sort(np.argsort(-seen, kind="stable")[:FIRST_POINTS])]
    repeated = np.zeros(scan.profiles, dtype=bool)
    for lag in range(1, min(MOST_LAG, scan.profiles - 1) + 1):
        rows = np.flatnonzero(_alike(first[lag:], first[:-lag]) & ~repeated[lag:]) + lag
        for block in np.array_split(rows, -(-rows.size // BLOCK) or 1):
            repeated[block] = _whole_alike(scan, block, lag)
    points = float(seen.sum()) / sample.shape[0]
    by_chance = _agreement(first, repeated) ** points > LEAST_CHANCE
    return float(repeated.mean()), MOST_SHARE_QUIET if by_chance else MOST_SHARE


def _alike(now: Array, before: Array) -> Mask:
    """Which profiles (n,) of readings (n, m) are the same, readings that are missing from both among them."""
    return np.asarray(((now == before) | (np.isnan(now) & np.isnan(before))).all(axis=1))


def _whole_alike(scan: Scan, rows: Ints, lag: int) -> Mask:
    """Which of some profiles (n,) are the one ``lag`` before them again; those without any reading are not."""
    z, x = (_alike(values[rows], values[rows - lag]) for values in (scan.z, scan.x))
    return np.asarray(np.isfinite(scan.z[rows]).any(axis=1) & z & x)


def _agreement(readings: Array, repeated: Mask) -> float:
    """Share of the readings (n, m) that are as in the profile before, where it is largest; repeated ones aside."""
    known = np.isfinite(readings[1:]) & np.isfinite(readings[:-1]) & ~repeated[1:, None]
    same = (readings[1:] == readings[:-1]) & known
    stretches = np.array_split(np.arange(known.shape[0]), STRETCHES)
    return max(float(same[s].sum() / max(int(known[s].sum()), 1)) for s in stretches)
