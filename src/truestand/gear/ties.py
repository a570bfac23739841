"""How the teeth of a gear that was clamped again lie on those of its first clamping.

Where the same flanks are seen again, the pattern of their pitches says by how many teeth it was turned: the shift at
which they agree, and at no other. Turned over, a sensor often sees the *other* flanks only: then marks on tips tell, a
chip or a drop of lacquer. They number the teeth; how far left and right flanks are apart they don't say.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import log, sqrt
from typing import Literal

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe, WrongDrawing
from truestand.core.robust import nan_median
from truestand.core.surface import Surface
from truestand.gear.closure import waves_of
from truestand.gear.flanks import Toothing
from truestand.gear.geometry import SIGMA, Involute
from truestand.gear.teeth import fold

OVER: Literal["over"] = "over"
PartTurned = int | Literal["over"] | None
"""By how many teeth a part sits turned, counter-clockwise from above; turned over; or None: its pitches tell."""
BY_CHANCE = 1e-4
"""Probability that another shift by teeth agrees as well by chance, from which clampings are not tied."""
LEAST_PATTERN = 1.5e-3
"""mm, rms, beyond ``MOST_WAVES`` a turn: pitches that scatter less may be the table's, which stay where they are when
the gear is turned."""
LEAST_TIPS = 3e-3
"""mm, rms: tips whose radii scatter less are alike, as the sensor sees them."""
TIP_ROW, CHIP = 1.0, 0.03
"""mm of the face in which tips are compared, and mm by which one departs plainly from the rest of its tooth."""
AGREES = 0.6
"""Share of the pattern's own rms that may be left of it where two patterns agree."""
LEAST_FLANKS = 8
"""That two clampings must both show."""
MOST_WAVES = 6
"""A turn, that a table's errors may have when clampings are tied."""
LEAST_NOISE, LEAST_NOISE_OF_TIPS = 1e-4, 1e-3
"""mm: flanks' places, and tips' radii, are not known better."""


@dataclass(frozen=True, slots=True)
class Tie:
    """How a clamping's teeth lie on those of the first."""

    teeth: int = 0
    """By so many it was turned, counter-clockwise from above,"""
    turn: float = 0.0
    """and by so many rad."""
    sure: bool = True
    """Whether pitches, or tips, say so."""
    by_flanks: bool = True
    """Whether flanks say so that both show: left and right flanks are as far apart as they are."""
    told: bool = True
    """Whether anything told that the part was turned over, and which tooth is which."""
    off: float = 0.0
    """mm: by how much it seems to sit otherwise than before, as its tips run out."""

    def beyond(self, other: "Tie") -> "Tie":
        """This tie to a clamping that has itself an ``other`` tie to the first."""
        return Tie(
            self.teeth + other.teeth, self.turn + other.turn, self.sure and other.sure,
            self.by_flanks and other.by_flanks, self.told and other.told, max(self.off, other.off),
        )  # fmt: skip


@dataclass(frozen=True)
class Clamping:
    """A clamping as it is to be tied: the right way up, and, of one that was turned over, as it was scanned."""

    surface: Surface
    toothing: Toothing
    turned: PartTurned
    as_scanned: "Clamping | None" = field(default=None, repr=False)

    @property
    def over(self) -> bool:
        """Whether it was turned over."""
        return self.turned == OVER

    @cached_property
    def places(self) -> Array:
        """Of the flanks (2, teeth) mm, counter-clockwise; NaN: not seen."""
        teeth = self.toothing.nominal.gear.teeth
        return np.asarray(SIGMA[:, None] * self.toothing.offsets.reshape(2, teeth))

    def tips(self, rows: int) -> Array:
        """Radius (teeth, rows) mm of each tip over its height: a tooth's median, but for what departs plainly from it,
        as a chip does; against the median of all teeth at that height, as they may have a chamfer.
        """
        tips = nan_median(fold(self.surface, self.toothing, rows).tips(self.toothing.nominal), 1)
        tips = tips - nan_median(tips, 0)
        usual = nan_median(tips, 1)[:, None]
        return np.where(np.isfinite(tips), np.where(np.abs(tips - usual) > CHIP, tips, usual), np.nan)


@dataclass(frozen=True, slots=True)
class _Shift:
    """The shift by teeth at which two patterns agree best."""

    teeth: int
    off: float
    """mm: what is left between them on the mean,"""
    rms: float
    """and about it."""
    sure: bool
    """Whether no other shift agrees as well."""


def ties_of(clampings: Sequence[Clamping], firsts: Sequence[int]) -> tuple[Tie, ...]:
    """How each clamping lies on the first one of its view, whose number is in ``firsts``.

    One that was turned over may show nothing of what its own view saw before, but flanks that another view saw, or that
    another clamping shows that was turned over.

    Raises:
        BadRecipe: the pitches say plainly that the part sits otherwise than stated.
        WrongDrawing: too few flanks are seen in both clampings.
    """
    ties = [Tie() for _ in clampings]
    for k, first in enumerate(firsts):
        if k != first:
            ties[k] = _tie(clampings, k, first, firsts, ties)
    return tuple(ties)


def _tie(clampings: Sequence[Clamping], k: int, at: int, firsts: Sequence[int], ties: Sequence[Tie]) -> Tie:
    """How clamping ``k`` lies: by the first one of its view, number ``at``, or, of a part that was turned over, by
    another one with which it shares flanks.
    """
    own, first = clampings[k], clampings[at]
    others = [*firsts, *(j for j in range(k) if clampings[j].over)] if own.over else []
    if own.as_scanned is not None:
        _demand_turned_over(first, own.as_scanned)
    unsure = None
    for j in dict.fromkeys([at, *others]):
        shift = _by_pitches(clampings[j].places, own.places, own.toothing.nominal)
        if shift is not None:
            tie = _as_shifted(clampings[j], own, shift).beyond(ties[j])
            tie = replace(tie, teeth=tie.teeth % own.toothing.nominal.gear.teeth)
            if tie.sure or not own.over:
                return tie
            unsure = unsure or tie
    if not own.over:
        raise WrongDrawing("found too few flanks that are seen in both clampings, need the same flanks in view again")
    tie = _by_tips(first, own)
    if unsure is None:
        return tie
    return _by_tips_and_flanks(first, own, tie) if tie.sure and tie.told else unsure


def _by_tips_and_flanks(first: Clamping, own: Clamping, tie: Tie) -> Tie:
    """How a clamping lies whose flanks are too even to tell it, or too few, and whose tips do: as far round as flanks
    say that both show.
    """
    off, rms, _ = _agreement(np.roll(own.places, -tie.teeth, axis=1) - first.places, own.toothing.nominal)
    return _as_shifted(first, own, _Shift(tie.teeth, off, rms, True)) if np.isfinite(rms) else tie


def _as_shifted(first: Clamping, own: Clamping, shift: _Shift) -> Tie:
    """The tie of a clamping whose pitches agree at a ``shift``, or of what was stated, which they may not confirm.

    Raises:
        BadRecipe: they contradict it.
    """
    nominal, stated = own.toothing.nominal, own.turned
    teeth = nominal.gear.teeth
    sure = shift.sure and (own.over or shift.teeth != 0)
    if isinstance(stated, int) and stated % teeth != shift.teeth:
        if sure:
            raise BadRecipe(
                f"found --part-turned {stated}, the pitches say that the part was turned by {shift.teeth} teeth; "
                "count again, or leave it to them (--part-turned auto)"
            )
        off, _, _ = _agreement(np.roll(own.places, -stated, axis=1) - first.places, nominal)
        shift = _Shift(stated % teeth, off, shift.rms, False)
    return Tie(shift.teeth, _turn(first, own, shift.teeth) + shift.off / nominal.base_radius, sure)


def _turn(first: Clamping, own: Clamping, teeth: int) -> float:
    """By how much (rad) a clamping stands turned where it was turned by so many teeth."""
    return own.toothing.first_tooth - first.toothing.first_tooth + teeth * own.toothing.nominal.gear.pitch


def _demand_turned_over(first: Clamping, as_scanned: Clamping) -> None:
    """Refuse a clamping whose pitches say that the part was not turned over at all.

    Raises:
        BadRecipe: it was not.
    """
    shift = _by_pitches(first.places, as_scanned.places, as_scanned.toothing.nominal)
    if shift is not None and shift.sure:
        raise BadRecipe(
            f"found --part-turned {OVER}, the pitches say that the part was not turned over, but turned by "
            f"{shift.teeth} teeth"
        )


def _by_pitches(before: Array, after: Array, nominal: Involute) -> _Shift | None:
    """The shift at which the places (2, teeth) mm of the flanks agree; None where too few are seen in both."""
    fits = [_agreement(np.roll(after, -shift, axis=1) - before, nominal) for shift in range(nominal.gear.teeth)]
    if not np.isfinite([rms for _, rms, _ in fits]).any():
        return None
    return _best(fits, _pattern(before, nominal), LEAST_PATTERN)


def _best(fits: Sequence[tuple[float, float, int]], pattern: float, least: float) -> _Shift:
    """The best of the shifts whose mean, rms and number are ``fits``: sure where the ``pattern`` (mm, rms) is ``least``
    and more, little of it is left, and no other shift agrees as well.
    """
    rms = np.array([fit[1] for fit in fits])
    order = np.argsort(rms)
    best, number = int(order[0]), fits[int(order[0])][2]
    gain = 2 * number * log(rms[order[1]] / rms[best]) if rms.size > 1 else np.inf
    alone = gain > 2 * log(rms.size / BY_CHANCE)
    sure = pattern > least and rms[best] < AGREES * pattern and alone
    return _Shift(best, fits[best][0], float(rms[best]), bool(sure))


def _agreement(difference: Array, nominal: Involute) -> tuple[float, float, int]:
    """Mean of differences (2, teeth) mm of places, their rms about it and what table and seat may make, and how many
    there are.

    A table turns both flanks of a tooth alike; how the part sits moves them once a turn, each in its own direction.
    """
    side, tooth = np.nonzero(np.isfinite(difference))
    orders = range(1, min(MOST_WAVES, (side.size - 2) // 6) + 1)
    if side.size < LEAST_FLANKS:
        return 0.0, np.inf, side.size
    waves = waves_of(np.asarray(tooth * nominal.gear.pitch), orders)
    design = np.column_stack([np.ones(side.size), waves, SIGMA[side][:, None] * waves[:, :2]])
    return _fitted(design, difference[side, tooth], LEAST_NOISE)


def _fitted(design: Array, values: Array, least: float) -> tuple[float, float, int]:
    """The first unknown that makes ``values`` (n,) of a design (n, k), the rms of what is left, ``least`` at least, and
    their number.
    """
    solution, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    rest, free = values - design @ solution, max(values.size - int(rank), 1)
    return float(solution[0]), max(sqrt(float(rest @ rest) / free), least), values.size


def _pattern(places: Array, nominal: Involute) -> float:
    """rms (mm) of the places (2, teeth) of flanks, each side by itself, beyond what a table may make of them."""
    sides = [_agreement(np.stack([side, np.full(side.size, np.nan)]), nominal)[1] for side in places]
    known = [rms for rms in sides if np.isfinite(rms)]
    return min(known, default=0.0)


def _by_tips(first: Clamping, own: Clamping) -> Tie:
    """How a clamping lies that shows none of the flanks that were seen before.

    Tips that are alike don't tell whether the part was turned over at all, nor do marks that look the same from below;
    uneven ones that agree nowhere are those of another part, or of one that was not turned over.
    """
    nominal = own.toothing.nominal
    rows = max(1, round(nominal.gear.face_width / TIP_ROW))
    before, after = first.tips(rows), own.tips(rows)
    pattern = max(_tips_agree(tips, nominal)[1] for tips in (before, after))
    if not np.isfinite(pattern) or pattern <= LEAST_TIPS:
        return Tie(0, _turn(first, own, 0), by_flanks=False, told=False)
    shift = _by_marks(before, after, pattern, nominal)
    told = own.as_scanned is None or not _by_marks(before, own.as_scanned.tips(rows), pattern, nominal).sure
    off = _off_axis(np.roll(after, -shift.teeth, axis=0) - before, nominal)
    return Tie(shift.teeth, _turn(first, own, shift.teeth), shift.sure, by_flanks=False, told=told, off=off)


def _by_marks(before: Array, after: Array, pattern: float, nominal: Involute) -> _Shift:
    """The shift at which the radii (teeth, heights) mm of the tips agree, of such a ``pattern`` (mm, rms)."""
    teeth = nominal.gear.teeth
    fits = [_tips_agree(np.roll(after, -shift, axis=0) - before, nominal) for shift in range(teeth)]
    return _best(fits, pattern, LEAST_TIPS)


def _tips_agree(difference: Array, nominal: Involute) -> tuple[float, float, int]:
    """Mean of differences (teeth, heights) mm of tips' radii, their rms about it and about a wave, and on how many
    teeth there are any.

    Run-out says nothing: it looks the same from below, and how the part sits, or where the calibration has the axis,
    turns it.
    """
    tooth, _ = at = np.nonzero(np.isfinite(difference))
    teeth = np.unique(tooth).size
    if teeth < LEAST_FLANKS:
        return 0.0, np.inf, teeth
    design = np.column_stack([np.ones(tooth.size), waves_of(np.asarray(tooth * nominal.gear.pitch), (1,))])
    mean, rms, _ = _fitted(design, difference[at], LEAST_NOISE_OF_TIPS)
    return mean, rms, teeth


def _off_axis(difference: Array, nominal: Involute) -> float:
    """How far (mm) a part sits off where it sat, as the radii (teeth, heights) of its tips differ."""
    by_tooth = nan_median(difference, 1)
    tooth = np.flatnonzero(np.isfinite(by_tooth))
    design = np.column_stack([np.ones(tooth.size), waves_of(np.asarray(tooth * nominal.gear.pitch), (1,))])
    _, *wave = np.linalg.lstsq(design, by_tooth[tooth], rcond=None)[0]
    return float(np.hypot(*wave))
