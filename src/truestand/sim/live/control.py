"""The virtual sensor's control channel: access rights, and the answer to each request. No sockets, no threads."""

from collections.abc import Callable
from dataclasses import dataclass

from truestand.devices.wire import gvcp
from truestand.devices.wire.gvcp import Acknowledge, Command, Register, Request, Resend, Status
from truestand.devices.wire.malformed import Malformed
from truestand.sim.live.registers import RegisterError, Registers

Address = tuple[str, int]
"""IPv4 address and port of a client."""

MAX_MEMORY_BYTES = 1024
"""In one READ_MEMORY."""


@dataclass(slots=True)
class Controller:
    """The client that holds control."""

    address: Address
    last_request: float
    """s: the time of its last request."""
    exclusive: bool


class Control:
    """Answers requests.

    Args:
        registers: the device's memory.
        released: called when control ends, with True where the heartbeat stopped.
        resend: called with the packets that PACKET_RESEND requests.
    """

    def __init__(
        self, registers: Registers, released: Callable[[bool], None], resend: Callable[[Resend], None]
    ) -> None:
        self.registers = registers
        self.controller: Controller | None = None
        self._released, self._resend = released, resend
        self._last_request: tuple[Address, int, int] | None = None
        self._last_answer = b""

    def answer(self, data: bytes, sender: Address, now: float) -> bytes | None:
        """The acknowledge for a datagram; None where it needs none or is no request. ``now`` in s, any origin."""
        try:
            request = gvcp.decode_request(data)
            held = self.controller
            if held is not None and held.address == sender:
                held.last_request = now
            if request.command == Command.PACKET_RESEND:
                self._resend(gvcp.decode_resend(request))
                return None
            if self._last_request == (sender, request.id, request.command) and request.command in _WRITES:
                return self._last_answer  # sent again because the answer got lost: not to be done twice
            status, body = self._execute(request, sender, now)
        except Malformed:
            return None
        self._last_request = (sender, request.id, request.command)
        self._last_answer = Acknowledge(request.command, request.id, body, status).encode()
        return self._last_answer if request.flags & gvcp.ACK_REQUIRED else None

    def expire(self, now: float) -> None:
        """End the control of a client whose heartbeat stopped for longer than the timeout."""
        held = self.controller
        if held is not None and now - held.last_request > self.registers.value(Register.HEARTBEAT) / 1000:
            self._end(heartbeat_lost=True)

    def _end(self, heartbeat_lost: bool) -> None:
        self.controller = None
        self.registers.put(Register.CONTROL, 0)
        self._released(heartbeat_lost)

    def _execute(self, request: Request, sender: Address, now: float) -> tuple[int, bytes]:
        """Status and body of the answer."""
        try:
            if request.command == Command.DISCOVERY:
                return Status.SUCCESS, self.registers.read(0, gvcp.DISCOVERY_BYTES)
            if request.command in _READS:
                return Status.SUCCESS, self._read(request, sender)
            if request.command in _WRITES:
                return Status.SUCCESS, self._write(request, sender, now)
            return Status.NOT_IMPLEMENTED, b""
        except RegisterError as refused:
            return refused.status, b""

    def _read(self, request: Request, sender: Address) -> bytes:
        held = self.controller
        if held is not None and held.exclusive and held.address != sender:
            raise RegisterError(Status.ACCESS_DENIED)
        words = gvcp.words(request.body)
        if request.command == Command.READ_REGISTER:
            return b"".join(self.registers.read(address, 4) for address in words)
        if len(words) != 2 or not 0 < words[1] <= MAX_MEMORY_BYTES:
            raise RegisterError(Status.INVALID_PARAMETER)
        return request.body[:4] + self.registers.read(words[0], words[1])

    def _write(self, request: Request, sender: Address, now: float) -> bytes:
        words = gvcp.words(request.body)
        if request.command == Command.WRITE_REGISTER:
            if len(words) % 2:
                raise RegisterError(Status.INVALID_PARAMETER)
            for address, value in zip(words[::2], words[1::2], strict=True):
                self._write_word(address, value, sender, now)
            return (len(words) // 2).to_bytes(4, "big")
        if not words:
            raise RegisterError(Status.INVALID_PARAMETER)
        self._demand_control(sender)
        if words[0] <= Register.CONTROL < words[0] + len(request.body) - 4:
            raise RegisterError(Status.WRITE_PROTECT)  # control is taken by WRITE_REGISTER
        self.registers.write_memory(words[0], request.body[4:])
        return (len(request.body) - 4).to_bytes(4, "big")

    def _write_word(self, address: int, value: int, sender: Address, now: float) -> None:
        if address != Register.CONTROL:
            self._demand_control(sender)
            self.registers.write(address, value)
            return
        held = self.controller
        if held is not None and held.address != sender:
            raise RegisterError(Status.ACCESS_DENIED)
        self.registers.write(address, value)
        if value:
            self.controller = Controller(sender, now, bool(value & gvcp.EXCLUSIVE))
        elif held is not None:
            self._end(heartbeat_lost=False)

    def _demand_control(self, sender: Address) -> None:
        if self.controller is None or self.controller.address != sender:
            raise RegisterError(Status.ACCESS_DENIED)


_READS = (Command.READ_REGISTER, Command.READ_MEMORY)
_WRITES = (Command.WRITE_REGISTER, Command.WRITE_MEMORY)
