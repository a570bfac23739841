"""A table that an OPC UA server shows as an object: asyncua's client in a thread with a loop of its own.

Everything that tells the state is read in one request. A connection that was lost is opened again by the next call.
"""

import asyncio
import logging
import struct
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from math import degrees, isfinite, radians
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from asyncua import Client, Node, ua

from truestand.devices.axis import DriveState
from truestand.devices.tables.errors import lost, nonsense, refused
from truestand.devices.tables.recipe import OpcUaRecipe

T = TypeVar("T")
CONNECTING = 6
"""Timeouts that the whole of connecting may take: it is some twenty requests, each within one timeout."""
GRACE = 0.5
"""s more for the thread to answer."""
GONE = (
    ua.StatusCodes.BadConnectionClosed, ua.StatusCodes.BadSecureChannelClosed, ua.StatusCodes.BadSessionClosed,
    ua.StatusCodes.BadSessionIdInvalid, ua.StatusCodes.BadSecureChannelIdInvalid, ua.StatusCodes.BadTimeout,
    ua.StatusCodes.BadShutdown, ua.StatusCodes.BadServerHalted, ua.StatusCodes.BadNotConnected,
)  # fmt: skip
"""What a server says that leaves."""
NOT_READ = (ValueError, TypeError, LookupError, AttributeError, AssertionError, struct.error)
"""What asyncua raises at damaged answers, found by damaging them."""

logging.getLogger("asyncua").addHandler(logging.NullHandler())  # our own errors tell what goes wrong


@dataclass(frozen=True, slots=True)
class _Session:
    """The table's nodes."""

    table: Node
    methods: dict[str, Node]
    variables: list[Node]


class OpcUaTable:
    """A ``Drive``; safe to use from two threads."""

    def __init__(self, address: str, recipe: OpcUaRecipe, timeout: float) -> None:
        self.name = f"table at {address} (OPC UA)"
        self._address, self._recipe, self._timeout = address, recipe, timeout
        self._lock = threading.RLock()
        self._client: Client | None = None
        self._session: _Session | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread()
        self._task: asyncio.Task[Any] | None = None

    def start_home(self) -> None:
        """Begin to look for the home position."""
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
            before = time.monotonic()
            values = self._run(lambda: self._read(session.variables), self._timeout)
            after = time.monotonic()
        position, moving, homed, fault = values
        if not (isinstance(position, float | int) and isfinite(position) and isinstance(fault, str | None)):
            raise nonsense(self.name, f"position {position!r} and fault {fault!r}", "a number and a text")
        angle = radians(position) if self._recipe.unit == "deg" else float(position)
        return DriveState(angle, bool(moving), bool(homed), (before + after) / 2, (after - before) / 2, fault or "")

    def close(self) -> None:
        """Leave the server and end the thread."""
        with self._lock:
            self._drop(politely=True)

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
            self._session = self._run(self._connect, CONNECTING * self._timeout)
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
        return _Session(table, methods, [await of(name) for name in (r.position, r.moving, r.homed, r.fault)])

    def _run(self, work: Callable[[], Coroutine[Any, Any, T]], seconds: float) -> T:
        """Do it on the loop.

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
            if self._session is None or wrong.code in GONE:
                self._drop()
            if wrong.code in GONE:
                raise lost(self.name, f"it left ({type(wrong).__name__})") from wrong
            raise refused(self.name, type(wrong).__name__, ADVICE) from wrong
        except (ua.UaError, *NOT_READ) as wrong:
            self._drop()
            raise nonsense(self.name, repr(wrong)[:80], "an answer of OPC UA") from wrong

    def _on_loop(self, work: Callable[[], Coroutine[Any, Any, T]], seconds: float) -> T:
        """What comes of ``work``. No lock is held while waiting, so that an interrupt (Ctrl-C) leaves none behind."""
        assert self._loop is not None
        loop, done = self._loop, SimpleQueue[asyncio.Task[T]]()

        def begin() -> None:
            self._task = loop.create_task(work())
            self._task.add_done_callback(done.put)

        loop.call_soon_threadsafe(begin)
        try:
            return done.get(timeout=seconds + GRACE).result()
        except Empty as wrong:
            raise TimeoutError from wrong

    def _drop(self, politely: bool = False) -> None:
        """End connection and thread; only who is polite waits for the server to say goodbye, a timeout at most."""
        if self._loop is None:
            return
        with suppress(TimeoutError):
            self._on_loop(lambda: self._leave(politely), self._timeout)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(GRACE)
        if not self._thread.is_alive():
            self._loop.close()
        self._loop, self._client, self._session = None, None, None

    async def _read(self, variables: list[Node]) -> list[Any]:
        assert self._client is not None
        return await self._client.read_values(variables)

    async def _leave(self, politely: bool) -> None:
        if self._client is not None:
            if politely:
                with suppress(TimeoutError, OSError, ua.UaError):
                    await asyncio.wait_for(self._client.disconnect(), self._timeout)
            self._client.disconnect_socket()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.sleep(0)  # the socket closes in the loop's next round


ADVICE = "check the names in [devices.table.opcua] of stand.toml, and whether the controller is in a fault"
