"""The history in a terminal."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from truestand.report.history import Course, Inspected
from truestand.report.numbers import number, places
from truestand.statistics.control import Point
from truestand.statistics.gage import GageStudy

if TYPE_CHECKING:
    from rich.table import Table


def series_table(courses: Sequence[Course]) -> "Table":
    """Each quantity with its last reading, what changed, the limits and whether all is well."""
    headings = ("n", "last", "U", "change", "drift", "limits", "unit")
    table = _table("Calibrations", ("quantity",), headings, ("ok",))
    for c in courses:
        last = c.chart.points[-1]
        d = places(last.U)
        table.add_row(
            c.title, str(len(c.chart.points)), number(last.value, d), number(last.U, d), number(last.change, d),
            number(c.chart.drift, d), _limits(c, d), c.unit, _told(c, last),
        )  # fmt: skip
    return table


def readings_table(c: Course) -> "Table":
    """One quantity, reading by reading."""
    d = places(c.chart.points[-1].U)
    title = f"{c.title} ({c.unit}), limits {_limits(c, d)}"
    table = _table(title, ("time",), ("entry", "value", "U", "change"), ("ok",))
    for time, entry, p in zip(c.times, c.numbers, c.chart.points, strict=True):
        cells = (number(p.value, d), number(p.U, d), number(p.change, d))
        table.add_row(time, str(entry), *cells, "ok" if p.ok else ", ".join(p.flags))
    return table


def inspections_table(inspected: Sequence[Inspected]) -> "Table":
    """Inspections by part."""
    table = _table("Inspections", ("part", "serial"), ("entry",), ("time", "operator", "verdict"))
    for i in inspected:
        verdict = i.verdict.replace("_", " ") + (" (corrected)" if i.corrected else "")
        table.add_row(i.part, i.serial, str(i.number), i.time, i.operator, verdict)
    return table


def study_table(studies: Mapping[str, GageStudy], source: str) -> "Table":
    """Standard deviations of each source, Gage R&R in per cent of the total variation, categories."""
    first = next(iter(studies.values()))
    title = f"{source}: {first.operators} operators x {first.parts} parts x {first.trials} trials"
    headings = ("EV", "AV", "interaction", "GRR", "PV", "TV", "% GRR", "ndc")
    table = _table(title, ("characteristic",), headings, ())
    for name, s in studies.items():
        values = (s.EV, s.AV, s.INT, s.GRR, s.PV, s.TV)
        share = number(s.share(s.GRR), 1)
        table.add_row(name, *(f"{v:.4g}" for v in values), share, "" if s.ndc is None else str(s.ndc))
    return table


def _told(c: Course, last: Point) -> str:
    return "by clamping" if c.clamping else "ok" if last.ok else ", ".join(last.flags)


def _limits(c: Course, decimals: int) -> str:
    if c.chart.lower is None:
        return ""
    few = " (provisional)" if c.chart.provisional else ""
    return f"{number(c.chart.lower, decimals)} .. {number(c.chart.upper, decimals)}{few}"


def _table(title: str, left: Sequence[str], right: Sequence[str], last: Sequence[str]) -> "Table":
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for heading in left:
        table.add_column(heading)
    for heading in right:
        table.add_column(heading, justify="right")
    for heading in last:
        table.add_column(heading)
    return table
