"""The decision rule of ISO 14253-1: both answers must be shown beyond a guard band; between: undecided.

Edition 2017 sets the guard band to 1.65 u, which leaves 5 % of risk on one side (u = U / 2); older practice takes U.
"""

from dataclasses import replace

from truestand.core.inspection import Characteristic, Verdict

EDITION = "ISO 14253-1:2017"
GUARD_FACTOR = 1.65
"""Guard band in standard uncertainties."""


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
