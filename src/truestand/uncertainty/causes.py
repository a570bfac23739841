"""What makes most of U, and what to do about it: told from the budgets, input by input."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from truestand.core.assumptions import ASSUMED, CLAMP_TWICE, LINEARITY, MOUNTING, Assumption, behind, better
from truestand.core.calibration import Calibration, Contribution, Uncertainty
from truestand.uncertainty.assumed import assumptions_of

Budget = tuple[Contribution, ...]
Known = Literal["assumed", "stated", "measured", "calibrated"]
LARGE = 0.25
"""Share of U squared from which an input is named beside the largest one."""
ASSUMED_IN_THE_FIT = (MOUNTING, "coaxiality of the steps")
"""Lines that may rest on an assumption and don't say so."""
FIT = (*ASSUMED_IN_THE_FIT, "noise", "form", "clamping", "drift", "table speed", "linearity of the sensor over")
"""The beginnings of the lines that stand in a calibration's covariance, through which it reaches a part."""
PLANE, SENSOR, SHAFT = ("laser_plane_offset_mm", "laser_plane_tilt_deg"), "radial_position_mm", "eccentricity_um"
OF_CALIBRATION = {
    "lateral offset of the laser plane": PLANE[:1], "skew of the laser line": PLANE[1:],
    "angle and radial zero of the sensor": (SENSOR,), "axis of the shaft": (SHAFT,),
    "calibration": (*PLANE, SENSOR, SHAFT),
}  # fmt: skip
"""Lines of a part's budget that the calibration brings, and the quantities of it that stand behind them."""
MEASURED = {
    "noise": "scan more turns",
    "height zero": "let the sensor see the face of the shoulder",
    "form that changes": "clean the shaft",
    "form and static profile": "bring a longer step into view",
    "drift": "let the sensor warm up",
    "table speed": "use an encoder",
    "between readings": "scan with more profiles a turn and more points a profile",
    "vibration": "keep sensor and part from shaking, or scan more turns",
    "shape within": "scan with more profiles a turn and more points a profile",
    "scatter of the teeth": "nothing: the teeth differ",
    "bore clearance": "clamp the part without play, and state bore_clearance_mm in the part's recipe",
    "on top of a flank": "clean the part, or cut reflections off",
    "damage that was not seen": "scan with more profiles a turn",
}
"""What to do about lines that no recipe states, by the beginning of their names."""


@dataclass(frozen=True, slots=True)
class Cause:
    """One input that makes most, or a good part, of U of some quantities."""

    name: str
    known: Known
    assumed: tuple[Assumption, ...]
    """Behind it."""
    better: str
    """What makes it smaller; empty where nothing is known to."""
    shares: Mapping[str, float]
    """Of U squared, by quantity, the largest first."""


def causes_of(calibration: Calibration, budgets: Mapping[str, Budget]) -> tuple[Cause, ...]:
    """What makes U of the quantities with these ``budgets``, the input with the largest share first.

    What a calibration brought to a part is told as what made it there, where one input made most of it.
    """
    shares: dict[str, dict[str, float]] = {}
    for quantity, lines in budgets.items():
        for name, share in _large(_shares(lines, calibration)):
            shares.setdefault(name, {})[quantity] = share
    assumed = assumptions_of(calibration, budgets.values())
    causes = [_cause(name, found, calibration, assumed) for name, found in shares.items()]
    return tuple(sorted(causes, key=lambda c: -max(c.shares.values())))


def _shares(lines: Budget, calibration: Calibration) -> dict[str, float]:
    """Share of each input in U squared, by its name."""
    whole = sum(line.U**2 for line in lines)
    shares: dict[str, float] = {}
    for line in lines if whole > 0 else ():
        name = _origin(line.name, calibration)
        shares[name] = shares.get(name, 0.0) + line.U**2 / whole
    return shares


def _large(shares: Mapping[str, float]) -> Iterable[tuple[str, float]]:
    """The largest share, and those that are large besides."""
    largest = max(shares.values(), default=0.0)
    return [(name, share) for name, share in shares.items() if share >= min(largest, LARGE)]


def _origin(name: str, calibration: Calibration) -> str:
    """The line's name, or that of what made most of it in the calibration, where that is one input."""
    found = {_largest_in_fit(calibration.uncertainty.get(key)) for key in OF_CALIBRATION.get(name, ())}
    (origin,) = found if len(found) == 1 else ("",)
    return origin or name


def _largest_in_fit(uncertainty: Uncertainty | None) -> str:
    """The line that makes most of what a calibration's covariance holds of a quantity; empty where none does."""
    budget = () if uncertainty is None else uncertainty.contributions
    lines = [line for line in budget if line.name.startswith(FIT)]
    largest = max(lines, key=lambda line: line.U, default=None)
    return "" if largest is None or sum(line.U**2 for line in lines) >= 2 * largest.U**2 else largest.name


def _cause(name: str, shares: dict[str, float], calibration: Calibration, assumed: Iterable[Assumption]) -> Cause:
    names = {a.name: a for a in assumed} if name.endswith(ASSUMED) or name in ASSUMED_IN_THE_FIT else {}
    inputs = behind(name)
    here = () if _seen_worse(name, calibration) else tuple(names[a.name] for a in inputs if a.name in names)
    known: Known = "calibrated" if name in OF_CALIBRATION else "measured"
    if here or _statable(name, inputs, calibration):
        known = "assumed" if here else "stated"
    advice = better(here or inputs, stated=not here) if inputs else _measured(name)
    if calibration.positions is not None:  # clamped again already
        advice = advice.removesuffix(CLAMP_TWICE).removesuffix(", or ")
    ordered = dict(sorted(shares.items(), key=lambda s: -s[1]))
    return Cause(name.removesuffix(ASSUMED), known, here, advice, ordered)


def _seen_worse(name: str, calibration: Calibration) -> bool:
    """Whether the scan of the artefact shows more than was stated or assumed, which counts then."""
    shown = max((s.peak_to_valley / 2 for s in calibration.static_profiles), default=0.0)
    return name.startswith(LINEARITY.name) and shown > calibration.stand.sensor.linearity


def _statable(name: str, inputs: Iterable[Assumption], calibration: Calibration) -> bool:
    """Whether the line's size comes from a recipe; several clampings measure a datum's axis."""
    by_clampings = name.startswith("coaxiality of the datum") and calibration.positions is not None
    return any(a.key for a in inputs) and not by_clampings and not _seen_worse(name, calibration)


def _measured(name: str) -> str:
    if name in OF_CALIBRATION:
        return "calibrate better: the calibration's report says what makes its U"
    return next((advice for beginning, advice in MEASURED.items() if name.startswith(beginning)), "")
