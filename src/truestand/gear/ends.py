"""Flanks that were not seen to an end of a range where those beside them were: what is there is not known.

No ray tells: where the face or the profile ends, readings run out on sound teeth, too, and a tooth that is broken off
within the last cell of the helix' range looks as if they had run out a little sooner.
"""

from collections.abc import Sequence
from math import ceil, log

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.gear.damage import Damage, unseen_region, zones_of
from truestand.gear.flanks import Flanks
from truestand.gear.grid import TRACE_SHARE, Grid, step_on_flank

ABOUT_CIRCLE = 0.15
"""Share of the control length to either side of the measuring circle whose readings say how far a flank is seen."""
BESIDE = (-3, -2, -1, 1, 2, 3)
"""Teeth beside one that say how far flanks are seen there: an eccentric gear is seen a little farther on one side."""
USUAL = 0.75
"""Quantile of what those show: some of them may be broken as well."""
BY_CHANCE, LEAST_LOST = 1e-5, 0.01
"""Probability that a sound flank lacks so many readings at its end, and share of them that get lost at least."""
ON_MOST = 0.75
"""Share of the flanks of a side that must lack them at one place for that to count against the rest of the face."""
OVERLAP, MORE = 4, 2
"""Windows that overlap along the face; readings more than those of two profiles that a flank must lack in one."""
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
    about_circle = np.abs(flanks.roll - nominal.measuring_roll) < ABOUT_CIRCLE * nominal.control_length
    flanks = flanks.select(about_circle)
    enough = _enough(flanks, points)
    for sign, end in zip((-1.0, 1.0), nominal.helix_range, strict=True):
        outward = _by_flank(flanks, sign * flanks.height, grid)
        for flank, readings in enumerate(outward):
            seen_to = _ends_before(readings, _beside(outward, flank), sign * end, enough)
            if seen_to is not None:
                columns = _between(grid.edges, sign, min(seen_to, sign * end), sign * end)
                side, tooth = divmod(flank, grid.delta.shape[1])
                found.append(unseen_region(side, tooth, zone & columns, grid))
    return found


def _ends_of_profiles(flanks: Flanks, grid: Grid, step: float, points: int) -> list[Damage]:
    """In windows along the face, as wide as its middle, for damage may cover a part of that; against the flanks beside
    each, and against the same flank elsewhere, for it may be on all of them.
    """
    nominal, found = grid.nominal, []
    edges = np.linspace(nominal.control_roll, nominal.tip_roll, grid.rolls.size + 1)
    (bottom, top), width = nominal.helix_range, 2 * TRACE_SHARE * nominal.gear.face_width
    lows = np.linspace(bottom, top - width, ceil(OVERLAP * (top - bottom) / width))
    for sign, end in zip((-1.0, 1.0), nominal.profile_range, strict=True):
        near = flanks.select(np.abs(flanks.roll - end) < 2 * float(step_on_flank(nominal, end, step)))
        windows = [near.select((near.height > low) & (near.height < low + width)) for low in lows]
        enough = [2 * _of_a_profile(window, points) + MORE for window in windows]
        outward = [_by_flank(window, sign * window.roll, grid) for window in windows]
        cells = np.zeros((2 * grid.delta.shape[1], *grid.delta.shape[2:]), dtype=bool)
        for low, least, own in zip(lows, enough, outward, strict=True):
            columns = (grid.edges[1:] > low) & (grid.edges[:-1] < low + width)
            beside = [_ends_before(r, _beside(own, k), sign * end, least) for k, r in enumerate(own)]
            elsewhere = [_ends_before(r, [w[k] for w in outward], sign * end, least) for k, r in enumerate(own)]
            for flank, seen_to in enumerate(_either(beside, elsewhere)):
                if seen_to is not None:
                    cells[flank] |= _between(edges, sign, min(seen_to, sign * end), sign * end)[:, None] & columns
        unseen = cells.reshape(grid.delta.shape) & ~grid.seen
        found += [unseen_region(s, t, unseen[s, t], grid) for s, t in np.argwhere(unseen.any(axis=(2, 3)))]
    return found


def _either(beside: list[float | None], elsewhere: list[float | None]) -> list[float | None]:
    """Where flanks end before those ``beside`` them, or, where most of a side do, before themselves ``elsewhere``."""
    teeth = len(beside) // 2
    sides = [elsewhere[:teeth], elsewhere[teeth:]]
    most = [sum(e is not None for e in side) >= ON_MOST * teeth for side in sides]
    return [
        b if b is not None or not most[k // teeth] else e
        for k, (b, e) in enumerate(zip(beside, elsewhere, strict=True))
    ]


def _by_flank(flanks: Flanks, outward: Array, grid: Grid) -> list[Array]:
    """Places ``outward`` (n,) mm of the readings of each flank, increasing."""
    order = np.lexsort((outward, flanks.flank))
    return np.split(outward[order], np.searchsorted(flanks.flank[order], np.arange(1, 2 * grid.delta.shape[1])))


def _beside(of_flanks: list[Array], flank: int) -> list[Array]:
    """Those of the teeth beside a flank, on its side."""
    teeth = len(of_flanks) // 2
    side, tooth = divmod(flank, teeth)
    return [of_flanks[side * teeth + (tooth + k) % teeth] for k in BESIDE]


def _between(edges: Array, sign: float, first: float, last: float) -> Mask:
    """Cells (n,) with ``edges`` (n + 1,) mm that lie in part between two places outward, by their ``sign``."""
    inner, outer = np.sort(sign * np.stack([edges[:-1], edges[1:]]), axis=0)
    return np.asarray((outer > first) & (inner < last))


def _of_a_profile(flanks: Flanks, points: int) -> int:
    """Readings that a profile, of so many ``points``, has at most on a flank: they come and go together."""
    rows = int(flanks.index.max(initial=0)) // points + 1
    profiles = flanks.flank.astype(np.int64) * rows + flanks.index // points
    return int(np.unique(profiles, return_counts=True)[1].max(initial=0))


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


def _ends_before(own: Array, beside: Sequence[Array], end: float, enough: int) -> float | None:
    """Where a flank's readings end, at increasing distances (n,) mm, if ``enough`` of flanks ``beside`` it lie beyond,
    up to the ``end`` or as far as they go; None where they don't, or its own do, too.
    """
    farthest = [float(other[-enough]) for other in beside if other.size >= enough]
    if not farthest or not own.size:
        return None
    looked_at = min(end, _usual(farthest))
    usual, few = _usual([_beyond(other, looked_at) for other in beside]), _beyond(own, looked_at)
    if usual < enough or few > HARDLY_ANY * usual or few >= own.size:
        return None
    return float(own[-1 - few])


def _usual(values: Sequence[float]) -> float:
    return float(np.quantile(values, USUAL, method="lower"))


def _beyond(values: Array, limit: float) -> int:
    """How many of increasing values (n,) lie beyond a limit."""
    return int(values.size - np.searchsorted(values, limit))
