"""The first view: is the stand calibrated, until when, what came last, what can be done."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from truestand.station.latch import latched_fault, not_stopped
from truestand.web.app_state import Page, ThePage
from truestand.web.models import CalibrationState, Home
from truestand.web.routes.recipes import parts_of
from truestand.web.routing import Doors, Policy

LAST = 8


def add(doors: Doors) -> None:
    """Register."""
    doors.add("GET", "/api/home", home, Policy("operator"), "The stand at a glance", response_model=Home)


def home(page: ThePage) -> dict[str, Any]:
    """All of it in one answer."""
    busy = page.runner.busy
    return {
        "calibration": calibration_state(page, datetime.now(UTC)),
        "last": page.results.entries(limit=LAST),
        "job": page.runner.current(),
        "fault": None if busy else latched_fault(page.settings.stand) or None,
        "not_stopped": [] if busy else not_stopped(page.settings.stand),
        "parts": parts_of(page),
    }


def calibration_state(page: Page, now: datetime) -> CalibrationState:
    """Of the newest calibration, and of what a verification found since."""
    entry = page.results.calibration()
    if entry is None:
        return CalibrationState(state="none")
    record = page.results.record(entry.number)
    until, verification = record.get("valid_until"), page.results.verification()
    state = _worth(record, None if verification is None else verification.verdict, now)
    told: dict[str, Any] = {"state": state, "number": entry.number, "time": entry.time, "valid_until": until}
    if verification is not None:
        told |= {"verification": verification.number, "verified": verification.time}
        if state == verification.verdict:
            record = page.results.record(verification.number)
    return CalibrationState.model_validate(told | {"reasons": [str(r) for r in record.get("reasons") or []]})


def _worth(record: Mapping[str, Any], verdict: str | None, now: datetime) -> str:
    """The worst that can be said of a calibration with this record and the ``verdict`` of its verification."""
    if record.get("status") != "valid":
        return "untrusted"
    if verdict == "does_not_hold":
        return "does_not_hold"
    if _over(record.get("valid_until"), now):
        return "expired"
    return "undecided" if verdict == "undecided" else "valid"


def _over(until: str | None, now: datetime) -> bool:
    """Whether a date has passed; a day without a time counts to its end."""
    if not until:
        return False
    try:
        end = datetime.fromisoformat(until if "T" in until else f"{until}T23:59:59")
    except ValueError:
        return True
    return now > (end if end.tzinfo else end.replace(tzinfo=UTC))
