"""Tells open pages when Home would say something else than before, by whatever program, recipe or clock that came."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from truestand.core.errors import TruestandError
from truestand.web.app_state import AppState
from truestand.web.routes.stand import home

POLL_INTERVAL_S = 2.0


@asynccontextmanager
async def watching(state: AppState) -> AsyncIterator[None]:
    """While this is open, one task looks at the disk for all who ask, page and interfaces alike."""
    if state.is_watched:
        yield
        return
    state.is_watched = True
    task = asyncio.create_task(watch(state))
    try:
        yield
    finally:
        state.is_watched = False
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def watch(state: AppState) -> None:
    """Publish Home's version whenever it has changed, until cancelled; only while somebody listens."""
    published = None
    while True:
        if state.hub.listeners:
            version = await asyncio.to_thread(_version, state)
            if version != published:
                published = version
                state.hub.publish("home", json.dumps({"type": "home", "version": version}))
        await asyncio.sleep(POLL_INTERVAL_S)


def _version(state: AppState) -> str:
    """Where Home can't be shown, the reason: a page that asks is told."""
    try:
        return str(home(state)["version"])
    except (TruestandError, OSError) as wrong:
        return str(wrong)
