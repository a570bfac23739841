"""Readings of a part that stand alone: what one profile saw and neither its neighbours nor another turn bear out.

On a part, outliers are single readings, never regions: a groove departs from the ideal surface as far as an outlier
does, but its readings bear each other out. A reading counts when readings beside it in profile and time are like it (or
more of them go along with it: a small dent has no two readings alike), or as one of two or three in a row that depart
from the surface together where outliers are too rare for that, or as one of more in a place than outliers would be,
and, where another turn shows its place, when it repeats there.
"""

from math import inf, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.robust import MAD_TO_SD, medians, robust_sd

IN_PROFILE, ACROSS = (-3, -2, -1, 1, 2, 3), (-1, 0, 1)
"""Points by which readings of the same profile are beside one, and of the profiles before and after it,"""
ROWS = 2
"""of which so many count where a region departs."""
MOST_SLANT = 2.0
"""Points a profile by which a groove may run aslant through profiles."""
MARGIN = 3 + round(ROWS * MOST_SLANT)
Image = NDArray[np.float32]
"""delta (profiles + 2 ROWS, points + 2 MARGIN) mm of a scan's readings, with an empty margin; NaN: none."""
LEAST_ALIKE, FEW = 2, 6
"""Readings beside one that must be like it; one is enough where fewer than so many were seen."""
LEAST_ALONG, ALONG = 4, 1 / 3
"""Or readings beside it that must depart from the surface as it does, to within a share of its own departure."""
ALIKE = 4.0
"""Standard deviations of the difference of two readings within which they are alike."""
SAME_PLACE = 0.25
"""Steps of the table within which a profile of another turn meets the same place."""
BY_CHANCE, HIGHEST = 0.5, 0.4
"""Outliers of a scan that may bear each other out by chance; density of a normal distribution at its middle, times its
standard deviation.
"""
NEAR = 6, 4
"""Profiles and points within which lone readings stand together,"""
LEAST_TOGETHER, RARE = 2, 0.01
"""so many more of them at least, and how many times in a scan that may happen by chance."""
LEAST_SPREAD = 5e-4
"""mm: the scatter of readings is not taken for less: sensors count in steps."""


def lone_readings(
    delta: Array,
    surface: NDArray[np.integer],
    index: NDArray[np.integer],
    points: int,
    angle: Array,
    slant: float = 0.0,
) -> Mask:
    """Which readings (n,) of surfaces nothing bears out.

    ``delta`` (n,) mm of deviation; ``surface`` (n,) a number for each flank or section; ``index`` (n,) of the reading
    in a scan of ``points`` a profile; ``angle`` (profiles,) rad of the table; ``slant``: points of a profile by which a
    place moves on from one profile to the next.
    """
    if not delta.size:
        return np.zeros(0, dtype=bool)
    row, column = np.divmod(index, points)
    image: Image = np.full((angle.size + 2 * ROWS, points + 2 * MARGIN), np.nan, dtype=np.float32)
    width, flat = image.shape[1], image.reshape(-1)
    at = (row + ROWS) * width + column + MARGIN
    flat[at] = delta
    reach = ALIKE * sqrt(2.0) * max(_spread(image), LEAST_SPREAD)
    seen, alike, along = np.zeros((3, delta.size), dtype=np.int8)
    above = delta - _median_of(surface, delta)
    off = np.abs(above)
    farther = reach + ALONG * off
    beside = [(0, c) for c in IN_PROFILE]
    beside += [(r, c + round(r * slant)) for r in range(-ROWS, ROWS + 1) if r for c in ACROSS]
    in_row = {}
    for r, c in beside:
        apart = np.abs(flat.take(at + (r * width + c)) - delta)
        with np.errstate(invalid="ignore"):
            goes_along = apart < farther
            along += goes_along
            if not r:
                in_row[c] = goes_along
            if abs(r) < ROWS:
                seen += np.isfinite(apart)
                alike += apart < reach
    shown, repeated = np.zeros((2, delta.size), dtype=bool)
    for place in _places_in_other_turns(angle):
        low, high = _bracket(image, np.where(repeated, np.nan, place[row]), column)
        drift = _drift(delta - _nearest(image, place[row], column), surface, angle[row])
        with np.errstate(invalid="ignore"):
            repeated |= (delta - drift > low - reach) & (delta - drift < high + reach)
        shown |= np.isfinite(low)
    alone = (alike < np.where(seen < FEW, 1, LEAST_ALIKE)) & (along < LEAST_ALONG)
    least_alike, least_along = _needed(off[alone], delta.size, reach, len(beside))
    alone |= (off > reach) & (alike < least_alike) & (along < least_along)
    number, total = np.count_nonzero(alone), alone.size
    if number**2 < total:  # two outliers side by side are not to be expected,
        alone &= ~(in_row[-1] | in_row[1])
    elif number**3 < total**2:  # or not three
        alone &= ~((in_row[-2] & in_row[-1]) | (in_row[-1] & in_row[1]) | (in_row[1] & in_row[2]))
    alone[alone] = ~_together(np.sign(above[alone]), row[alone], (column - slant * row)[alone], total)
    return np.asarray(alone | (shown & ~repeated))


def _together(side: Array, row: NDArray[np.int64], column: Array, total: int) -> Mask:
    """Which lone readings (n,) of a ``total`` stand with more such on the same ``side`` of the surface (-1 or 1) than
    chance puts there: where a steep edge is seen aslant, no two of its readings are alike.

    Those that do are no outliers, and don't tell how many of them chance makes.
    """
    others, found = _others_near(side, row, column), np.zeros(side.size, dtype=bool)
    while True:
        together = others >= _fewest_together(int(np.count_nonzero(~found)), total)
        if not (together & ~found).any():
            return found
        found |= together


def _others_near(side: Array, row: NDArray[np.int64], column: Array) -> NDArray[np.int64]:
    """How many of the others on its ``side`` (n,) stand near each reading in ``row`` and ``column``."""
    from scipy.spatial import KDTree

    others = np.zeros(side.size, dtype=np.int64)
    for sign in (-1.0, 1.0):
        own = np.flatnonzero(side == sign)
        if own.size:
            at = np.stack([row[own] / NEAR[0], column[own] / NEAR[1]], axis=1)
            others[own] = KDTree(at).query_ball_point(at, 1.0, p=inf, return_length=True) - 1
    return others


def _fewest_together(outliers: int, total: int) -> float:
    """How many others must stand near one of so many ``outliers`` among a ``total`` of readings for that not to happen
    by chance anywhere in a scan.
    """
    from scipy.special import bdtrc

    places = (2 * NEAR[0] + 1) * (2 * NEAR[1] + 1) - 1
    fewest = np.arange(LEAST_TOGETHER, places + 1)
    rare = outliers * bdtrc(fewest - 1, places, outliers / total) < RARE
    return float(fewest[np.argmax(rare)]) if rare.any() else inf


def _needed(off: Array, total: int, reach: float, beside: int) -> tuple[int, int]:
    """How many of the readings ``beside`` one that is off the surface must be like it, and how many must go along with
    it, for outliers not to do so by chance: the more of them there are, the more.

    ``off`` (n,) mm by which those are off that are alone, of a ``total``; ``reach``: mm within which two are alike.
    """
    from scipy.special import bdtrc

    spread = max(float(np.median(off)) * MAD_TO_SD, reach) if off.size else reach
    each = off.size / max(total, 1) * HIGHEST / spread  # outliers a reading and mm
    windows = 2 * reach, 2 * (reach + ALONG * spread)
    needed = []
    for window, least in zip(windows, (LEAST_ALIKE, LEAST_ALONG), strict=True):
        numbers = np.arange(least, beside + 1)
        by_chance = off.size * bdtrc(numbers - 1, beside, min(each * window, 1.0))
        needed.append(int(numbers[np.argmax(by_chance < BY_CHANCE)]) if (by_chance < BY_CHANCE).any() else beside)
    return needed[0], needed[1]


def _spread(image: Image) -> float:
    """Standard deviation (mm) of a reading, from its differences to the next one of its profile."""
    steps = np.diff(image, axis=1)
    steps = steps[np.isfinite(steps)]
    return robust_sd(steps.astype(np.float64)) / sqrt(2.0) if steps.size else 0.0


def _places_in_other_turns(angle: Array) -> list[Array]:
    """For each other turn, where (profiles,) at its profiles each profile's angle comes again; NaN: nowhere.

    Halfway between two profiles lies what neither of them may have met: a groove narrower than a step.
    """
    upward = angle if angle[-1] >= angle[0] else -angle
    rows, turns = np.arange(angle.size, dtype=np.float64), int(np.ptp(angle) / (2 * pi))
    others = (t for t in range(-turns, turns + 1) if t)
    places = (np.interp(upward + 2 * pi * t, upward, rows, left=np.nan, right=np.nan) for t in others)
    return [np.where(np.abs(place - np.rint(place)) < SAME_PLACE, place, np.nan) for place in places]


def _bracket(image: Image, place: Array, column: NDArray[np.int64]) -> tuple[Array, Array]:
    """Least and largest delta (n,) of the readings about each ``place`` (n,) between two profiles; NaN: none."""
    there = np.flatnonzero(np.isfinite(place))
    first = np.minimum(place[there].astype(np.int64), image.shape[0] - 2 * ROWS - 2)
    width, flat = image.shape[1], image.reshape(-1)
    at = (first + ROWS) * width + column[there] + MARGIN
    least, largest = np.full((2, there.size), np.nan, dtype=np.float32)
    for r in (0, 1):
        for c in (-1, 0, 1):
            other = flat.take(at + (r * width + c))
            np.fmin(least, other, out=least)
            np.fmax(largest, other, out=largest)
    low, high = np.full((2, place.size), np.nan)
    low[there], high[there] = least, largest
    return low, high


def _nearest(image: Image, place: Array, column: NDArray[np.int64]) -> Array:
    """delta (n,) of the reading nearest to each ``place`` (n,); NaN: none."""
    there = np.isfinite(place)
    row = np.rint(np.where(there, place, 0.0)).astype(np.int64)
    return np.where(there, image.reshape(-1).take((row + ROWS) * image.shape[1] + column + MARGIN), np.nan)


def _drift(apart: Array, surface: NDArray[np.integer], angle: Array) -> Array:
    """By how much (n,) a surface stands elsewhere on the other turn: the median of what lies ``apart`` there, mm."""
    turn = ((angle - angle.min()) / (2 * pi)).astype(np.int64)
    return _median_of(surface.astype(np.int64) * (int(turn.max(initial=0)) + 1) + turn, apart)


def _median_of(key: NDArray[np.integer], values: Array) -> Array:
    """Median (n,) of the values of the same key, NaN aside."""
    known = np.isfinite(values)
    median, _ = medians(key[known], values[known], int(key.max(initial=0)) + 1)
    return np.asarray(median[key])
