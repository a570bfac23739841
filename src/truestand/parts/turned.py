"""A turned part inspected: diameter, roundness, cylindricity and run-out of its sections about the datum axis."""

from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from truestand.apply.datum import Datum, datum_of
from truestand.core.arrays import Array, Ints
from truestand.core.calibration import Calibration, Contribution
from truestand.core.inspection import (
    EDITION,
    GUARD_FACTOR,
    PARTIAL,
    Characteristic,
    Inspection,
    Status,
    decided,
    status_of,
)
from truestand.core.scan import Scan
from truestand.core.surface import Surface, table_angle
from truestand.parts.drawings import Section, Turned
from truestand.parts.patches import Grid, Patches, patches_of
from truestand.parts.roundness import STATISTICS, Reading, Rings, read_rings
from truestand.statistics.noise import cleared, from_noise
from truestand.uncertainty import lines as budget_lines
from truestand.uncertainty.influence import moves

REACH = 1.0
"""mm: a surface farther than this from its drawing is another one's, or an outlier."""
MARGIN = 0.3
"""mm from a section's ends: chamfers, fillets, burrs."""
CELLS_PER_WAVE = 20
"""At the filter's cut-off: their width takes 0.4 % of its amplitude."""
LEAST_ANGLES = 36
CIRCLE_HEIGHT = 1.0
"""mm of height that one circle is read from."""
READINGS_PER_CELL = 12
"""On average, where there are so many."""
BLOCK = 256
"""Profiles worked on at once."""
FORM = (
    ("roundness", "roundness_limit", "ISO 12181 RONt (LSCI)"),
    ("cylindricity", "cylindricity_limit", "ISO 12180 CYLt (LSCY)"),
    ("runout", "runout_limit", "ISO 1101 circular radial run-out"),
    ("total_runout", "total_runout_limit", "ISO 1101 total radial run-out"),
)
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
    noise: float
    """mm: standard deviation of one reading."""
    floor: float
    """mm: roundness that the noise alone would read; it is taken off."""


@dataclass(frozen=True, slots=True)
class TurnedEvidence:
    """What the report draws of a turned part."""

    sections: tuple[SectionEvidence, ...]


@dataclass(frozen=True, slots=True)
class _Inspected:
    """The part and the scan that it is inspected on."""

    part: Turned
    scan: Scan
    angle: Array
    """(N,) rad."""
    calibration: Calibration
    datum: Datum


@dataclass(frozen=True, slots=True)
class _Readings:
    """The readings of one section: where they stand in the scan, r - R (n,) mm and their cells."""

    flat: Ints
    deviation: Array
    cell: Ints


def inspect_turned(surface: Surface, part: Turned) -> Inspection:
    """Each section's diameter, roundness, cylindricity, circular and total run-out, with U (k = 2) and verdict.

    All about the datum axis. Where too little was seen there is no number; a circumference that isn't closed makes form
    and run-out partial at best. Noise's share of the ranges is taken off (``core.denoise``).

    Raises:
        BadRecipe: a surface without its scan and calibration, or a datum that the shaft doesn't have.
    """
    scan, calibration = surface.origin
    datum = datum_of(calibration, part.datum, part.bore_clearance)
    inspected = _Inspected(part, scan, table_angle(scan, calibration), calibration, datum)
    deviation = np.full(surface.x.shape, np.nan)
    found: list[Characteristic] = []
    drawn, remarks = [], [f"datum: {datum.remark}"]
    for section in part.sections:
        grid, readings = _readings(surface, inspected, section)
        deviation.ravel()[readings.flat] = readings.deviation
        lines, shown, remark = _section(inspected, section, grid, readings)
        found += lines
        drawn += shown
        remarks += remark
    deviation.flags.writeable = False
    if calibration.covariance.size == 0:
        remarks.append("the calibration carries no covariance: no U can be told, nothing is decided")
    return Inspection(
        "turned", part.name, tuple(found), reasons=calibration.reasons, remarks=tuple(remarks),
        settings=_settings(part, datum), deviation=deviation, evidence=TurnedEvidence(tuple(drawn)),
    )  # fmt: skip


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


def _readings(surface: Surface, inspected: _Inspected, section: Section) -> tuple[Grid, _Readings]:
    """The section's grid, and its readings within the drawing's reach, about the datum axis."""
    margin = min(MARGIN, 0.15 * (section.top - section.bottom))
    low, high = section.bottom + margin, section.top - margin
    pose, width = inspected.datum.pose, surface.x.shape[1]
    flats, psis, heights, offs = [], [], [], []
    for first in range(0, inspected.scan.profiles, BLOCK):
        rows = slice(first, first + BLOCK)
        z = surface.z[rows]
        near = np.flatnonzero((z > low - REACH) & (z < high + REACH))  # NaN compares false
        points = pose(np.stack([a[rows].ravel()[near] for a in (surface.x, surface.y, surface.z)], axis=-1))
        off = np.hypot(points[:, 0], points[:, 1]) - section.diameter / 2
        on = np.flatnonzero((np.abs(off) < REACH) & (points[:, 2] > low) & (points[:, 2] < high))
        flats.append(near[on] + first * width)
        psis.append(np.arctan2(points[on, 1], points[on, 0]))
        heights.append(points[on, 2])
        offs.append(off[on])
    off = np.concatenate(offs)
    grid = _grid(inspected, low, high, off.size)
    return grid, _Readings(
        np.concatenate(flats), off, grid.cells(np.concatenate(psis), np.concatenate(heights))
    )  # fmt: skip


def _grid(inspected: _Inspected, low: float, high: float, readings: int) -> Grid:
    """Cells as fine as the filter needs, as far as the readings fill them."""
    a_turn = inspected.scan.profiles / max(inspected.scan.revolutions, 1.0)
    angles = int(np.clip(min(CELLS_PER_WAVE * inspected.part.upr, a_turn / 2), LEAST_ANGLES, None))
    heights = int(np.clip(min((high - low) / CIRCLE_HEIGHT, readings / (READINGS_PER_CELL * angles)), 1, None))
    return Grid(low, high, heights, angles)


def _section(
    inspected: _Inspected, section: Section, grid: Grid, readings: _Readings
) -> tuple[list[Characteristic], list[SectionEvidence], list[str]]:
    """One section's characteristics, what is drawn of it and what is to be said."""
    patches = patches_of(grid, readings.cell, readings.deviation, REACH)
    rings = Rings(section.diameter / 2, grid.angle, grid.height, patches.seen, float(inspected.part.upr))
    if not rings.used.any() or rings.coverage < PARTIAL:
        missing = [
            _characteristic(section, how, None, None, rings.coverage, "not_measurable") for how in _drawn(section)
        ]
        remark = (
            f"section {section.name!r}: {rings.coverage:.0%} seen of a surface of {section.diameter:g} mm from "
            f"{section.bottom:g} to {section.top:g} mm; check the drawing, the datum and what is in view"
        )
        return missing, [], [remark]
    used = np.where(patches.seen & rings.used[:, None], patches.mean, np.nan)
    reading = read_rings(rings, used)

    def read(maps: Array) -> Array:
        return read_rings(rings, maps).statistics

    clear = cleared(read, used, patches.noise)
    clear = replace(clear, value=np.append(reading.statistics[0], clear.value[1:]))  # a mean has no bias
    whole = status_of(rings.coverage)
    closed = whole if bool(rings.closed.all()) else "partial"
    noise = np.maximum(clear.u, 0.0) * _rougher(patches, rings, reading, used)
    U = _budgets(inspected, section, rings, _moved(inspected, readings, patches, rings, used), reading, noise)
    lines = [
        _characteristic(section, how, float(clear.value[i]), U[i], rings.coverage, closed if i else whole)
        for i, how in enumerate(_drawn(section))
    ]
    evidence = SectionEvidence(
        section.name, rings.radius, grid.angle, grid.height, reading.travel, reading.form, reading.centres,
        patches.scatter, float(from_noise(read, used, patches.noise)[1]),
    )  # fmt: skip
    said = f"section {section.name!r}: noise {1000 * patches.scatter:.2g} um a reading, roundness floor "
    remarks = [f"{said}{1000 * evidence.floor:.2g} um (taken off)"]
    if closed == "partial":
        remarks.append(f"section {section.name!r}: the circumference is not closed at every height")
    return lines, [evidence], remarks


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


def _rougher(patches: Patches, rings: Rings, reading: Reading, used: Array) -> float:
    """By how much neighbouring cells differ more than their readings' own noise explains: speckle, drift, fine form."""
    usual = float(np.sqrt(np.nanmean(np.square(patches.noise[patches.seen]))))
    step = np.diff(np.where(rings.used[:, None], used, np.nan), axis=1)
    return max(1.0, float(np.sqrt(np.nanmedian(np.square(step)) / 0.4549 / 2)) / max(usual, 1e-12))


def _moved(inspected: _Inspected, readings: _Readings, patches: Patches, rings: Rings, used: Array) -> Array | None:
    """How the statistics change (2, k, 5) with each independent part of the calibration's U; None: not known."""
    at = np.flatnonzero(patches.pick.ravel() >= 0)
    flat = readings.flat[patches.pick.ravel()[at]]
    row, column = np.divmod(flat, inspected.scan.x.shape[1])
    psi = np.broadcast_to(rings.angle, patches.mean.shape).ravel()[at]
    outward = np.stack([np.cos(psi), np.sin(psi), np.zeros_like(psi)], axis=-1) @ inspected.datum.pose.rotation
    lifts = moves(
        inspected.calibration,
        inspected.scan.x[row, column],
        inspected.scan.z[row, column],
        inspected.angle[row],
        outward,
    )
    if lifts is None:
        return None
    maps = np.zeros((len(lifts), used.size))
    maps[:, at] = lifts
    maps = maps.reshape(-1, *used.shape)
    still = read_rings(rings, used).statistics
    return np.stack([read_rings(rings, used + sign * maps).statistics - still for sign in (1.0, -1.0)])


def _budgets(
    inspected: _Inspected, section: Section, rings: Rings, moved: Array | None, reading: Reading, noise: Array
) -> list[tuple[tuple[Contribution, ...], float] | None]:
    """Lines and U of each statistic; None where the calibration's own uncertainty is not known."""
    if moved is None:
        return [None] * len(STATISTICS)
    calibration = inspected.calibration
    U = budget_lines.spread_of(moved)
    apart = rings.radius - budget_lines.base_radius(calibration)
    middle = (section.bottom + section.top) / 2
    offset = max(hypot(*reading.centres[rings.used].mean(axis=0)), 0.0)
    travel = 2 * (calibration.eccentricity + offset)
    axis = [replace(c, U=2 * c.U) for c in inspected.datum.lines(middle)]  # an axis aside by c shows as 2 c
    budgets: list[tuple[tuple[Contribution, ...], float] | None] = []
    for i, name in enumerate(STATISTICS):
        lines = [
            budget_lines.line(budget_lines.CALIBRATION, float(U[i])),
            budget_lines.line(budget_lines.NOISE, budget_lines.K * float(noise[i])),
        ]
        if name == "d":
            lines += [
                budget_lines.linearity_line(calibration, apart, 2.0), budget_lines.scale_line(calibration, 2 * apart),
                budget_lines.temperature_line(section.diameter), budget_lines.artefact_line(calibration, 1.0),
            ]  # fmt: skip
        else:
            lines += [budget_lines.linearity_line(calibration, travel), budget_lines.bearing_line(2.0)]
            lines.append(budget_lines.scale_line(calibration, float(reading.statistics[i])))
        if name.endswith("runout"):
            lines += [*axis, budget_lines.zero_line(calibration.eccentricity, 2.0)]
        budgets.append(budget_lines.together(lines))
    return budgets
