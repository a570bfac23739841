"""A gear that was clamped again between scans, turned on its shaft by some teeth or turned over: its scans laid onto
each other (``ties``), and the table told from the gear (``closure``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt

import numpy as np

from truestand.apply.datum import COAXIALITY, Datum, datum_of
from truestand.core.assumptions import K
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe
from truestand.core.frames import ECCENTRICITY, Pose, about_axis
from truestand.core.message import Message
from truestand.core.surface import Surface, apply_calibration
from truestand.gear.closure import MOST, Closure, closure_of, seated_u
from truestand.gear.drawing import Gear
from truestand.gear.flanks import find_toothing
from truestand.gear.geometry import Involute, involute
from truestand.gear.ties import OVER, Clamping, PartTurned, Tie, ties_of

TIP_NOISE = 1e-3
"""mm, standard: of a wave round the tips."""
FIRST_ALONE = Message("first_clamping_alone", "the first clamping alone is shown; the others can't be laid onto it")


@dataclass(frozen=True, slots=True)
class Together:
    """The surfaces of several clampings in the first one's frame, why nothing may be decided, and what to know."""

    surfaces: tuple[Surface, ...]
    reasons: tuple[Message, ...] = ()
    remarks: tuple[Message, ...] = ()
    sides_tied: bool = True
    """Whether any flank is seen in all clampings: else nothing says how far left and right flanks are apart."""
    datum: Datum | None = None
    """The axis on which the part sat, where closure has told it from the shaft's."""


def laid_together(surfaces: Sequence[Surface], gear: Gear, turned: Sequence[PartTurned]) -> Together:
    """The surfaces of several clampings in the first one's frame.

    ``turned``: by how many teeth the part sat turned in each, counter-clockwise from above, 0 in the first one of each
    view; None: its pitches tell; "over": turned over, with the other face on the shoulder, and its pitches or its tips
    tell by how many teeth. Pitches too even to tell decide nothing, whatever is stated: nobody could notice a part that
    was not turned at all. Only the first clamping counts then, as where closure contradicts.

    Raises:
        BadRecipe: not one entry for each surface, the first not 0, or what the pitches contradict.
        WrongDrawing: too few flanks are seen in both clampings.
        NotEnoughData: nothing of the toothing is in view.
    """
    firsts = _firsts(surfaces, turned)
    if len(surfaces) == len(set(firsts)):
        return Together(tuple(surfaces))
    nominal, datum = involute(gear), datum_of(surfaces[0].origin[1], gear.datum, gear.bore_clearance)
    clampings = [_clamping(s, of, nominal, datum) for s, of in zip(surfaces, turned, strict=True)]
    ties = ties_of(clampings, firsts)
    alone = tuple(s for k, s in enumerate(surfaces) if firsts[k] == k)
    if untied := [k for k, tie in enumerate(ties, 1) if not tie.sure]:
        return Together(alone, (_not_tied(untied, turned),), (FIRST_ALONE,))
    placed = [_turned_back(c.surface, datum, tie.turn) for c, tie in zip(clampings, ties, strict=True)]
    again, doubted = _turned_over(ties), _doubted(ties, surfaces[0].origin[1], gear)
    if not any(tie.by_flanks for k, tie in enumerate(ties) if firsts[k] != k):
        return Together(tuple(placed), doubted, again, sides_tied=False)
    by_flanks = [k for k, tie in enumerate(ties) if tie.by_flanks]
    closure = closure_of([placed[k] for k in by_flanks], nominal, datum)
    if wrong := closure.contradictions(nominal.measuring_radius):
        return Together(alone, wrong, (FIRST_ALONE,))
    moves = np.zeros((len(placed), 3))
    moves[by_flanks] = np.column_stack([closure.seats + closure.aside, closure.turns])
    closed = [closure.corrected(s, nominal.measuring_radius) for s in placed]
    seated = tuple(_moved_back(s, datum, *move) for s, move in zip(closed, moves, strict=True))
    said = _said(closure, ties, nominal.measuring_radius)
    return Together(seated, doubted, (said, *again), not again, _own_axis(datum))


def _own_axis(datum: Datum) -> Datum:
    """The axis on which the part sat: what stays with the seat while the part is turned is no run-out of the part."""
    lines = tuple(line for line in datum.contributions if not line.name.startswith(COAXIALITY))
    remark = "the axis on which the part sat, told from the shaft's by closure"
    return replace(datum, contributions=lines, U_offset=hypot(*(line.U for line in lines)), remark=remark)


def _firsts(surfaces: Sequence[Surface], turned: Sequence[PartTurned]) -> list[int]:
    """The first surface of each one's view.

    Raises:
        BadRecipe: as ``laid_together``.
    """
    if len(turned) != len(surfaces):
        raise BadRecipe(
            f"found --part-turned for {len(turned)} clampings and {len(surfaces)} scans, need one number of teeth "
            "for each scan, in their order"
        )
    names = ["" if s.calibration is None else s.calibration.name for s in surfaces]
    firsts = [names.index(name) for name in names]
    for first in firsts:
        if turned[first] not in (0, None):
            raise BadRecipe(
                f"found --part-turned {turned[first]} for the first scan of a view, need 0: the others count from it"
            )
    return firsts


def _clamping(surface: Surface, turned: PartTurned, nominal: Involute, datum: Datum) -> Clamping:
    """A clamping with its toothing, the right way up."""
    toothing = find_toothing(surface, nominal, datum)
    if turned != OVER:
        return Clamping(surface, toothing, turned)
    upright = _moved(surface, datum, Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 2 * nominal.middle])))
    return Clamping(upright, find_toothing(upright, nominal, datum), turned, Clamping(surface, toothing, None))


def _not_tied(clampings: list[int], turned: Sequence[PartTurned]) -> Message:
    listed = ", ".join(map(str, clampings))
    over = any(turned[k - 1] == OVER for k in clampings)
    turned_over = "" if over else ", or it was turned over, which --part-turned 0,over says"
    text = (
        f"clamping {listed}: how the part was turned can't be told, its pitches are too even, its tips contradict, its "
        f"face lies at other heights, it was not turned{turned_over}: inspect each scan by itself"
    )
    return Message("part_not_tied", text)


def _said(closure: Closure, ties: Sequence[Tie], radius: float) -> Message:
    size, U, seat = 1000 * float(np.hypot(*closure.waves[:2])) * radius, closure.expanded(0), K * closure.seated
    turned = [f"scan {k} was turned by {tie.teeth} teeth" for k, tie in enumerate(ties, 1) if tie.teeth]
    text = (
        f"closure over {len(closure.seats)} scans: the table errs by {size:.1f} +- {1000 * U * radius:.1f} um once "
        f"a turn at the measuring circle, taken off, if the part sits alike to {1000 * seat:.1f} um; "
        f"{', '.join(turned)}{'; ' if turned else ''}{1000 * closure.left * radius:.1f} um rms are left between them"
    )
    return Message("part_clamped_again", text)


def _turned_over(ties: Sequence[Tie]) -> tuple[Message, ...]:
    """What to know where clampings show other flanks than the first one."""
    apart = [k for k, tie in enumerate(ties, 1) if not tie.by_flanks]
    if not apart:
        return ()
    listed = ", ".join(map(str, apart))
    numbers = (
        "the tips tell which tooth is which"
        if all(tie.told for tie in ties)
        else "left and right flanks are numbered each from a tooth of their own"
    )
    text = (
        f"clamping {listed}: turned over, the part shows other flanks than before; {numbers}. How far left and right "
        "flanks are apart nothing tells: s, W_k, M_d and F_r are not measurable"
    )
    return (Message("part_turned_over", text),)


def _doubted(ties: Sequence[Tie], calibration: Calibration, gear: Gear) -> tuple[Message, ...]:
    """Why nothing may be decided of a part whose tips don't tell that it was turned over, or that it sits as before.

    An axis that the calibration has aside turns over with the part: twice as much shows between the scans.
    """
    found = []
    if untold := [k for k, tie in enumerate(ties, 1) if not tie.told]:
        text = (
            f"clamping {', '.join(map(str, untold))}: nothing tells that the part was turned over, it shows no flank "
            "again and its tips look the same from below: mark one tip off the middle of the face (a drop of lacquer, "
            "0.05 mm high), or let a sensor see both sides"
        )
        found.append(Message("turned_over_not_told", text))
    if not calibration.covariance.size:
        return tuple(found)
    axis = K * sqrt(float(np.linalg.eigvalsh(calibration.covariance[ECCENTRICITY, ECCENTRICITY])[-1]))
    U, off = hypot(K * seated_u(gear), 2 * axis, K * TIP_NOISE), max((tie.off for tie in ties), default=0.0)
    if off > MOST * U:
        text = (
            f"the tips say that the part sits {1000 * off:.1f} um otherwise than in the first clamping, U is "
            f"{1000 * U:.1f} um: state its play (bore_clearance_mm)"
        )
        found.append(Message("part_sits_otherwise", text))
    return tuple(found)


def _turned_back(surface: Surface, datum: Datum, turn: float) -> Surface:
    """The surface as it would be seen had the part not been turned."""
    return _moved(surface, datum, about_axis(-turn, 0.0)) if turn else surface


def _moved_back(surface: Surface, datum: Datum, x: float, y: float, turn: float) -> Surface:
    """The surface as it would be seen had the part not sat aside (mm), nor turned (rad)."""
    return _moved(surface, datum, about_axis(-turn, 0.0) @ Pose(np.eye(3), np.array([-x, -y, 0.0])))


def _moved(surface: Surface, datum: Datum, by: Pose) -> Surface:
    """The surface as it would be seen had the part been moved in its datum frame."""
    scan, calibration = surface.origin
    back = datum.pose.inverse @ by @ datum.pose
    return apply_calibration(scan, replace(calibration, shaft_from_rotor=back @ calibration.shaft_from_rotor))
