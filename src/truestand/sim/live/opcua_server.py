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

from truestand.devices.tables.recipe import ControllerRecipe
from truestand.sim.live.servers import ServerThread
from truestand.sim.live.table import VirtualTable

PUBLISH_INTERVAL_S = 0.1
"""Between two notifications of subscribers; a read gives the value of its moment."""
Value = float | bool | str
Method = Callable[..., bool | None]

logging.getLogger("asyncua").addHandler(logging.NullHandler())  # our own errors say what goes wrong


class OpcUaServer(ServerThread):
    """Serves one table without security, as within a machine's own network.

    It takes about a second to start: asyncua builds the whole standard address space. ``table`` may be changed while
    it runs.
    """

    def __init__(self, table: VirtualTable, recipe: ControllerRecipe) -> None:
        super().__init__()
        self.table, self.map = table, recipe.opcua
        self._url = recipe.address
        self._to_rad, self._from_rad = (radians, degrees) if self.map.unit == "deg" else (float, float)

    async def _serve(self, started: threading.Event) -> None:
        server = Server()
        with _no_garbage_collection():
            await server.init()
        server.set_endpoint(self._url)
        server.set_server_name("truestand virtual table")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        variables = await self._build(server)
        async with server:
            url = urlsplit(self._url)
            assert server.bserver is not None
            self.address = f"opc.tcp://{url.hostname}:{server.bserver.port}{url.path}"
            started.set()
            while not self._stopped.is_set():
                for node, value in variables:
                    await node.write_value(ua.DataValue(ua.Variant(value())))
                    _serve_reads(server, node, value)
                await asyncio.sleep(PUBLISH_INTERVAL_S)

    async def _build(self, server: Server) -> list[tuple[Node, Callable[[], Value]]]:
        """The object; returns its variables and the functions that give their values."""
        m = self.map
        space = await server.register_namespace(m.namespace)
        parent = server.nodes.objects
        for name in m.object.split("/"):
            parent = await parent.add_object(space, name)
        methods: list[tuple[str, Method, int]] = [
            (m.home, lambda: self.table.home(), 0),
            (m.move, lambda target, speed: self.table.move(self._to_rad(target), self._to_rad(speed)), 2),
            (m.halt, lambda: self.table.halt(), 0),
            (m.reset, lambda: self.table.reset(), 0),
        ]
        for name, call, count in methods:
            await parent.add_method(space, name, _method(call, count), [ua.VariantType.Double] * count, [])
        variables: list[tuple[str, Callable[[], Value]]] = [
            (m.position, lambda: self._from_rad(self.table.status().position)),
            (m.moving, lambda: self.table.status().moving),
            (m.homed, lambda: self.table.status().homed),
            (m.fault, lambda: self.table.status().fault),
        ]
        return [(await parent.add_variable(space, name, value()), value) for name, value in variables]


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """While the address space is built: a collection takes as long again, and there is no garbage."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def _serve_reads(server: Server, node: Node, value: Callable[[], Value]) -> None:
    """Answer reads of ``node`` with ``value`` at that moment; each write of a value takes this callback away."""
    server.set_attribute_value_callback(
        node.nodeid, lambda *_: ua.DataValue(ua.Variant(value())), ua.AttributeIds.Value
    )


def _method(function: Method, count: int) -> Callable[..., ua.StatusCode | list[ua.Variant]]:
    def call(parent: ua.NodeId, *arguments: ua.Variant) -> ua.StatusCode | list[ua.Variant]:
        if len(arguments) != count or not all(isinstance(a.Value, float) for a in arguments):
            return _refusal(ua.StatusCodes.BadInvalidArgument)
        taken = function(*(a.Value for a in arguments))
        return [] if taken is not False else _refusal(ua.StatusCodes.BadInvalidState)

    return call


def _refusal(code: int) -> ua.StatusCode:
    return ua.StatusCode(ua.UInt32(code))
