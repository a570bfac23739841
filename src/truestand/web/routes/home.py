"""The first view: is the stand calibrated, until when, what came last, what can be done."""

from datetime import UTC, datetime
from typing import Any

from truestand.station.latch import latched_fault
from truestand.web.doors import Doors, Policy
from truestand.web.models import CalibrationState, Home
from truestand.web.page import Page, ThePage
from truestand.web.routes.recipes import parts_of

LAST = 8


def add(doors: Doors) -> None:
    """Register."""
    doors.add("GET", "/api/home", home, Policy("operator"), "The stand at a glance", response_model=Home)


def home(page: ThePage) -> dict[str, Any]:
    """All of it in one answer."""
    busy = page.runner.busy
    return {
        "calibration": calibration_state(page, datetime.now(UTC)),
        "last": page.results.entries(kinds=("calibration", "inspection"), limit=LAST),
        "job": page.runner.current(),
        "fault": None if busy else latched_fault(page.settings.stand) or None,
        "parts": parts_of(page),
    }


def calibration_state(page: Page, now: datetime) -> CalibrationState:
    """Of the newest calibration."""
    entry = page.results.calibration()
    if entry is None:
        return CalibrationState(state="none")
    record = page.results.record(entry.number)
    until = record.get("valid_until")
    state = "untrusted" if record.get("status") != "valid" else "expired" if _over(until, now) else "valid"
    reasons = [str(reason) for reason in record.get("reasons") or []]
    return CalibrationState.model_validate(
        {"state": state, "number": entry.number, "time": entry.time, "valid_until": until, "reasons": reasons}
    )


def _over(until: str | None, now: datetime) -> bool:
    """Whether a date has passed; a day without a time counts to its end."""
    if not until:
        return False
    try:
        end = datetime.fromisoformat(until if "T" in until else f"{until}T23:59:59")
    except ValueError:
        return True
    return now > (end if end.tzinfo else end.replace(tzinfo=UTC))
