"""Servers of the virtual stand end what they accepted, however little of it was connected when they stopped."""

import gc
import socket
from contextlib import ExitStack

import pytest

from truestand.devices.tables.recipe import TableRecipe
from truestand.sim.live import modbus_server, servers
from truestand.sim.live.clock import Clock
from truestand.sim.live.stand import axis_server
from truestand.sim.live.table import VirtualTable

EACH_TURN = {"modbus": (modbus_server, "_check_heartbeat"), "zaber": (servers, "_poll")}
"""The module that waits between two calls of this method of its server."""


@pytest.mark.parametrize("turns", range(1, 6))
@pytest.mark.parametrize("protocol", EACH_TURN)
def test_a_client_that_comes_as_a_server_stops_leaves_nothing_open(protocol, turns, monkeypatch):
    module, each_turn = EACH_TURN[protocol]
    server = axis_server(VirtualTable(Clock(1.0)), TableRecipe(protocol=protocol, address="127.0.0.1:0"))
    gone = 0
    with ExitStack() as clients:

        def connect_then_stop():
            nonlocal gone
            if gone == 0:
                host, port = server.address.split(":")
                clients.enter_context(socket.create_connection((host, int(port))))
            gone += 1
            if gone == turns + 1:
                server._stopped.set()

        monkeypatch.setattr(module, "POLL_INTERVAL_S", 0.0)  # a turn of the loop each
        monkeypatch.setattr(server, each_turn, connect_then_stop)
        server.start()
        server._thread.join()
        server.stop()
    gc.collect()  # what is left open warns, and warnings are errors
