"""Flanks that were not seen to an end of a range where those beside them were: what is there is not known.

No ray tells: where the face or the profile ends, readings run out on sound teeth, too, and a tooth that is broken off
within the last cell of the helix' range looks as if they had run out a little sooner.
"""

from collections.abc import Sequence
from math import ceil, log, pi

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.gear.damage import Damage, unseen_region, zones_of
from truestand.gear.flanks import Flanks, about_circle
from truestand.gear.grid import TRACE_SHARE, Grid, step_on_flank

BESIDE = (-3, -2, -1, 1, 2, 3)
"""Teeth beside one that say how far flanks are seen there: an eccentric gear is seen a little farther on one side."""
USUAL = 0.75
"""Quantile of what those show: some of them may be broken as well."""
BY_CHANCE, LEAST_LOST = 1e-5, 0.01
"""Probability that a sound flank lacks so many readings at its end, and share of them that get lost at least."""
ON_MOST = 0.75
"""Share of the flanks of a side that must lack them at one place for that to count against the rest of the face."""
OVERLAP, MORE = 4, 2
"""Windows that overlap along the face; readings that a flank must lack in one, more than those of a profile a pass and
one besides."""
FARTHER = 1.5
"""Times as far as readings of a profile lie apart a flank must end before the range: noise moves them."""
ALL_ALONG = 3.0
"""Times as far as readings of other flanks lie apart there, at most: where profiles on end don't have theirs at the
same roll lengths, they fill it.
"""
HARDLY_ANY = 0.1
"""Share of the usual readings beyond a height, at most, that a flank which ends before it has there: strays."""


def unseen_at_ends(flanks: Flanks, grid: Grid, step: float, points: int) -> tuple[Damage, ...]:
    """The ends of helices and profiles that flanks don't show where those beside them do.

    ``step``: table angle from one profile to the next, rad; so many ``points`` a profile.
    """
    helices = _ends_of_helices(flanks, grid, zones_of(grid, step)["helix"], points)
    return (*helices, *_ends_of_profiles(flanks, grid, step, points))


def _ends_of_helices(flanks: Flanks, grid: Grid, zone: Mask, points: int) -> list[Damage]:
    nominal, found = grid.nominal, []
    flanks = about_circle(flanks)
    enough = _enough(flanks, points)
    for sign, end in zip((-1.0, 1.0), nominal.helix_range, strict=True):
        outward = _by_flank(flanks, sign * flanks.height, grid)
        ends = _ends_before(outward, _beside(outward), sign * end, enough)
        for flank in np.flatnonzero(np.isfinite(ends)):
            columns = _between(grid.edges, sign, min(ends[flank], sign * end), sign * end)
            side, tooth = divmod(int(flank), grid.delta.shape[1])
            found.append(unseen_region(side, tooth, zone & columns, grid))
    return found


def _ends_of_profiles(flanks: Flanks, grid: Grid, step: float, points: int) -> list[Damage]:
    """In windows along the face, as wide as its middle, for damage may cover a part of that; against the flanks beside
    each, and against the same flank elsewhere, for it may be on all of them.

    A profile begins anywhere within a step of the table: with every pass one flank may show one more than another. And
    across helical flanks its readings lie apart, at the same roll lengths for profiles on end.
    """
    nominal, found = grid.nominal, []
    edges = np.linspace(nominal.control_roll, nominal.tip_roll, grid.rolls.size + 1)
    (bottom, top), width = nominal.helix_range, 2 * TRACE_SHARE * nominal.gear.face_width
    lows = np.linspace(bottom, top - width, ceil(OVERLAP * (top - bottom) / width))
    turns = (int(flanks.profile.max(initial=0)) + 1) * abs(step) / (2 * pi)
    passes = max(ceil(turns - (1.0 - USUAL)), 1)
    for sign, end in zip((-1.0, 1.0), nominal.profile_range, strict=True):
        near = flanks.select(np.abs(flanks.roll - end) < 2 * float(step_on_flank(nominal, end, step)))
        windows = [near.select((near.height > low) & (near.height < low + width)) for low in lows]
        outward = [_by_flank(window, sign * window.roll, grid) for window in windows]
        elsewhere = _side_by_side(outward).swapaxes(0, 1)
        apart = _apart_on_profiles(near, points)
        cells = np.zeros((2 * grid.delta.shape[1], *grid.delta.shape[2:]), dtype=bool)
        for low, window, own in zip(lows, windows, outward, strict=True):
            least = (passes + 1) * _of_a_profile(window, points) + MORE
            columns = (grid.edges[1:] > low) & (grid.edges[:-1] < low + width)
            ends = _either(
                *(_ends_far_before(own, others, sign * end, least, apart) for others in (_beside(own), elsewhere))
            )
            for flank in np.flatnonzero(np.isfinite(ends)):
                cells[flank] |= _between(edges, sign, min(ends[flank], sign * end), sign * end)[:, None] & columns
        unseen = cells.reshape(grid.delta.shape) & ~grid.seen
        found += [unseen_region(s, t, unseen[s, t], grid) for s, t in np.argwhere(unseen.any(axis=(2, 3)))]
    return found


def _either(beside: Array, elsewhere: Array) -> Array:
    """Where flanks end before those ``beside`` them, or, where most of a side do, before themselves ``elsewhere``."""
    of_sides = np.isfinite(elsewhere).reshape(2, -1)
    most = np.repeat(of_sides.mean(axis=1) >= ON_MOST, of_sides.shape[1])
    return np.where(np.isnan(beside) & most, elsewhere, beside)


def _by_flank(flanks: Flanks, outward: Array, grid: Grid) -> Array:
    """Places ``outward`` (n,) mm of the readings of each flank: (flanks, most), increasing, after -inf for none."""
    order = np.lexsort((outward, flanks.flank))
    flank = flanks.flank[order]
    number = np.bincount(flank, minlength=2 * grid.delta.shape[1])
    places = np.full((number.size, int(number.max(initial=0))), -np.inf)
    places[flank, places.shape[1] + np.arange(flank.size) - np.cumsum(number)[flank]] = outward[order]
    return places


def _side_by_side(places: Sequence[Array]) -> Array:
    """Places of readings by flank, of several windows: (windows, flanks, most)."""
    most = max(p.shape[1] for p in places)
    return np.stack([np.pad(p, ((0, 0), (most - p.shape[1], 0)), constant_values=-np.inf) for p in places])


def _beside(places: Array) -> Array:
    """Places (flanks, others, most) on the teeth beside each flank's, on its side."""
    sides = places.reshape(2, places.shape[0] // 2, places.shape[1])
    return np.stack([np.roll(sides, -k, axis=1).reshape(places.shape) for k in BESIDE], axis=1)


def _between(edges: Array, sign: float, first: float, last: float) -> Mask:
    """Cells (n,) with ``edges`` (n + 1,) mm that lie in part between two places outward, by their ``sign``."""
    inner, outer = np.sort(sign * np.stack([edges[:-1], edges[1:]]), axis=0)
    return np.asarray((outer > first) & (inner < last))


def _of_a_profile(flanks: Flanks, points: int) -> int:
    """Readings that a profile, of so many ``points``, has at most on a flank: they come and go together."""
    rows = int(flanks.index.max(initial=0)) // points + 1
    profiles = flanks.flank.astype(np.int64) * rows + flanks.index // points
    return int(np.unique(profiles, return_counts=True)[1].max(initial=0))


def _apart_on_profiles(flanks: Flanks, points: int) -> float:
    """mm of roll length from one reading of a profile, of so many ``points``, on a flank to the next."""
    order, numbers = flanks.along_profiles(points)
    apart = np.abs(np.diff(flanks.roll[order]))[numbers == 1]
    return float(np.median(apart)) if apart.size else 0.0


def _enough(flanks: Flanks, points: int) -> int:
    """Readings that no flank lacks at its end by chance: profiles begin and end anywhere within the distance of two
    readings, and some get lost. So many ``points`` a profile.
    """
    _, apart = flanks.along_profiles(points)
    within = apart[apart > 0]
    lost = 1.0 - within.size / max(int(within.sum()), 1)
    crossing = (apart.size - within.size) / max(np.unique(flanks.flank).size, 1)
    elsewhere = float(crossing * (1.0 - BY_CHANCE ** (1.0 / max(crossing, 1.0))))
    return ceil(max(elsewhere, log(BY_CHANCE) / log(max(lost, LEAST_LOST))))


def _ends_before(own: Array, others: Array, end: float, enough: int) -> Array:
    """Where the readings of flanks end, (flanks,) mm of places (flanks, most), if ``enough`` of ``others`` (flanks,
    others, most) lie beyond, up to the ``end`` or as far as they go; NaN where they don't, or its own do, too.
    """
    if enough > others.shape[-1]:
        return np.full(own.shape[0], np.nan)
    farthest = others[..., -enough]
    looked_at = np.minimum(end, _usual(np.where(np.isfinite(farthest), farthest, np.nan)))[:, None]
    usual = _usual((others >= looked_at[..., None]).sum(axis=-1))
    few = (own >= looked_at).sum(axis=-1)
    last = np.take_along_axis(np.pad(own, ((0, 0), (1, 0)), constant_values=-np.inf), -1 - few[:, None], axis=1)[:, 0]
    return np.where((usual >= enough) & (few <= HARDLY_ANY * usual) & np.isfinite(last), last, np.nan)


def _ends_far_before(own: Array, others: Array, end: float, enough: int, apart: float) -> Array:
    """``_ends_before``, where that is farther than readings of a profile lie ``apart`` (mm), or those of others."""
    ends = _ends_before(own, others, end, enough)
    most_apart = np.fmin(FARTHER * apart, ALL_ALONG * _widest_gap(others, ends, end, enough))
    return np.where(end - ends > most_apart, ends, np.nan)


def _widest_gap(others: Array, ends: Array, end: float, enough: int) -> Array:
    """How far apart, mm, readings of most ``others`` (flanks, others, most) that have ``enough`` there lie at most
    between where flanks end, at ``ends`` (flanks,) mm outward, and the ``end`` of the range; NaN: a flank doesn't end
    before.
    """
    shown = (others > ends[:, None, None]).sum(axis=2) >= enough
    places = np.pad(np.clip(others, ends[:, None, None], end), ((0, 0), (0, 0), (1, 1)), constant_values=end)
    places[:, :, 0] = ends[:, None]
    return _usual(np.where(shown, np.diff(places, axis=2).max(axis=2), np.nan))


def _usual(values: Array) -> Array:
    """What most of the values (flanks, others) reach, NaN aside; NaN where there is nothing else."""
    known = np.isfinite(values).sum(axis=1, keepdims=True)
    at = np.floor(USUAL * (known - 1)).astype(np.intp)
    return np.where(known > 0, np.take_along_axis(np.sort(values, axis=1), at, axis=1), np.nan)[:, 0]
