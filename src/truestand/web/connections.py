"""uvicorn's connections with timeouts and limits, so that slow or hostile clients cost little.

A client that doesn't finish its request's head, or doesn't take what it is sent, is dropped after a while; where too
many are connected, the one that has waited longest is dropped. A slow client costs one small buffer.
"""

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, ClassVar, cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.exceptions import InvalidState

HEAD_TIMEOUT_S = 10.0
"""For a request's head, from its connection or the last answer on."""
WRITE_TIMEOUT_S = 30.0
"""For a client to take anything at all of an answer."""
POLL_INTERVAL_S = 1.0
WEBSOCKET_BYTES, WEBSOCKET_BYTES_PER_S = 8_192, 200.0
"""What a listener may send, and how much more with time: its handshake, answers to pings, its close frame."""
MAX_CONNECTIONS = 400
"""Below the 1024 files that a process commonly may open."""


@dataclass(slots=True)
class _Activity:
    """What a connection was doing when last polled, and since when."""

    since: float
    doing: tuple[str, int] = ("", 0)


@dataclass(slots=True)
class ConnectionMonitor:
    """All connections of a server."""

    activity: dict[asyncio.Transport, _Activity] = field(default_factory=dict)

    def opened(self, transport: asyncio.Transport) -> None:
        """Add a connection; where there are too many, the one longest without a request is dropped."""
        if len(self.activity) >= MAX_CONNECTIONS:
            order = ("head", "write", "busy")
            self.drop(min(self.activity, key=lambda t: (order.index(_doing(t)[0]), self.activity[t].since)))
        self.activity[transport] = _Activity(asyncio.get_running_loop().time(), ("head", 0))

    def drop_late(self) -> None:
        """Drop connections whose timeout is over."""
        now = asyncio.get_running_loop().time()
        for transport, activity in list(self.activity.items()):
            doing = _doing(transport)
            if doing != activity.doing:
                activity.doing, activity.since = doing, now
            timeout = {"head": HEAD_TIMEOUT_S, "write": WRITE_TIMEOUT_S}.get(doing[0])
            if timeout is not None and now - activity.since > timeout:
                self.drop(transport)

    def drop(self, transport: asyncio.Transport) -> None:
        """Abort a connection at once, with what it has not taken."""
        self.activity.pop(transport, None)
        transport.abort()

    async def watch(self) -> None:
        """Poll until cancelled."""
        while True:
            await asyncio.sleep(POLL_INTERVAL_S)
            self.drop_late()


class Http(H11Protocol):
    """HTTP/1.1."""

    monitor: ClassVar[ConnectionMonitor]

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Add it to the monitor."""
        super().connection_made(transport)
        self.monitor.opened(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove it from the monitor."""
        self.monitor.activity.pop(self.transport, None)
        super().connection_lost(exc)

    @property
    def waits_for_head(self) -> bool:
        """Whether a request's head, or its rest, is what is missing."""
        idle = self.cycle is None or self.cycle.response_complete
        return idle and self.conn.their_state in (h11.IDLE, h11.DONE)


class WebSocket(WebSocketsSansIOProtocol):
    """A listener."""

    monitor: ClassVar[ConnectionMonitor]
    _opened_at: float | None = None
    _received = 0

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove it from the monitor."""
        self.monitor.activity.pop(self.transport, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Drop who sends too much, before it is parsed: each ping costs more to answer than to send."""
        now = self.loop.time()
        if self._opened_at is None:
            self._opened_at = now
        self._received += len(data)
        if self._received > WEBSOCKET_BYTES + WEBSOCKET_BYTES_PER_S * (now - self._opened_at):
            self.monitor.drop(self.transport)
            return
        super().data_received(data)

    def shutdown(self) -> None:
        """End with the server; uvicorn's own raises where the client is closing the connection at this moment."""
        with suppress(InvalidState):
            super().shutdown()
        self.transport.close()

    def pause_writing(self) -> None:
        """Who doesn't take answers isn't read either: pings would pile up their pongs."""
        super().pause_writing()
        self.transport.pause_reading()

    def resume_writing(self) -> None:
        """Go on reading."""
        super().resume_writing()
        if not self.read_paused and not self.transport.is_closing():
            self.transport.resume_reading()


def protocols(monitor: ConnectionMonitor) -> tuple[type[Http], type[WebSocket]]:
    """Both for one server: uvicorn makes instances itself and passes nothing on, so the monitor is in the class."""
    return type("MonitoredHttp", (Http,), {"monitor": monitor}), type(
        "MonitoredWebSocket", (WebSocket,), {"monitor": monitor}
    )


def _doing(transport: asyncio.Transport) -> tuple[str, int]:
    """What a connection does: it waits for a head, writes (with the bytes still to send), or is busy."""
    unsent = transport.get_write_buffer_size()
    if unsent:
        return "write", unsent
    protocol: Any = cast(Any, transport).get_protocol()
    return ("head", 0) if isinstance(protocol, Http) and protocol.waits_for_head else ("busy", 0)
