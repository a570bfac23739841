"""What results rest on: the cloud, thinned out and cached; and the audit of it all."""

from pathlib import Path
from typing import Annotated, Any

from fastapi import Query
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse

from truestand.web.app_state import ThePage
from truestand.web.models import Audit
from truestand.web.problem import Problem
from truestand.web.routing import Doors, Policy

SHOWN = 200_000
"""Points that software WebGL turns smoothly."""
CACHED = 64
"""Clouds that are kept, 3 MB each; the one longest not looked at gives way."""
WITHIN, AUDIT_WITHIN = 120.0, 3600.0
"""s for a cloud; for reading all evidence there is."""


def add(doors: Doors) -> None:
    """Register."""
    cloud_path, operator = "/api/results/{number}/cloud", Policy("operator")
    doors.add("GET", cloud_path, cloud, operator, "The cloud, thinned out", (404,), response_class=FileResponse)
    doors.add("GET", "/api/audit", audit, Policy("engineer"), "Check every hash", (409,), response_model=Audit)


async def cloud(number: int, page: ThePage, points: Annotated[int, Query(ge=1000, le=SHOWN)] = SHOWN) -> FileResponse:
    """uint32 n, then float32 x[n], y[n], z[n] in mm and deviation[n] in um (NaN: none), little endian."""
    source = await run_in_threadpool(page.results.file, number, "cloud")
    if source is None:
        raise Problem(404, f"found no cloud of result {number}; choose one that has it")
    folder = page.settings.cache_folder
    target = folder / f"{source.name}-{points}.bin"
    if not await run_in_threadpool(target.exists):
        async with page.clouds:
            if not await run_in_threadpool(target.exists):
                await page.ask("cloud", str(source), str(target), str(points), within=WITHIN)
    await run_in_threadpool(_tidy, folder, target)
    return FileResponse(target, media_type="application/octet-stream", headers={"cache-control": "private, no-cache"})


async def audit(page: ThePage) -> dict[str, Any]:
    """Every byte of the store is read; one audit at a time."""
    if not await run_in_threadpool(page.settings.store.exists):
        return {"findings": []}
    async with page.audits:
        return {"findings": await page.ask("audit", str(page.settings.store), within=AUDIT_WITHIN)}


def _tidy(folder: Path, used: Path) -> None:
    """Mark one as used; remove those that were not for longest."""
    used.touch()
    kept = sorted(folder.glob("*.bin"), key=lambda path: path.stat().st_mtime, reverse=True)
    for path in kept[CACHED:]:
        path.unlink(missing_ok=True)
