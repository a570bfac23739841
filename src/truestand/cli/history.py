"""``truestand history``: how the stand and its parts did over time, and how much of it is the measuring."""

from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from truestand.cli.options import JsonOption, QuietOption, StoreOption, output_option
from truestand.cli.store import open_store
from truestand.cli.terminal import print_json, print_table
from truestand.core.errors import BadRecipe
from truestand.files.atomic import write_text_atomic
from truestand.files.recipes.recipes import read_company
from truestand.files.records.record import messages_record
from truestand.files.records.study import read_study
from truestand.report.history import InspectionRow, QuantityHistory, history_report, study_report
from truestand.report.terminal import inspections_table, readings_table, series_table, study_table
from truestand.statistics.gage import GageStudy, gage_study, readings_of
from truestand.store import Result, Store
from truestand.store.history import Series, inspections, repeated, series


def history(
    store: StoreOption = None,
    quantity: Annotated[
        str | None, typer.Option(metavar="NAME", help="One quantity or characteristic, reading by reading.")
    ] = None,
    part: Annotated[str | None, typer.Option(metavar="NAME", help="Inspections of this part only.")] = None,
    since: Annotated[str | None, typer.Option(metavar="DATE", help="From this day on, such as 2026-01-31.")] = None,
    gage_rr: Annotated[
        str | None,
        typer.Option(
            "--gage-rr", metavar="STUDY.csv|PART", help="Gage R&R of a table, or of a part's repeated inspections."
        ),
    ] = None,
    report: Annotated[
        Path | None, output_option("--report", metavar="REPORT.html", help="Write one HTML file.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Show the calibrations' quantities over time with control limits, and the inspections by part.

    Example: truestand history --store results --quantity phi_deg --report history.html
    """
    _check(since)
    if gage_rr is not None:
        _gage(gage_rr, store, since, quantity, report, as_json, quiet)
        return
    opened = open_store(store)
    quantities, parts = series(opened, since, quantity), inspections(opened, since, part)
    courses, lines = [_course(s) for s in quantities], [_line(i) for i in parts]
    if report is not None:
        _write_report(report, opened, courses, lines)
    if as_json:
        print_json(_record(opened, quantities, parts))
    elif not quiet:
        _print(courses, lines, quantity)
        if report is not None:
            typer.echo(report)


def _check(since: str | None) -> None:
    """Refuse a text that is no date."""
    try:
        datetime.fromisoformat(since or "2026-01-01")
    except ValueError:
        raise BadRecipe(f"found --since {since!r}, need a day such as 2026-01-31") from None


def _print(courses: list[QuantityHistory], lines: list[InspectionRow], quantity: str | None) -> None:
    if quantity is not None:
        for course in courses:
            print_table(readings_table(course))
        return
    print_table(series_table(courses))
    if lines:
        print_table(inspections_table(lines))


def _write_report(path: Path, store: Store, courses: list[QuantityHistory], lines: list[InspectionRow]) -> None:
    stand = Path("stand.toml")
    company = read_company(stand) if stand.is_file() else None
    number, stated = store.head()
    head = f"{store.folder.name}: last entry {number}, hash {stated}"
    write_text_atomic(path, history_report(courses, lines, head, company.name if company else None))


def _course(s: Series) -> QuantityHistory:
    title = f"{s.sensor}: {s.quantity}"
    times, numbers = tuple(e.time for e in s.entries), tuple(e.number for e in s.entries)
    return QuantityHistory(title, s.unit, times, numbers, s.chart, s.clamping)


def _line(i: Result) -> InspectionRow:
    e = i.entry
    return InspectionRow(
        e.number, e.time, e.part or "", e.serial or "", e.operator or "", i.verdict, i.corrected, i.doubts
    )


def _record(store: Store, quantities: list[Series], parts: list[Result]) -> dict[str, Any]:
    number, stated = store.head()
    return {
        "format": "truestand.history",
        "version": 1,
        "head": {"number": number, "hash": stated},
        "quantities": [
            {
                "sensor": s.sensor, "name": s.quantity, "unit": s.unit, "mean": s.chart.mean, "lower": s.chart.lower,
                "upper": s.chart.upper, "drift": s.chart.drift, "by_clamping": s.clamping,
                "provisional": s.chart.provisional,
                "readings": [
                    {"entry": e.number, "time": e.time, "value": p.value, "U": p.U, "change": p.change, "ok": p.ok,
                     "flags": list(p.flags)}
                    for e, p in zip(s.entries, s.chart.points, strict=True)
                ],
            }
            for s in quantities
        ],
        "inspections": [
            {"entry": i.entry.number, "time": i.entry.time, "part": i.entry.part,
             "serial": i.entry.serial, "order": i.entry.order,
             "operator": i.entry.operator, "verdict": i.verdict, "corrected": i.corrected,
             "doubts": messages_record(i.doubts)}
            for i in parts
        ],
    }  # fmt: skip


def _gage(
    source: str, store: Path | None, since: str | None, quantity: str | None, report: Path | None,
    as_json: bool, quiet: bool,
) -> None:  # fmt: skip
    table = source.lower().endswith((".csv", ".txt"))
    rows = {"value": read_study(Path(source))} if table else repeated(open_store(store), source, since, quantity)
    title = Path(source).name if table else source
    studies = {name: gage_study(readings_of(readings)[0]) for name, readings in rows.items()}
    if report is not None:
        write_text_atomic(report, study_report(studies, title))
    if as_json:
        print_json({"format": "truestand.gage", "version": 1, "source": source,
                    "studies": {name: _study(s) for name, s in studies.items()}})  # fmt: skip
    elif not quiet:
        print_table(study_table(studies, title))


def _study(s: GageStudy) -> dict[str, Any]:
    return {
        "operators": s.operators, "parts": s.parts, "trials": s.trials, "interaction_pooled": s.pooled,
        "EV": s.EV, "AV": s.AV, "INT": s.INT, "GRR": s.GRR, "PV": s.PV, "TV": s.TV, "ndc": s.ndc,
        "percent_of_TV": {name: s.share(getattr(s, name)) for name in ("EV", "AV", "INT", "GRR", "PV")},
        "anova": [{"name": line.name, "dof": line.dof, "squares": line.squares, "mean": line.mean, "F": line.F,
                   "p": line.p} for line in s.full],
    }  # fmt: skip
