"""The lines of the report: each figure with U, limit, class, coverage and verdict; and how it was all evaluated.

Limits: flank tolerances of ISO 1328-1, editions 2013 and 1995, rounded as the standard says. 2013: formulas of class 5
with a step of sqrt(2), from the gear's own values. 1995: the same step, from the geometric means of ranges. Totals come
from unrounded parts; rounding is last.
"""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, degrees, hypot, sqrt

import numpy as np

from truestand.apply.datum import Datum
from truestand.core.arrays import Mask
from truestand.core.calibration import Contribution
from truestand.core.errors import BadRecipe
from truestand.core.inspection import EDITION, GUARD_FACTOR, Characteristic, decided, status_of
from truestand.core.scan import Scan
from truestand.gear.budget import Influence, lines_of
from truestand.gear.damage import Damage, Zone, damage_in
from truestand.gear.drawing import Gear, Standard
from truestand.gear.evaluate import AREAL, AREAL_NAMES, MEAN, MEANS, NEVER_NEGATIVE, PER_TOOTH, PITCH, Figures
from truestand.gear.geometry import FACE_SHARE, FLANKS, TIP_SHARE, Involute, pitch_span
from truestand.gear.grid import CLIP, HEIGHT_CELL, Coverage
from truestand.gear.teeth import Diameter

PROFILE_NAMES = frozenset({"F_alpha", "f_falpha", "f_Halpha", "C_alpha"})
SIZES = ("s", "W_k", "M_d")
LEFT_OUT = "damage left out"
UM = 1000.0
STEP = sqrt(2.0)
CLASSES: dict[Standard, tuple[int, int]] = {"ISO 1328-1:2013": (1, 11), "ISO 1328-1:1995": (0, 12)}
DIAMETERS_1995 = (5, 20, 50, 125, 280, 560, 1000, 1600, 2500, 4000, 6000, 8000, 10000)
MODULES_1995 = (0.5, 2, 3.5, 6, 10, 16, 25, 40, 70)
WIDTHS_1995 = (4, 10, 20, 40, 80, 160, 250, 400, 650, 1000)
INFORMATIVE = frozenset({"F_r", "F_pk", "f_u"})
"""Told with a class but without deciding: informative in 2013, or formulas that no public source confirms."""


@dataclass(frozen=True, slots=True)
class Assessment:
    """Figures (mm) and by how much each input of the budget may move them (U, k = 2)."""

    nominal: Involute
    figures: Figures
    expanded: dict[str, Figures]
    """U by the name of the input."""
    influences: tuple[Influence, ...]
    coverage: Coverage
    damage: tuple[Damage, ...]
    """What the figures leave out,"""
    zones: dict[Zone, Mask]
    """and from which cells (roll lengths, heights) they are read."""
    runout_per_delta: float


def characteristics_of(a: Assessment, diameters: tuple[Diameter, ...]) -> tuple[Characteristic, ...]:
    """Whole gear first, then tooth by tooth."""
    names = (*PITCH, *(name + AREAL for name in AREAL_NAMES))
    lines = [_line(a, n, (side,)) for n in names for side in (0, 1)]
    lines.append(_line(a, "F_r", ()))
    lines += [_line(a, n + MEAN, (side,)) for n in MEANS for side in (0, 1)]
    lines += [_line(a, n, ()) for n in SIZES]
    lines += [_diameter(d, a.nominal.gear) for d in diameters]
    teeth = range(a.nominal.gear.teeth)
    lines += [_line(a, n, (side, tooth)) for n in PER_TOOTH for side in (0, 1) for tooth in teeth]
    return tuple(lines)


def _line(a: Assessment, name: str, at: tuple[int, ...]) -> Characteristic:
    plain = name.removesuffix(MEAN)
    size = plain in SIZES
    coverage = _coverage(a.coverage, plain, at)
    status = status_of(coverage)
    value = float(a.figures[name][at])
    seen = status != "not_measurable" and bool(np.isfinite(value))
    budget = lines_of(a.expanded, a.influences, name, at) if seen else ()
    limits, standard = _limits(a.nominal.gear, plain)
    line = Characteristic(
        name=plain,
        value=value if seen else None,
        U=hypot(*(c.U for c in budget)) if seen else None,
        flank=FLANKS[at[0]] if at else None,
        tooth=at[1] + 1 if len(at) > 1 else None,
        size=size,
        limits=limits,
        grade=_grade(a.nominal.gear, plain, value) if seen else None,
        coverage=coverage,
        status=status if seen else "not_measurable",
        standard=standard,
        budget=budget,
    )
    line = line if plain in INFORMATIVE else decided(line)
    return _with_damage(line, a, at) if seen else line


def _with_damage(line: Characteristic, a: Assessment, at: tuple[int, ...]) -> Characteristic:
    """The line with what was left out of it in its U; undecided where that has no known depth."""
    side, tooth = (*at, None, None)[:2]
    regions = damage_in(a.damage, a.zones[_zone(line.name)], side, tooth)
    if not regions:
        return line
    gravest = max(regions, key=lambda d: (not d.resolved, abs(d.depth or 1e9)))
    depths = [abs(d.depth or 0.0) for d in regions]
    most = sum(depths) / a.nominal.gear.teeth if line.size else max(depths)
    u = most * _per_delta(line.name, a) / sqrt(3.0)  # anywhere between none of it and all
    budget = sorted((*line.budget, Contribution(LEFT_OUT, 2 * u, u, "rectangular")), key=lambda c: -c.U)
    wider = replace(line, U=hypot(line.U or 0.0, 2 * u), grade=None, budget=tuple(budget), reason=gravest.text)
    if line.verdict is None:
        return wider
    if not gravest.resolved:
        return replace(wider, verdict="undecided")
    return replace(decided(wider), capable=line.capable)  # U of a sound part is what the stand can do


def _zone(name: str) -> Zone:
    if name.endswith(AREAL):
        return "area"
    return "profile" if name in PROFILE_NAMES else "helix" if name in MEANS else "position"


def _per_delta(name: str, a: Assessment) -> float:
    """By how much a figure may follow one flank's delta."""
    if name in PITCH or name == "s" or name.endswith(AREAL):
        return a.nominal.arc_per_delta * (2.0 if name == "f_u" else 1.0)
    others = {"F_r": a.runout_per_delta, "M_d": 2 * a.runout_per_delta, "W_k": a.nominal.normal_per_delta}
    return others.get(name, 1.0)


def _coverage(c: Coverage, name: str, at: tuple[int, ...]) -> float:
    """Share of what the figure needs; of both flanks where it needs both."""
    which = c.profile if name in PROFILE_NAMES else c.helix if name in MEANS else c.position
    if not at:
        return float(np.minimum(c.position[0], c.position[1]).mean())
    return float(which[at].mean())


def _limits(g: Gear, name: str) -> tuple[tuple[float | None, float | None] | None, str | None]:
    if name in g.limits:
        return g.limits[name], "drawing"
    if g.accuracy_class is None or name in ("F_pk", "f_u") or not has_tolerance(name):
        return None, None
    limit = tolerance(name, g, g.accuracy_class)
    standard = f"{g.standard} class {g.accuracy_class}" + (" (informative)" if name in INFORMATIVE else "")
    return ((None, limit) if name in NEVER_NEGATIVE else (-limit, limit)), standard


def _grade(g: Gear, name: str, value: float) -> int | None:
    return reached(name, value, g) if g.accuracy_class is not None and has_tolerance(name) else None


def _diameter(d: Diameter, g: Gear) -> Characteristic:
    status = status_of(d.coverage)
    seen = status != "not_measurable"
    limits = g.limits.get(d.name)
    return decided(
        Characteristic(
            d.name, d.value if seen else None, d.U if seen else None, size=True, limits=limits, coverage=d.coverage,
            status=status, standard="drawing" if limits else None, budget=d.budget if seen else (),
        )
    )  # fmt: skip


def settings_of(nominal: Involute, datum: Datum, scan: Scan) -> dict[str, str]:
    """How it was evaluated, each setting as it is printed."""
    g = nominal.gear
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    alpha = degrees(float(np.arccos(nominal.base_radius / nominal.measuring_radius)))
    return {
        "datum": datum.remark,
        "measuring circle": f"{2 * nominal.measuring_radius:.3f} mm (transverse pressure angle {alpha:.3f}°)",
        "base circle": f"{2 * nominal.base_radius:.4f} mm",
        "profile control length": f"roll length {nominal.control_roll:.3f} to {nominal.tip_roll:.3f} mm",
        "profile evaluation": f"roll length {low:.3f} to {high:.3f} mm; {100 * TIP_SHARE:g} % at the tip left out",
        "helix evaluation": f"height {bottom:.2f} to {top:.2f} mm; {100 * FACE_SHARE:g} % or a module left out "
        "at either end",
        "slope deviations": "over the whole control length and face"
        if nominal.full_slopes
        else "over the evaluation ranges",
        "position": "measuring circle, middle of the face, from a quadratic over the flank's evaluation area; areal: "
        "its mean over that area",
        "traces": "means across the flank's other direction; deviations along the base tangent, transverse",
        "lateral resolution": f"{g.evaluation.resolution:g} mm of roll length, {HEIGHT_CELL:g} mm of height; "
        f"points beyond {CLIP:g} robust sigma of a cell's median have no vote; no further filter",
        "maxima": "freed of what noise alone lifts them by",
        "ball": f"{nominal.ball_diameter:.2f} mm",
        "span": f"{nominal.span_teeth} teeth",
        "F_pk": f"k = {pitch_span(g)}",
        "angle": f"{scan.angle_source}, {2 * np.pi / abs(scan.step):.0f} profiles a turn",
        "decision": f"{EDITION}, guard band {GUARD_FACTOR:g} u; U with k = 2",
    }


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
