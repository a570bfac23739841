"""Whether a quantity that is measured again and again stays what it was.

Individuals chart with moving range: mean -+ 2.66 mean moving range (ISO 7870-2, table of constants: 3 / d2,
d2 = 1.128). Two rules: a point beyond the limits, and eight in a row on one side of the mean. Beside them the reading's
own U.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot

import numpy as np

MR_FACTOR = 2.66
RUN = 8
ENOUGH = 20
"""Readings from which limits are more than provisional (AIAG SPC: 20 to 25)."""
BEYOND, ONE_SIDE, CHANGED = "beyond the limits", "8 on one side", "changed by more than U"


@dataclass(frozen=True, slots=True)
class Point:
    """One reading of the quantity, in its own unit."""

    value: float
    U: float | None = None
    change: float | None = None
    """Since the reading before."""
    change_U: float | None = None
    """U of the change: both readings' U together."""
    flags: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing is to be said about it."""
        return not self.flags


@dataclass(frozen=True, slots=True)
class ControlChart:
    """A quantity's readings in their order with the limits that follow from them."""

    points: tuple[Point, ...]
    mean: float | None
    lower: float | None
    """None: fewer than two readings."""
    upper: float | None

    @property
    def provisional(self) -> bool:
        """Whether the limits rest on few readings."""
        return len(self.points) < ENOUGH

    @property
    def drift(self) -> float | None:
        """Last minus first reading."""
        return None if len(self.points) < 2 else self.points[-1].value - self.points[0].value


def control_chart(
    values: Sequence[float], U: Sequence[float | None] | None = None, period: float | None = None
) -> ControlChart:
    """The chart of readings with their U (k = 2), oldest first.

    ``period``: of a direction, 360 in degrees; each reading is then taken the short way round from the one before.
    """
    known = list(U) if U is not None else [None] * len(values)
    # A direction is taken the short way round from the reading before.
    straight = list(values) if period is None else [float(v) for v in np.unwrap(values, period=period)]
    changes = [None, *(b - a for a, b in pairwise(straight))][: len(straight)]
    mean, lower, upper = _limits(straight)
    sides = _runs(straight, mean)
    points = []
    for k, value in enumerate(straight):
        change, before = changes[k], known[k - 1] if k else None
        both = None if before is None or known[k] is None else hypot(before, known[k] or 0.0)
        flags = []
        if lower is not None and upper is not None and not lower <= value <= upper:
            flags.append(BEYOND)
        if sides[k] >= RUN:
            flags.append(ONE_SIDE)
        if change is not None and both is not None and abs(change) > both:
            flags.append(CHANGED)
        points.append(Point(value, known[k], change, both, tuple(flags)))
    return ControlChart(tuple(points), mean, lower, upper)


def _limits(values: Sequence[float]) -> tuple[float | None, float | None, float | None]:
    """Mean, and the limits at MR_FACTOR mean moving ranges (sizes of the changes) from it, where they are known."""
    if len(values) < 2:
        return (values[0] if values else None), None, None
    first = values[0]
    mean = first + sum(v - first for v in values) / len(values)  # of equal readings exactly theirs
    half = MR_FACTOR * sum(abs(b - a) for a, b in pairwise(values)) / (len(values) - 1)
    return mean, mean - half, mean + half


def _runs(values: Sequence[float], mean: float | None) -> list[int]:
    """How many readings in a row, up to each, lie on its side of the mean."""
    runs: list[int] = []
    side = 0
    for value in values:
        now = 0 if mean is None or value == mean else 1 if value > mean else -1
        runs.append(0 if now == 0 else runs[-1] + 1 if runs and now == side else 1)
        side = now
    return runs
