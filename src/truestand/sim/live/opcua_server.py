"""The virtual table as an object of an OPC UA server, with the names of the recipe."""

import asyncio
import gc
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import degrees, radians
from urllib.parse import urlsplit

from asyncua import Node, Server, ua

from truestand.devices.tables.recipe import TableRecipe
from truestand.sim.live.serving import ServerThread
from truestand.sim.live.table import VirtualTable

PUBLISH = 0.1
"""s between two news to subscribers; who reads gets what is true now."""
Value = float | bool | str
Method = Callable[..., bool | None]

logging.getLogger("asyncua").addHandler(logging.NullHandler())  # our own errors tell what goes wrong


class OpcUaServer(ServerThread):
    """Serves one table without security, as a machine's inner network does.

    It takes about a second to start: asyncua builds the whole standard address space. ``table`` may be changed while
    it runs.
    """

    def __init__(self, table: VirtualTable, recipe: TableRecipe) -> None:
        super().__init__()
        self.table, self.map = table, recipe.opcua
        self._url = recipe.address
        self._degrees = self.map.unit == "deg"

    async def _serve(self, started: threading.Event) -> None:
        server = Server()
        with _no_collection():
            await server.init()
        server.set_endpoint(self._url)
        server.set_server_name("truestand virtual table")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        shown = await self._build(server)
        async with server:
            url = urlsplit(self._url)
            assert server.bserver is not None
            self.address = f"opc.tcp://{url.hostname}:{server.bserver.port}{url.path}"
            started.set()
            while not self._ended.is_set():
                for node, value in shown:
                    await node.write_value(ua.DataValue(_variant(value())))
                    _answer(server, node, value)
                await asyncio.sleep(PUBLISH)

    async def _build(self, server: Server) -> list[tuple[Node, Callable[[], Value]]]:
        """The object; returns its variables and what they show."""
        m = self.map
        space = await server.register_namespace(m.namespace)
        place = server.nodes.objects
        for part in m.object.split("/"):
            place = await place.add_object(space, part)
        methods: list[tuple[str, Method, int]] = [
            (m.home, lambda: self.table.home(), 0),
            (m.move, lambda target, speed: self.table.move(self._in(target), self._in(speed)), 2),
            (m.halt, lambda: self.table.halt(), 0),
            (m.reset, lambda: self.table.reset(), 0),
        ]
        for name, do, count in methods:
            await place.add_method(space, name, _method(do, count), [ua.VariantType.Double] * count, [])
        variables: list[tuple[str, Callable[[], Value]]] = [
            (m.position, lambda: self._out(self.table.status().position)),
            (m.moving, lambda: self.table.status().moving),
            (m.homed, lambda: self.table.status().homed),
            (m.fault, lambda: self.table.status().fault),
        ]
        return [(await place.add_variable(space, name, _variant(value())), value) for name, value in variables]

    def _in(self, value: float) -> float:
        return radians(value) if self._degrees else value

    def _out(self, angle: float) -> float:
        return degrees(angle) if self._degrees else angle


@contextmanager
def _no_collection() -> Iterator[None]:
    """While the address space is built: looking for garbage in it takes as long again, and there is none."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _variant(value: Value) -> ua.Variant:
    kind = ua.VariantType.Boolean if isinstance(value, bool) else None
    return ua.Variant(value, kind or (ua.VariantType.String if isinstance(value, str) else ua.VariantType.Double))


def _answer(server: Server, node: Node, value: Callable[[], Value]) -> None:
    """Who reads ``node`` gets what ``value`` says then; a value that is written takes this away."""
    server.set_attribute_value_callback(node.nodeid, lambda *_: ua.DataValue(_variant(value())), ua.AttributeIds.Value)


def _method(do: Method, count: int) -> Callable[..., ua.StatusCode | list[ua.Variant]]:
    def call(parent: ua.NodeId, *arguments: ua.Variant) -> ua.StatusCode | list[ua.Variant]:
        if len(arguments) != count or not all(isinstance(a.Value, float) for a in arguments):
            return _refusal(ua.StatusCodes.BadInvalidArgument)
        taken = do(*(a.Value for a in arguments))
        return [] if taken is not False else _refusal(ua.StatusCodes.BadInvalidState)

    return call


def _refusal(code: int) -> ua.StatusCode:
    return ua.StatusCode(ua.UInt32(code))
