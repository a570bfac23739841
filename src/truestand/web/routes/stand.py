"""The stand at a glance: whether it is calibrated, what came last, what can be done; its devices and their fault."""

import hashlib
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from truestand.files.recipes.changes import differences
from truestand.files.records.record import is_past, texts_of
from truestand.station.stand_lock import latched_fault, not_stopped
from truestand.web.app_state import AppState, StateDep
from truestand.web.models import CalibrationState, Device, Home, Reset
from truestand.web.problem import Problem
from truestand.web.routes.recipes import parts
from truestand.web.routing import OPERATOR, Routes

LAST_RESULTS = 8
DEVICES_TIMEOUT_S = 60.0
"""For all devices to answer or not."""
routes = Routes()


@routes.add("GET", "/api/home", OPERATOR, "The stand at a glance", response_model=Home)
def home(state: StateDep) -> dict[str, Any]:
    """All of it in one answer."""
    lasting = {
        "calibration": calibration_state(state, datetime.now(UTC)),
        "last": state.results.entries(limit=LAST_RESULTS),
        "fault": latched_fault(state.settings.stand) or None,
        "not_stopped": not_stopped(state.settings.stand),
        "parts": parts(state),
    }
    version = hashlib.sha256(repr((lasting, state.results.head())).encode()).hexdigest()[:16]
    return lasting | {"job": state.runner.current(), "version": version}


@routes.add("GET", "/api/devices", OPERATOR, "Ask table and sensors", (409, 422), response_model=list[Device])
async def devices(state: StateDep) -> Any:
    """Nothing moves, no laser goes on; 409 while a job runs."""
    async with state.devices_lock:
        _require_idle(state)
        return await state.run_task("devices", str(state.settings.stand), timeout_s=DEVICES_TIMEOUT_S)


@routes.add("POST", "/api/reset", OPERATOR, "Reset a latched fault", (409,))
async def reset(state: StateDep) -> Reset:
    """The cause is mended: the stand may be used again. Nothing moves."""
    async with state.devices_lock:
        _require_idle(state)
        fault = await state.run_task("reset", str(state.settings.stand), timeout_s=DEVICES_TIMEOUT_S)
    return Reset(fault=fault or None)


def calibration_state(state: AppState, now: datetime) -> CalibrationState:
    """What the calibration in force is worth at a time, by its record and its verification."""
    entry = state.results.calibration()
    not_in_force, reason = state.results.not_in_force() or (None, None)
    fields: dict[str, Any] = {"not_in_force": not_in_force, "not_in_force_reason": reason}
    if entry is None:
        return CalibrationState(state="none", **fields)
    record = state.results.record(entry.number)
    until, verification = record.get("valid_until"), state.results.verification()
    verdict = None if verification is None else verification.verdict
    changes = differences(record, state.settings.stand, state.settings.artefact)
    worst = _worst(record, verdict, bool(changes), now)
    fields |= {"state": worst, "number": entry.number, "time": entry.time, "valid_until": until, "changes": changes}
    if verification is not None:
        fields |= {"verification": verification.number, "verified": verification.time}
        if worst == verdict:
            record = state.results.record(verification.number)
    return CalibrationState(**fields, reasons=texts_of(record))


def _worst(record: Mapping[str, Any], verdict: str | None, changed: bool, now: datetime) -> str:
    """The worst that can be said of a calibration with this record and the ``verdict`` of its verification."""
    if record.get("status") != "valid":
        return "untrusted"
    if verdict == "does_not_hold":
        return "does_not_hold"
    if is_past(record.get("valid_until"), now):
        return "expired"
    return "undecided" if verdict == "undecided" else "changed" if changed else "valid"


def _require_idle(state: AppState) -> None:
    if state.runner.busy:
        raise Problem(409, "found a job running, need the stand idle; wait for its end, or abort it")
