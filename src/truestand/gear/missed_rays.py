"""Cells of flanks that rays show nothing of, and how sure it is that the flank is not there, or covered.

Sensors lose readings on sound flanks, too: what is missed counts where it is missed more often than on other teeth, or
elsewhere on all of them.
"""

from math import log, sqrt

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.robust import nan_median, robust_sd
from truestand.gear.rays import FlankRays, Rays

LEAST_LOST, MOST_LOST = 1e-3, 0.05
"""Share of rays that get lost on sound flanks at least, and share from which only their number counts: of the twenty
cells to which a region may go on from one, chance then leaves one out.
"""
RARELY_LOST = 1e-3
"""So seldom a ray must get lost for a cell without it to weigh as much as one that departs."""
ON_MOST = 0.75
"""Share of a cell's rays, over all teeth, that must meet the flank for it to be missed on the others."""
WINDOWS: tuple[tuple[int | None, int | None], ...] = ((3, 9), (5, 17), (2, None), (None, 2))
"""Cells of roll length and height in which missed rays are counted together; None: all."""
TOO_OFTEN = 5.0
"""Standard deviations by which there are more of them than elsewhere."""
PLACE, OFTEN_AT_ONE_PLACE = (3, 3), 0.25
"""Cells about a place, and share of the rays there that all teeth together miss, from which it is one of holes."""
NEIGHBOURS = (-2, -1, 1, 2)
"""Teeth beside one that say what is usual there."""
PASSES = 3
"""In which teeth with more of them are left out of what is usual."""
MOST_BETWEEN = 8
"""Cells along the height that may lie between two of which many are missed."""


def unseen_cells(rays: FlankRays, there: Mask) -> tuple[Mask, Array]:
    """Cells (2, teeth, roll lengths, heights) that rays of any kind show nothing of, and how much each of them
    weighs.
    """
    in_empty_rows, in_runs = rays.inside.in_empty_rows, rays.in_runs.missed
    (first, by_first), (second, by_second) = (_not_seen(told, there) for told in (rays.beside, rays.between))
    alike = _missed_at_one_place(rays.between, there)
    return (
        first | second | in_runs | in_empty_rows | alike,
        np.maximum.reduce([by_first, by_second, in_empty_rows, alike]),
    )


def _missed_at_one_place(rays: Rays, there: Mask) -> Mask:
    """Cells (2, teeth, roll lengths, heights) at a place where many teeth miss ``rays`` between readings of a profile
    which they show at other heights of its row: holes at one place of all flanks, however often readings get lost.
    """
    pooled = (cells[:, there].sum(axis=1, keepdims=True) for cells in (rays.expected, rays.missed))
    expected, missed = (_sums(cells, PLACE) for cells in pooled)
    share = np.where(expected > 0, missed / np.maximum(expected, 1.0), np.nan)
    usual = np.clip(np.nan_to_num(nan_median(share, axis=3))[..., None], LEAST_LOST, 1.0 - LEAST_LOST)
    more = _deviance(missed, expected, usual) > TOO_OFTEN * sqrt(min(rays.on_end, PLACE[1]))
    return np.asarray(rays.missed & more & (share > OFTEN_AT_ONE_PLACE))


def _not_seen(rays: Rays, there: Mask) -> tuple[Mask, Array]:
    """Cells (2, teeth, roll lengths, heights) that rays show nothing of, though most teeth ``there`` show them, and
    how much each of them weighs.

    Where rays often get lost, only where they get lost more often than on other teeth; cells between those are none
    that others show.
    """
    expected, missed = (cells[:, there].sum(axis=1, keepdims=True) for cells in (rays.expected, rays.missed))
    on_most = (expected > 0) & (missed <= (1.0 - ON_MOST) * expected)
    too_often = rays.missed & _missed_too_often(rays, there)
    weight = np.clip(np.log(np.maximum(rays.lost, LEAST_LOST) / MOST_LOST) / log(RARELY_LOST / MOST_LOST), 0.0, 1.0)
    single = rays.missed & on_most & (rays.lost <= MOST_LOST)
    weight /= rays.on_end  # those of one run are lost together
    not_seen = single | with_those_between(too_often, rays.expected & ~rays.missed, MOST_BETWEEN)
    return not_seen, np.where(too_often, 1.0, np.where(single, weight, 0.0))


def with_those_between(cells: Mask, shown: Mask, most: int) -> Mask:
    """The same cells (2, teeth, roll lengths, heights) and those not ``shown`` between them, at ``most`` so many along
    the height.
    """
    from scipy.ndimage import binary_closing

    closed = binary_closing(cells, np.ones((1, 1, 1, most + 1), dtype=bool))
    return np.asarray(cells | (closed & ~shown))


def _missed_too_often(rays: Rays, there: Mask) -> Mask:
    """Cells (2, teeth, roll lengths, heights) of windows in which more rays miss the flank than on other teeth."""
    from scipy.ndimage import maximum_filter

    too_often = np.zeros(rays.expected.shape, dtype=bool)
    for window in WINDOWS:
        expected, missed = _sums(rays.expected, window), _sums(rays.missed, window)
        together = rays.on_end if window[1] is None else min(rays.on_end, window[1])
        sound = there[:, None, None] & (expected > 0)
        for _ in range(PASSES):
            excess = _deviance(missed, expected, _usual(np.where(sound, missed, 0.0), np.where(sound, expected, 0.0)))
            spread = robust_sd(excess[sound]) if sound.any() else 1.0  # losses beside each other go together
            more = np.asarray(excess > TOO_OFTEN * max(spread, sqrt(together)))
            sound &= ~more
        too_often |= maximum_filter(
            more, [1, 1, *(2 * n if of is None else of for n, of in zip(more.shape[2:], window, strict=True))]
        )
    return too_often


def _usual(missed: Array, expected: Array) -> Array:
    """Share (2, teeth, roll lengths, heights) of rays that get lost on all teeth, or on those beside each where it is
    more: an eccentric gear is seen at another incidence all round.
    """
    beside = [sum(np.roll(n, shift, axis=1) for shift in NEIGHBOURS) for n in (missed, expected)]
    of_all = [n.sum(axis=1, keepdims=True) for n in (missed, expected)]
    share = np.maximum(*(lost / np.maximum(of, 1.0) for lost, of in (beside, of_all)))
    return np.asarray(np.clip(share, LEAST_LOST, 1.0 - LEAST_LOST))


def _sums(cells: Mask | Array, window: tuple[int | None, int | None]) -> Array:
    """Sums (2, teeth, roll lengths, heights) of cells, or of numbers of them, in a window about each; None: all of a
    column or row.
    """
    from scipy.ndimage import uniform_filter1d

    total = cells.astype(np.float64)
    for axis, size in zip((2, 3), window, strict=True):
        if size is None:
            total = np.broadcast_to(total.sum(axis=axis, keepdims=True), cells.shape)
        elif size > 1:
            total = size * uniform_filter1d(total, size, axis=axis, mode="constant")
    return np.asarray(np.rint(total))


def _deviance(number: Array, of: Array, share: Array) -> Array:
    """By how many standard deviations a ``number`` ``of`` trials exceeds a ``share``: signed root of the deviance of a
    binomial distribution.
    """
    from scipy.special import rel_entr

    found = number / np.maximum(of, 1.0)
    square = 2 * of * (rel_entr(found, share) + rel_entr(1.0 - found, 1.0 - share))
    return np.asarray(np.sign(found - share) * np.sqrt(np.maximum(square, 0.0)))
