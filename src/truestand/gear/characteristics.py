"""The lines of the report: each figure with U, limit, class, coverage and verdict; and how it was all evaluated."""

from dataclasses import dataclass, replace
from math import degrees, hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from truestand.apply.datum import Datum
from truestand.core.calibration import Contribution
from truestand.core.inspection import EDITION, GUARD_FACTOR, Characteristic, Flank, decided, status_of
from truestand.core.scan import Scan
from truestand.gear.budget import Influence, lines_of
from truestand.gear.coverage import Coverage
from truestand.gear.damage import Bools, Damage, Zone, reading
from truestand.gear.figures import AREAL, AREAL_NAMES, MEAN, MEANS, NEVER_NEGATIVE, PER_TOOTH, PITCH, Figures
from truestand.gear.fold import Ends
from truestand.gear.geometry import FACE_SHARE, TIP_SHARE, Involute, pitch_span
from truestand.gear.grid import CLIP, HEIGHT_CELL
from truestand.gear.tolerances import INFORMATIVE, has_tolerance, reached, tolerance

Array = NDArray[np.float64]

PROFILE_NAMES = frozenset({"F_alpha", "f_falpha", "f_Halpha", "C_alpha"})
SIZES = ("s", "W_k", "M_d")
LEFT_OUT = "damage left out"


@dataclass(frozen=True, slots=True)
class Told:
    """Figures (mm) and by how much each input of the budget may move them (U, k = 2)."""

    figures: Figures
    expanded: dict[str, Figures]
    influences: tuple[Influence, ...]
    coverage: Coverage
    damage: tuple[Damage, ...]
    """What the figures leave out, and from which cells (roll lengths, heights) they are read."""
    zones: dict[Zone, Bools]
    runout_per_delta: float


def characteristics_of(told: Told, nominal: Involute, ends: tuple[Ends, ...]) -> tuple[Characteristic, ...]:
    """Whole gear first, then tooth by tooth."""
    names = (*PITCH, *(name + AREAL for name in AREAL_NAMES))
    lines = [_line(told, nominal, n, (side,)) for n in names for side in (0, 1)]
    lines.append(_line(told, nominal, "F_r", ()))
    lines += [_line(told, nominal, n + MEAN, (side,)) for n in MEANS for side in (0, 1)]
    lines += [_line(told, nominal, n, ()) for n in SIZES]
    lines += [_end(e, nominal) for e in ends]
    teeth = range(nominal.gear.teeth)
    lines += [_line(told, nominal, n, (side, tooth)) for n in PER_TOOTH for side in (0, 1) for tooth in teeth]
    return tuple(lines)


def _line(told: Told, nominal: Involute, name: str, at: tuple[int, ...]) -> Characteristic:
    plain = name.removesuffix(MEAN)
    size = plain in SIZES
    coverage = _coverage(told.coverage, plain, at)
    status = status_of(coverage)
    value = float(told.figures[name][at])
    seen = status != "not_measurable" and bool(np.isfinite(value))
    budget = lines_of(told.expanded, told.influences, name, at) if seen else ()
    limits, standard = _limits(nominal, plain)
    flank: Flank | None = ("left", "right")[at[0]] if at else None
    line = Characteristic(
        name=plain,
        value=value if seen else None,
        U=hypot(*(c.U for c in budget)) if seen else None,
        flank=flank,
        tooth=at[1] + 1 if len(at) > 1 else None,
        size=size,
        limits=limits,
        grade=_grade(nominal, plain, value) if seen else None,
        coverage=coverage,
        status=status if seen else "not_measurable",
        standard=standard,
        budget=budget,
    )
    line = line if plain in INFORMATIVE else decided(line)
    return _damaged(line, told, nominal, at) if seen else line


def _damaged(line: Characteristic, told: Told, nominal: Involute, at: tuple[int, ...]) -> Characteristic:
    """The line with what was left out of it in its U; undecided where that has no known depth."""
    side, tooth = (*at, None, None)[:2]
    regions = reading(told.damage, told.zones[_zone(line.name)], side, tooth)
    if not regions:
        return line
    gravest = max(regions, key=lambda d: (not d.resolved, abs(d.depth or 1e9)))
    depths = [abs(d.depth or 0.0) for d in regions]
    most = sum(depths) / nominal.gear.teeth if line.size else max(depths)
    u = most * _per_delta(line.name, told, nominal) / sqrt(3.0)  # anywhere between none of it and all
    budget = sorted((*line.budget, Contribution(LEFT_OUT, 2 * u, u, "rectangular")), key=lambda c: -c.U)
    doubted = replace(line, U=hypot(line.U or 0.0, 2 * u), grade=None, budget=tuple(budget), reason=gravest.text)
    if line.verdict is None:
        return doubted
    if not gravest.resolved:
        return replace(doubted, verdict="undecided")
    return replace(decided(doubted), capable=line.capable)  # U of a sound part is what the stand can do


def _zone(name: str) -> Zone:
    if name.endswith(AREAL):
        return "area"
    return "profile" if name in PROFILE_NAMES else "helix" if name in MEANS else "position"


def _per_delta(name: str, told: Told, nominal: Involute) -> float:
    """By how much a figure may follow one flank's delta."""
    if name in PITCH or name == "s" or name.endswith(AREAL):
        return nominal.arc_per_delta * (2.0 if name == "f_u" else 1.0)
    others = {"F_r": told.runout_per_delta, "M_d": 2 * told.runout_per_delta, "W_k": nominal.normal_per_delta}
    return others.get(name, 1.0)


def _coverage(c: Coverage, name: str, at: tuple[int, ...]) -> float:
    """Share of what the figure needs; of both flanks where it needs both."""
    which = c.profile if name in PROFILE_NAMES else c.helix if name in MEANS else c.position
    if not at:
        return float(np.minimum(c.position[0], c.position[1]).mean())
    return float(which[at].mean())


def _limits(nominal: Involute, name: str) -> tuple[tuple[float | None, float | None] | None, str | None]:
    g = nominal.gear
    if name in g.limits:
        return g.limits[name], "drawing"
    if g.accuracy_class is None or name in ("F_pk", "f_u") or not has_tolerance(name):
        return None, None
    limit = tolerance(name, g, g.accuracy_class)
    standard = f"{g.standard} class {g.accuracy_class}" + (" (informative)" if name in INFORMATIVE else "")
    return ((None, limit) if name in NEVER_NEGATIVE else (-limit, limit)), standard


def _grade(nominal: Involute, name: str, value: float) -> int | None:
    if nominal.gear.accuracy_class is None or not has_tolerance(name):
        return None
    return reached(name, value, nominal.gear)


def _end(e: Ends, nominal: Involute) -> Characteristic:
    """A tip or root diameter."""
    status = status_of(e.coverage)
    seen = status != "not_measurable"
    limits = nominal.gear.limits.get(e.name)
    return decided(
        Characteristic(
            e.name, e.diameter if seen else None, e.U if seen else None, size=True, limits=limits, coverage=e.coverage,
            status=status, standard="drawing" if limits else None, budget=e.budget if seen else (),
        )
    )  # fmt: skip


def settings_of(nominal: Involute, datum: Datum, scan: Scan) -> dict[str, str]:
    """How it was evaluated, each setting as it is printed."""
    g = nominal.gear
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    full = (g.evaluation.slope_ends or ("full" if g.standard.endswith("2013") else "evaluation")) == "full"
    alpha = degrees(float(np.arccos(nominal.base_radius / nominal.measuring_radius)))
    return {
        "datum": datum.remark,
        "measuring circle": f"{2 * nominal.measuring_radius:.3f} mm (transverse pressure angle {alpha:.3f}°)",
        "base circle": f"{2 * nominal.base_radius:.4f} mm",
        "profile control length": f"roll length {nominal.control_roll:.3f} to {nominal.tip_roll:.3f} mm",
        "profile evaluation": f"roll length {low:.3f} to {high:.3f} mm; {100 * TIP_SHARE:g} % at the tip left out",
        "helix evaluation": f"height {bottom:.2f} to {top:.2f} mm; {100 * FACE_SHARE:g} % or a module left out "
        "at either end",
        "slope deviations": "over the whole control length and face" if full else "over the evaluation ranges",
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
