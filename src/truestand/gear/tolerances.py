"""Flank tolerances of ISO 1328-1, editions 2013 and 1995, rounded as the standard says.

2013: formulas of class 5 with a step of sqrt(2), from the gear's own values. 1995: the same step, from the geometric
means of ranges. Totals come from unrounded parts; rounding is last.
"""

from bisect import bisect_right
from collections.abc import Callable
from math import cos, degrees, hypot, sqrt

from truestand.core.errors import BadRecipe
from truestand.gear.drawing import Gear, Standard

UM = 1000.0
STEP = sqrt(2.0)
CLASSES: dict[Standard, tuple[int, int]] = {"ISO 1328-1:2013": (1, 11), "ISO 1328-1:1995": (0, 12)}
DIAMETERS_1995 = (5, 20, 50, 125, 280, 560, 1000, 1600, 2500, 4000, 6000, 8000, 10000)
MODULES_1995 = (0.5, 2, 3.5, 6, 10, 16, 25, 40, 70)
WIDTHS_1995 = (4, 10, 20, 40, 80, 160, 250, 400, 650, 1000)


def tolerance(name: str, gear: Gear, accuracy_class: int) -> float:
    """Tolerance (mm) in a class of a characteristic that has one (``has_tolerance``).

    Raises:
        BadRecipe: a gear or class outside the standard's range.
    """
    size = _size(gear)
    lowest, highest = CLASSES[gear.standard]
    if not lowest <= accuracy_class <= highest:
        raise BadRecipe(f"found accuracy_class {accuracy_class}, need {lowest}..{highest} of {gear.standard}")
    formulas = _CLASS_5[gear.standard]
    parts = (name,) if name in formulas else TOTALS[name]
    return _rounded(hypot(*(formulas[part](*size) for part in parts)) * STEP ** (accuracy_class - 5)) / UM


def reached(name: str, value: float, gear: Gear) -> int | None:
    """The best class whose tolerance holds |value| (mm); None beyond the last class."""
    lowest, highest = CLASSES[gear.standard]
    classes = range(max(lowest, 1), highest + 1)
    return next((a for a in classes if abs(value) <= tolerance(name, gear, a)), None)


def has_tolerance(name: str) -> bool:
    """Whether the standard has a tolerance of that name, be it informative."""
    return name in _CLASS_5["ISO 1328-1:2013"] or name in TOTALS


def _size(gear: Gear) -> tuple[float, float, float]:
    """Reference diameter, module and face width (mm) with which the standard's formulas are read."""
    standard = gear.standard
    d, m, b = gear.teeth * gear.module / cos(gear.helix_angle), gear.module, gear.face_width
    most_d, most_b = (15000, 1200) if standard == "ISO 1328-1:2013" else (10000, 1000)
    inside = 5 <= d <= most_d and 0.5 <= m <= 70 and 4 <= b <= most_b and gear.teeth >= 5
    if not inside or abs(degrees(gear.helix_angle)) > 45:
        raise BadRecipe(
            f"{standard} covers 5 teeth and more, d 5..{most_d}, module 0.5..70, width 4..{most_b} mm and helix angles "
            f"up to 45 degrees; found z {gear.teeth}, d {d:.1f}, module {m:g}, width {b:g}, helix "
            f"{degrees(gear.helix_angle):.1f}; leave accuracy_class out to measure without limits"
        )
    if standard == "ISO 1328-1:1995":
        return _mean_of(d, DIAMETERS_1995), _mean_of(m, MODULES_1995), _mean_of(b, WIDTHS_1995)
    return d, m, b


def _mean_of(value: float, limits: tuple[float, ...]) -> float:
    """Geometric mean of the range that holds ``value``."""
    at = min(max(bisect_right(limits, value), 1), len(limits) - 1)
    if value == limits[at - 1] and at > 1:
        at -= 1  # a limit belongs to the range below it
    return sqrt(limits[at - 1] * limits[at])


def _rounded(um: float) -> float:
    """Above 10 um to 1, from 5 to 0.5, below to 0.1 um."""
    step = 1.0 if um > 10 else 0.5 if um >= 5 else 0.1
    return round(um / step + 1e-9) * step


Formula = Callable[[float, float, float], float]
TOTALS = {"F_alpha": ("f_Halpha", "f_falpha"), "F_beta": ("f_Hbeta", "f_fbeta")}


def _pitch_2013(d: float, m: float, b: float) -> float:
    return 0.001 * d + 0.4 * m + 5


def _total_pitch_2013(d: float, m: float, b: float) -> float:
    return 0.002 * d + 0.55 * sqrt(d) + 0.7 * m + 12


_CLASS_5: dict[Standard, dict[str, Formula]] = {
    "ISO 1328-1:2013": {
        "f_p": _pitch_2013,
        "F_p": _total_pitch_2013,
        "F_r": lambda d, m, b: 0.9 * _total_pitch_2013(d, m, b),
        "f_Halpha": lambda d, m, b: 0.4 * m + 0.001 * d + 4,
        "f_falpha": lambda d, m, b: 0.55 * m + 5,
        "f_Hbeta": lambda d, m, b: 0.05 * sqrt(d) + 0.35 * sqrt(b) + 4,
        "f_fbeta": lambda d, m, b: 0.07 * sqrt(d) + 0.45 * sqrt(b) + 4,
    },
    "ISO 1328-1:1995": {
        "f_p": lambda d, m, b: 0.3 * (m + 0.4 * sqrt(d)) + 4,
        "F_p": lambda d, m, b: 0.3 * m + 1.25 * sqrt(d) + 7,
        "F_r": lambda d, m, b: 0.24 * m + sqrt(d) + 5.6,
        "F_alpha": lambda d, m, b: 3.2 * sqrt(m) + 0.22 * sqrt(d) + 0.7,
        "F_beta": lambda d, m, b: 0.1 * sqrt(d) + 0.63 * sqrt(b) + 4.2,
        "f_falpha": lambda d, m, b: 2.5 * sqrt(m) + 0.17 * sqrt(d) + 0.5,
        "f_Halpha": lambda d, m, b: 2 * sqrt(m) + 0.14 * sqrt(d) + 0.5,
        "f_fbeta": lambda d, m, b: 0.07 * sqrt(d) + 0.45 * sqrt(b) + 3,
        "f_Hbeta": lambda d, m, b: 0.07 * sqrt(d) + 0.45 * sqrt(b) + 3,
    },
}
