"""The virtual table as a PLC would show it: Modbus TCP registers, served by pymodbus. The map is the recipe's."""

import asyncio
import logging
import threading
from math import tau

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from truestand.devices.tables.recipe import TableRecipe, host_and_port
from truestand.sim.live.serving import ServerThread
from truestand.sim.live.table import VirtualTable

LOST_HEARTBEAT, OTHER_FAULT = 2, 1
"""Fault codes."""
WATCH = 0.05
"""s between two looks at the heartbeat."""

logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class ModbusServer(ServerThread):
    """Serves one table; ``watchdog`` s without a new heartbeat stop it with a fault, once there was one."""

    def __init__(self, table: VirtualTable, recipe: TableRecipe, watchdog: float | None = None) -> None:
        super().__init__()
        self.table = table
        self.map = recipe.modbus
        self.watchdog = watchdog if self.map.heartbeat is not None else None
        self._where = host_and_port(recipe.address, 502)
        self._number = 0
        self._beat = 0
        self._beat_time = 0.0

    async def _serve(self, started: threading.Event) -> None:
        top = max(self.map.command, self.map.target + 1, self.map.speed + 1, self.map.heartbeat or 0, self.map.status,
                  self.map.position + 1, self.map.fault_code)  # fmt: skip
        memory = SimData(0, count=top + 1, values=0, datatype=DataType.REGISTERS)
        device = SimDevice(id=self.map.unit, simdata=[memory], action=self._act)
        server = ModbusTcpServer(device, address=self._where)
        await server.serve_forever(background=True)
        host, port = server.transport.sockets[0].getsockname()[:2]  # type: ignore[attr-defined]
        self.address = f"{host}:{port}"
        started.set()
        while not self._ended.is_set():
            await asyncio.sleep(WATCH)
            self._watch()
        await server.shutdown()
        await asyncio.sleep(0)

    async def _act(
        self,
        function: int,
        first: int,
        address: int,
        count: int,
        memory: list[int],
        written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Before pymodbus reads or writes ``memory``: take commands out of what is written, put the state into it."""
        if written:
            values = [int(v) for v in written]
            after = memory[: address - first] + values + memory[address - first + len(values) :]
            self._take(after, range(address, address + len(values)))
        self._show(memory)
        return None

    def _take(self, memory: list[int], touched: range) -> None:
        m = self.map
        if m.heartbeat is not None and m.heartbeat in touched:
            beat = memory[m.heartbeat]
            if beat != self._beat:
                self._beat, self._beat_time = beat, asyncio.get_running_loop().time()
        if m.command not in touched or memory[m.command] >> 8 == self._number:
            return
        bits, self._number = memory[m.command] & 0xFF, memory[m.command] >> 8
        target, speed = self._number_at(memory, m.target), self._number_at(memory, m.speed)
        if bits & 8:
            self.table.halt()
        elif bits & 1:
            self.table.home()
        elif bits & 2:
            self.table.move(target, abs(speed))
        elif bits & 16:
            self._beat_time = asyncio.get_running_loop().time()
            self.table.reset()

    def _number_at(self, memory: list[int], register: int) -> float:
        """Counts as rad."""
        high, low = memory[register], memory[register + 1]
        if self.map.words == "low-first":
            high, low = low, high
        return ((high << 16 | low) - (1 << 32 if high & 0x8000 else 0)) * tau / self.map.counts_per_turn

    def _show(self, memory: list[int]) -> None:
        m, status = self.map, self.table.status()
        memory[m.status] = (
            self._number << 8 | int(status.homed) | int(status.moving) << 1 | (1 << 2 if status.fault else 0)
        )
        counts = round(status.position * m.counts_per_turn / tau) & 0xFFFFFFFF
        words = (counts >> 16, counts & 0xFFFF)
        memory[m.position], memory[m.position + 1] = words if m.words == "high-first" else words[::-1]
        memory[m.fault_code] = 0 if not status.fault else LOST_HEARTBEAT if "heartbeat" in status.fault else OTHER_FAULT

    def _watch(self) -> None:
        silent = asyncio.get_running_loop().time() - self._beat_time
        if self.watchdog is not None and self._beat and silent > self.watchdog and self.table.status().moving:
            self.table.trip("heartbeat lost")
