"""Jobs: start one, see how far it is, abort it; and the WebSocket that follows it.

The WebSocket sends the newest of the job and its live profile to any number of listeners of any speed.
"""

import asyncio
import re
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket, WebSocketDisconnect

from truestand.files.recipes.recipes import read_toml
from truestand.station.jobs import STEPS
from truestand.station.stand_lock import latched_fault
from truestand.web.app_state import AppState, PrincipalDep, StateDep, app_state
from truestand.web.authentication import Principal
from truestand.web.hub import Listener
from truestand.web.models import Job, JobBody
from truestand.web.problem import Problem
from truestand.web.recipes import RecipeFile
from truestand.web.routing import OPERATOR, GuardedWebSocketRoute, Routes

KEEP = ("keep", "Keep the result")
STARTING = replace(OPERATOR, max_body_bytes=8_000)
MAX_LISTENERS = 100
SEND_TIMEOUT_S = 20.0
"""For a listener to take one message."""
LOGIN_CHECK_INTERVAL_S = 15.0
POLICY_VIOLATION, TRY_AGAIN_LATER = 1008, 1013
"""WebSocket close codes (RFC 6455; 1013 as registered by IANA)."""
_PLAIN_TEXT = re.compile(r"[^\x00-\x1f\x7f]*")
routes = Routes()


@routes.add("POST", "/api/jobs", STARTING, "Calibrate, inspect or verify", (404, 409), response_model=Job)
async def start(body: JobBody, state: StateDep, principal: PrincipalDep) -> dict[str, Any]:
    """One at a time: 409 where one runs, and as long as a fault is latched."""
    for text in (body.operator, body.order, body.serial):
        if not _PLAIN_TEXT.fullmatch(text or ""):
            raise Problem(422, "found control characters in a name, need plain text; type it again")
    async with state.devices_lock, state.recipe_lock:
        return await run_in_threadpool(_start, body, state, principal)


@routes.add("GET", "/api/jobs/current", OPERATOR, "The newest job", response_model=Job | None)
def current(state: StateDep) -> dict[str, Any] | None:
    """Null before the first."""
    return state.runner.current()


@routes.add("POST", "/api/jobs/{id}/abort", OPERATOR, "Stop a job", (404,), response_model=Job)
def abort(id: str, state: StateDep) -> dict[str, Any]:
    """The stand stops, the recording is kept; a second abort ends a worker that doesn't obey within ten seconds."""
    job = state.runner.abort(id)
    if job is None:
        raise Problem(404, "found no such job; it may be over, see the current one")
    return job


async def live(websocket: WebSocket) -> None:
    """Send until the listener leaves, says anything, is too slow, or is logged out."""
    state = app_state(websocket)
    await websocket.accept()
    if len(state.hub.listeners) >= MAX_LISTENERS:
        await websocket.close(TRY_AGAIN_LATER)
        return
    listener = state.hub.listen()
    # nothing is expected from a listener: any message ends it, as its leaving does
    tasks = [asyncio.create_task(_send(websocket, listener, state)), asyncio.create_task(websocket.receive())]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        state.hub.leave(listener)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    with suppress(RuntimeError, WebSocketDisconnect, TimeoutError):
        async with asyncio.timeout(1.0):
            await websocket.close(POLICY_VIOLATION)


routes.append(GuardedWebSocketRoute("/api/live", live, policy=OPERATOR))


def _start(body: JobBody, state: AppState, principal: Principal) -> dict[str, Any]:
    fault = latched_fault(state.settings.stand)
    if fault:  # the worker would refuse too, but a job that runs for a moment hides what is still on
        raise Problem(409, fault)
    if body.kind == "inspect" and not body.part:
        raise Problem(422, "found no part, an inspection needs one; choose it from the list of parts")
    part = state.folder.part(body.part) if body.part else None
    request = _job_request(state, body, principal, part)
    return state.runner.start(request, _title(state, part), body.part, (*STEPS[body.kind], KEEP))


def _job_request(
    state: AppState, body: JobBody, principal: Principal, part: RecipeFile | None
) -> dict[str, str | None]:
    """What the worker reads. With users, the operator is the one who is logged in."""
    settings = state.settings
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H%M%S.%fZ")
    request = {
        "kind": body.kind,
        "stand": str(settings.stand),
        "folder": str(settings.jobs_folder / f"{now}-{body.kind}"),
        "store": str(settings.store),
        "operator": principal.user or body.operator,
        "order": body.order,
        "serial": body.serial,
    }
    if body.kind != "inspect" or settings.artefact.exists():  # an inspection needs none, but says what changed in it
        request["artefact"] = str(settings.artefact)
    if part is not None:
        request["part"] = str(state.folder.file(part.file))
    if body.kind != "calibrate":
        request["calibration"] = _calibration(state)
    return request


def _calibration(state: AppState) -> str:
    """The record of the calibration in force."""
    newest = state.results.calibration()
    path = None if newest is None else state.results.file(newest.number, "record")
    if path is None:
        raise Problem(409, "found no calibration of this stand, need one first; calibrate with the shaft")
    return str(path)


def _title(state: AppState, part: RecipeFile | None) -> str:
    if part is not None:
        return part.title
    return str(read_toml(state.settings.artefact).get("name") or state.settings.artefact.stem)


async def _send(websocket: WebSocket, listener: Listener, state: AppState) -> None:
    """What is new, as long as it is taken in time and the login lasts."""
    while state.principal(websocket.state.cookie, is_use=False).role is not None:
        try:
            async with asyncio.timeout(LOGIN_CHECK_INTERVAL_S):
                messages = await listener.next()
        except TimeoutError:
            continue
        for message in messages:
            async with asyncio.timeout(SEND_TIMEOUT_S):
                await websocket.send_text(message)
