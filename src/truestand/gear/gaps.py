"""Gaps of traces without a reading, and how deep damage may be in them: as deep as its like elsewhere on the gear."""

from dataclasses import dataclass
from math import inf

import numpy as np

from truestand.core.arrays import Array
from truestand.core.inspection import Characteristic
from truestand.gear.assess import Assessment
from truestand.gear.coverage import NARROWEST
from truestand.gear.damage import Damage
from truestand.gear.evaluate import MEANS, PROFILE_NAMES
from truestand.gear.runs import ANYWHERE

NARROW = 2.0
"""Gaps without a reading that damage may be wide, along the trace, to be of a kind that hides in one."""
STEEPEST = 0.5
"""Depth of such damage over the gap's width, at most."""
RARELY = 0.05
"""Of the teeth: where damage was found on more of them, none is sound with 95 % where nothing was seen of it."""
BY_CHANCE = 1
"""Teeth more, on which readings got lost in such a way that it looks like damage that no reading shows,"""
ALONE_BY_CHANCE = ANYWHERE - 1
"""and on which single profiles alone lost some."""
UM = 1000.0


@dataclass(frozen=True, slots=True, order=True)
class Gap:
    """A stretch of a trace that no reading shows."""

    depth: float = 0.0
    """mm of delta that damage may be deep there."""
    width: float = 0.0
    """mm along the trace."""


def gap_with_damage(line: Characteristic, a: Assessment, name: str, at: tuple[int, ...]) -> Gap:
    """The gap of a line of flanks in which damage may be deepest; the widest where it has none that may hide any."""
    if line.name not in MEANS:
        return Gap()
    widest = gap_of(a, line.name, at)
    narrowest = a.nominal.gear.evaluation.narrowest_damage or NARROWEST
    often = _often_damaged(a) or _often_unseen(a, line.name, widest)
    hides = line.status == "partial" or (widest > narrowest and often)
    found = Gap(_deepest(a, line.name, widest) if hides else 0.0, widest)
    return max(found, _in_profile(a, at) if line.name in PROFILE_NAMES else _at_open_ends(a, at))


def gap_of(a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """How much (mm) has no reading of the profile or helix that a figure reads, in one stretch; 0 for other figures."""
    if name not in MEANS:
        return 0.0
    gap = a.coverage.profile_gap if name in PROFILE_NAMES else a.coverage.helix_gap
    return float(_read(gap, a, at).max(initial=0.0))


def without_reading(line: Characteristic, a: Assessment, gap: Gap) -> str:
    """What of a trace no reading shows."""
    what = "roll length" if line.name in PROFILE_NAMES else "the helix"
    without = f"{gap.width:.1f} mm of {what} without a reading"
    if _often_unseen(a, line.name, gap.width):
        return f"{without}, on a gear with damage elsewhere that no reading shows"
    return f"{without}, where damage like that elsewhere may be {UM * gap.depth:.0f} um deep" if gap.depth else without


def _in_profile(a: Assessment, at: tuple[int, ...]) -> Gap:
    """The gap of a profile in which damage may be deepest that so many flanks of its side have there that no other is
    sound with 95 %, if it is wide enough for that.
    """
    gone = [d for d in _gone(a) if d.side == at[0]]
    if not gone:
        return Gap()
    rolls = _read(a.coverage.profile_rolls, a, at)
    low, high = (of.reshape(-1, 1) for of in (rolls[..., :-1], rolls[..., 1:]))
    first, last = np.array([d.rolls for d in gone]).T
    there = (first < high) & (last > low) & (last - first <= high - low)
    teeth = np.array([d.tooth for d in gone])[:, None] == np.arange(a.there.size)
    often = np.count_nonzero(there @ teeth, axis=1) > RARELY * a.teeth
    deepest = np.where(there & often[:, None], [_may_be_deep(d) for d in gone], 0.0).max(axis=1)
    widths = (high - low)[:, 0].tolist()
    return max((Gap(_bounded(d, w, a), w) for d, w in zip(deepest.tolist(), widths, strict=True)), default=Gap())


def _at_open_ends(a: Assessment, at: tuple[int, ...]) -> Gap:
    """The end to which a helix was not seen and that of other flanks is damaged most, however few they are."""
    (low, high), found = a.nominal.helix_range, Gap()
    for end, gaps in enumerate(a.coverage.helix_ends):
        width = float(_read(gaps, a, at).max(initial=0.0))
        reaching = (
            _may_be_deep(d) for d in _gone(a) if (d.heights[1] > high - width if end else d.heights[0] < low + width)
        )
        if width > a.open_end:
            found = max(found, Gap(min(max(reaching, default=0.0), a.nominal.thickness / 2), width))
    return found


def _read(values: Array, a: Assessment, at: tuple[int, ...]) -> Array:
    """Those of values (2, teeth, ...) that are of the flanks a figure reads."""
    return np.asarray(values[at[0], at[1] if len(at) > 1 else a.there])


def _gone(a: Assessment) -> list[Damage]:
    """Damage where material is clearly gone."""
    return [d for d in a.damage if d.depth and d.clear and not d.on_top]


def _often_damaged(a: Assessment) -> bool:
    """Whether so many teeth are damaged that none can be taken to be as sound between its readings as where it was
    seen.
    """
    damaged = {d.tooth for d in a.damage if d.clear and not d.on_top}
    return len(damaged) > RARELY * a.teeth


def _often_unseen(a: Assessment, name: str, gap: float) -> bool:
    """Whether so many teeth have damage of which no reading shows how deep it is, narrow enough for a ``gap`` (mm) of
    the traces that a figure reads.
    """
    teeth: set[int] = set()
    alone: set[int] = set()
    others: set[int] = set()
    for d in a.told:
        first, last = d.rolls if name in PROFILE_NAMES else d.heights
        narrow = d.depth is None and last - first <= NARROW * gap
        (others if not narrow else alone if d.alone else teeth).add(d.tooth)
    number, with_alone = len(teeth - others), len((teeth | alone) - others)
    rarely = RARELY * a.teeth
    return number > rarely + BY_CHANCE or with_alone > rarely + ALONE_BY_CHANCE


def _deepest(a: Assessment, name: str, gap: float) -> float:
    """How deep (mm) the deepest damage is that may hide in a ``gap`` (mm) of the traces that a figure reads.

    Of such as is narrow enough for it; where none is, of all. What a tip has lost is found there. Where many teeth have
    damage that no reading shows, or where its bottom is hidden, it is as deep as the gap lets it be.
    """
    profile, tip = name in PROFILE_NAMES, a.nominal.profile_range[1] - 2 * a.nominal.gear.evaluation.resolution
    gone = [d for d in _gone(a) if profile or d.rolls[1] < tip]
    along = [(d.rolls if profile else d.heights, _may_be_deep(d)) for d in gone]
    narrow = [depth for (first, last), depth in along if last - first <= NARROW * gap]
    deepest = inf if _often_unseen(a, name, gap) else max(narrow or [depth for _, depth in along], default=0.0)
    return _bounded(deepest, gap, a)


def _bounded(depth: float, gap: float, a: Assessment) -> float:
    """As much of a ``depth`` (mm) as fits into a ``gap`` (mm)."""
    return min(depth, STEEPEST * gap, a.nominal.thickness / 2)


def _may_be_deep(damage: Damage) -> float:
    """How deep (mm) damage that shows in readings may be: by as much again where few profiles cross it, and no one
    knows how deep where its bottom is hidden.
    """
    return inf if damage.hidden else (1.0 if damage.resolved else 2.0) * (damage.depth or 0.0)
