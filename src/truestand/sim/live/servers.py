"""Servers in a thread of their own; those of lines of bytes listen on TCP or at a pseudo terminal.

Drivers take a pseudo terminal for a serial port.
"""

import asyncio
import os
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from types import TracebackType
from typing import Self

from truestand.devices.tables.recipe import host_and_port, is_network

START_TIMEOUT_S = 10.0
"""For a server to start or end."""
POLL_INTERVAL_S = 0.01
"""Between two checks for changes that a server reports unasked."""
TURNS_TO_CONNECT = 4
"""Of the loop: a task makes the transport, its protocol learns of it, another task begins to serve; one to spare."""
Send = Callable[[bytes], object]
Receive = Callable[[bytes], None]


async def close_port(server: asyncio.Server) -> None:
    """Accept nothing more, let what was accepted be connected, then close: asyncio forgets what is between the two."""
    with suppress(NotImplementedError):  # Windows
        for port in server.sockets:
            asyncio.get_running_loop().remove_reader(port.fileno())
    for _ in range(TURNS_TO_CONNECT):
        await asyncio.sleep(0)
    server.close()


class Service:
    """Something that is started and closed; also as a context."""

    def start(self) -> None:
        """Bind sockets and answer."""

    def close(self) -> None:
        """End everything, close all sockets."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class ServerThread:
    """A server with a thread and an event loop of its own; subclasses serve in ``_serve`` until ``_stopped`` is set."""

    def __init__(self) -> None:
        self.address = ""
        """Where a driver finds it, known once it started: the ``address`` of its recipe."""
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    async def _serve(self, started: threading.Event) -> None:
        raise NotImplementedError

    def start(self) -> None:
        """Serve from now on.

        Raises:
            OSError: the port is taken.
        """
        started = threading.Event()
        self._stopped.clear()
        self._thread = threading.Thread(target=self._run, args=(started,), name=type(self).__name__, daemon=True)
        self._thread.start()
        if not started.wait(START_TIMEOUT_S) or self._failure is not None:
            self.stop()
            raise OSError(f"{type(self).__name__}: can't serve ({self._failure or 'no start'})") from self._failure

    def stop(self) -> None:
        """Close the port and all connections."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(START_TIMEOUT_S)
            self._thread = None

    def _run(self, started: threading.Event) -> None:
        try:
            asyncio.run(self._serve(started))
        except (OSError, RuntimeError) as wrong:
            self._failure = wrong
            started.set()


class LineServer(ServerThread):
    """Serves at ``address``: host:port, port 0 = any; anything else is a pseudo terminal."""

    def __init__(self, address: str, port: int) -> None:
        super().__init__()
        self._requested, self._default_port = address, port
        self._clients: set[Send] = set()

    def _connected(self, send: Send) -> Receive:
        """The function that takes the bytes of a new client; ``send`` sends it answers."""
        raise NotImplementedError

    def _poll(self) -> None:
        """Report changes unasked."""

    async def _serve(self, started: threading.Event) -> None:
        close = await self._listen() if is_network(self._requested) else self._open_terminal()
        started.set()
        try:
            while not self._stopped.is_set():
                await asyncio.sleep(POLL_INTERVAL_S)
                self._poll()
        finally:
            await close()
            await asyncio.sleep(0)

    async def _listen(self) -> Callable[[], Awaitable[None]]:
        server = await asyncio.start_server(self._serve_client, *host_and_port(self._requested, self._default_port))
        host, port = server.sockets[0].getsockname()[:2]
        self.address = f"{host}:{port}"
        return partial(close_port, server)

    async def _serve_client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take what a client sends until it goes, or until the event loop ends."""
        self._clients.add(writer.write)
        receive = self._connected(writer.write)
        with suppress(ConnectionError, asyncio.CancelledError):  # the client is gone, or the server ends
            while data := await reader.read(4096):
                receive(data)
        self._clients.discard(writer.write)
        writer.transport.abort()

    def _open_terminal(self) -> Callable[[], Awaitable[None]]:
        """A pseudo terminal; this process keeps the driver's end open too, so that a driver may come and go."""
        import tty  # not on Windows

        server_end, driver_end = os.openpty()
        tty.setraw(driver_end)
        self.address = os.ttyname(driver_end)
        loop = asyncio.get_running_loop()

        def send(data: bytes) -> object:
            return os.write(server_end, data)

        self._clients.add(send)
        receive = self._connected(send)
        loop.add_reader(server_end, lambda: receive(os.read(server_end, 4096)))

        async def close() -> None:
            loop.remove_reader(server_end)
            self._clients.clear()
            os.close(server_end)
            os.close(driver_end)

        return close
