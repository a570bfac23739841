"""Results: the list, one with its record, their trends."""

from typing import Annotated, Any, Literal

from fastapi import Query

from truestand.files.records.inspection_record import with_limits
from truestand.web.app_state import Page, ThePage
from truestand.web.models import Entry, History, Result
from truestand.web.problem import Problem
from truestand.web.routing import Doors, Policy

MOST = 500
Number = Annotated[int, Query(ge=1)]


def add(doors: Doors) -> None:
    """Register."""
    operator = Policy("operator")
    one = "/api/results/{number}"
    doors.add("GET", "/api/results", results, operator, "Results, newest first", response_model=list[Entry])
    doors.add("GET", one, result, operator, "A result with its record", (404,), response_model=Result)
    doors.add("GET", "/api/history", history, operator, "Trends with their limits", response_model=History)


def results(
    page: ThePage,
    kind: str | None = None,
    part: str | None = None,
    limit: Annotated[int, Query(ge=1, le=MOST)] = 50,
    before: Number | None = None,
) -> list[Entry]:
    """``before``: the last number of the page before."""
    return page.results.entries((kind,) if kind else (), _names(page, part), limit, before)


def result(number: int, page: ThePage) -> dict[str, Any]:
    """Entry and record; in one of an inspection each deviation has ``limits_um``, however old the record is."""
    return {"entry": entry_of(page, number), "record": with_limits(page.results.record(number))}


def history(
    page: ThePage, kind: Literal["calibration", "inspection"] = "calibration", part: str | None = None
) -> dict[str, Any]:
    """Of calibrations, or of the inspections of one part."""
    return {"quantities": page.results.history(kind, _names(page, part))}


def _names(page: Page, part: str | None) -> tuple[str, ...]:
    """Under which names a part's results are kept: the recipe's file may have another one than the part."""
    return () if part is None else (part, *(r.called for r in page.folder.recipes() if r.name == part))


def entry_of(page: Page, number: int) -> Entry:
    """One result.

    Raises:
        Problem: 404 there is none.
    """
    entry = page.results.entry(number) if number < 1 << 62 else None
    if entry is None:
        raise Problem(404, f"found no result {number}; see the list of results")
    return entry
