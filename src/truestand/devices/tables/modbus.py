"""A table behind a PLC: Modbus TCP. The register map is explained in ``ModbusRecipe``. All of pymodbus is here.

A command is a handshake: target and speed first, then the command word with the next number in its high byte, then
wait until the PLC repeats that number in its status. A connection that was lost is opened again by the next call, so
that a stop can still get through.
"""

import logging
import threading
import time
from collections.abc import Callable
from math import pi, tau
from struct import pack, unpack
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from truestand.core.errors import LimitExceeded
from truestand.devices.axis import DriveState, lost, malformed, refused, timed
from truestand.devices.tables.recipe import PORTS, ModbusRecipe, host_and_port

HOME, MOVE, HALT, RESET = 1, 2, 8, 16
"""Bits of the command word."""
HOMED, MOVING, FAULT = 1, 2, 4
"""Bits of the status word."""
HEARTBEAT_INTERVAL_S = 0.1
POLL_INTERVAL_S = 0.002
"""Between two questions whether a command was accepted."""

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # our own errors say what goes wrong


class ModbusTable:
    """A ``Drive``; safe to use from two threads."""

    def __init__(self, address: str, registers: ModbusRecipe, timeout: float, what: str = "table") -> None:
        self.name = f"{what} at {address} (Modbus TCP)"
        self._map = registers
        self._timeout = timeout
        self._lock = threading.RLock()
        self._received = 0
        self._heartbeat, self._heartbeat_time = 0, 0.0
        host, port = host_and_port(address, PORTS["modbus"])
        self._client = ModbusTcpClient(host, port=port, timeout=timeout, retries=0, trace_packet=self._count_received)

    def start_home(self) -> None:
        """Begin to search for the home position."""
        self._command(HOME)

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move to ``position`` (rad) at ``speed`` (rad/s) and stop there."""
        self._command(MOVE, (self._map.target, self._counts(position)), (self._map.speed, max(1, self._counts(speed))))

    def halt(self) -> None:
        """Begin to slow down to rest."""
        self._command(HALT)

    def reset(self) -> None:
        """Clear the PLC's fault."""
        self._command(RESET)

    def state(self) -> DriveState:
        """Ask the PLC; sends the heartbeat where there is one."""
        with self._lock:
            self._send_heartbeat()
            block, asked, half_width = timed(self._status)
        m = self._map
        word = block[m.status]
        (counts,) = unpack(">i", pack(">HH", *self._order(block[m.position], block[m.position + 1])))
        fault = f"fault {block[m.fault_code]} of the controller" if word & FAULT else ""
        return DriveState(
            counts * tau / m.counts_per_turn,
            bool(word & MOVING),
            bool(word & HOMED),
            asked,
            half_width,
            fault,
        )

    def close(self) -> None:
        """Close the connection."""
        with self._lock:
            self._client.close()

    def _command(self, bits: int, *numbers: tuple[int, int]) -> None:
        """Send a command, after its numbers (register, value), and wait until the PLC has accepted it."""
        with self._lock:
            for register, value in numbers:
                self._write(register, *self._order(*unpack(">HH", pack(">i", value))))
            number = (self._status()[self._map.status] >> 8) % 255 + 1
            self._write(self._map.command, number << 8 | bits)
            end = time.monotonic() + self._timeout
            while self._status()[self._map.status] >> 8 != number:
                if time.monotonic() > end:
                    raise refused(
                        self.name,
                        f"the PLC didn't repeat command number {number} in its status within {self._timeout:g} s",
                        "check that its program runs, and the map in its modbus table",
                    )
                time.sleep(POLL_INTERVAL_S)

    def _counts(self, angle: float) -> int:
        """Counts of an angle (rad) or speed (rad/s); what doesn't fit into 32 bit is refused."""
        counts = round(angle * self._map.counts_per_turn / tau)
        if not -(2**31) <= counts < 2**31:
            most = 2**31 / self._map.counts_per_turn
            raise LimitExceeded(
                f"{self.name}: found {angle / (2 * pi):.0f} turns, the register holds {most:.0f}; home first"
            )
        return counts

    def _order(self, first: int, second: int) -> tuple[int, int]:
        """High word and low word, to and from the order of the PLC."""
        return (first, second) if self._map.words == "high-first" else (second, first)

    def _send_heartbeat(self) -> None:
        now = time.monotonic()
        if self._map.heartbeat is not None and now - self._heartbeat_time >= HEARTBEAT_INTERVAL_S:
            self._heartbeat, self._heartbeat_time = self._heartbeat % 65535 + 1, now
            self._write(self._map.heartbeat, self._heartbeat)

    def _status(self) -> dict[int, int]:
        """The registers that the PLC writes, by address."""
        m = self._map
        used = (m.status, m.position, m.position + 1, m.fault_code)
        first, count = min(used), max(used) - min(used) + 1
        read = self._client.read_holding_registers if m.status_in == "holding" else self._client.read_input_registers
        answer = self._ask(lambda: read(first, count=count, device_id=m.unit))
        values = list(answer.registers)
        if len(values) != count:
            raise malformed(self.name, f"{len(values)} registers", f"{count}")
        return dict(enumerate(values, first))

    def _write(self, register: int, *values: int) -> None:
        self._ask(lambda: self._client.write_registers(register, list(values), device_id=self._map.unit))

    def _ask(self, question: Callable[[], Any]) -> Any:
        """One request and its answer.

        Raises:
            DeviceLost: silence, or a broken connection.
            DeviceError: an answer that is none, or an exception of Modbus.
        """
        self._received = 0
        try:
            answer = question()
        except (ModbusException, OSError) as wrong:
            self._client.close()
            if self._received:
                raise malformed(self.name, f"{self._received} bytes", "a Modbus answer") from wrong
            raise lost(self.name, f"no answer within {self._timeout:g} s") from wrong
        if answer.isError():
            raise refused(self.name, f"Modbus exception {answer.exception_code}", "check the map in its modbus table")
        return answer

    def _count_received(self, sending: bool, data: bytes) -> bytes:
        """Count the bytes received: none is no answer, some are a malformed one."""
        self._received += 0 if sending else len(data)
        return data
