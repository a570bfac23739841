"""Flanks that are broken at an end of the face or at the tip, beyond the ranges in which helices and profiles are
evaluated.

No line of the standards reads a flank there, but a tooth that is chipped there is chipped.
"""

from math import ceil, hypot

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.inspection import GUARD_FACTOR, Defect, decide
from truestand.core.robust import robust_sd
from truestand.gear.damage import DEPTH_SHARE_U
from truestand.gear.ends import BESIDE
from truestand.gear.flanks import FlankPoints, Flanks
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import bin_index
from truestand.gear.teeth import SIGNIFICANT, TOOTH_DEPTH, FoldedMap, usual_tips

INSIDE, INSIDE_TIP = 2.0, 0.5
"""mm of face inside the range at its end, and of roll length, that say where a flank stands there."""
USUALLY, MORE = 0.75, 3.0
"""Quantile of the readings far below them that flanks of a side have, and times as many that a broken one must have: an
end face, a chamfer or a rounded edge has them on all, and strays fall anywhere.
"""
TIP_BIN = 0.1
"""mm of roll length over which the edges of tips are usually alike."""
LEAST_READINGS, LEAST_PROFILES = 8, 3
"""Readings more than those, and profiles that must have them to decide."""
MOST_LEFT = 0.5
"""Of the readings that should be there, that a flank has which was not seen to its end,"""
STRETCHES = (1.0, 1 / 2, 1 / 3)
"""and the shares of the range of profiles over which they are counted: a break needn't take all of a flank."""
DEPTH_QUANTILE = 0.9
"""Of the readings, that is the depth: the last few may be outliers."""


def broken_edges(
    flanks: Flanks, folded: FoldedMap, scatter: float, there: Mask, defects: tuple[Defect, ...]
) -> tuple[Defect, ...]:
    """Chips of flanks beyond the ranges of helices and profiles, and ends of flanks that were not seen.

    ``scatter``: standard deviation of a reading, mm; ``there`` (teeth,): teeth that the drawing has. Of teeth that
    ``defects`` name as broken they say nothing new.
    """
    broken = {d.tooth for d in defects if d.verdict == "does_not_conform"}
    found = (*_broken_ends(flanks, scatter, there), *_chipped_tips(flanks, folded, scatter, there))
    return tuple(d for d in found if d.tooth not in broken)


def _broken_ends(flanks: Flanks, scatter: float, there: Mask) -> list[Defect]:
    """Chips between an end of the face and the range of helices, and flanks that were not seen there."""
    nominal, found = flanks.toothing.nominal, []
    points = _near_ends(flanks, nominal).joined([_near_ends(flanks.outside_gate, nominal)])
    for sign, end in zip((-1.0, 1.0), nominal.helix_range, strict=True):
        beyond = sign * (points.height - end)
        inside, at_end = points.select((beyond < 0) & (beyond > -INSIDE)), points.select(beyond > 0)
        depth = _median_of_flanks(inside, flanks.toothing.offsets)[at_end.flank] - at_end.delta
        gone = depth > _least_depth(scatter)
        chipped = _more_than_usual(at_end.select(gone), there)
        found += [_chip(at_end, depth, flank, scatter, nominal) for flank in chipped]
        hidden = _hidden_stretches(at_end.select(~gone), inside, there, nominal)
        found += [_hidden(f, stretch, sign, end, nominal) for f, stretch in hidden.items() if f not in chipped]
    return found


def _chipped_tips(flanks: Flanks, folded: FoldedMap, scatter: float, there: Mask) -> list[Defect]:
    """Chips of the tip's edge beyond the range of profiles: readings below the flank, by more than all teeth have
    there, and below the land.
    """
    nominal, teeth = flanks.toothing.nominal, there.size
    end = nominal.profile_range[1]
    inside = flanks.select((flanks.roll < end) & (flanks.roll > end - INSIDE_TIP))
    within, outside = (p.select(p.roll > end) for p in (flanks, flanks.outside_gate))
    at_tip = within.joined([outside])
    depth = _median_of_flanks(inside, flanks.toothing.offsets)[at_tip.flank] - at_tip.delta
    drop = usual_tips(folded, nominal)[at_tip.flank % teeth] - nominal.radius(at_tip.roll)
    missing = np.minimum(depth - _usual_depth(at_tip, depth, teeth), drop)
    chipped = _more_than_usual(at_tip.select(missing > _least_depth(scatter)), there)
    return [_chip(at_tip, missing, flank, scatter, nominal) for flank in chipped]


def _least_depth(scatter: float) -> float:
    """mm that a reading must lie deep to be one of a chip; ``scatter``: standard deviation of a reading, mm."""
    return TOOTH_DEPTH - GUARD_FACTOR * scatter


def _usual_depth(points: FlankPoints, depth: Array, teeth: int) -> Array:
    """How far below their flanks (n,) mm readings of a side usually are at the roll lengths of ``points``, by their own
    ``depth`` (n,) mm: tips may be chamfered or rounded.
    """
    if not points.roll.size:
        return depth
    first, last = float(points.roll.min()), float(points.roll.max())
    bins = max(1, ceil((last - first) / TIP_BIN))
    cell = points.flank // teeth * bins + bin_index(points.roll, first, last, bins)
    usual = np.zeros(2 * bins)
    for n in np.unique(cell):
        seen = depth[(cell == n) & np.isfinite(depth)]
        usual[n] = max(float(np.quantile(seen, USUALLY)), 0.0) if seen.size else 0.0
    return np.asarray(usual[cell])


def _near_ends(points: FlankPoints, nominal: Involute) -> FlankPoints:
    """The points near the ends of helices' range and beyond them, within that of profiles: beyond that lie the land of
    the tip, and the root.
    """
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    on_profile = (points.roll > low) & (points.roll < high)
    return points.select(on_profile & ((points.height < bottom + INSIDE) | (points.height > top - INSIDE)))


def _median_of_flanks(points: FlankPoints, otherwise: Array) -> Array:
    """Median delta (flanks,) mm of some points; ``otherwise`` (flanks,) mm where a flank has none."""
    stands = otherwise.copy()
    order = np.argsort(points.flank, kind="stable")
    flanks, first = np.unique(points.flank[order], return_index=True)
    for flank, delta in zip(flanks, np.split(points.delta[order], first[1:]), strict=False):
        stands[flank] = np.median(delta)
    return stands


def _more_than_usual(gone: FlankPoints, there: Mask) -> list[int]:
    """Flanks with so many of the readings ``gone`` as others of their side don't have; ``there`` (teeth,)."""
    number = np.bincount(gone.flank, minlength=2 * there.size).reshape(2, there.size)
    usual = np.quantile(number[:, there], USUALLY, axis=1)[:, None] if there.any() else np.zeros((2, 1))
    return np.flatnonzero((number >= MORE * usual + LEAST_READINGS) & there).tolist()


def _hidden_stretches(
    sound: FlankPoints, inside: FlankPoints, there: Mask, nominal: Involute
) -> dict[int, tuple[float, float]]:
    """Flanks that were not seen to an end of the face, with the longest stretch of roll lengths (mm, from and to) over
    which they were not.
    """
    found: dict[int, tuple[float, float]] = {}
    low, high = nominal.profile_range
    for share in STRETCHES:
        for first in np.linspace(low, high - share * (high - low), round(2 / share) - 1):
            last = first + share * (high - low)
            of_end, of_inside = (p.select((p.roll >= first) & (p.roll <= last)) for p in (sound, inside))
            for flank in _fewer_than_usual(of_end, of_inside, there):
                found.setdefault(flank, (float(first), float(last)))
    return found


def _fewer_than_usual(sound: FlankPoints, inside: FlankPoints, there: Mask) -> list[int]:
    """Flanks of whose readings, against those ``inside`` the range beside them, far fewer are ``sound`` ones than on
    the teeth beside them; ``there`` (teeth,).
    """
    of_end, of_inside = (
        np.bincount(p.flank, minlength=2 * there.size).reshape(2, -1).astype(np.float64) for p in (sound, inside)
    )
    share = np.where(there & (of_inside > 0), of_end / np.maximum(of_inside, 1.0), np.nan)
    beside = np.sort(np.stack([np.roll(share, -k, axis=1) for k in BESIDE]), axis=0)  # NaN last
    expected = np.nan_to_num(beside[len(BESIDE) // 4]) * of_inside
    lacking = expected - of_end
    scatter = np.array([[robust_sd(side[there]) if there.any() else 0.0] for side in lacking])
    few = (of_end < MOST_LEFT * expected) & (lacking >= LEAST_READINGS + MORE * scatter)
    return np.flatnonzero(few & there).tolist()


def _chip(points: FlankPoints, depth: Array, flank: int, scatter: float, nominal: Involute) -> Defect:
    """The chip of a flank that shows in those of the ``points`` that lie deep, by their ``depth`` (n,) mm."""
    on = (points.flank == flank) & (depth > _least_depth(scatter))
    gone, depths = points.select(on), depth[on]
    side, tooth = divmod(flank, nominal.gear.teeth)
    deepest = float(np.quantile(depths, DEPTH_QUANTILE))
    scatters = max(scatter, robust_sd(depths - np.median(depths)) / np.sqrt(depths.size))
    U = hypot(DEPTH_SHARE_U * deepest, 2 * scatters)
    verdict = decide(deepest, U, (None, TOOTH_DEPTH))
    if verdict == "does_not_conform" and np.unique(gone.profile).size < LEAST_PROFILES:
        verdict = "undecided"
    extent = float(max(np.ptp(gone.height), np.ptp(gone.roll)))
    return Defect(
        tooth + 1, FLANKS[side], float(np.median(gone.roll)), float(np.median(gone.height)), deepest, extent,
        "chipped flank", deepest / TOOTH_DEPTH * SIGNIFICANT, U=U, verdict=verdict,
    )  # fmt: skip


def _hidden(flank: int, stretch: tuple[float, float], sign: float, end: float, nominal: Involute) -> Defect:
    """An end of a flank that was not seen over a ``stretch`` of roll lengths, where the teeth beside it have theirs: it
    may have broken off.
    """
    side, tooth = divmod(flank, nominal.gear.teeth)
    face = nominal.gear.face_to if sign > 0 else nominal.gear.face_from
    return Defect(
        tooth + 1, FLANKS[side], sum(stretch) / 2, (end + face) / 2, None, abs(face - end), "hidden end", 0.0,
        verdict="undecided",
    )  # fmt: skip
