"""A turned part inspected: diameter, roundness, cylindricity and run-out of its sections about the datum axis.

All are read off one map r - R (heights by angles) about the datum axis, from the deviations on patches (``rings``). Of
several views each section is read by the one that shows it best: a map of two would have a step where one of them
ceases to see.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, sqrt, tau

import numpy as np

from truestand.apply.datum import Datum, datum_of
from truestand.core.arrays import Array, Ints, Mask
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
from truestand.parts.patches import TRUSTED, Grid, Patches, Readings, patches_of
from truestand.parts.rings import (
    LEVEL,
    STATISTICS,
    Reading,
    Rings,
    Trend,
    read_edges,
    read_rings,
    read_steps,
    read_trend,
    trend_of,
)
from truestand.parts.views import PartView, PartViews, seams_between, views_of
from truestand.statistics.lone_readings import lone_readings
from truestand.statistics.noise import cleared, from_noise
from truestand.uncertainty import lines as budget_lines

REACH = 1.0
"""mm: a surface farther than this from its drawing is another one's, or an outlier."""
MARGIN = 0.3
"""mm from a section's ends: chamfers, fillets, burrs."""
CELLS_PER_WAVE, FINE_CELLS_PER_WAVE = 20, 6
"""At the filter's cut-off: their width takes 0.4 % of its amplitude, or 5 % where they are low instead."""
LEAST_ANGLES = 36
CIRCLE_HEIGHT = 1.0
"""mm of height that one circle is read from."""
READINGS_PER_CELL, READINGS_PER_FINE_CELL = 12, 4
"""On average, where there are so many."""
PLAINLY = 3.0
"""Standard deviations by which lower cells must read more to count."""
FINE_HEIGHT, SPACINGS, FINE_SPACINGS = 0.25, 2.0, 1.5
"""mm of height, and points of a profile at least, by which it is told what was seen; and points by which it is told
what higher cells flatten."""
END_BIN, END_FILLED = 0.25, 0.3
"""mm of height, and share of the usual number of its readings, from which the part reaches there."""
END_FACE, END_FACE_SHARE, MORE_AT_END = 0.05, 0.05, 2.0
"""mm off the section's median; share of the readings next to an end that are so, and how many times that of the others,
from which some are of its end face."""
END_SHARE = 1e-3
"""Of a section's readings: those beyond its ends as seen may be strays."""
TREND_PASSES = 2
"""The second from readings that the first has brought to the middle of their cells."""
BLOCK = 256
"""Profiles worked on at once."""
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
class _Inspected:
    """The part and the view that it is inspected by."""

    part: Turned
    view: PartView
    datum: Datum

    @property
    def a_turn(self) -> float:
        """Profiles of one turn."""
        return self.view.scan.profiles / max(self.view.scan.revolutions, 1.0)


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
    inspected = [_Inspected(part, view, datum) for view in views.each]
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


@dataclass(frozen=True, slots=True)
class _Seen:
    """Readings (n,) of a section: where they stand in the scan, r - R (mm), polar angle (rad) and height (mm) about the
    datum axis; and the heights (mm) between which the section is read.
    """

    flat: Ints
    deviation: Array
    angle: Array
    height: Array
    lone: Mask
    """Those that nothing bears out."""
    low: float
    high: float
    trend: Trend

    def readings(self, grid: Grid) -> Readings:
        """The readings in the cells of a grid, brought to the middle of their cells' heights along the trend."""
        cell, trend = grid.cells(self.angle, self.height), self.trend
        middle = grid.height[cell // grid.angles]
        level = self.deviation - trend.at(self.angle, self.height) + trend.at(self.angle, middle)
        return Readings(self.flat, level, cell, self.lone)

    @property
    def spacing(self) -> float:
        """mm of height from one point of a profile to the next."""
        return float(np.median(np.abs(np.diff(self.height)))) if self.height.size > 1 else self.high - self.low

    @property
    def grid(self) -> Grid:
        """Cells by which it is told what was seen, whatever the height of those that form is read from."""
        heights = max(int((self.high - self.low) / max(FINE_HEIGHT, SPACINGS * self.spacing)), 1)
        return Grid(self.low, self.high, heights, LEAST_ANGLES)

    @property
    def share(self) -> float:
        """Of the section's surface that the readings show."""
        cells = self.grid.cells(self.angle, self.height)
        return float((np.bincount(cells, minlength=int(np.prod(self.grid.shape))) > 0).mean())

    @property
    def ends(self) -> tuple[float, float]:
        """mm of height from which and to which there are readings, but for a few."""
        low, high = np.quantile(self.height, (END_SHARE, 1 - END_SHARE))
        return float(low), float(high)


@dataclass(frozen=True, slots=True)
class _Figures:
    """A section's statistics, read from cells of one height."""

    grid: Grid
    readings: Readings
    patches: Patches
    rings: Rings
    used: Array
    """(H, A) mm: the map that they are read from."""
    reading: Reading
    value: Array
    """(5,) mm, without the noise's share of ranges, as far as the section was seen."""
    more: Array
    """(5,) mm of it, which the trend says of what lies between the cells' middles and beyond them."""
    beyond: Array
    """(5,) mm: how much more it were if the trend went on where the ends were not seen."""
    edges: Array
    """(5,) mm: by how much the statistics change with where steep edges run."""
    noise: Array
    """(5,) mm: their standard deviation."""
    floor: Array
    """(5,) mm: what the noise alone would read."""


def _seen(inspected: _Inspected, section: Section) -> _Seen:
    """The section's readings within the drawing's reach."""
    surface, view = inspected.view.surface, inspected.view
    margin = min(MARGIN, 0.15 * (section.top - section.bottom))
    low, high = section.bottom + margin, section.top - margin
    pose, width = inspected.datum.pose, surface.x.shape[1]
    flats, places = [], []
    for first in range(0, view.scan.profiles, BLOCK):
        rows = slice(first, first + BLOCK)
        z = surface.z[rows]
        near = np.flatnonzero((z > low - REACH) & (z < high + REACH))  # NaN compares false
        points = pose(np.stack([a[rows].ravel()[near] for a in (surface.x, surface.y, surface.z)], axis=-1))
        off = np.hypot(points[:, 0], points[:, 1]) - section.diameter / 2
        on = np.flatnonzero((np.abs(off) < REACH) & (points[:, 2] > low) & (points[:, 2] < high))
        flats.append(near[on] + first * width)
        places.append(points[on])
    (x, y, z), flat = np.concatenate(places).T, np.concatenate(flats)
    off = np.hypot(x, y) - section.diameter / 2
    clear = _clear_of_end_faces(z, off, low, high)
    x, y, z, flat, off = x[clear], y[clear], z[clear], flat[clear], off[clear]
    lone = lone_readings(off, np.zeros(off.size, dtype=np.int64), flat, width, view.angle)
    seen = _Seen(flat, off, np.arctan2(y, x), z, lone, low, high, LEVEL)
    for _ in range(TREND_PASSES):
        mean = patches_of(seen.grid, seen.readings(seen.grid), REACH).mean
        seen = replace(seen, trend=trend_of(low, high, seen.grid.angle, seen.grid.height, mean))
    return seen


def _clear_of_end_faces(height: Array, off: Array, low: float, high: float) -> Mask:
    """Which of the readings (n,) at heights and ``off`` the drawing, mm, lie clear of the part's ends, where it ends
    before the section does: its end faces are no part of it. Where the sensor's view ends, there are none.
    """
    counts, edges = np.histogram(height, max(round((high - low) / END_BIN), 1), (low, high))
    on = np.ones(height.size, dtype=bool)
    if not counts.any():
        return on
    filled = np.flatnonzero(counts > END_FILLED * np.median(counts[counts > 0]))
    far = np.abs(off - np.median(off)) > END_FACE
    for end, inwards, ends_inside in (
        (edges[filled[0]], 1.0, filled[0] > 0),
        (edges[filled[-1] + 1], -1.0, filled[-1] < counts.size - 1),
    ):
        beyond = inwards * (height - end) < MARGIN
        if beyond.all():
            continue
        if ends_inside and far[beyond].mean() > END_FACE_SHARE + MORE_AT_END * far[~beyond].mean():
            on &= ~beyond
    return on


def _grid(inspected: _Inspected, seen: _Seen, height: float, per_wave: int, readings_per_cell: int) -> Grid:
    """Cells as narrow as the filter needs, and as high as ``height`` mm, or higher where readings are few."""
    angles = int(np.clip(min(per_wave * inspected.part.upr, inspected.a_turn / 2), LEAST_ANGLES, None))
    filled = seen.height.size / (readings_per_cell * angles)
    heights = int(np.clip(min((seen.high - seen.low) / height, filled), 1, None))
    return Grid(seen.low, seen.high, heights, angles)


def _figures(inspected: _Inspected, section: Section, grid: Grid, seen: _Seen) -> _Figures | None:
    """A section's statistics from the cells of a grid; None where no height holds a circle."""
    readings = seen.readings(grid)
    patches = patches_of(grid, readings, REACH)
    rings = Rings(section.diameter / 2, grid.angle, grid.height, patches.seen, float(inspected.part.upr))
    if not rings.used.any():
        return None
    used = np.where(patches.seen & rings.used[:, None], patches.mean, np.nan)
    reading = read_rings(rings, used)

    def read(maps: Array) -> Array:
        return read_rings(rings, maps).statistics

    clear = cleared(read, used, patches.noise)
    more, whole = (read_trend(rings, used, seen.trend, *between) for between in (seen.ends, (seen.low, seen.high)))
    value = np.append(reading.statistics[0], clear.value[1:]) + more  # a mean has no bias
    noise = clear.u * _rougher(patches, rings, used)
    floor = from_noise(read, used, patches.noise)
    edges = _read_edges(grid, readings, patches, rings, used, tau / inspected.a_turn)
    return _Figures(grid, readings, patches, rings, used, reading, value, more, whole - more, edges, noise, floor)


def _read_edges(grid: Grid, readings: Readings, patches: Patches, rings: Rings, used: Array, step: float) -> Array:
    """By how much (5,) mm the statistics of the map ``used`` change with where steep edges run.

    Nobody knows it between two profiles, ``step`` rad apart, and readings that were not trusted may be what lies beyond
    an edge; nor on which side of a step that runs all round the readings of its heights lie.
    """
    total = np.bincount(readings.cell, minlength=patches.count.size).reshape(patches.count.shape)
    untrusted = 1.0 - patches.count / np.maximum(total, 1)
    steep = TRUSTED * sqrt(2.0) * float(np.median(patches.noise[patches.seen]))
    across = read_edges(rings, used, step / 2 * grid.angles / tau + untrusted, steep)
    return np.hypot(across, read_steps(rings, used, steep))


def _with_shape_within(coarse: _Figures, fine: _Figures | None) -> tuple[_Figures, Array]:
    """The figures, and by how much (5,) mm cells may flatten what they read.

    Where lower cells, seen all round, read plainly more than their noise explains, they count. What they flatten in
    turn is a sixth of the second difference along the height, as of a parabola whose peak lies between two cells, and
    half of it where it is as large as the figure: of a dent no longer than two cells are high. What the trend adds is
    doubted by a sixth, too, and by half where no lower cells bear it out.
    """
    if fine is None or fine.grid.heights == coarse.grid.heights or not fine.rings.closed.all():
        return coarse, np.abs(coarse.more) / 2
    known = np.hypot(coarse.value, fine.floor) + np.hypot(coarse.edges, fine.edges)
    more = np.maximum(fine.reading.statistics + fine.more - known, 0.0)
    more[0] = 0.0  # a mean has no extremes
    plain = more > np.maximum(PLAINLY * np.hypot(fine.noise, coarse.noise), fine.floor)
    bend = float(np.nanmax(np.abs(np.diff(fine.reading.form, 2, axis=0)), initial=0.0))
    left = bend * (1 / 6 + np.minimum(bend / np.maximum(fine.value, 1e-9), 1.0) / 3)
    pairs = {key: (getattr(fine, key), getattr(coarse, key)) for key in ("value", "more", "beyond", "edges", "noise")}
    drawn = fine if plain.any() else coarse  # the report shows what was read
    read = replace(drawn, **{key: np.where(plain, *pair) for key, pair in pairs.items()})
    return read, np.where(plain, left, more) + np.abs(read.more) / 6


def _section(inspected: _Inspected, section: Section, deviation: Array) -> _Section:
    """One section's characteristics, what is drawn of it and what is to be said; the ``deviation`` (N, M) mm of its
    readings is filled in.
    """
    seen = _seen(inspected, section)
    deviation.ravel()[seen.flat] = seen.deviation
    share = seen.share
    high_cells = _grid(inspected, seen, CIRCLE_HEIGHT, CELLS_PER_WAVE, READINGS_PER_CELL)
    coarse = _figures(inspected, section, high_cells, seen)
    coverage = 0.0 if coarse is None else min(coarse.rings.coverage, share)
    if coarse is None or coverage < PARTIAL:
        missing = (_characteristic(section, how, None, None, coverage, "not_measurable") for how in _drawn(section))
        remark = (
            f"section {section.name!r}: {coverage:.0%} seen of a surface of {section.diameter:g} mm from "
            f"{section.bottom:g} to {section.top:g} mm; check the drawing, the datum and what is in view"
        )
        return _Section(tuple(missing), None, (Message("section_not_seen", remark),))
    lowest = max(FINE_HEIGHT, FINE_SPACINGS * seen.spacing)
    low_cells = _grid(inspected, seen, lowest, FINE_CELLS_PER_WAVE, READINGS_PER_FINE_CELL)
    found, within = _with_shape_within(coarse, _figures(inspected, section, low_cells, seen))
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


def _rougher(patches: Patches, rings: Rings, used: Array) -> float:
    """By how much neighbouring cells differ more than their readings' own noise explains: speckle, drift, fine form."""
    usual = float(np.sqrt(np.nanmean(np.square(patches.noise[patches.seen]))))
    step = np.diff(np.where(rings.used[:, None], used, np.nan), axis=1)
    return max(1.0, float(np.sqrt(np.nanmedian(np.square(step)) / 0.4549 / 2)) / max(usual, 1e-12))


def _moved(inspected: _Inspected, found: _Figures) -> Array | None:
    """How the statistics change (2, k, 5) with each independent part of the calibration's U; None: not known."""
    rings, used, pick = found.rings, found.used, found.patches.pick.ravel()
    at = np.flatnonzero(pick >= 0)
    flat = found.readings.flat[pick[at]]
    psi = np.broadcast_to(rings.angle, used.shape).ravel()[at]
    outward = np.stack([np.cos(psi), np.sin(psi), np.zeros_like(psi)], axis=-1) @ inspected.datum.pose.rotation
    lifts = PartViews((inspected.view,)).moves(flat, outward)
    if lifts is None:
        return None
    maps = np.zeros((len(lifts), used.size))
    maps[:, at] = lifts
    maps = maps.reshape(-1, *used.shape)
    still = read_rings(rings, used).statistics
    return np.stack([read_rings(rings, used + sign * maps).statistics - still for sign in (1.0, -1.0)])


def _budgets(
    inspected: _Inspected, section: Section, found: _Figures, within: Array
) -> list[tuple[tuple[Contribution, ...], float] | None]:
    """Lines and U of each statistic; None where the calibration's own uncertainty is not known.

    ``within`` (5,) mm: by how much cells may flatten what they read.
    """
    moved = _moved(inspected, found)
    if moved is None:
        return [None] * len(STATISTICS)
    calibration, rings, reading = inspected.view.calibration, found.rings, found.reading
    U = budget_lines.spread_of(moved)
    apart = budget_lines.range_apart(calibration, rings.radius, float(rings.height[rings.used].mean()))
    middle = (section.bottom + section.top) / 2
    offset = hypot(*reading.centres[rings.used].mean(axis=0))
    travel = 2 * (calibration.eccentricity + offset)
    axis = [replace(c, U=2 * c.U) for c in inspected.datum.lines(middle)]  # an axis aside by c shows as 2 c
    budgets: list[tuple[tuple[Contribution, ...], float] | None] = []
    for i, name in enumerate(STATISTICS):
        lines = [
            budget_lines.line(budget_lines.CALIBRATION, float(U[i])),
            budget_lines.line(budget_lines.NOISE, budget_lines.K * float(found.noise[i])),
            budget_lines.line(WITHIN, 2 / sqrt(3.0) * float(within[i]), "rectangular"),
            budget_lines.line(EDGES, 2 / sqrt(3.0) * float(found.edges[i]), "rectangular"),
            budget_lines.line(ENDS, 2 / sqrt(3.0) * float(found.beyond[i]) / 2, "rectangular"),
        ]
        if name == "d":
            lines += [
                budget_lines.linearity_line(calibration, apart, 2.0), budget_lines.scale_line(calibration, 2 * apart),
                budget_lines.temperature_line(section.diameter, inspected.part.temperature),
                budget_lines.artefact_line(calibration, 1.0),
                budget_lines.stability_line(calibration, inspected.view.scan, 2.0),
            ]  # fmt: skip
        else:
            lines += [
                budget_lines.linearity_line(calibration, travel), budget_lines.bearing_line(calibration, 2.0),
                budget_lines.scale_line(calibration, float(reading.statistics[i])),
            ]  # fmt: skip
        if name.endswith("runout"):
            lines += [*axis, budget_lines.zero_line(calibration.eccentricity, 2.0),
                      budget_lines.angle_line(inspected.view.scan, travel)]  # fmt: skip
        budgets.append(budget_lines.together(lines))
    return budgets
