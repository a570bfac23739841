"""The WebSocket: the newest of the job and its live profile, for any number of listeners of any speed."""

import asyncio
from contextlib import suppress

from starlette.websockets import WebSocket, WebSocketDisconnect

from truestand.web.app_state import Page, page_of
from truestand.web.hub import Listener
from truestand.web.routing import Doors, Policy

MOST = 100
"""Listeners."""
PATIENCE = 20.0
"""s for a listener to take one message."""
LOGIN = 15.0
"""s between two looks whether the listener is still logged in."""
POLICY, LATER = 1008, 1013
"""WebSocket close codes (RFC 6455; 1013 as registered by IANA: try again later)."""


def add(doors: Doors) -> None:
    """Register."""
    doors.add_socket("/api/live", live, Policy("operator"))


async def live(websocket: WebSocket) -> None:
    """Send until the listener leaves, says anything, is too slow, or is logged out."""
    page = page_of(websocket)
    await websocket.accept()
    if page.hub.listeners >= MOST:
        await websocket.close(LATER)
        return
    listener = page.hub.listen()
    tasks = [asyncio.create_task(_send(websocket, listener, page)), asyncio.create_task(_hear(websocket))]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        page.hub.leave(listener)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    with suppress(RuntimeError, WebSocketDisconnect, TimeoutError):
        async with asyncio.timeout(1.0):
            await websocket.close(POLICY)


async def _send(websocket: WebSocket, listener: Listener, page: Page) -> None:
    """What is new, as long as it is taken in time and the login lasts."""
    while page.who(websocket.state.cookie, seen=False).role is not None:
        try:
            async with asyncio.timeout(LOGIN):
                messages = await listener.next()
        except TimeoutError:
            continue
        for message in messages:
            async with asyncio.timeout(PATIENCE):
                await websocket.send_text(message)


async def _hear(websocket: WebSocket) -> None:
    """Nothing is expected: any message, or the end, is the end."""
    await websocket.receive()
