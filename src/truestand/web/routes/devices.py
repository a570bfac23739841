"""Devices: who answers; and the reset of a latched fault."""

from typing import Any

from truestand.web.app_state import Page, ThePage
from truestand.web.models import Device, Reset
from truestand.web.problem import Problem
from truestand.web.routing import Doors, Policy

WITHIN = 60.0
"""s for all devices to answer or not."""


def add(doors: Doors) -> None:
    """Register."""
    operator = Policy("operator")
    listed: Any = list[Device]
    doors.add("GET", "/api/devices", devices, operator, "Ask table and sensors", (409, 422), response_model=listed)
    doors.add("POST", "/api/reset", reset, operator, "Reset a latched fault", (409,), response_model=Reset)


async def devices(page: ThePage) -> Any:
    """Nothing moves, no laser goes on; 409 while a job runs."""
    async with page.devices:
        _demand_idle(page)
        return await page.ask("devices", str(page.settings.stand), within=WITHIN)


async def reset(page: ThePage) -> dict[str, Any]:
    """The cause is mended: the stand may be used again. Nothing moves."""
    async with page.devices:
        _demand_idle(page)
        fault = await page.ask("reset", str(page.settings.stand), within=WITHIN)
    return {"fault": fault or None}


def _demand_idle(page: Page) -> None:
    if page.runner.busy:
        raise Problem(409, "found a job running, need the stand idle; wait for its end, or abort it")
