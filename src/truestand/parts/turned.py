"""A turned part inspected: diameter, roundness, cylindricity and run-out of its sections about the datum axis.

All are read off one map r - R (heights by angles) about the datum axis, from the deviations on patches (``rings``). Of
several views each section is read by the one that shows it best: a map of two would have a step where one of them
ceases to see.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt

import numpy as np

from truestand.apply.datum import Datum, datum_of
from truestand.core.arrays import Array
from truestand.core.calibration import Contribution
from truestand.core.inspection import (
    EDITION,
    GUARD_FACTOR,
    MEASURED,
    PARTIAL,
    Characteristic,
    Inspection,
    Seam,
    Status,
    contradictions,
    decided,
    status_of,
)
from truestand.core.message import Message
from truestand.core.surface import Surface, stacked_values
from truestand.parts.drawings import Section, Turned
from truestand.parts.rings import STATISTICS, read_rings
from truestand.parts.sections import (
    CIRCLE_HEIGHT,
    MARGIN,
    REACH,
    Figures,
    Inspected,
    figures_of,
    readings_of,
    with_shape_within,
)
from truestand.parts.views import PartViews, seams_between, views_of
from truestand.uncertainty import lines as budget_lines

FORM = (
    ("roundness", "roundness_limit", "ISO 12181 RONt (LSCI)"),
    ("cylindricity", "cylindricity_limit", "ISO 12180 CYLt (LSCY)"),
    ("runout", "runout_limit", "ISO 1101 circular radial run-out"),
    ("total_runout", "total_runout_limit", "ISO 1101 total radial run-out"),
)
WITHIN, ENDS, EDGES = "shape within a cell", "ends not seen", "edges between readings"
SIZE = "ISO 14405-1 GG (least squares)"


@dataclass(frozen=True, slots=True)
class SectionEvidence:
    """What the report draws of one section; None where too little was seen."""

    name: str
    radius: float
    """mm, nominal."""
    angle: Array
    """(A,) rad about the datum axis."""
    height: Array
    """(H,) mm along the datum axis."""
    travel: Array
    """(H, A) mm: filtered r - R about the datum axis; NaN = not seen."""
    form: Array
    """(H, A) mm: filtered deviation from each height's own least-squares circle."""
    centres: Array
    """(H, 2) mm: of these circles, from the datum axis."""
    floor: float
    """mm: roundness that the noise alone would read; it is taken off."""


@dataclass(frozen=True, slots=True)
class TurnedEvidence:
    """What the report draws of a turned part."""

    sections: tuple[SectionEvidence, ...]


@dataclass(frozen=True, slots=True)
class _Section:
    """What one view says of a section."""

    lines: tuple[Characteristic, ...]
    """The diameter first."""
    evidence: SectionEvidence | None
    remarks: tuple[Message, ...]

    @property
    def rank(self) -> tuple[int, float]:
        """The higher, the better the section was seen: by the status of its lines, then by their U."""
        seen = sum(_RANKS[line.status] for line in self.lines)
        return seen, -sum(line.U or 0.0 for line in self.lines)


_RANKS: dict[Status, int] = {"measured": 2, "partial": 1, "not_measurable": 0}


def inspect_turned(surface: Surface | Sequence[Surface], part: Turned) -> Inspection:
    """Each section's diameter, roundness, cylindricity, circular and total run-out, with U (k = 2) and verdict.

    All about the datum axis. Where too little was seen there is no number; a circumference that isn't closed makes form
    and run-out partial at best. Noise's share of the ranges is taken off (``statistics.noise``). Of several views in
    one frame (``roll_views``) the one that shows a section best reads it; where two measure its diameter, they are held
    against each other.

    Raises:
        BadRecipe: a surface without its scan and calibration, or a datum that the shaft doesn't have.
    """
    views = views_of(surface)
    datum = datum_of(views.first.calibration, part.datum, part.bore_clearance)
    inspected = [Inspected(part, view, datum) for view in views.each]
    deviations = [np.full(view.surface.x.shape, np.nan) for view in views.each]
    best: list[_Section] = []
    seams: list[Seam] = []
    for section in part.sections:
        found = [_section(of, section, deviation) for of, deviation in zip(inspected, deviations, strict=True)]
        seams += _seams(section, found, views.names)
        k = max(range(len(found)), key=lambda n: found[n].rank)
        lines = tuple(replace(line, views=views.names[k : k + 1]) for line in found[k].lines)
        best.append(replace(found[k], lines=lines))
    remarks = [Message("datum", f"datum: {datum.remark}"), *_read_by(best), *(r for of in best for r in of.remarks)]
    if any(view.calibration.covariance.size == 0 for view in views.each):
        text = "the calibration carries no covariance: no U can be told, nothing is decided"
        remarks.append(Message("no_covariance", text))
    deviation = stacked_values(deviations)
    deviation.flags.writeable = False
    return Inspection(
        "turned", part.name, tuple(line for of in best for line in of.lines),
        reasons=(*views.reasons, *contradictions(tuple(seams))), remarks=tuple(remarks),
        settings=_settings(part, datum), deviation=deviation, seams=tuple(seams),
        evidence=TurnedEvidence(tuple(of.evidence for of in best if of.evidence is not None)),
    )  # fmt: skip


def _read_by(sections: Sequence[_Section]) -> tuple[Message, ...]:
    """Which of several views has read each section."""
    read = [(line.section, *line.views) for section in sections for line in section.lines[:1] if line.views]
    text = ", ".join(f"{section!r} by {view!r}" for section, view in read)
    return (Message("sections_read_by", f"sections are read by the view that shows each best: {text}"),) if read else ()


def _seams(section: Section, found: Sequence[_Section], names: Sequence[str]) -> tuple[Seam, ...]:
    """By how much the radii differ that views measured."""
    diameters = [(name, of.lines[0]) for name, of in zip(names, found, strict=False)]
    known = [(name, d.value / 2, d.U / 2) for name, d in diameters if d.status == "measured" and d.value and d.U]
    return seams_between(known, section.name)


def _settings(part: Turned, datum: Datum) -> dict[str, str]:
    return {
        "datum": f"{datum.name}: {datum.remark}",
        "filter": f"Gaussian, {part.upr} UPR (ISO 16610-21), along the circumference, for form and run-out",
        "reference": "least squares: circle at each height, cylinder of the section",
        "heights": f"{MARGIN:g} mm from a section's ends left aside; one circle for each {CIRCLE_HEIGHT:g} mm or so",
        "outliers": f"farther than {REACH:g} mm from the drawing, or beyond 6 robust standard deviations of their cell",
        "noise": "its share of ranges is taken off by extrapolation to none (SIMEX); the floor stands beside each form",
        "decision rule": f"{EDITION}, guard band {GUARD_FACTOR:g} u",
    }


def _section(inspected: Inspected, section: Section, deviation: Array) -> _Section:
    """One section's characteristics, what is drawn of it and what is to be said; the ``deviation`` (N, M) mm of its
    readings is filled in.
    """
    seen = readings_of(inspected, section)
    deviation.ravel()[seen.flat] = seen.deviation
    share = seen.share
    coarse = figures_of(inspected, section, seen)
    coverage = 0.0 if coarse is None else min(coarse.rings.coverage, share)
    if coarse is None or coverage < PARTIAL:
        missing = (_characteristic(section, how, None, None, coverage, "not_measurable") for how in _drawn(section))
        remark = (
            f"section {section.name!r}: {coverage:.0%} seen of a surface of {section.diameter:g} mm from "
            f"{section.bottom:g} to {section.top:g} mm; check the drawing, the datum and what is in view"
        )
        return _Section(tuple(missing), None, (Message("section_not_seen", remark),))
    found, within = with_shape_within(coarse, figures_of(inspected, section, seen, fine=True))
    value = found.value + found.beyond / 2  # it may go on level, or as the trend does
    whole = status_of(coverage)
    closed = whole if bool(found.rings.closed.all()) else "partial"
    U = _budgets(inspected, section, found, within)
    lines = tuple(
        _characteristic(section, how, float(value[i]), U[i], coverage, closed if i else whole)
        for i, how in enumerate(_drawn(section))
    )
    reading = found.reading
    evidence = SectionEvidence(
        section.name, found.rings.radius, found.grid.angle, found.grid.height, reading.travel, reading.form,
        reading.centres, float(found.floor[1]),
    )  # fmt: skip
    said = f"section {section.name!r}: noise {1000 * found.patches.scatter:.2g} um a reading, roundness floor "
    remarks = [Message("section_noise", f"{said}{1000 * evidence.floor:.2g} um (taken off)")]
    if share < MEASURED:
        text = (
            f"section {section.name!r}: {share:.0%} of its surface was seen, the rest may be worse: draw what is seen"
        )
        remarks.append(Message("section_in_part", text))
    elif closed == "partial":
        text = f"section {section.name!r}: the circumference is not closed at every height"
        remarks.append(Message("section_not_closed", text))
    return _Section(lines, evidence, tuple(remarks))


Drawn = tuple[str, tuple[float | None, float | None] | None, str]


def _drawn(section: Section) -> tuple[Drawn, ...]:
    """Names, limits (mm) and standards in the order of ``STATISTICS``."""
    form = tuple(
        (name, None if (limit := getattr(section, key)) is None else (None, float(limit)), standard)
        for name, key, standard in FORM
    )
    return (("d", section.diameter_limits, SIZE), *form)


def _characteristic(
    section: Section,
    how: Drawn,
    value: float | None,
    budget: tuple[tuple[Contribution, ...], float] | None,
    coverage: float,
    status: Status,
) -> Characteristic:
    name, limits, standard = how
    lines, U = budget if budget is not None else ((), None)
    return decided(
        Characteristic(
            name, value, U, section=section.name, size=name == "d", limits=limits, coverage=coverage,
            status=status, standard=standard, budget=lines,
        )
    )  # fmt: skip


def _known(inspected: Inspected, found: Figures) -> dict[str, Array] | None:
    """U (5,) mm of the statistics for the calibration and for errors of the sensor's range; None: not known."""
    rings, used, pick = found.rings, found.used, found.patches.pick.ravel()
    at = np.flatnonzero(pick >= 0)
    flat = found.readings.flat[pick[at]]
    psi = np.broadcast_to(rings.angle, used.shape).ravel()[at]
    outward = np.stack([np.cos(psi), np.sin(psi), np.zeros_like(psi)], axis=-1) @ inspected.datum.pose.rotation
    moves = PartViews((inspected.view,)).moves(flat, outward)
    if moves is None:
        return None
    still = read_rings(rings, used).statistics

    def changes(lifts: Array) -> Array:
        maps = np.zeros((len(lifts), used.size))
        maps[:, at] = lifts
        maps = maps.reshape(-1, *used.shape)
        return np.stack([read_rings(rings, used + sign * maps).statistics - still for sign in (1.0, -1.0)])

    return {name: budget_lines.spread_of(changes(lifts)) for name, lifts in moves.items()}


def _budgets(
    inspected: Inspected, section: Section, found: Figures, within: Array
) -> list[tuple[tuple[Contribution, ...], float] | None]:
    """Lines and U of each statistic; None where the calibration's own uncertainty is not known.

    ``within`` (5,) mm: by how much cells may flatten what they read.
    """
    known = _known(inspected, found)
    if known is None:
        return [None] * len(STATISTICS)
    calibration, rings, reading = inspected.view.calibration, found.rings, found.reading
    middle = (section.bottom + section.top) / 2
    offset = hypot(*reading.centres[rings.used].mean(axis=0))
    travel = 2 * (calibration.eccentricity + offset)
    axis = [replace(c, U=2 * c.U) for c in inspected.datum.lines(middle)]  # an axis aside by c shows as 2 c
    budgets: list[tuple[tuple[Contribution, ...], float] | None] = []
    for i, name in enumerate(STATISTICS):
        lines = [
            *(budget_lines.line(line, float(U[i])) for line, U in known.items()),
            budget_lines.line(budget_lines.NOISE, budget_lines.K * float(found.noise[i])),
            budget_lines.line(WITHIN, 2 / sqrt(3.0) * float(within[i]), "rectangular"),
            budget_lines.line(EDGES, 2 / sqrt(3.0) * float(found.edges[i]), "rectangular"),
            budget_lines.line(ENDS, 2 / sqrt(3.0) * float(found.beyond[i]) / 2, "rectangular"),
        ]
        if name == "d":
            lines += [
                budget_lines.temperature_line(section.diameter, inspected.part.temperature),
                budget_lines.artefact_line(calibration, 1.0),
                budget_lines.stability_line(calibration, inspected.view.scan, 2.0),
            ]  # fmt: skip
        else:
            lines += [
                budget_lines.bearing_line(calibration, 2.0),
            ]  # fmt: skip
        if name.endswith("runout"):
            lines += [*axis, budget_lines.zero_line(calibration.eccentricity, 2.0),
                      budget_lines.angle_line(inspected.view.scan, travel)]  # fmt: skip
        budgets.append(budget_lines.together(lines))
    return budgets
