"""The WebSocket: the newest of the job and its live profile, for any number of listeners of any speed."""

import asyncio
from contextlib import suppress

from starlette.websockets import WebSocket, WebSocketDisconnect

from truestand.web.app_state import AppState, app_state
from truestand.web.hub import Listener
from truestand.web.routing import OPERATOR, Routes

MAX_LISTENERS = 100
SEND_TIMEOUT_S = 20.0
"""For a listener to take one message."""
LOGIN_CHECK_INTERVAL_S = 15.0
POLICY_VIOLATION, TRY_AGAIN_LATER = 1008, 1013
"""WebSocket close codes (RFC 6455; 1013 as registered by IANA)."""
routes = Routes()


@routes.add_websocket("/api/live", OPERATOR)
async def live(websocket: WebSocket) -> None:
    """Send until the listener leaves, says anything, is too slow, or is logged out."""
    state = app_state(websocket)
    await websocket.accept()
    if state.hub.listeners >= MAX_LISTENERS:
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
