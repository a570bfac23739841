"""What people take with them: the report, the characteristics as CSV, the certificate."""

from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, Response

from truestand.files.records.characteristics_csv import csv_of
from truestand.files.records.inspection_record import characteristics_from
from truestand.web.app_state import ThePage
from truestand.web.models import Entry
from truestand.web.problem import Problem
from truestand.web.routes.results import entry_of
from truestand.web.routing import Doors, Policy
from truestand.web.security import REPORT_CSP

LABORATORY = "laboratory.toml"
"""Beside stand.toml: who issues certificates; without it they are drafts, and say so."""


def add(doors: Doors) -> None:
    """Register."""
    operator, one, gone = Policy("operator"), "/api/results/{number}", (404, 409)
    doors.add("GET", f"{one}/report", report, operator, "The report, HTML", gone, response_class=FileResponse)
    doors.add("GET", f"{one}/characteristics.csv", table, operator, "As CSV", gone, response_class=Response)
    doors.add("GET", f"{one}/certificate.xml", certificate, operator, "As a certificate", gone, response_class=Response)


def report(number: int, page: ThePage, download: bool = False) -> FileResponse:
    """As it was written, in a sandbox: it runs nothing and fetches nothing."""
    entry = entry_of(page, number)
    path = page.results.file(number, "report")
    if path is None:
        raise Problem(404, f"found no report of result {number}; choose one that has it")
    headers = {"content-security-policy": REPORT_CSP} | _named(entry, "html", "attachment" if download else "inline")
    return FileResponse(path, media_type="text/html", headers=headers)


def table(number: int, page: ThePage) -> Response:
    """As `truestand inspect --csv` writes it: no cell is a formula."""
    entry = entry_of(page, number)
    if entry.kind != "inspection":
        raise Problem(404, f"found a {entry.kind}, need an inspection; choose one")
    text = csv_of(characteristics_from(page.results.record(number)))
    return Response(text, media_type="text/csv; charset=utf-8", headers=_named(entry, "csv"))


async def certificate(number: int, page: ThePage) -> Response:
    """A Digital Calibration Certificate (DCC 3.3); 409 where there can be none, and why."""
    entry = await run_in_threadpool(entry_of, page, number)
    path = await run_in_threadpool(page.results.file, number, "record")
    if entry.kind != "calibration" or path is None:
        raise Problem(404, f"found no calibration under number {number}, a certificate needs one; choose one")
    laboratory = page.settings.stand.with_name(LABORATORY)
    text = await page.ask("certificate", str(path), str(laboratory))
    return Response(str(text), media_type="application/xml", headers=_named(entry, "xml"))


def _named(entry: Entry, suffix: str, place: str = "attachment") -> dict[str, str]:
    return {"content-disposition": f'{place}; filename="{entry.kind}-{entry.number}.{suffix}"'}
