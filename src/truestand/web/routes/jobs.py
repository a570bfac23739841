"""Jobs: start one, see how far it is, abort it."""

import json
import re
from datetime import UTC, datetime
from typing import Any

from starlette.concurrency import run_in_threadpool

from truestand.files.recipes.recipes import read_toml
from truestand.station.jobs import STEPS
from truestand.web.app_state import Page, ThePage, TheWho
from truestand.web.models import Job, JobBody
from truestand.web.problem import Problem
from truestand.web.recipes import Listed
from truestand.web.routing import Doors, Policy, Who
from truestand.web.runner import Busy

KEEP = ("keep", "Keep the result")
_PLAIN = re.compile(r"[^\x00-\x1f\x7f]*")


def add(doors: Doors) -> None:
    """Register."""
    operator, starting = Policy("operator"), Policy("operator", body=8_000)
    doors.add("POST", "/api/jobs", start, starting, "Calibrate, inspect or verify", (404, 409), response_model=Job)
    doors.add("GET", "/api/jobs/current", current, operator, "The newest job", response_model=Job | None)
    doors.add("POST", "/api/jobs/{id}/abort", abort, operator, "Stop a job", (404,), response_model=Job)


async def start(body: JobBody, page: ThePage, who: TheWho) -> dict[str, Any]:
    """One at a time: 409 where one runs."""
    for text in (body.operator, body.order, body.serial):
        if not _PLAIN.fullmatch(text or ""):
            raise Problem(422, "found control characters in a name, need plain text; type it again")
    async with page.devices, page.recipes:
        return await run_in_threadpool(_begin, body, page, who)


def current(page: ThePage) -> dict[str, Any] | None:
    """Null before the first."""
    return page.runner.current()


def abort(id: str, page: ThePage) -> dict[str, Any]:
    """The stand stops, and what came is kept; a second abort ends a worker that doesn't obey within ten seconds."""
    found = page.runner.abort(id)
    if found is None:
        raise Problem(404, "found no such job; it may be over, see the current one")
    return found


def _begin(body: JobBody, page: Page, who: Who) -> dict[str, Any]:
    part = _part(page, body)
    order = _order(page, body, who, part)
    steps = (*STEPS[body.kind], KEEP)
    try:
        return page.runner.start(order, _title(page, part), body.part, steps)
    except Busy as busy:
        raise Problem(409, str(busy)) from busy


def _part(page: Page, body: JobBody) -> Listed | None:
    if body.kind == "inspect" and not body.part:
        raise Problem(422, "found no part, an inspection needs one; choose it from the list of parts")
    return page.folder.part(body.part) if body.part else None


def _order(page: Page, body: JobBody, who: Who, part: Listed | None) -> dict[str, Any]:
    """What the worker reads. With users, the operator is the one who is logged in."""
    settings = page.settings
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H%M%S.%fZ")
    order: dict[str, Any] = {
        "kind": body.kind,
        "stand": str(settings.stand),
        "folder": str(settings.jobs_folder / f"{now}-{body.kind}"),
        "store": str(settings.store),
        "operator": who.user or body.operator,
        "order": body.order,
        "serial": body.serial,
    }
    if body.kind != "inspect":
        order["artefact"] = str(settings.artefact)
    if part is not None:
        order["part"] = str(page.folder.file(part.file))
    if body.kind != "calibrate":
        order["calibration"] = _calibration(page)
    json.dumps(order, allow_nan=False)
    return order


def _calibration(page: Page) -> str:
    """The record of the one that counts."""
    newest = page.results.calibration()
    path = None if newest is None else page.results.file(newest.number, "record")
    if path is None:
        raise Problem(409, "found no calibration of this stand, need one first; calibrate with the shaft")
    return str(path)


def _title(page: Page, part: Listed | None) -> str:
    if part is not None:
        return part.title
    return str(read_toml(page.settings.artefact).get("name") or page.settings.artefact.stem)
