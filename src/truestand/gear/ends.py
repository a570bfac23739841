"""Flanks that were not seen to an end of the helix' range where those beside them were: what is there is not known.

No ray tells: where the face ends, readings run out on sound teeth, too, and a tooth that is broken off within the last
cell of the range looks as if they had run out a little sooner.
"""

from collections.abc import Sequence
from math import ceil, log

import numpy as np

from truestand.core.arrays import Array
from truestand.gear.damage import Damage, unseen_region, zones_of
from truestand.gear.flanks import Flanks
from truestand.gear.grid import Grid

ABOUT_CIRCLE = 0.15
"""Share of the control length to either side of the measuring circle whose readings say how far a flank is seen."""
BESIDE = (-3, -2, -1, 1, 2, 3)
"""Teeth beside one that say how far flanks are seen there: an eccentric gear is seen a little farther on one side."""
USUAL = 0.75
"""Quantile of what those show: some of them may be broken as well."""
BY_CHANCE, LEAST_LOST = 1e-5, 0.01
"""Probability that a sound flank lacks so many readings at its end, and share of them that get lost at least."""
HARDLY_ANY = 0.1
"""Share of the usual readings beyond a height, at most, that a flank which ends before it has there: strays."""


def unseen_at_ends(flanks: Flanks, grid: Grid, step: float, points: int) -> tuple[Damage, ...]:
    """The ends of helices that flanks don't show where those beside them do.

    ``step``: table angle from one profile to the next, rad; so many ``points`` a profile.
    """
    nominal, zone, teeth = grid.nominal, zones_of(grid, step)["helix"], grid.delta.shape[1]
    about_circle = np.abs(flanks.roll - nominal.measuring_roll) < ABOUT_CIRCLE * nominal.control_length
    flanks, found = flanks.select(about_circle), []
    enough = _enough(flanks, points)
    for sign, end in zip((-1.0, 1.0), nominal.helix_range, strict=True):
        order = np.lexsort((sign * flanks.height, flanks.flank))
        of_flank = np.searchsorted(flanks.flank[order], np.arange(1, 2 * teeth))
        outward = np.split(sign * flanks.height[order], of_flank)
        inner, outer = np.sort(sign * np.stack([grid.edges[:-1], grid.edges[1:]]), axis=0)
        for side, tooth in np.ndindex(2, teeth):
            beside = [outward[side * teeth + (tooth + k) % teeth] for k in BESIDE]
            seen_to = _ends_before(outward[side * teeth + tooth], beside, sign * end, enough)
            if seen_to is not None:
                columns = (outer > min(seen_to, sign * end)) & (inner < sign * end)
                found.append(unseen_region(side, tooth, zone & columns, grid))
    return tuple(found)


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
