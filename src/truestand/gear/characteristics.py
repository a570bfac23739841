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
from truestand.core.inspection import EDITION, GUARD_FACTOR, WORST, Characteristic, Verdict, decided, status_of
from truestand.core.scan import Scan
from truestand.gear.budget import Influence, lines_of
from truestand.gear.coverage import Coverage
from truestand.gear.damage import Damage, Zone, damage_in
from truestand.gear.drawing import Gear, Standard
from truestand.gear.evaluate import (
    AREAL,
    AREAL_NAMES,
    MEAN,
    MEANS,
    NEVER_NEGATIVE,
    PER_TOOTH,
    PITCH,
    Figures,
    mean_seen,
)
from truestand.gear.geometry import FACE_SHARE, FLANKS, TIP_SHARE, Involute, pitch_span
from truestand.gear.grid import TRACE_SHARE
from truestand.gear.sections import Sections
from truestand.gear.teeth import Diameter
from truestand.gear.traces import CUTOFF_SHARE, LEAST_CUTOFF

PROFILE_NAMES = frozenset({"F_alpha", "f_falpha", "f_Halpha", "C_alpha"})
FORMS = frozenset({"F_alpha", "f_falpha", "F_beta", "f_fbeta"})
"""What grows with every damage."""
SIZES = ("s", "W_k", "M_d")
AT_BALL = frozenset({"F_r", "M_d"})
ON_TOP = "on top of a flank, or a second reflection"
NOT_SEEN = "damage that was not seen whole"
EDGES = "edges of damage in the middle of the face"
HIDDEN = "damage like that found elsewhere, where nothing was seen"
NARROWEST = 1.0
"""mm of a profile without a reading in which damage may hide, unless the drawing says otherwise."""
RARELY = 0.05
"""Of the flanks: where damage was found on more of them, no flank is sound with 95 % where nothing was seen of it."""
UM = 1000.0
STEP = sqrt(2.0)
CLASSES: dict[Standard, tuple[int, int]] = {"ISO 1328-1:2013": (1, 11), "ISO 1328-1:1995": (0, 12)}
DIAMETERS_1995 = (5, 20, 50, 125, 280, 560, 1000, 1600, 2500, 4000, 6000, 8000, 10000)
MODULES_1995 = (0.5, 2, 3.5, 6, 10, 16, 25, 40, 70)
WIDTHS_1995 = (4, 10, 20, 40, 80, 160, 250, 400, 650, 1000)
INFORMATIVE = frozenset({"F_r", "F_pk", "f_u"})
"""Told with a class but without deciding: informative in 2013, or formulas that no public source confirms."""
LARGEST_OF_SECTIONS = 0.77
"""Of U of noise: by so much noise lifts the largest of ten sections (1.54 standard deviations) at most; it adds."""
DRAWING = "drawing"
"""Where a limit comes from that the drawing states itself: it decides whatever it limits."""


@dataclass(frozen=True, slots=True)
class Assessment:
    """Figures (mm) and by how much each input of the budget may move them (U, k = 2)."""

    nominal: Involute
    figures: Figures
    without_damage: Figures
    """The same as if no reading had fallen on damage,"""
    without_top: Figures
    """or on what lies on top of a flank."""
    expanded: dict[str, Figures]
    """U by the name of the input."""
    influences: tuple[Influence, ...]
    coverage: Coverage
    damage: tuple[Damage, ...]
    zones: dict[Zone, Mask]
    """From which cells (roll lengths, heights) figures are read."""
    there: Mask
    """(teeth,): but for those that the drawing leaves out."""
    sections: Sections
    edge_share: float
    """Half a cell's height over the height of the middle of the face."""


def characteristics_of(a: Assessment, diameters: tuple[Diameter, ...]) -> tuple[Characteristic, ...]:
    """Whole gear first, then tooth by tooth."""
    of_gear, of_teeth = _places(a)
    lines = [_line(a, name, at) for name, at in of_gear]
    lines += _of_sections(a)
    lines += [_diameter(d, a.nominal.gear) for d in diameters]
    return (*lines, *(_line(a, name, at) for name, at in of_teeth))


def _of_sections(a: Assessment) -> list[Characteristic]:
    """What other sections of the flanks say, as information: the mean over the teeth of each side, and the worst."""
    found = []
    for name in PER_TOOTH:
        for side in (0, 1):
            values = np.where(a.there, a.sections.mean[name][side], np.nan)
            found.append(_informing(_measured(a, name + MEAN, (side,)), name + AREAL, float(mean_seen(values))))
            found.append(_worst_section(a, name, side))
    return found


def _worst_section(a: Assessment, name: str, side: int) -> Characteristic:
    """The section of any tooth that departs most."""
    sizes = np.where(a.there, np.abs(np.nan_to_num(a.sections.worst[name][side])), -1.0)
    tooth = int(sizes.argmax())
    line = _measured(a, name, (side, tooth))
    line = line if line.value is None else _largest_of_sections(_with_damage(line, a, name, (side, tooth)))
    place = float(a.sections.place[name][side, tooth])
    where = f"height {place:.1f} mm" if name in PROFILE_NAMES else f"roll length {place:.1f} mm"
    worst = _informing(line, name + WORST, float(a.sections.worst[name][side, tooth]))
    return replace(worst, tooth=None, reason=f"tooth {tooth + 1} {FLANKS[side]}, {where}")


def _largest_of_sections(line: Characteristic) -> Characteristic:
    """The line with what noise lifts the largest of many sections by in its U."""
    if line.U is None:
        return line
    noise = next((c.U for c in line.budget if c.name == "noise"), 0.0)
    U = line.U + LARGEST_OF_SECTIONS * noise
    lifted = sqrt(U**2 - line.U**2)
    cause = Contribution("largest of ten sections", lifted, lifted / 2)
    return replace(line, U=U, budget=tuple(sorted((*line.budget, cause), key=lambda c: -c.U)))


def _informing(line: Characteristic, name: str, value: float) -> Characteristic:
    """A line of another section than the standard's, with the doubt of ``line``, which is of the standard's."""
    seen = bool(np.isfinite(value)) and line.U is not None
    return replace(
        line, name=name, value=value if seen else None, U=line.U if seen else None, limits=None, grade=None,
        verdict=None, standard=None, reason=None, status=line.status if seen else "not_measurable",
    )  # fmt: skip


def without_damage_of(a: Assessment) -> tuple[Characteristic, ...]:
    """The lines that damage touches once more, as if no reading had fallen on it: information, without a verdict."""
    found = []
    for name, at in (place for places in _places(a) for place in places):
        value = float(a.without_damage[name][at])
        line = _measured(a, name, at)
        if line.value is not None and any(d.depth for d in _touching(a, line.name, at)) and np.isfinite(value):
            found.append(replace(line, value=value, limits=None, grade=None, verdict=None, standard=None))
    return tuple(found)


Place = tuple[str, tuple[int, ...]]
"""Name of a figure, and where in its array it stands: (), (side,) or (side, tooth)."""


def _places(a: Assessment) -> tuple[list[Place], list[Place]]:
    """The figures of the whole gear, and those of its teeth, in the order of the report."""
    sides = [(0,), (1,)]
    pitch: list[Place] = [(n, s) for n in (*PITCH, *(name + AREAL for name in AREAL_NAMES)) for s in sides]
    means: list[Place] = [(n + MEAN, s) for n in MEANS for s in sides]
    sizes: list[Place] = [(n, ()) for n in SIZES]
    teeth: list[Place] = [(n, (*s, int(tooth))) for n in PER_TOOTH for s in sides for tooth in np.flatnonzero(a.there)]
    return [*pitch, ("F_r", ()), *means, *sizes], teeth


def _line(a: Assessment, name: str, at: tuple[int, ...]) -> Characteristic:
    line = _measured(a, name, at)
    line = decided(line) if line.standard == DRAWING or line.name not in INFORMATIVE else line
    return _with_damage(line, a, name, at) if line.value is not None else line


def _measured(a: Assessment, name: str, at: tuple[int, ...]) -> Characteristic:
    """A figure with its U and limits, damage included and not judged yet."""
    plain = name.removesuffix(MEAN)
    size = plain in SIZES
    coverage = _coverage(a, plain, at)
    status = status_of(coverage)
    narrowest = a.nominal.gear.evaluation.narrowest_damage
    if status == "measured" and narrowest is not None and _gap(a, plain, at) > narrowest:
        status = "partial"
    value = float(a.figures[name][at])
    seen = status != "not_measurable" and bool(np.isfinite(value))
    budget = lines_of(a.expanded, a.influences, name, at) if seen else ()
    limits, standard = _limits(a.nominal.gear, plain)
    return Characteristic(
        name=plain,
        value=value if seen else None,
        U=hypot(*(c.U for c in budget)) if budget else None,
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


def _with_damage(line: Characteristic, a: Assessment, name: str, at: tuple[int, ...]) -> Characteristic:
    """The line with what is not known of damage in its U, and the verdict that is left of it: of damage that it reads,
    and of such as may be where nothing was seen.
    """
    regions, hidden = _touching(a, line.name, at), _may_hide(line, a, name, at)
    if not regions:
        line = _borne_out_by_nothing(line)
        if not hidden:
            return line
    value = line.value or 0.0
    without_top = float(a.without_top[name][at]) if any(d.on_top for d in regions) else value
    half_widths = {
        ON_TOP: abs(value - (without_top if np.isfinite(without_top) else 0.0)),
        EDGES: _edges(regions, a, name) * _per_delta(name, a),
        NOT_SEEN: _unknown_depth(regions, a, name) * _per_delta(name, a),
        HIDDEN: hidden * _per_delta(name, a),
    }
    causes = [Contribution(c, 2 * half / sqrt(3.0), half / sqrt(3.0), "rectangular") for c, half in half_widths.items()]
    budget = tuple(sorted((*line.budget, *(c for c in causes if c.U)), key=lambda c: -c.U))
    reason = _gravest(regions).text if regions else _without_reading(line, a, at)
    wider = replace(
        line, grade=None if regions else line.grade, U=hypot(*(c.U for c in budget)), budget=budget, reason=reason
    )
    if line.verdict is None:
        return wider
    if regions:
        line = decided(replace(line, U=hypot(line.U or 0.0, *(c.U for c in causes if c.name == EDGES))))
    material_gone = not regions or any((d.depth or 0.0) > 0 for d in regions)
    return replace(wider, verdict=_verdict(line, wider, without_top, material_gone))


def _gravest(regions: tuple[Damage, ...]) -> Damage:
    return max(regions, key=lambda d: (d.hidden, not d.resolved, abs(d.depth or 0.0)))


def _may_hide(line: Characteristic, a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """How deep (mm of delta) damage may be where a line of flanks shows nothing: as deep as the deepest that was found.

    One of the teeth of a mean may have such damage more.
    """
    narrowest = a.nominal.gear.evaluation.narrowest_damage or NARROWEST
    gap = _gap(a, line.name, at) > narrowest and _often_damaged(a)
    if line.name not in MEANS or not (gap or line.status == "partial"):
        return 0.0
    return _deepest(a) / max(int(np.count_nonzero(a.there)), 1) if name.endswith(MEAN) else _deepest(a)


def _often_damaged(a: Assessment) -> bool:
    """Whether so many flanks are damaged that none can be taken to be as sound between its readings as where it was
    seen.
    """
    damaged = {(d.side, d.tooth) for d in a.damage if (d.depth or 0.0) > 0}
    return len(damaged) > RARELY * int(np.count_nonzero(a.coverage.position[:, a.there]))


def _deepest(a: Assessment) -> float:
    """How deep (mm) the deepest damage is that readings show, half a tooth at most."""
    return min(max((d.depth or 0.0 for d in a.damage), default=0.0), a.nominal.thickness / 2)


def _gap(a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """The widest stretch (mm of roll length) of the profiles that a figure reads without a reading; 0 of others."""
    return (
        float(a.coverage.gap[at[0], at[1] if len(at) > 1 else a.there].max(initial=0.0))
        if name in PROFILE_NAMES
        else 0.0
    )


def _without_reading(line: Characteristic, a: Assessment, at: tuple[int, ...]) -> str:
    """What of a trace no reading shows."""
    gap = _gap(a, line.name, at)
    what = f"{gap:.1f} mm of roll length" if gap else f"{1.0 - line.coverage:.0%} of the helix"
    return f"{what} without a reading, on a gear with damage of {UM * _deepest(a):.0f} um elsewhere"


def _borne_out_by_nothing(line: Characteristic) -> Characteristic:
    """The line; form that fails where no region shows why must fail at twice its noise: pairs of outliers do that."""
    if line.verdict != "does_not_conform" or line.name not in FORMS or line.U is None:
        return line
    noise = next((c.U for c in line.budget if c.name == "noise"), 0.0)
    return replace(line, verdict=decided(replace(line, U=hypot(line.U, sqrt(3.0) * noise))).verdict)


def _edges(regions: tuple[Damage, ...], a: Assessment, name: str) -> float:
    """By how much (mm) delta may be off, where a figure is the mean of the middle of the face, because edges of damage
    run there: each may lie half a cell elsewhere, and a range has two of them at either end.
    """
    if _zone(name.removesuffix(MEAN)) in ("helix", "area"):
        return 0.0
    deepest = 2 * a.edge_share * max((abs(d.depth or 0.0) for d in regions if d.ends_at_middle), default=0.0)
    return deepest / max(int(np.count_nonzero(a.there)), 1) if name.endswith(MEAN) or name in SIZES else deepest


def _unknown_depth(regions: tuple[Damage, ...], a: Assessment, name: str) -> float:
    """By how much (mm) delta may be off, where a figure reads it, because damage may be deeper than it was seen.

    As deep as half a tooth where its bottom is hidden, by as much again where few profiles cross it. Areal figures read
    the smooth flank, which damage has no part in.
    """
    if name.endswith(AREAL):
        return 0.0
    depths = [a.nominal.thickness / 2 if d.hidden else 0.0 if d.resolved else abs(d.depth or 0.0) for d in regions]
    mean = name.endswith(MEAN) or name in SIZES
    return sum(depths) / max(int(np.count_nonzero(a.there)), 1) if mean else max(depths, default=0.0)


def _per_delta(name: str, a: Assessment) -> float:
    """By how much a figure may follow delta where it is read; a slope, on half of a flank."""
    plain = name.removesuffix(MEAN)
    if plain in PITCH or plain == "s":
        return a.nominal.arc_per_delta * (2.0 if plain == "f_u" else 1.0)
    at_ball = a.nominal.runout_per_delta
    others = {
        "F_r": at_ball, "M_d": 2 * at_ball, "W_k": a.nominal.normal_per_delta,
        "f_Halpha": 1.5, "f_Hbeta": 1.5,
    }  # fmt: skip
    return others.get(plain, 1.0)


def _verdict(line: Characteristic, wider: Characteristic, without_top: float, material_gone: bool) -> Verdict | None:
    """The verdict of a line that damage makes ``wider``.

    What lies on top may be a second reflection: with it and without, the line must say the same. Forms and totals are
    no less than what was seen, where readings show that material is gone: what was not seen makes them no better.
    """
    if not np.isfinite(without_top) or decided(replace(line, value=without_top)).verdict != line.verdict:
        return "undecided"
    if line.verdict == "does_not_conform" and line.name in FORMS and material_gone:
        return line.verdict
    return decided(wider).verdict


def _touching(a: Assessment, name: str, at: tuple[int, ...]) -> tuple[Damage, ...]:
    """The damage that a figure reads."""
    side, tooth = (*at, None, None)[:2]
    return damage_in(a.damage, a.zones[_zone(name)], side, tooth)


def _zone(name: str) -> Zone:
    if name.endswith(AREAL):
        return "area"
    if name in AT_BALL:
        return "ball"
    return "profile" if name in PROFILE_NAMES else "helix" if name in MEANS else "position"


def _coverage(a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """Share of what the figure needs; of both flanks where it needs both."""
    c = a.coverage
    which = c.profile if name in PROFILE_NAMES else c.helix if name in MEANS else c.position
    if not at:
        return float(np.minimum(c.position[0], c.position[1])[a.there].mean())
    return float(which[at] if len(at) > 1 else which[at][a.there].mean())


def _limits(g: Gear, name: str) -> tuple[tuple[float | None, float | None] | None, str | None]:
    if name in g.limits:
        return g.limits[name], DRAWING
    accuracy_class = g.class_of(name)
    if accuracy_class is None or name in ("F_pk", "f_u") or not has_tolerance(name):
        return None, None
    limit = tolerance(name, g, accuracy_class)
    standard = f"{g.standard} class {accuracy_class}" + (" (informative)" if name in INFORMATIVE else "")
    return ((None, limit) if name in NEVER_NEGATIVE else (-limit, limit)), standard


def _grade(g: Gear, name: str, value: float) -> int | None:
    return reached(name, value, g) if g.class_of(name) is not None and has_tolerance(name) else None


def _diameter(d: Diameter, g: Gear) -> Characteristic:
    status = status_of(d.coverage)
    seen = status != "not_measurable"
    limits = g.limits.get(d.name)
    return decided(
        Characteristic(
            d.name, d.value if seen else None, d.U if seen else None, size=True, limits=limits, coverage=d.coverage,
            status=status, standard=DRAWING if limits else None, budget=d.budget if seen else (),
        )
    )  # fmt: skip


def settings_of(nominal: Involute, datum: Datum, scan: Scan, cell_height: float) -> dict[str, str]:
    """How it was evaluated, each setting as it is printed; ``cell_height``: mm, of a cell."""
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
        "position": f"measuring circle, middle of the face +- {TRACE_SHARE:.0%} of its width, from a parabola through "
        "the profiles beside it, or between the nearest two where the flank bends; areal: mean of a quadratic over the "
        "flank's evaluation area",
        "traces": f"profile at the middle of the face +- {TRACE_SHARE:.0%}, helix on the measuring circle; deviations "
        "along the base tangent, transverse, damage included",
        "lateral resolution": f"{g.evaluation.resolution:g} mm of roll length, {cell_height:.2g} mm of height; single "
        "readings that nothing bears out are left out",
        "low-pass": f"Gaussian, 50 % at a wavelength of 1/{1 / CUTOFF_SHARE:.0f} of the evaluation length or the face, "
        f"{LEAST_CUTOFF:g} mm at least, for form and total deviations",
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
