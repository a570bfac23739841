"""The lines of the report: each figure with U, limit, class, coverage and verdict; and how it was all evaluated."""

from collections.abc import Sequence
from dataclasses import replace
from math import degrees, hypot, sqrt

import numpy as np

from truestand.apply.datum import Datum
from truestand.core.calibration import Contribution
from truestand.core.inspection import EDITION, GUARD_FACTOR, WORST, Characteristic, decided, status_of
from truestand.core.scan import Scan
from truestand.gear.assess import Assessment
from truestand.gear.budget import lines_of
from truestand.gear.doubt import SIZES, noise_of, touching, with_damage
from truestand.gear.drawing import Gear
from truestand.gear.evaluate import (
    AREAL,
    AREAL_NAMES,
    MEAN,
    MEANS,
    NEVER_NEGATIVE,
    PER_TOOTH,
    PITCH,
    PROFILE_NAMES,
    mean_seen,
)
from truestand.gear.gaps import gap_of
from truestand.gear.geometry import FACE_SHARE, FLANKS, TIP_SHARE, Involute, pitch_span
from truestand.gear.grid import TRACE_SHARE
from truestand.gear.sections import Sections
from truestand.gear.teeth import Diameter
from truestand.gear.tolerances import has_tolerance, reached, tolerance
from truestand.gear.trace_line import CUTOFF_SHARE, LEAST_CUTOFF

INFORMATIVE = frozenset({"F_r", "F_pk", "f_u"})
"""Told with a class but without deciding: informative in 2013, or formulas that no public source confirms."""
LARGEST_OF_SECTIONS = 0.77
"""Of U of noise: by so much noise lifts the largest of ten sections (1.54 standard deviations) at most; it adds."""
DRAWING = "drawing"
"""Where a limit comes from that the drawing states itself: it decides whatever it limits."""


def characteristics_of(a: Assessment, diameters: tuple[Diameter, ...]) -> tuple[Characteristic, ...]:
    """Whole gear first, then tooth by tooth."""
    of_gear, of_teeth = _places(a)
    lines = [_line(a, name, at) for name, at in of_gear]
    lines += [] if a.sections is None else _of_sections(a, a.sections)
    lines += [_diameter(d, a.nominal.gear) for d in diameters]
    return (*lines, *(_line(a, name, at) for name, at in of_teeth))


def _of_sections(a: Assessment, sections: Sections) -> list[Characteristic]:
    """What other sections of the flanks say, as information: the mean over the teeth of each side, and the worst."""
    found = []
    for name in PER_TOOTH:
        for side in (0, 1):
            values = np.where(a.there, sections.mean[name][side], np.nan)
            found.append(_informing(_measured(a, name + MEAN, (side,)), name + AREAL, float(mean_seen(values))))
            found.append(_worst_section(a, sections, name, side))
    return found


def _worst_section(a: Assessment, sections: Sections, name: str, side: int) -> Characteristic:
    """The section of any tooth that departs most."""
    sizes = np.where(a.there, np.abs(np.nan_to_num(sections.worst[name][side])), -1.0)
    tooth = int(sizes.argmax())
    line = _measured(a, name, (side, tooth))
    line = line if line.value is None else _largest_of_sections(with_damage(line, a, name, (side, tooth)))
    place = float(sections.place[name][side, tooth])
    where = f"height {place:.1f} mm" if name in PROFILE_NAMES else f"roll length {place:.1f} mm"
    worst = _informing(line, name + WORST, float(sections.worst[name][side, tooth]))
    return replace(worst, tooth=None, reason=f"tooth {tooth + 1} {FLANKS[side]}, {where}")


def _largest_of_sections(line: Characteristic) -> Characteristic:
    """The line with what noise lifts the largest of many sections by in its U."""
    if line.U is None:
        return line
    U = line.U + LARGEST_OF_SECTIONS * noise_of(line)
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
        if line.value is not None and any(d.depth for d in touching(a, line.name, at)) and np.isfinite(value):
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
    return with_damage(line, a, name, at) if line.value is not None else line


def _measured(a: Assessment, name: str, at: tuple[int, ...]) -> Characteristic:
    """A figure with its U and limits, damage included and not judged yet."""
    plain = name.removesuffix(MEAN)
    size = plain in SIZES
    coverage = _coverage(a, plain, at)
    status = status_of(coverage)
    if status == "measured" and plain in MEANS and not _seen_whole(a, plain, at):
        status = "partial"
    value = float(a.figures[name][at])
    seen = status != "not_measurable" and bool(np.isfinite(value))
    budget = lines_of(a.expanded, a.influences, name, at) if seen else ()
    limits, standard = limits_of(a.nominal.gear, plain)
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


def _seen_whole(a: Assessment, name: str, at: tuple[int, ...]) -> bool:
    """Whether the traces that a figure reads were seen to their ends, without a gap in which damage may hide; those of
    a mean, on every tooth.
    """
    narrowest = a.nominal.gear.evaluation.narrowest_damage
    if narrowest is not None and gap_of(a, name, at) > narrowest:
        return False
    if name in PROFILE_NAMES:
        return not a.coverage.hidden[at[0]]
    of_teeth = (slice(None), at[0], at[1] if len(at) > 1 else a.there)
    seen = a.coverage.helix_blind[of_teeth[1:]] < a.cell_height
    return bool(seen.all() and (a.coverage.helix_ends[of_teeth] < a.cell_height).all())


def _coverage(a: Assessment, name: str, at: tuple[int, ...]) -> float:
    """Share of what the figure needs; of both flanks where it needs both."""
    c = a.coverage
    which = c.profile if name in PROFILE_NAMES else c.helix if name in MEANS else c.position
    if not at and not c.sides_tied:
        return 0.0
    if not at:
        return float(np.minimum(c.position[0], c.position[1])[a.there].mean())
    return float(which[at] if len(at) > 1 else which[at][a.there].mean())


def limits_of(g: Gear, name: str) -> tuple[tuple[float | None, float | None] | None, str | None]:
    """Lower and upper limit (mm) of a figure, and where they are from.

    Raises:
        BadRecipe: a gear or class outside the standard's range.
    """
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


def _angle_setting(scan: Scan) -> str:
    return f"{scan.angle_source}, {2 * np.pi / abs(scan.step):.0f} profiles a turn"


def settings_of(nominal: Involute, datum: Datum, scans: Sequence[Scan], cell_height: float) -> dict[str, str]:
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
        "angle": "; ".join(dict.fromkeys(map(_angle_setting, scans))),
        "decision": f"{EDITION}, guard band {GUARD_FACTOR:g} u; U with k = 2; forms and totals that exceed their limit "
        "by damage that was seen do not conform, however deep the rest of it may be",
    }
