"""uvicorn's connections with the patience of a machine that has a stand to serve.

A client that doesn't finish its request's head, or doesn't take what it is sent, is dropped after a while; where too
many are connected, the one that has waited longest gives way. Nobody's slowness costs more than one small buffer.
"""

import asyncio
from dataclasses import dataclass, field
from typing import Any, ClassVar, cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

HEAD, TAKE = 10.0, 30.0
"""s for a request's head from its connection or the last answer on; and for taking anything at all of an answer."""
LOOK = 1.0
"""s between two looks."""
CHATTER, CHATTER_RATE = 8_192, 200.0
"""Bytes, and bytes per s more, that a listener may send: its handshake, answers to pings, its goodbye."""
MOST = 400
"""Connections, below the 1024 files that a process commonly may open."""


@dataclass(slots=True)
class _Seen:
    """What a look saw of a connection, and since when it has been so."""

    since: float
    doing: tuple[str, int] = ("", 0)


@dataclass(slots=True)
class Keeper:
    """All connections of a server."""

    seen: dict[asyncio.Transport, _Seen] = field(default_factory=dict)

    def opened(self, transport: asyncio.Transport) -> None:
        """Keep it; where there are too many, the one longest without a request is dropped."""
        if len(self.seen) >= MOST:
            order = ("head", "take", "busy")
            self.drop(min(self.seen, key=lambda t: (order.index(_doing(t)[0]), self.seen[t].since)))
        self.seen[transport] = _Seen(asyncio.get_running_loop().time(), ("head", 0))

    def look(self) -> None:
        """Drop whoever is late."""
        now = asyncio.get_running_loop().time()
        for transport, seen in list(self.seen.items()):
            doing = _doing(transport)
            if doing != seen.doing:
                seen.doing, seen.since = doing, now
            late = {"head": HEAD, "take": TAKE}.get(doing[0])
            if late is not None and now - seen.since > late:
                self.drop(transport)

    def drop(self, transport: asyncio.Transport) -> None:
        """At once, with what it has not taken."""
        self.seen.pop(transport, None)
        transport.abort()

    async def watch(self) -> None:
        """Look again and again."""
        while True:
            await asyncio.sleep(LOOK)
            self.look()


class Http(H11Protocol):
    """HTTP/1.1."""

    keeper: ClassVar[Keeper]

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Keep it."""
        super().connection_made(transport)
        self.keeper.opened(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self.keeper.seen.pop(self.transport, None)
        super().connection_lost(exc)

    @property
    def waits_for_head(self) -> bool:
        """Whether a request's head, or its rest, is what is missing."""
        idle = self.cycle is None or self.cycle.response_complete
        return idle and self.conn.their_state in (h11.IDLE, h11.DONE)


class WebSocket(WebSocketsSansIOProtocol):
    """A listener."""

    keeper: ClassVar[Keeper]
    _began: float | None = None
    _heard = 0

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self.keeper.seen.pop(self.transport, None)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Drop who talks much, before anything is made of it: each ping costs more to answer than to send."""
        now = self.loop.time()
        if self._began is None:
            self._began = now
        self._heard += len(data)
        if self._heard > CHATTER + CHATTER_RATE * (now - self._began):
            self.keeper.drop(self.transport)
            return
        super().data_received(data)

    def pause_writing(self) -> None:
        """Who doesn't take answers isn't read either: pings would pile up their pongs."""
        super().pause_writing()
        self.transport.pause_reading()

    def resume_writing(self) -> None:
        """Go on reading."""
        super().resume_writing()
        if not self.read_paused and not self.transport.is_closing():
            self.transport.resume_reading()


def protocols(keeper: Keeper) -> tuple[type[Http], type[WebSocket]]:
    """Both for one server: uvicorn makes them itself and hands nothing down, so they find their keeper in the class."""
    return type("KeptHttp", (Http,), {"keeper": keeper}), type("KeptWebSocket", (WebSocket,), {"keeper": keeper})


def _doing(transport: asyncio.Transport) -> tuple[str, int]:
    """What a connection is at: waiting for a head, giving (with what is left), or busy."""
    left = transport.get_write_buffer_size()
    if left:
        return "take", left
    protocol: Any = cast(Any, transport).get_protocol()
    return ("head", 0) if isinstance(protocol, Http) and protocol.waits_for_head else ("busy", 0)
