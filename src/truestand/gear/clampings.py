"""A gear that was clamped again between scans, turned on its shaft by some teeth: its scans laid onto each other.

The pattern of its pitches ties them, where the same flanks are seen again: the shift by whole teeth at which the
pitches agree, and at no other. Then closure separates the table from the gear: what stays with the table while the gear
is turned is the table's,

    F_c(j) = g(j) + t(theta_j + o_c) + const_c,    t = sum of waves a turn

(multi-step technique: D. J. Whitehouse, J. Phys. E 9 (1976) 531). What is left of the table's errors, and of all else
that does not turn with the gear, is averaged over the clampings.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log, sqrt, tau

import numpy as np
from numpy.typing import NDArray

from truestand.apply.datum import Datum, datum_of
from truestand.core.arrays import Array
from truestand.core.assumptions import SEATED_U, SIDEWAYS_U, K
from truestand.core.errors import BadRecipe, WrongDrawing
from truestand.core.frames import Pose, about_axis
from truestand.core.message import Message
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration, seen_at, table_angle
from truestand.gear.drawing import Gear
from truestand.gear.flanks import Toothing, find_toothing, flank_offsets
from truestand.gear.geometry import SIGMA, Involute, involute
from truestand.uncertainty.lines import once_per_turn

BY_CHANCE = 1e-4
"""Probability that another shift by teeth agrees as well by chance, from which clampings are not tied."""
LEAST_PATTERN = 1.5e-3
"""mm, rms, beyond ``MOST_WAVES`` a turn: pitches that scatter less may be the table's, which stay where they are when
the gear is turned."""
LEAST_FLANKS = 8
"""That two clampings must both show."""
MOST_WAVES = 6
"""A turn, that a table's errors may have when clampings are tied."""
MOST = 1.5
"""Times its U that what closure finds may be."""
FIRST_ALONE = Message("first_clamping_alone", "the first clamping alone is shown; the others can't be laid onto it")
LEAST_VARIANCE = 1e-16
"""rad2: no wave is known better."""
LEAST_NOISE = 1e-4
"""mm: flanks' places are not known better."""


@dataclass(frozen=True, slots=True)
class Tie:
    """How a clamping's teeth lie on those of the first."""

    teeth: int
    """By so many it was turned, counter-clockwise from above."""
    turn: float
    """rad: the same, to the flanks' places."""
    sure: bool
    """Whether the pattern of the pitches says so."""


@dataclass(frozen=True, slots=True)
class Closure:
    """What several clampings tell of the table, and of how the part sat in each."""

    orders: tuple[int, ...]
    """Waves a turn of the table's error:"""
    waves: Array
    """(2 orders,) rad, cosine and sine of each,"""
    covariance: Array
    """(2 orders, 2 orders) rad2."""
    seats: Array
    """(clampings, 2) mm: how far off the first one's axis the part sat in each."""
    known: Array
    """(2 orders,) rad: standard uncertainty of the waves beforehand,"""
    seated: float
    """and mm, of the seats."""
    left: float
    """rad: standard deviation of what differs between clampings beyond all that."""

    def expanded(self, wave: int) -> float:
        """Of a wave (k = 2, rad), in the phase in which it is known worst."""
        own = slice(2 * wave, 2 * wave + 2)
        return K * sqrt(max(float(np.linalg.eigvalsh(self.covariance[own, own])[-1]), LEAST_VARIANCE))

    @property
    def faster(self) -> float:
        """U (k = 2, rad) of the waves beyond once a turn: of those that were found, and of all others."""
        found = max(self.expanded(k) for k in range(1, len(self.orders)))
        return max(found, K * self.left / sqrt(len(self.seats)))

    def contradictions(self, radius: float) -> tuple[Message, ...]:
        """What of it can't be, by what was known beforehand; ``radius``: mm, of the measuring circle."""
        found, once = [], float(np.hypot(*self.waves[:2]))
        if once > MOST * K * self.known[0]:
            text = (
                f"closure: the table would err by {1000 * once * radius:.1f} um once a turn at the measuring circle, "
                f"which its U ({1000 * K * self.known[0] * radius:.1f} um) does not allow: count the teeth, see that "
                "the part sits as it sat (bore_clearance_mm), or state angle_U_arcsec under [table]"
            )
            found.append(Message("closure_contradicts", text))
        off = float(np.hypot(*self.seats.T).max(initial=0.0))
        if off > MOST * K * self.seated:
            text = (
                f"closure: the part would sit {1000 * off:.1f} um otherwise than in the first clamping, U is "
                f"{1000 * K * self.seated:.1f} um: state its play (bore_clearance_mm)"
            )
            found.append(Message("part_sits_otherwise", text))
        return tuple(found)


def laid_together(
    surfaces: Sequence[Surface], gear: Gear, turned: Sequence[int | None]
) -> tuple[tuple[Surface, ...], tuple[Message, ...], tuple[Message, ...]]:
    """The surfaces of several clampings in the first one's frame, why nothing may be decided, and what to know.

    ``turned``: by how many teeth the part sat turned in each, counter-clockwise from above, 0 in the first one of each
    view; None: its pitches tell. Pitches too even to tell decide nothing, whatever is stated: nobody could notice a
    part that was not turned at all. Only the first clamping counts then, as where closure contradicts.

    Raises:
        BadRecipe: not one number for each surface, the first not 0, or a number that the pitches contradict.
        NotEnoughData: nothing of the toothing is in view.
    """
    firsts = _firsts(surfaces, turned)
    if len(surfaces) == len(set(firsts)):
        return tuple(surfaces), (), ()
    nominal, datum = involute(gear), datum_of(surfaces[0].origin[1], gear.datum, gear.bore_clearance)
    toothings = [find_toothing(s, nominal, datum) for s in surfaces]
    ties = [
        Tie(0, 0.0, True) if first == k else _tie(toothings[first], toothings[k], turned[k])
        for k, first in enumerate(firsts)
    ]
    alone = tuple(s for k, s in enumerate(surfaces) if firsts[k] == k)
    if untied := [k for k, tie in enumerate(ties, 1) if not tie.sure]:
        return alone, (_not_tied(untied),), (FIRST_ALONE,)
    placed = [_turned_back(s, datum, tie.turn) for s, tie in zip(surfaces, ties, strict=True)]
    closure = _closure(placed, nominal, datum)
    if wrong := closure.contradictions(nominal.measuring_radius):
        return alone, wrong, (FIRST_ALONE,)
    closed = [_with_table(s, closure, nominal.measuring_radius) for s in placed]
    seated = [_shifted(s, datum, seat) for s, seat in zip(closed, closure.seats, strict=True)]
    return tuple(seated), (), (_said(closure, ties, nominal.measuring_radius),)


def _firsts(surfaces: Sequence[Surface], turned: Sequence[int | None]) -> list[int]:
    """The first surface of each one's view.

    Raises:
        BadRecipe: as ``laid_together``.
    """
    if len(turned) != len(surfaces):
        raise BadRecipe(
            f"found --part-turned for {len(turned)} clampings and {len(surfaces)} scans, need one number of teeth "
            "for each scan, in their order"
        )
    known = [s.scan.sha256 for s in surfaces if s.scan is not None and s.scan.sha256]
    if len(set(known)) < len(known):
        raise BadRecipe("found the same scan twice, need one scan of each clamping")
    names = ["" if s.calibration is None else s.calibration.name for s in surfaces]
    firsts = [names.index(name) for name in names]
    for first in firsts:
        if turned[first] not in (0, None):
            raise BadRecipe(
                f"found --part-turned {turned[first]} for the first scan of a view, need 0: the others count from it"
            )
    return firsts


def _not_tied(clampings: list[int]) -> Message:
    listed = ", ".join(map(str, clampings))
    text = (
        f"clamping {listed}: by how many teeth the part was turned can't be told, its pitches are too even, or it was "
        "not turned: inspect each scan by itself"
    )
    return Message("part_not_tied", text)


def _said(closure: Closure, ties: Sequence[Tie], radius: float) -> Message:
    size, U, seat = 1000 * float(np.hypot(*closure.waves[:2])) * radius, closure.expanded(0), K * closure.seated
    turned = ", ".join(f"clamping {k} was turned by {tie.teeth} teeth" for k, tie in enumerate(ties, 1) if tie.teeth)
    text = (
        f"closure over {len(ties)} clampings: the table errs by {size:.1f} +- {1000 * U * radius:.1f} um once a turn "
        f"at the measuring circle, taken off, if the part sits alike to {1000 * seat:.1f} um; {turned}; "
        f"{1000 * closure.left * radius:.1f} um rms are left between them"
    )
    return Message("part_clamped_again", text)


def _tie(first: Toothing, other: Toothing, stated: int | None) -> Tie:
    """The shift by teeth at which the places of the flanks agree.

    Raises:
        BadRecipe: the pitches say plainly that it was another one than stated.
        WrongDrawing: too few flanks are seen in both clampings.
    """
    nominal, teeth = first.nominal, first.nominal.gear.teeth
    before, after = (SIGMA[:, None] * t.offsets.reshape(2, teeth) for t in (first, other))
    fits = [_agreement(np.roll(after, -shift, axis=1) - before, nominal) for shift in range(teeth)]
    rms = np.array([fit[1] for fit in fits])
    if not np.isfinite(rms).any():
        raise WrongDrawing("found too few flanks that are seen in both clampings, need the same flanks in view again")
    order = np.argsort(rms)
    best, number = int(order[0]), fits[int(order[0])][2]
    gain = 2 * number * log(rms[order[1]] / rms[best]) if teeth > 1 else np.inf
    sure = best != 0 and gain > 2 * log(teeth / BY_CHANCE) and _pattern(before, nominal) > LEAST_PATTERN
    if stated is not None and sure and stated % teeth != best:
        raise BadRecipe(
            f"found --part-turned {stated}, the pitches say that the part was turned by {best} teeth; count again, or "
            "leave it to them (--part-turned auto)"
        )
    shift = best if stated is None else stated % teeth
    turn = other.first_tooth - first.first_tooth + shift * nominal.gear.pitch + fits[shift][0] / nominal.base_radius
    return Tie(shift, turn, sure)


def _agreement(difference: Array, nominal: Involute) -> tuple[float, float, int]:
    """Mean of differences (2, teeth) mm of places, their rms about it and what table and seat may make, and how many
    there are.

    A table turns both flanks of a tooth alike; how the part sits moves them once a turn, each in its own direction.
    """
    side, tooth = np.nonzero(np.isfinite(difference))
    orders = range(1, min(MOST_WAVES, (side.size - 2) // 6) + 1)
    if side.size < LEAST_FLANKS:
        return 0.0, np.inf, side.size
    waves = _waves(np.asarray(tooth * nominal.gear.pitch), orders)
    design = np.column_stack([np.ones(side.size), waves, SIGMA[side][:, None] * waves[:, :2]])
    values = difference[side, tooth]
    solution, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    rest, free = values - design @ solution, max(side.size - int(rank), 1)
    return float(solution[0]), max(sqrt(float(rest @ rest) / free), LEAST_NOISE), side.size


def _pattern(places: Array, nominal: Involute) -> float:
    """rms (mm) of the places (2, teeth) of flanks, each side by itself, beyond what a table may make of them."""
    sides = [_agreement(np.stack([side, np.full(side.size, np.nan)]), nominal)[1] for side in places]
    known = [rms for rms in sides if np.isfinite(rms)]
    return min(known, default=0.0)


def _waves(angle: Array, orders: Sequence[int]) -> Array:
    """Cosine and sine (n, 2 orders) of each wave a turn at angles (n,) rad."""
    return np.stack([f(n * angle) for n in orders for f in (np.cos, np.sin)], axis=-1)


def _turned_back(surface: Surface, datum: Datum, turn: float) -> Surface:
    """The surface as it would be seen had the part not been turned."""
    return _moved(surface, datum, about_axis(-turn, 0.0))


def _shifted(surface: Surface, datum: Datum, seat: Array) -> Surface:
    """The surface as it would be seen had the part sat as in the first clamping."""
    return _moved(surface, datum, Pose(np.eye(3), np.array([*-seat, 0.0]))) if seat.any() else surface


def _moved(surface: Surface, datum: Datum, by: Pose) -> Surface:
    """The surface as it would be seen had the part been moved in its datum frame."""
    scan, calibration = surface.origin
    back = datum.pose.inverse @ by @ datum.pose
    return apply_calibration(scan, replace(calibration, shaft_from_rotor=back @ calibration.shaft_from_rotor))


def _orders(teeth: int) -> tuple[int, ...]:
    """Waves a turn that are looked for: slow ones, and the one that neighbouring teeth feel most."""
    return tuple(sorted({1, 2, 3, max(2, teeth // 4)}))


def _closure(surfaces: Sequence[Surface], nominal: Involute, datum: Datum) -> Closure:
    """Least squares: the gear's own places are free, and so is what each clamping turns it by; the table, and how far
    off the axis a part sits that was clamped again, are known beforehand as their budget says.
    """
    toothing, teeth = find_toothing(surfaces[0], nominal, datum), nominal.gear.teeth
    orders = _orders(teeth)
    flanks, clampings, waves = 2 * teeth, len(surfaces), 2 * len(orders)
    rows, values = [], []
    for c, surface in enumerate(surfaces):
        offsets = flank_offsets(surface, toothing)
        place = (SIGMA[:, None] * offsets.reshape(2, teeth)).reshape(-1) / nominal.base_radius
        seen = np.flatnonzero(np.isfinite(place))
        points, gradient = _middles(toothing, seen)
        design = np.zeros((seen.size, flanks + 3 * (clampings - 1) + waves))
        design[np.arange(seen.size), seen] = 1.0
        if c:
            moved = SIGMA[seen // teeth][:, None] * gradient[:, :2] / nominal.base_radius
            design[:, flanks + 3 * (c - 1) : flanks + 3 * c] = np.column_stack([np.ones(seen.size), moved])
        # An angle that counts too much by t shows the flank turned back by t.
        design[:, -waves:] = -_waves(seen_at(surface.origin[1], points), orders)
        rows.append(design)
        values.append(place[seen])
    design, value = np.concatenate(rows), np.concatenate(values)
    left = _noise(design, value)
    weight = 1.0 / left**2
    normal = weight * design.T @ design
    known = _before(surfaces[0].origin[0], nominal, orders)
    seated = max(nominal.gear.bore_clearance / 2 / sqrt(3.0), SEATED_U / K)
    normal[-waves:, -waves:] += np.diag(1.0 / np.square(known))
    for c in range(clampings - 1):
        at = flanks + 3 * c + np.array([1, 2])
        normal[at, at] += 1.0 / seated**2
    inverse = np.asarray(np.linalg.pinv(normal, rcond=1e-14, hermitian=True))
    solution = inverse @ (weight * design.T @ value)
    seats = np.zeros((clampings, 2))
    seats[1:] = solution[flanks:-waves].reshape(-1, 3)[:, 1:]
    return Closure(orders, solution[-waves:], inverse[-waves:, -waves:], seats, known, seated, left)


def _middles(toothing: Toothing, flanks: NDArray[np.intp]) -> tuple[Array, Array]:
    """Where (n, 3) mm in C the measuring circle of some ``flanks`` (side * teeth + tooth) is at the middle of the face,
    and the gradient (n, 3) of delta there.
    """
    nominal = toothing.nominal
    side, tooth = np.divmod(flanks, nominal.gear.teeth)
    roll, height = np.full(side.size, nominal.measuring_roll), np.full(side.size, nominal.middle)
    points = toothing.points((side, tooth), roll, height, np.zeros(side.size))
    return points, toothing.gradient(points, SIGMA[side])


def _noise(design: Array, value: Array) -> float:
    """Standard deviation (rad) of the flanks' places, from what waves, teeth and clampings leave of them."""
    solution, _, rank, _ = np.linalg.lstsq(design, value, rcond=None)
    rest = value - design @ solution
    return max(sqrt(float(rest @ rest) / max(value.size - int(rank), 1)), 1e-7)


def _before(scan: Scan, nominal: Involute, orders: Sequence[int]) -> Array:
    """Standard uncertainty (2 orders,) rad of each wave beforehand."""
    _, U = once_per_turn(scan)
    stated = scan.stand.table.sideways_U
    sideways = (SIDEWAYS_U if stated is None else stated) / nominal.measuring_radius
    return np.repeat([sqrt((U / n) ** 2 + (sideways if n > 1 else 0.0) ** 2) / K for n in orders], 2)


def _with_table(surface: Surface, closure: Closure, radius: float) -> Surface:
    """The surface with the table's waves taken off its angle; what is left of them is known, as angle once a turn and,
    at the measuring ``radius`` (mm), as sideways motion beyond.
    """
    scan, calibration = surface.origin
    angle = table_angle(scan, calibration)
    table = replace(scan.stand.table, angle_U=closure.expanded(0), sideways_U=closure.faster * radius)
    angle = angle - _waves(angle % tau, closure.orders) @ closure.waves
    corrected = replace(scan, angle=angle, stand=replace(scan.stand, table=table))
    return apply_calibration(corrected, replace(calibration, speed_factor=1.0, applied_to=corrected))
