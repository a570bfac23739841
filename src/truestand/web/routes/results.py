"""Results: the list, one with its record, its files, their trends, and the audit of the store that holds them."""

from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import Query
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, Response

from truestand.files.records.inspection_record import characteristics_csv, characteristics_from, with_limits
from truestand.store import Store
from truestand.web.app_state import AppState, PrincipalDep, StateDep
from truestand.web.models import Audit, Entry, History, Result, WithdrawBody
from truestand.web.problem import Problem
from truestand.web.result_index import KINDS
from truestand.web.routing import ENGINEER, OPERATOR, Routes
from truestand.web.security import REPORT_CSP

MAX_LISTED = 500
LABORATORY = "laboratory.toml"
"""Beside stand.toml: who issues certificates; without it they are drafts, and say so."""
MAX_POINTS = 200_000
"""Of a cloud: what software WebGL turns smoothly."""
MAX_CACHED_CLOUDS = 64
"""3 MB each; the one not looked at for longest gives way."""
CLOUD_TIMEOUT_S = 120.0
AUDIT_TIMEOUT_S = 3600.0
"""For reading all evidence there is."""
RESULT = "/api/results/{number}"
routes = Routes()


@routes.add("GET", "/api/results", OPERATOR, "Results, newest first")
def results(
    state: StateDep,
    kind: str | None = None,
    part: str | None = None,
    limit: Annotated[int, Query(ge=1, le=MAX_LISTED)] = 50,
    before: Annotated[int | None, Query(ge=1)] = None,
) -> list[Entry]:
    """``before``: the last number of the page before."""
    return state.results.entries((kind,) if kind else KINDS, _part_names(state, part), limit, before)


@routes.add("GET", RESULT, OPERATOR, "A result with its record", (404,))
def result(number: int, state: StateDep) -> Result:
    """Entry and record; in one of an inspection each deviation has ``limits_um``, however old the record is."""
    return Result(entry=_entry(state, number), record=with_limits(state.results.record(number)))


@routes.add("POST", f"{RESULT}/withdraw", ENGINEER, "Take a result back, for a reason", (404, 409))
def withdraw(number: int, body: WithdrawBody, state: StateDep, principal: PrincipalDep) -> Entry:
    """The entry that says so; the result itself is kept as it was. A withdrawn calibration is not in force any more."""
    entry = _entry(state, number)
    if entry.standing == "corrected":
        raise Problem(409, f"found result {number} corrected by {entry.corrected_by}; withdraw that one")
    store = Store.open(state.settings.store)
    made = store.correct(number, None, reason=body.reason, operator=principal.user or body.operator)
    return _entry(state, made.number)


@routes.add("GET", "/api/history", OPERATOR, "Trends with their limits")
def history(
    state: StateDep, kind: Literal["calibration", "inspection"] = "calibration", part: str | None = None
) -> History:
    """Of calibrations, or of the inspections of one part."""
    return History(quantities=state.results.trends(kind, _part_names(state, part)))


@routes.add("GET", f"{RESULT}/report", OPERATOR, "The report, HTML", (404, 409), response_class=FileResponse)
def report(number: int, state: StateDep, download: bool = False) -> FileResponse:
    """As it was written, in a sandbox: it runs nothing and fetches nothing."""
    entry = _entry(state, number)
    path = state.results.file(number, "report")
    if path is None:
        raise Problem(404, f"found no report of result {number}; choose one that has it")
    disposition = _disposition(entry, "html", "attachment" if download else "inline")
    return FileResponse(path, media_type="text/html", headers={"content-security-policy": REPORT_CSP} | disposition)


@routes.add("GET", f"{RESULT}/characteristics.csv", OPERATOR, "As CSV", (404, 409), response_class=Response)
def table(number: int, state: StateDep) -> Response:
    """As `truestand inspect --csv` writes it: no cell is a formula."""
    entry = _entry(state, number)
    if entry.kind != "inspection":
        raise Problem(404, f"found a {entry.kind}, need an inspection; choose one")
    text = characteristics_csv(characteristics_from(state.results.record(number)))
    return Response(text, media_type="text/csv; charset=utf-8", headers=_disposition(entry, "csv"))


@routes.add("GET", f"{RESULT}/certificate.xml", OPERATOR, "As a certificate", (404, 409), response_class=Response)
async def certificate(number: int, state: StateDep) -> Response:
    """A Digital Calibration Certificate (DCC 3.3); 409 where there can be none, and why."""
    entry = await run_in_threadpool(_entry, state, number)
    path = await run_in_threadpool(state.results.file, number, "record")
    if entry.kind != "calibration" or path is None:
        raise Problem(404, f"found no calibration under number {number}, a certificate needs one; choose one")
    if entry.standing in ("corrected", "withdrawn"):
        raise Problem(
            409, f"found calibration {number} {entry.standing}, a certificate needs one that stands; choose one"
        )
    laboratory = state.settings.stand.with_name(LABORATORY)
    text = await state.run_task("certificate", str(path), str(laboratory))
    return Response(str(text), media_type="application/xml", headers=_disposition(entry, "xml"))


@routes.add("GET", f"{RESULT}/cloud", OPERATOR, "The cloud, thinned out", (404,), response_class=FileResponse)
async def cloud(
    number: int, state: StateDep, points: Annotated[int, Query(ge=1000, le=MAX_POINTS)] = MAX_POINTS
) -> FileResponse:
    """uint32 n, then float32 x[n], y[n], z[n] in mm and deviation[n] in um (NaN: none), little endian."""
    source = await run_in_threadpool(state.results.file, number, "cloud")
    if source is None:
        raise Problem(404, f"found no cloud of result {number}; choose one that has it")
    target = state.settings.cache_folder / f"{source.name}-{points}.bin"
    if not await run_in_threadpool(target.exists):
        async with state.cloud_lock:
            if not await run_in_threadpool(target.exists):
                await state.run_task("cloud", str(source), str(target), str(points), timeout_s=CLOUD_TIMEOUT_S)
    await run_in_threadpool(_mark_used, target)
    return FileResponse(target, media_type="application/octet-stream", headers={"cache-control": "private, no-cache"})


@routes.add("GET", "/api/audit", ENGINEER, "Check every hash", (409,), response_model=Audit)
async def audit(state: StateDep) -> dict[str, Any]:
    """Every byte of the store is read; one audit at a time."""
    if not await run_in_threadpool(state.settings.store.exists):
        return {"findings": []}
    async with state.audit_lock:
        return {"findings": await state.run_task("audit", str(state.settings.store), timeout_s=AUDIT_TIMEOUT_S)}


def _entry(state: AppState, number: int) -> Entry:
    """One result.

    Raises:
        Problem: 404 there is none.
    """
    entry = state.results.entry(number)
    if entry is None:
        raise Problem(404, f"found no result {number}; see the list of results")
    return entry


def _part_names(state: AppState, part: str | None) -> tuple[str, ...]:
    """Under which names a part's results are stored: the recipe's file may have another one than the part."""
    return () if part is None else (part, *(r.part_name for r in state.folder.recipes() if r.name == part))


def _disposition(entry: Entry, suffix: str, place: str = "attachment") -> dict[str, str]:
    return {"content-disposition": f'{place}; filename="{entry.kind}-{entry.number}.{suffix}"'}


def _mark_used(cloud: Path) -> None:
    """Remove those of the cache that were not used for longest."""
    cloud.touch()
    clouds = sorted(cloud.parent.glob("*.bin"), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in clouds[MAX_CACHED_CLOUDS:]:
        path.unlink(missing_ok=True)
