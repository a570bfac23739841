"""A server of bytes over TCP, or over a pseudo terminal that drivers take for a serial port."""

import asyncio
import os
import threading
from collections.abc import Callable
from typing import Protocol, cast

from truestand.devices.tables.recipe import host_and_port, is_network
from truestand.sim.live.serving import ServerThread

LOOK = 0.01
"""s between two looks at what happens by itself."""
Send = Callable[[bytes], object]


class Talk(Protocol):
    """One connection."""

    def hear(self, data: bytes) -> None:
        """Take what came."""


class LineServer(ServerThread):
    """Serves talks at ``address``: host:port, port 0 = any; anything else is a pseudo terminal."""

    def __init__(self, address: str, port: int) -> None:
        super().__init__()
        self._wanted, self._default = address, port
        self._talks: dict[Send, Talk] = {}

    def _talk(self, send: Send) -> Talk:
        raise NotImplementedError

    def _look(self) -> None:
        """Take the chance to say something unasked."""

    async def _serve(self, started: threading.Event) -> None:
        close = await self._listen() if is_network(self._wanted) else self._pretend()
        started.set()
        try:
            while not self._ended.is_set():
                await asyncio.sleep(LOOK)
                self._look()
        finally:
            close()
            await asyncio.sleep(0)

    async def _listen(self) -> Callable[[], None]:
        open_: set[asyncio.Transport] = set()
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: _Connection(self, open_), *host_and_port(self._wanted, self._default))
        host, port = server.sockets[0].getsockname()[:2]
        self.address = f"{host}:{port}"

        def close() -> None:
            server.close()
            for transport in tuple(open_):
                transport.abort()

        return close

    def _pretend(self) -> Callable[[], None]:
        """A pseudo terminal; our end of the other side stays open, so that a driver may come and go."""
        import tty  # not on Windows

        ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.address = os.ttyname(theirs)
        loop = asyncio.get_running_loop()

        def send(data: bytes) -> object:
            return os.write(ours, data)

        self._talks[send] = talk = self._talk(send)
        loop.add_reader(ours, lambda: talk.hear(os.read(ours, 4096)))

        def close() -> None:
            loop.remove_reader(ours)
            self._talks.clear()
            os.close(ours)
            os.close(theirs)

        return close


class _Connection(asyncio.Protocol):
    def __init__(self, server: LineServer, open_: set[asyncio.Transport]) -> None:
        self._server, self._open = server, open_

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self._open.add(self._transport)
        self._send = self._transport.write
        self._talk = self._server._talks[self._send] = self._server._talk(self._send)

    def data_received(self, data: bytes) -> None:
        self._talk.hear(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._open.discard(self._transport)
        self._server._talks.pop(self._send, None)
