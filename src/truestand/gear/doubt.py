"""What is not known of damage: in the U of each line, and what is left of its verdict.

Damage is read as it was seen. It may be deeper than that, lie on top or be a second reflection, end anywhere within a
cell of the middle of the face, or be where no reading shows anything.
"""

from dataclasses import dataclass, replace
from math import hypot, inf, sqrt

import numpy as np

from truestand.core.arrays import Mask
from truestand.core.calibration import Contribution
from truestand.core.inspection import Characteristic, Verdict, decided
from truestand.gear.coverage import NARROWEST, Coverage
from truestand.gear.damage import Damage, Zone, damage_in
from truestand.gear.evaluate import AREAL, MEAN, MEANS, PITCH, PROFILE_NAMES, Figures
from truestand.gear.geometry import Involute
from truestand.gear.grid import TRACE_SHARE
from truestand.gear.sections import Sections
from truestand.gear.seen_flanks import Influence

SIZES = ("s", "W_k", "M_d")
AT_BALL = frozenset({"F_r", "M_d"})
FORMS = frozenset({"F_alpha", "f_falpha", "F_beta", "f_fbeta"})
"""What grows with every damage."""
ON_TOP = "on top of a flank, or a second reflection"
NOT_SEEN = "damage that was not seen whole"
EDGES = "edges of damage in the middle of the face"
HIDDEN = "damage like that found elsewhere, where nothing was seen"
NARROW = 2.0
"""Gaps without a reading that damage may be wide, along the trace, to be of a kind that hides in one."""
STEEPEST = 0.5
"""Depth of such damage over the gap's width, at most."""
RARELY = 0.05
"""Of the teeth: where damage was found on more of them, none is sound with 95 % where nothing was seen of it."""
BY_CHANCE = 1
"""Teeth more, on which readings got lost in such a way that it looks like damage that no reading shows."""
UM = 1000.0


@dataclass(frozen=True, slots=True)
class Assessment:
    """Figures (mm) and by how much each input of the budget may move them (U, k = 2)."""

    nominal: Involute
    figures: Figures
    without_damage: Figures
    """The same as if no reading had fallen on damage,"""
    without_top: Figures
    """or on what lies on top of a flank."""
    expanded: dict[str, Figures]
    """U by the name of the input."""
    influences: tuple[Influence, ...]
    coverage: Coverage
    damage: tuple[Damage, ...]
    told: tuple[Damage, ...]
    """Those of them that show in readings, or in rays that should have met the flank and didn't: no mere gaps."""
    zones: dict[Zone, Mask]
    """From which cells (roll lengths, heights) figures are read."""
    there: Mask
    """(teeth,): but for those that the drawing leaves out."""
    sections: Sections | None
    """None: only the sections that the standard reads."""
    cell_height: float
    """mm."""

    @property
    def edge_share(self) -> float:
        """Half a cell's height over the height of the middle of the face."""
        return self.cell_height / (4 * TRACE_SHARE * self.nominal.gear.face_width)

    @property
    def open_end(self) -> float:
        """mm before the end of its range at which a helix that was seen to its end may have its last point."""
        return self.cell_height / 2


def with_damage(line: Characteristic, a: Assessment, name: str, at: tuple[int, ...]) -> Characteristic:
    """The line with what is not known of damage in its U, and the verdict that is left of it: of damage that it reads,
    and of such as may be where nothing was seen.
    """
    regions, hidden = touching(a, line.name, at), _may_hide(line, a, name, at)
    if not regions:
        line = _borne_out_by_nothing(line)
        if line.status == "partial" and line.name in MEANS:
            line = replace(line, reason=_without_reading(line, a, at))
            if line.name not in FORMS and line.verdict == "does_not_conform":
                line = replace(line, verdict="undecided")  # what was not seen may make a slope better
        if not hidden:
            return line
    value = line.value or 0.0
    without_top = float(a.without_top[name][at]) if any(d.on_top for d in regions) else value
    half_widths = {
        ON_TOP: abs(value - (without_top if np.isfinite(without_top) else 0.0)),
        EDGES: _edges(regions, a, name) * _per_delta(name, a),
        NOT_SEEN: _unknown_depth(regions, a, name) * _per_delta(name, a),
        HIDDEN: hidden * _per_delta(name, a),
    }
    causes = [Contribution(c, 2 * half / sqrt(3.0), half / sqrt(3.0), "rectangular") for c, half in half_widths.items()]
    budget = tuple(sorted((*line.budget, *(c for c in causes if c.U)), key=lambda c: -c.U))
    wider = replace(line, grade=None, U=hypot(*(c.U for c in budget)), budget=budget)
    if line.verdict is not None:
        if regions:
            line = decided(replace(line, U=hypot(line.U or 0.0, *(c.U for c in causes if c.name == EDGES))))
        material_gone = not regions or any((d.depth or 0.0) > 0 for d in regions)
        wider = replace(decided(wider), verdict=_verdict(line, wider, without_top, material_gone))
    return replace(wider, reason=_gravest(regions, wider.verdict) if regions else _without_reading(line, a, at))


def _gravest(regions: tuple[Damage, ...], verdict: Verdict | None) -> str:
    """What is gravest for a verdict: what was seen where the line fails for it, else what was not."""
    failing = verdict == "does_not_conform" and any(d.depth for d in regions)
    gravest = max(
        regions, key=lambda d: (not failing and d.hidden, not failing and not d.resolved, abs(d.depth or 0.0))
    )
    return gravest.text


def _may_hide(line: Characteristic, a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """How deep (mm of delta) damage may be where a line of flanks shows nothing: as deep as such damage elsewhere.

    One of the teeth of a mean may have such damage more.
    """
    gap, narrowest = gap_of(a, line.name, at), a.nominal.gear.evaluation.narrowest_damage or NARROWEST
    if line.name not in MEANS:
        return 0.0
    hidden = line.status == "partial" or (gap > narrowest and (_often_damaged(a) or _often_unseen(a, line.name, gap)))
    deepest = max(_deepest(a, line.name, gap) if hidden else 0.0, _at_open_ends(a, line.name, at))
    return deepest / max(int(np.count_nonzero(a.there)), 1) if name.endswith(MEAN) else deepest


def _at_open_ends(a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """How deep (mm) damage like that at the same end of other flanks may be where a helix was not seen to its end."""
    if name in PROFILE_NAMES:
        return 0.0
    (low, high), deepest = a.nominal.helix_range, 0.0
    for end, gaps in enumerate(a.coverage.helix_ends):
        gap = float(gaps[at[0], at[1] if len(at) > 1 else a.there].max(initial=0.0))
        reaching = [
            d.depth
            for d in a.damage
            if d.depth and d.clear and not d.on_top and (d.heights[1] > high - gap if end else d.heights[0] < low + gap)
        ]
        if gap > a.open_end:
            deepest = max(deepest, *reaching, 0.0)
    return min(deepest, a.nominal.thickness / 2)


def _often_damaged(a: Assessment) -> bool:
    """Whether so many teeth are damaged that none can be taken to be as sound between its readings as where it was
    seen.
    """
    damaged = {d.tooth for d in a.damage if d.clear and not d.on_top}
    return len(damaged) > RARELY * int(np.count_nonzero(a.there))


def _often_unseen(a: Assessment, name: str, gap: float) -> bool:
    """Whether so many teeth have damage of which no reading shows how deep it is, narrow enough for a ``gap`` (mm) of
    the traces that a figure reads.
    """
    teeth: set[int] = set()
    others: set[int] = set()
    for d in a.told:
        first, last = d.rolls if name in PROFILE_NAMES else d.heights
        (teeth if d.depth is None and last - first <= NARROW * gap else others).add(d.tooth)
    return len(teeth - others) > RARELY * int(np.count_nonzero(a.there)) + BY_CHANCE


def _deepest(a: Assessment, name: str, gap: float) -> float:
    """How deep (mm) the deepest damage is that may hide in a ``gap`` (mm) of the traces that a figure reads.

    Of such as is narrow enough for it; where none is, of all. What a tip has lost is found there. Where many teeth have
    damage that no reading shows, it is as deep as the gap lets it be.
    """
    profile, tip = name in PROFILE_NAMES, a.nominal.profile_range[1] - 2 * a.nominal.gear.evaluation.resolution
    gone = [d for d in a.damage if d.depth and d.clear and not d.on_top and (profile or d.rolls[1] < tip)]
    along = [(d.rolls if profile else d.heights, d.depth or 0.0) for d in gone]
    narrow = [depth for (first, last), depth in along if last - first <= NARROW * gap]
    deepest = inf if _often_unseen(a, name, gap) else max(narrow or [depth for _, depth in along], default=0.0)
    return min(deepest, STEEPEST * gap, a.nominal.thickness / 2)


def gap_of(a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """How much (mm) has no reading of the profile or helix that a figure reads, in one stretch; 0 for other figures."""
    if name not in MEANS:
        return 0.0
    gap = a.coverage.profile_gap if name in PROFILE_NAMES else a.coverage.helix_gap
    return float(gap[at[0], at[1] if len(at) > 1 else a.there].max(initial=0.0))


def _without_reading(line: Characteristic, a: Assessment, at: tuple[int, ...]) -> str:
    """What of a trace no reading shows."""
    gap = gap_of(a, line.name, at)
    what = "roll length" if line.name in PROFILE_NAMES else "the helix"
    without = f"{gap:.1f} mm of {what} without a reading"
    if _often_unseen(a, line.name, gap):
        return f"{without}, on a gear with damage elsewhere that no reading shows"
    elsewhere = UM * _deepest(a, line.name, gap)
    return f"{without}, on a gear with damage of {elsewhere:.0f} um elsewhere" if elsewhere else without


def _borne_out_by_nothing(line: Characteristic) -> Characteristic:
    """The line; form that fails where no region shows why must fail at twice its noise: pairs of outliers do that."""
    if line.verdict != "does_not_conform" or line.name not in FORMS or line.U is None:
        return line
    return replace(line, verdict=decided(replace(line, U=hypot(line.U, sqrt(3.0) * noise_of(line)))).verdict)


def noise_of(line: Characteristic) -> float:
    """U (k = 2, mm) of noise in a line's budget."""
    return next((c.U for c in line.budget if c.name == "noise"), 0.0)


def _edges(regions: tuple[Damage, ...], a: Assessment, name: str) -> float:
    """By how much (mm) delta may be off, where a figure is the mean of the middle of the face, because edges of damage
    run there: each may lie half a cell elsewhere, and a range has two of them at either end.
    """
    if _zone(name.removesuffix(MEAN)) in ("helix", "area"):
        return 0.0
    deepest = 2 * a.edge_share * max((abs(d.depth or 0.0) for d in regions if d.ends_at_middle), default=0.0)
    return deepest / max(int(np.count_nonzero(a.there)), 1) if name.endswith(MEAN) or name in SIZES else deepest


def _unknown_depth(regions: tuple[Damage, ...], a: Assessment, name: str) -> float:
    """By how much (mm) delta may be off, where a figure reads it, because damage may be deeper than it was seen.

    As deep as half a tooth where its bottom is hidden, by as much again where few profiles cross it, or a helix has no
    point. Areal figures read the smooth flank, which damage has no part in.
    """
    if name.endswith(AREAL):
        return 0.0
    helix = _zone(name.removesuffix(MEAN)) == "helix"
    depths = [
        a.nominal.thickness / 2 if d.hidden else 0.0 if d.resolved and not (helix and d.unread) else abs(d.depth or 0.0)
        for d in regions
    ]
    mean = name.endswith(MEAN) or name in SIZES
    return sum(depths) / max(int(np.count_nonzero(a.there)), 1) if mean else max(depths, default=0.0)


def _per_delta(name: str, a: Assessment) -> float:
    """By how much a figure may follow delta where it is read; a slope, on half of a flank."""
    plain = name.removesuffix(MEAN)
    if plain in PITCH or plain == "s":
        return a.nominal.arc_per_delta * (2.0 if plain == "f_u" else 1.0)
    at_ball = a.nominal.runout_per_delta
    others = {
        "F_r": at_ball, "M_d": 2 * at_ball, "W_k": a.nominal.normal_per_delta,
        "f_Halpha": 1.5, "f_Hbeta": 1.5,
    }  # fmt: skip
    return others.get(plain, 1.0)


def _verdict(line: Characteristic, wider: Characteristic, without_top: float, material_gone: bool) -> Verdict | None:
    """The verdict of a line that damage makes ``wider``.

    What lies on top may be a second reflection: with it and without, the line must say the same. Forms and totals are
    no less than what was seen, where readings show that material is gone: what was not seen makes them no better.
    """
    if not np.isfinite(without_top) or decided(replace(line, value=without_top)).verdict != line.verdict:
        return "undecided"
    if line.verdict == "does_not_conform" and line.name in FORMS and material_gone:
        return line.verdict
    return decided(wider).verdict


def touching(a: Assessment, name: str, at: tuple[int, ...]) -> tuple[Damage, ...]:
    """The damage that a figure reads."""
    side, tooth = (*at, None, None)[:2]
    return damage_in(a.damage, a.zones[_zone(name)], side, tooth)


def _zone(name: str) -> Zone:
    if name.endswith(AREAL):
        return "area"
    if name in AT_BALL:
        return "ball"
    return "profile" if name in PROFILE_NAMES else "helix" if name in MEANS else "position"
