"""A table as an object of an OPC UA server: asyncua's client in a thread with an event loop of its own.

All variables of the state are read in one request. A connection that was lost is opened again by the next call.
"""

import asyncio
import logging
import struct
import threading
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from math import degrees, isfinite, radians
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from asyncua import Client, Node, ua

from truestand.devices.axis import DriveState, lost, malformed, refused, timed
from truestand.devices.tables.recipe import OpcUaRecipe

T = TypeVar("T")
CONNECT_TIMEOUTS = 6
"""That connecting as a whole may take: it is some twenty requests, each within one timeout."""
THREAD_MARGIN_S = 0.5
"""For the thread to answer."""
DISCONNECTED = (
    ua.StatusCodes.BadConnectionClosed, ua.StatusCodes.BadSecureChannelClosed, ua.StatusCodes.BadSessionClosed,
    ua.StatusCodes.BadSessionIdInvalid, ua.StatusCodes.BadSecureChannelIdInvalid, ua.StatusCodes.BadTimeout,
    ua.StatusCodes.BadShutdown, ua.StatusCodes.BadServerHalted, ua.StatusCodes.BadNotConnected,
)  # fmt: skip
"""Status codes of a server that ended the connection."""
DECODING_ERRORS = (ValueError, TypeError, LookupError, AttributeError, AssertionError, struct.error)
"""Of asyncua at damaged answers, found by tests that damage them."""

logging.getLogger("asyncua").addHandler(logging.NullHandler())  # our own errors say what goes wrong


@dataclass(frozen=True, slots=True)
class _Session:
    """A connection and the table's nodes."""

    client: Client
    table: Node
    methods: dict[str, Node]
    variables: list[Node]


class OpcUaTable:
    """A ``Drive``; safe to use from two threads."""

    def __init__(self, address: str, recipe: OpcUaRecipe, timeout: float, what: str = "table") -> None:
        self.name = f"{what} at {address} (OPC UA)"
        self._address, self._recipe, self._timeout = address, recipe, timeout
        self._lock = threading.RLock()
        self._client: Client | None = None
        self._session: _Session | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread()
        self._task: asyncio.Task[Any] | None = None

    def start_home(self) -> None:
        """Begin to search for the home position."""
        self._call(self._recipe.home)

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move to ``position`` (rad) at ``speed`` (rad/s) and stop there."""
        self._call(self._recipe.move, self._out(position), self._out(speed))

    def halt(self) -> None:
        """Begin to slow down to rest."""
        self._call(self._recipe.halt)

    def reset(self) -> None:
        """Clear the controller's fault."""
        self._call(self._recipe.reset)

    def state(self) -> DriveState:
        """Ask the server."""
        with self._lock:
            session = self._connected()
            values, asked, half_width = timed(
                self._run, lambda: session.client.read_values(session.variables), self._timeout
            )
        position, moving, homed, fault = values
        if not (isinstance(position, float | int) and isfinite(position) and isinstance(fault, str | None)):
            raise malformed(self.name, f"position {position!r} and fault {fault!r}", "a number and a text")
        angle = radians(position) if self._recipe.unit == "deg" else float(position)
        return DriveState(angle, bool(moving), bool(homed), asked, half_width, fault or "")

    def close(self) -> None:
        """Close the session and end the thread."""
        with self._lock:
            self._drop(disconnect=True)

    def _out(self, angle: float) -> ua.Variant:
        value = degrees(angle) if self._recipe.unit == "deg" else angle
        return ua.Variant(value, ua.VariantType.Double)

    def _call(self, method: str, *arguments: ua.Variant) -> None:
        with self._lock:
            session = self._connected()
            node = session.methods[method].nodeid
            self._run(lambda: session.table.call_method(node, *arguments), self._timeout)

    def _connected(self) -> _Session:
        if self._session is None:
            self._loop = asyncio.new_event_loop()
            self._thread = threading.Thread(target=self._loop.run_forever, name=self.name, daemon=True)
            self._thread.start()
            self._session = self._run(self._connect, CONNECT_TIMEOUTS * self._timeout)
        return self._session

    async def _connect(self) -> _Session:
        """A session, with the nodes that the recipe names."""
        r = self._recipe
        client = self._client = Client(self._address, timeout=self._timeout)
        await client.connect()
        try:
            space = await client.get_namespace_index(r.namespace)
        except ValueError as wrong:
            raise refused(self.name, f"it knows no namespace {r.namespace!r}", ADVICE) from wrong
        table = await client.nodes.objects.get_child([f"{space}:{part}" for part in r.object.split("/")])

        async def of(name: str) -> Node:
            return await table.get_child(f"{space}:{name}")

        methods = {name: await of(name) for name in (r.home, r.move, r.halt, r.reset)}
        return _Session(client, table, methods, [await of(name) for name in (r.position, r.moving, r.homed, r.fault)])

    def _run(self, work: Callable[[], Coroutine[Any, Any, T]], seconds: float) -> T:
        """The result of ``work`` on the event loop, within so many seconds.

        Raises:
            DeviceLost: silence, or a broken connection.
            DeviceError: refused, or an answer that is none.
        """
        try:
            return self._on_loop(lambda: asyncio.wait_for(work(), seconds), seconds)
        except (TimeoutError, OSError) as wrong:
            self._drop()
            raise lost(self.name, f"no answer within {self._timeout:g} s") from wrong
        except ua.UaStatusCodeError as wrong:
            if self._session is None or wrong.code in DISCONNECTED:
                self._drop()
            if wrong.code in DISCONNECTED:
                raise lost(self.name, f"it left ({type(wrong).__name__})") from wrong
            raise refused(self.name, type(wrong).__name__, ADVICE) from wrong
        except (ua.UaError, *DECODING_ERRORS) as wrong:
            self._drop()
            raise malformed(self.name, repr(wrong)[:80], "an answer of OPC UA") from wrong

    def _on_loop(self, work: Callable[[], Coroutine[Any, Any, T]], seconds: float) -> T:
        """The result of ``work``. No lock is held while waiting, so that an interrupt (Ctrl-C) leaves none behind."""
        assert self._loop is not None
        loop, done = self._loop, SimpleQueue[asyncio.Task[T]]()

        def begin() -> None:
            self._task = loop.create_task(work())
            self._task.add_done_callback(done.put)

        loop.call_soon_threadsafe(begin)
        try:
            return done.get(timeout=seconds + THREAD_MARGIN_S).result()
        except Empty as wrong:
            raise TimeoutError from wrong

    def _drop(self, disconnect: bool = False) -> None:
        """End connection and thread; ``disconnect`` closes the session at the server first, a timeout at most."""
        if self._loop is None:
            return
        with suppress(TimeoutError):
            self._on_loop(lambda: self._leave(disconnect), self._timeout)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(THREAD_MARGIN_S)
        if not self._thread.is_alive():
            self._loop.close()
        self._loop, self._client, self._session = None, None, None

    async def _leave(self, disconnect: bool) -> None:
        if self._client is not None:
            if disconnect:
                with suppress(TimeoutError, OSError, ua.UaError):
                    await asyncio.wait_for(self._client.disconnect(), self._timeout)
            self._client.disconnect_socket()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.sleep(0)  # the socket closes in the loop's next round


ADVICE = "check the names in its opcua table, and whether the controller is in a fault"
