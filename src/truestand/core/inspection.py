"""What an inspection is: characteristics with their uncertainty and verdict, defects, and what could not be seen.

The decision rule is that of ISO 14253-1: both answers must be shown beyond a guard band; between: undecided. Edition
2017 sets the guard band to 1.65 u, which leaves 5 % of risk on one side (u = U / 2); older practice takes U.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Literal

from truestand.core.arrays import Array
from truestand.core.calibration import Contribution
from truestand.core.message import Message

Flank = Literal["left", "right"]
Status = Literal["measured", "partial", "not_measurable"]
Verdict = Literal["conforms", "does_not_conform", "undecided"]
Kind = Literal["gear", "turned", "cad"]

EDITION = "ISO 14253-1:2017"
GUARD_FACTOR = 1.65
"""Guard band in standard uncertainties."""
MEASURED, PARTIAL = 0.9, 0.3
"""Coverage from which a characteristic is measured, and from which it is at least partial."""
WORST = "_worst"
"""Behind the name of a figure that is the worst of all sections of all teeth of a side."""


@dataclass(frozen=True, slots=True)
class Characteristic:
    """One line of the report. ``value``, ``U`` (k = 2) and ``limits`` are mm; None = not seen, no limit."""

    name: str
    value: float | None
    U: float | None
    flank: Flank | None = None
    """Left: the flank of a tooth at the larger polar angle."""
    tooth: int | None = None
    """From 1; None: the whole gear."""
    section: str | None = None
    """Of a turned part."""
    size: bool = False
    """A size is reported in mm, a deviation in um."""
    limits: tuple[float | None, float | None] | None = None
    """Lower and upper limit."""
    grade: int | None = None
    """The best class of the standard that the value keeps."""
    coverage: float = 1.0
    status: Status = "measured"
    verdict: Verdict | None = None
    """None where there is no limit."""
    capable: bool = True
    """Whether U is small enough, against the limits, that conformance can be shown at all."""
    standard: str | None = None
    budget: tuple[Contribution, ...] = ()
    """Lines of U, largest first, in mm."""
    reason: str | None = None
    """What makes the line doubtful: the damage that it reads, or surface that was not seen."""
    views: tuple[str, ...] = ()
    """Of several views: those that saw what it reads."""

    @property
    def at_least(self) -> bool:
        """Whether the value is a lower bound of a flank's form: what was seen exceeds the limit, what was not seen
        makes it no better. Other lines, as of CAD parts, may fail by their means with a wider U, which bounds nothing.
        """
        if self.flank is None or self.verdict != "does_not_conform" or self.value is None or self.U is None:
            return False
        low, high = self.limits or (None, None)
        if high is None or low is not None or self.value <= high:
            return False
        return self.status == "partial" or decide(self.value, self.U, (low, high)) != self.verdict


@dataclass(frozen=True, slots=True)
class Defect:
    """Something on a tooth that its neighbours don't have; lengths mm, depth positive into the material."""

    tooth: int | None
    flank: Flank | None
    roll_length: float | None
    height: float | None
    depth: float | None
    extent: float | None
    kind: str
    """dent | bump | chipped tip | chipped end | burr | missing tooth | hidden tip | hidden end | chipped flank."""
    score: float
    second_score: float | None = None
    """IsolationForest, 0..1, where scikit-learn is installed."""
    U: float | None = None
    """Of the depth (k = 2), mm, where it is known."""
    verdict: Verdict | None = None
    """Of a tooth that is missing, broken or chipped, and of what is deeper than the part's limit, or may be; None: only
    listed."""


CONTRADICTS = 1.5
"""Times its U that a difference must be for views to contradict each other: of normal errors, 1 of 400 is by chance."""


@dataclass(frozen=True, slots=True)
class Seam:
    """What two views of the same surface differ by when all others have told where the views stand; mm."""

    views: tuple[str, str]
    flank: Flank | None
    difference: float
    """First less second, positive where the first has more material."""
    U: float
    """k = 2: of the calibration and the sensors."""
    ok: bool
    section: str | None = None
    """Of a turned part."""

    @classmethod
    def between(
        cls, views: tuple[str, str], difference: float, U: float, flank: Flank | None = None, section: str | None = None
    ) -> "Seam":
        """A seam whose views agree within ``CONTRADICTS`` times its U."""
        return cls(views, flank, difference, U, abs(difference) <= CONTRADICTS * U, section)

    @property
    def place(self) -> str:
        """Where the surface is that both saw."""
        if self.section is not None:
            return f"section {self.section!r}"
        return f"the {self.flank} flanks" if self.flank else "all that both show"


def contradictions(seams: tuple[Seam, ...]) -> tuple[Message, ...]:
    """Why nothing may be decided where views contradict each other; a third view tells which of them moved."""
    wrong = [seam for seam in seams if not seam.ok]
    if not wrong:
        return ()
    worst = max(wrong, key=lambda seam: abs(seam.difference) / seam.U)
    agreeing = {view for seam in seams if seam.ok for view in seam.views}
    moved = {view for seam in wrong for view in seam.views} - agreeing
    which = f"view {min(moved)!r} has" if len(moved) == 1 else "one of them has"
    text = (
        f"views {' and '.join(map(repr, worst.views))} differ by {1000 * abs(worst.difference):.1f} um on "
        f"{worst.place}, U is {1000 * worst.U:.1f} um: {which} moved since the calibration; verify each (truestand "
        "verify), or inspect by one view"
    )
    return (Message("views_contradict", text),)


@dataclass(frozen=True, slots=True)
class Inspection:
    """What was found on one part."""

    kind: Kind
    name: str
    characteristics: tuple[Characteristic, ...]
    defects: tuple[Defect, ...] = ()
    without_damage: tuple[Characteristic, ...] = ()
    """Those that damage touches once more, as if no reading had fallen on it: information, without a verdict."""
    reasons: tuple[Message, ...] = ()
    """Why nothing may be decided; empty where the calibration, the angle and the datum may carry a verdict."""
    remarks: tuple[Message, ...] = ()
    """What the reader should know: coarse sampling, a flank that was hidden, where the angle comes from."""
    settings: dict[str, str] = field(default_factory=dict)
    """How it was evaluated: ranges, filters, datum, decision rule, each as it is printed."""
    defect_depth: float | None = None
    """mm: the part's limit for defects; None: they don't decide."""
    deviation: Array | None = None
    """(N, M) mm: normal deviation of each reading, positive outwards; NaN = not seen, or no surface of the part."""
    evidence: Any = None
    """What the report draws: ``GearEvidence``, ``TurnedEvidence`` or ``CadEvidence``."""
    identity: dict[str, str] = field(default_factory=dict)
    """Serial number, order, operator, as the recipe has them."""
    published: dict[str, float] = field(default_factory=dict)
    """The same characteristics (mm) after the published compensation, by name and flank: ``F_p left``."""
    seams: tuple[Seam, ...] = ()
    """Of several views: where they overlap."""
    created: str | None = None
    software: str = ""

    def __post_init__(self) -> None:
        """With reasons nothing is decided, no single line either."""
        if self.reasons:
            object.__setattr__(self, "characteristics", tuple(replace(c, verdict=None) for c in self.characteristics))
            object.__setattr__(self, "defects", tuple(replace(d, verdict=None) for d in self.defects))

    @property
    def verdict(self) -> Verdict:
        """Does not conform if any line fails or a defect decides so; else undecided if any line or defect is, or if
        nothing may be decided.

        A part without limits can fail by defects only.
        """
        found = {c.verdict for c in self.characteristics} | {d.verdict for d in self.defects}
        if not self.reasons and "does_not_conform" in found:
            return "does_not_conform"
        return "undecided" if self.reasons or "undecided" in found else "conforms"


def status_of(coverage: float) -> Status:
    """What a coverage of 0..1 allows to say."""
    return "measured" if coverage >= MEASURED else "partial" if coverage >= PARTIAL else "not_measurable"


def decide(value: float, U: float, limits: tuple[float | None, float | None]) -> Verdict:
    """The verdict on ``value`` with expanded uncertainty ``U`` (k = 2) against lower and upper limit (None: open)."""
    guard = GUARD_FACTOR * U / 2
    low, high = limits
    above, below = -1e300 if low is None else low, 1e300 if high is None else high
    if value < above - guard or value > below + guard:
        return "does_not_conform"
    return "conforms" if above + guard <= value <= below - guard else "undecided"


def capable(U: float, limits: tuple[float | None, float | None], floor: float | None = None) -> bool:
    """Whether any value could be shown to conform: the guard bands leave room between the limits.

    ``floor``: the least value that the characteristic can have (0 for totals), where there is no lower limit.
    """
    low, high = limits
    low = floor if low is None else low
    if high is None or low is None:
        return True
    ends = 1 if limits[0] is None else 2
    return ends * GUARD_FACTOR * U / 2 < high - low


def decided(c: Characteristic) -> Characteristic:
    """The characteristic with its verdict: undecided where nothing was measured or U is not known."""
    if c.limits is None:
        return c
    if c.value is None or c.U is None or c.status == "not_measurable":
        return replace(c, verdict="undecided")
    floor = None if c.size else 0.0
    verdict = decide(c.value, c.U, c.limits)
    if c.status == "partial" and verdict == "conforms":
        verdict = "undecided"  # what was not seen may be worse
    return replace(c, verdict=verdict, capable=capable(c.U, c.limits, floor))
