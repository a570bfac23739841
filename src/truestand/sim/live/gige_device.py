"""A virtual scanCONTROL: a GigE Vision device on a loopback address, which streams the profiles of its source.

Its control channel (access rights, the answer to each request) knows no sockets and no threads. Not a safety function,
and no model of a laser: with the laser off it sees nothing.
"""

import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from zlib import crc32

from truestand.core.errors import DeviceError, TruestandError
from truestand.devices.wire import gvcp
from truestand.devices.wire.gvcp import PORT, Acknowledge, Command, Register, Request, Resend, Status
from truestand.devices.wire.malformed import Malformed
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.genicam_xml import description
from truestand.sim.live.profile_source import SimulatedSource
from truestand.sim.live.registers import (
    CONTAINER,
    DEFAULT_POINTS,
    LASER_OFF,
    TICKS_PER_S,
    DeviceRegister,
    Identity,
    RegisterError,
    Registers,
)
from truestand.sim.live.servers import Service
from truestand.sim.live.streaming import StreamChannel, Streamer

Address = tuple[str, int]
"""IPv4 address and port of a client."""

MAX_MEMORY_BYTES = 1024
"""In one READ_MEMORY."""
POLL_INTERVAL_S = 0.02
"""Real time, between two checks of heartbeat and end."""
LATCH = 2
"""Bit of the register that controls the time stamp."""


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


class GigeDevice(Service):
    """One virtual sensor."""

    def __init__(
        self,
        identity: Identity,
        source: SimulatedSource,
        clock: Clock,
        faults: Faults | None = None,
        points: int = DEFAULT_POINTS,
        seed: int = 0,
    ) -> None:
        self.identity, self.clock, self.source = identity, clock, source
        self.faults = faults or Faults()
        self.registers = Registers(identity, description(identity.model), points)
        self.registers.on_write = {
            Register.STREAM_PACKET_SIZE: self._set_packet_size,
            Register.TIMESTAMP_CONTROL: self._latch_timestamp,
            DeviceRegister.ACQUISITION_START: self._start_stream,
            DeviceRegister.ACQUISITION_STOP: self._stop_stream,
            DeviceRegister.MOUNTED: self._mount,
            DeviceRegister.FAULT: self._begin_fault,
        }
        self.registers.on_read = {
            DeviceRegister.MOUNTED: lambda: int(self.source.part_mounted),
            DeviceRegister.FAULT: lambda: int(self.faults.latest),
        }
        self._seed = seed
        self._power_on = 3.0 + crc32(identity.serial.encode()) % 100_000 / 1000
        """s: the sensor's clock when the stand's shows 0; arbitrary, as that of a real one."""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def laser(self) -> int:
        """0 off, 1 reduced, 2 full."""
        return self.registers.value(DeviceRegister.LASER)

    @property
    def controlled(self) -> bool:
        """Whether a client holds control."""
        return self._control.controller is not None

    def start(self) -> None:
        """Bind the sockets and answer.

        Raises:
            DeviceError: the address is not this machine's, or taken.
        """
        address = self.identity.address
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((address, PORT))
        except OSError as wrong:
            self._socket.close()
            raise DeviceError(
                f"virtual sensor: can't listen at {address}:{PORT} ({wrong.strerror}); take another loopback address "
                "(127.0.0.x), or end the program that holds this one"
            ) from wrong
        self._socket.settimeout(POLL_INTERVAL_S)
        self.channel = StreamChannel(address, self.registers, self.faults, self._seed)
        self._streamer = Streamer(
            f"sensor {address}", self.clock, self.source, self.registers, self.channel, self._power_on
        )
        self._control = Control(self.registers, self._released, self.channel.resend)
        self._thread = threading.Thread(target=self._serve, name=f"control {address}")
        self._thread.start()

    def close(self) -> None:
        """End the stream, close the sockets."""
        if self._thread is None:
            return
        self._stop.set()
        self._thread.join()
        self._thread = None
        self._streamer.stop()
        self.channel.close()
        self._socket.close()

    def _serve(self) -> None:
        while not self._stop.is_set():
            self._control.expire(time.monotonic())
            try:
                data, sender = self._socket.recvfrom(2048)
            except OSError:  # nothing came in time, or an earlier answer met a closed port
                continue
            if FaultKind.UNPLUGGED in self.faults:
                continue
            if FaultKind.HEARTBEAT_IGNORED in self.faults and not _is_resend(data):
                continue
            answer = self._control.answer(data, sender, time.monotonic())
            if answer is not None:
                with suppress(OSError):  # the client is gone
                    self._socket.sendto(answer, sender)

    def _released(self, heartbeat_lost: bool) -> None:
        """Control ended: the stream ends; where the heartbeat was lost, the laser goes off too."""
        self._stop_stream(1)
        self.registers.put(Register.STREAM_PORT, 0)
        if heartbeat_lost:
            self.registers.put(DeviceRegister.LASER, LASER_OFF)

    def _start_stream(self, value: int) -> None:
        if not value:
            return
        if not self.registers.format.valid or self.registers.value(DeviceRegister.TRANSMISSION) != CONTAINER:
            raise RegisterError(Status.INVALID_PARAMETER)
        self._streamer.start()
        self.registers.streaming = True

    def _stop_stream(self, value: int) -> None:
        if value:
            self._streamer.stop()
            self.registers.streaming = False

    def _set_packet_size(self, value: int) -> None:
        if value & gvcp.FIRE_TEST:
            self.channel.fire_test(value)

    def _latch_timestamp(self, value: int) -> None:
        if value & LATCH:
            ticks = int((self.clock.now() + self._power_on) * TICKS_PER_S)
            self.registers.put(Register.TIMESTAMP_HIGH, ticks >> 32)
            self.registers.put(Register.TIMESTAMP_LOW, ticks & 0xFFFFFFFF)

    def _mount(self, value: int) -> None:
        try:
            self.source.mount(bool(value))
        except TruestandError:
            raise RegisterError(Status.INVALID_PARAMETER) from None

    def _begin_fault(self, value: int) -> None:
        strength = {
            FaultKind.LOSE_PACKETS: self.registers.value(DeviceRegister.LOSS) / 1000,
            FaultKind.LATENCY: self.registers.value(DeviceRegister.LATENCY),
        }
        try:
            kind = FaultKind(value)
            self.faults.begin(kind, strength.get(kind) or None)
        except (ValueError, TruestandError):
            raise RegisterError(Status.INVALID_PARAMETER) from None


def _is_resend(data: bytes) -> bool:
    return data[2:4] == gvcp.Command.PACKET_RESEND.to_bytes(2, "big")
