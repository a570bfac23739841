"""Virtual tables on loopback, each behind one protocol, with a clock that runs faster than ours."""

import select
import socket
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace

from truestand.devices.axis import Axis
from truestand.devices.tables import TableRecipe, open_table
from truestand.sim.live.clock import Clock
from truestand.sim.live.grbl_server import GrblServer
from truestand.sim.live.modbus_server import ModbusServer
from truestand.sim.live.opcua_server import OpcUaServer
from truestand.sim.live.table import VirtualTable
from truestand.sim.live.zaber_server import ZaberServer

PACE = 20.0
SERVERS = {"modbus": ModbusServer, "zaber": ZaberServer, "grbl": GrblServer, "opcua": OpcUaServer}
ADDRESSES = {
    "modbus": "127.0.0.1:{port}",
    "zaber": "127.0.0.1:{port}",
    "grbl": "127.0.0.1:{port}",
    "opcua": "opc.tcp://127.0.0.1:{port}/truestand",
}


PATIENT = {"timeout_s": 5.0, "stop_timeout_s": 30.0}
"""For tests that aren't about time, on machines that are busy; virtual seconds are short."""
KEPT: list[OpcUaServer] = []
"""An OPC UA server is slow to start: a module keeps one with the default names, and gives it another table."""


@contextmanager
def served(protocol, motion=None, pace=PACE, tables=None, address=None, mortal=False, **limits):
    """A virtual table, its server, and the recipe that finds it; only what is ``mortal`` may be stopped."""
    virtual = VirtualTable(Clock(pace), motion)
    settings = {"protocol": protocol, **PATIENT, **limits, **({protocol: tables} if tables else {})}
    if protocol == "opcua" and not (mortal or tables):
        server = kept()
        server.table = virtual
        yield virtual, server, TableRecipe(address=server.address, **settings)
        virtual.halt()
        return
    wanted = TableRecipe(address=address or ADDRESSES[protocol].format(port=0), **settings)
    server = SERVERS[protocol](virtual, wanted)
    server.start()
    try:
        yield virtual, server, TableRecipe(address=server.address, **settings)
    finally:
        server.stop()


def kept() -> OpcUaServer:
    if not KEPT:
        recipe = TableRecipe(protocol="opcua", address=ADDRESSES["opcua"].format(port=0))
        KEPT.append(OpcUaServer(VirtualTable(Clock()), recipe))
        KEPT[0].start()
    return KEPT[0]


@contextmanager
def table_at(protocol, motion=None, pace=PACE, tables=None, mortal=False, **limits):
    """A virtual table, its server, and the table that the driver opens; waiting goes by the virtual clock."""
    with served(protocol, motion, pace, tables, mortal=mortal, **limits) as (virtual, server, recipe):
        table = on_virtual_time(open_table(recipe), virtual.clock)
        try:
            yield virtual, server, table
        finally:
            table.close()


def on_virtual_time(table: Axis, clock: Clock) -> Axis:
    return replace(table, clock=clock.now, sleep=lambda s: time.sleep(s / clock.pace))


def speed_of(virtual: VirtualTable, seconds: float) -> float:
    """rad/s, the mean over the last virtual ``seconds``."""
    now = virtual.clock.now()
    return float(virtual.angle_at(now) - virtual.angle_at(now - seconds)) / seconds


@contextmanager
def listener(answer):
    """A TCP server on loopback that gives ``answer(data)`` to whatever it hears; None = it keeps silent."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.05)
        ended = threading.Event()
        thread = threading.Thread(target=_listen, args=(server, answer, ended))
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            ended.set()
            thread.join()


def _listen(server, answer, ended):
    open_ = []
    while not ended.is_set():
        try:
            connection, _ = server.accept()
            connection.settimeout(0.01)
            open_.append(connection)
        except TimeoutError:
            pass
        for connection in open_:
            try:
                data = connection.recv(1000)
                reply = answer(data) if data else None
                if reply is not None:
                    connection.sendall(reply)
            except OSError:
                pass
    for connection in open_:
        connection.close()


class Relay:
    """Passes bytes on to a server, both ways, until it is ``frozen``: the connections stay, nothing moves.

    What the server says goes through ``spoil``.
    """

    def __init__(self, port, spoil=bytes):
        self._spoil = spoil
        self._servers = set()
        self._to = ("127.0.0.1", port)
        self.frozen = threading.Event()
        self._ended = threading.Event()
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()

    def _run(self):
        other = {}
        while not self._ended.is_set():
            ready = select.select([self._server, *(() if self.frozen.is_set() else other)], [], [], 0.01)[0]
            for end in ready:
                if end is self._server:
                    here, _ = self._server.accept()
                    try:
                        there = socket.create_connection(self._to)
                    except OSError:
                        here.close()
                        continue
                    other.update({here: there, there: here})
                    self._servers.add(there)
                elif end in other and not self.frozen.is_set():
                    data = received(end)
                    if data:
                        with suppress(OSError):
                            other[end].sendall(self._spoil(data) if end in self._servers else data)
                    else:
                        for gone in (other.pop(end), end):
                            other.pop(gone, None)
                            gone.close()
        for end in (*other, self._server):
            end.close()


def received(connection):
    try:
        return connection.recv(4096)
    except OSError:
        return b""
