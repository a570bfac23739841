"""The virtual table behind a PLC: Modbus TCP registers, served by pymodbus, with the register map of the recipe."""

import asyncio
import logging
import threading
from math import tau

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from truestand.devices.tables.recipe import PORTS, ControllerRecipe, host_and_port
from truestand.sim.live.servers import ServerThread, close_port
from truestand.sim.live.table import VirtualTable

HEARTBEAT_FAULT, OTHER_FAULT = 2, 1
"""Fault codes."""
POLL_INTERVAL_S = 0.05
"""Between two checks of the heartbeat."""

logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class ModbusServer(ServerThread):
    """Serves one table; after a first heartbeat, ``watchdog`` s without another stop the table with a fault."""

    def __init__(self, table: VirtualTable, recipe: ControllerRecipe, watchdog: float | None = None) -> None:
        super().__init__()
        self.table = table
        self.map = recipe.modbus
        self.watchdog = watchdog if self.map.heartbeat is not None else None
        self._address = host_and_port(recipe.address, PORTS["modbus"])
        self._command_number = 0
        self._heartbeat = 0
        self._heartbeat_time = 0.0

    async def _serve(self, started: threading.Event) -> None:
        top = max(self.map.command, self.map.target + 1, self.map.speed + 1, self.map.heartbeat or 0, self.map.status,
                  self.map.position + 1, self.map.fault_code)  # fmt: skip
        memory = SimData(0, count=top + 1, values=0, datatype=DataType.REGISTERS)
        device = SimDevice(id=self.map.unit, simdata=[memory], action=self._access)
        server = ModbusTcpServer(device, address=self._address)
        await server.serve_forever(background=True)
        port: asyncio.Server = server.transport  # type: ignore[assignment]
        self.address = "{}:{}".format(*port.sockets[0].getsockname()[:2])
        started.set()
        while not self._stopped.is_set():
            await asyncio.sleep(POLL_INTERVAL_S)
            self._check_heartbeat()
        await close_port(port)
        await server.shutdown()
        await asyncio.sleep(0)

    async def _access(
        self,
        function: int,
        first: int,
        address: int,
        count: int,
        memory: list[int],
        written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Before pymodbus reads or writes ``memory``: execute commands in what is written, put the status into it."""
        if written:
            values = [int(v) for v in written]
            after = memory[: address - first] + values + memory[address - first + len(values) :]
            self._execute(after, range(address, address + len(values)))
        self._write_status(memory)
        return None

    def _execute(self, memory: list[int], written: range) -> None:
        m = self.map
        if m.heartbeat is not None and m.heartbeat in written:
            beat = memory[m.heartbeat]
            if beat != self._heartbeat:
                self._heartbeat, self._heartbeat_time = beat, asyncio.get_running_loop().time()
        if m.command not in written or memory[m.command] >> 8 == self._command_number:
            return
        bits, self._command_number = memory[m.command] & 0xFF, memory[m.command] >> 8
        target, speed = self._angle(memory, m.target), self._angle(memory, m.speed)
        if bits & 8:
            self.table.halt()
        elif bits & 1:
            self.table.home()
        elif bits & 2:
            self.table.move(target, abs(speed))
        elif bits & 16:
            self._heartbeat_time = asyncio.get_running_loop().time()
            self.table.reset()

    def _angle(self, memory: list[int], register: int) -> float:
        """A number of 32 bit, in counts, as rad."""
        high, low = memory[register], memory[register + 1]
        if self.map.words == "low-first":
            high, low = low, high
        return ((high << 16 | low) - (1 << 32 if high & 0x8000 else 0)) * tau / self.map.counts_per_turn

    def _write_status(self, memory: list[int]) -> None:
        m, status = self.map, self.table.status()
        memory[m.status] = (
            self._command_number << 8 | int(status.homed) | int(status.moving) << 1 | (1 << 2 if status.fault else 0)
        )
        counts = round(status.position * m.counts_per_turn / tau) & 0xFFFFFFFF
        words = (counts >> 16, counts & 0xFFFF)
        memory[m.position], memory[m.position + 1] = words if m.words == "high-first" else words[::-1]
        memory[m.fault_code] = (
            0 if not status.fault else HEARTBEAT_FAULT if "heartbeat" in status.fault else OTHER_FAULT
        )

    def _check_heartbeat(self) -> None:
        silent = asyncio.get_running_loop().time() - self._heartbeat_time
        if self.watchdog is not None and self._heartbeat and silent > self.watchdog and self.table.status().moving:
            self.table.trip("heartbeat lost")
