"""Gage R&R: how much of what is measured is the measuring, from operators x parts x trials (crossed, ANOVA).

AIAG, Measurement Systems Analysis, 4th ed., chapter III B (ANOVA method) and appendix A. Components are standard
deviations in the unit of the readings; a component that comes out negative is zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import NotEnoughData

SIGNIFICANT = 0.05
"""AIAG MSA 4th ed., table A 3: an interaction whose F isn't significant at this level joins the repeatability."""
CATEGORIES = 1.41
"""AIAG MSA 4th ed., chapter III B: sqrt(2), as printed there."""


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the analysis of variance."""

    name: str
    """operator | part | interaction | repeatability | total."""
    dof: int
    squares: float
    mean: float | None
    F: float | None
    p: float | None


@dataclass(frozen=True, slots=True)
class GageStudy:
    """What the measuring contributes, against what the parts differ by."""

    operators: int
    parts: int
    trials: int
    full: tuple[Line, ...]
    """With the interaction."""
    used: tuple[Line, ...]
    """The analysis that the components come from: without the interaction where that isn't significant."""
    EV: float
    """Repeatability: equipment variation."""
    AV: float
    """Between operators: appraiser variation."""
    INT: float
    """Interaction of operators and parts."""
    GRR: float
    """Repeatability and reproducibility."""
    PV: float
    """Between parts."""
    TV: float
    """Total variation."""

    @property
    def pooled(self) -> bool:
        """Whether the interaction was counted as repeatability."""
        return len(self.used) < len(self.full)

    @property
    def ndc(self) -> int | None:
        """Distinct categories that the measuring can tell apart, cut to a whole number, at least 1; None: no GRR."""
        return None if self.GRR == 0.0 else max(int(CATEGORIES * self.PV / self.GRR), 1)

    def share(self, component: float) -> float | None:
        """Per cent of the total variation; shares of standard deviations don't add up to 100."""
        return None if self.TV == 0.0 else 100.0 * component / self.TV

    def contribution(self, component: float) -> float | None:
        """Per cent of the total variance."""
        return None if self.TV == 0.0 else 100.0 * (component / self.TV) ** 2


def gage_study(readings: Array) -> GageStudy:
    """The study of readings (operators, parts, trials); without NaN.

    Raises:
        NotEnoughData: fewer than two operators, parts or trials, or a reading that is missing.
    """
    y = np.asarray(readings, dtype=np.float64)
    if y.ndim != 3 or min(y.shape) < 2 or not np.isfinite(y).all():
        found = " x ".join(map(str, y.shape))
        raise NotEnoughData(f"found {found} readings, need at least 2 operators x 2 parts x 2 trials, none missing")
    o, p, r = y.shape
    full = _analysis(y)
    p_interaction = next(line.p for line in full if line.name == "interaction")
    pooled = p_interaction is None or p_interaction >= SIGNIFICANT  # nothing to test against is nothing significant
    used = _without_interaction(full) if pooled else full
    mean = {line.name: line.mean or 0.0 for line in used}
    within = mean["repeatability"]
    base = within if pooled else mean["interaction"]
    EV, AV = _root(within), _root((mean["operator"] - base) / (p * r))
    INT, PV = 0.0 if pooled else _root((base - within) / r), _root((mean["part"] - base) / (o * r))
    GRR = float(np.linalg.norm((EV, AV, INT)))
    return GageStudy(o, p, r, full, used, EV, AV, INT, GRR, PV, float(np.hypot(GRR, PV)))


def readings_of(rows: Sequence[tuple[str, str, float]]) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
    """Readings (operators, parts, trials) of (operator, part, value) rows, with the names; trials in their order.

    Raises:
        NotEnoughData: an operator who measured a part more or less often than others did.
    """
    cells: dict[tuple[str, str], list[float]] = {}
    for operator, part, value in rows:
        cells.setdefault((operator, part), []).append(value)
    operators = tuple(dict.fromkeys(o for o, _ in cells))
    parts = tuple(dict.fromkeys(p for _, p in cells))
    counts = {(o, p): len(cells.get((o, p), ())) for o in operators for p in parts}
    if len(set(counts.values())) != 1:
        few, many = min(counts, key=lambda c: counts[c]), max(counts, key=lambda c: counts[c])
        raise NotEnoughData(
            f"found {counts[few]} readings of part {few[1]} by {few[0]} and {counts[many]} of part {many[1]} by "
            f"{many[0]}; each operator measures each part equally often"
        )
    return np.array([[cells[o, p] for p in parts] for o in operators]), operators, parts


def _analysis(y: Array) -> tuple[Line, ...]:
    """Two-way analysis of variance with interaction; F of the main effects against the interaction (random effects)."""
    o, p, r = y.shape
    mean, part, operator, cell = y.mean(), y.mean((0, 2)), y.mean((1, 2)), y.mean(2)
    squares = {
        "operator": p * r * float(np.sum((operator - mean) ** 2)),
        "part": o * r * float(np.sum((part - mean) ** 2)),
        "interaction": r * float(np.sum((cell - part - operator[:, None] + mean) ** 2)),
        "repeatability": float(np.sum((y - cell[:, :, None]) ** 2)),
    }
    dof = {"operator": o - 1, "part": p - 1, "interaction": (o - 1) * (p - 1), "repeatability": o * p * (r - 1)}
    return _lines(squares, dof, {"operator": "interaction", "part": "interaction", "interaction": "repeatability"})


def _without_interaction(full: tuple[Line, ...]) -> tuple[Line, ...]:
    """The same with the interaction counted as repeatability."""
    squares = {line.name: line.squares for line in full[:-1]}
    dof = {line.name: line.dof for line in full[:-1]}
    squares["repeatability"] += squares.pop("interaction")
    dof["repeatability"] += dof.pop("interaction")
    return _lines(squares, dof, {"operator": "repeatability", "part": "repeatability"})


def _lines(squares: dict[str, float], dof: dict[str, int], against: dict[str, str]) -> tuple[Line, ...]:
    from scipy.special import fdtrc

    means = {name: squares[name] / dof[name] for name in squares}
    lines = []
    for name, mean in means.items():
        other = against.get(name)
        F = means[name] / means[other] if other is not None and means[other] > 0 else None
        p = None if F is None or other is None else float(fdtrc(dof[name], dof[other], F))
        lines.append(Line(name, dof[name], squares[name], mean, F, p))
    return (*lines, Line("total", sum(dof.values()), sum(squares.values()), None, None, None))


def _root(variance: float) -> float:
    return float(np.sqrt(max(variance, 0.0)))
