"""A virtual scanCONTROL: a GigE Vision device on a loopback address, which streams what its source sees.

Not a safety function, and no model of a laser: with the laser off it sees nothing, that is all.
"""

import socket
import threading
import time
from types import TracebackType
from typing import Self
from zlib import crc32

from truestand.core.errors import DeviceError, TruestandError
from truestand.devices.wire import gvcp
from truestand.devices.wire.gvcp import PORT, Register, Status
from truestand.sim.live.clock import Clock
from truestand.sim.live.control import Control
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.genicam_xml import description
from truestand.sim.live.profile_source import Source
from truestand.sim.live.registers import CONTAINER, LASER_OFF, TICKS, DeviceRegister, Identity, RegisterError, Registers
from truestand.sim.live.stream_channel import StreamChannel
from truestand.sim.live.streamer import Streamer

LOOK = 0.02
"""Real s between two looks at heartbeat and end."""
LATCH, RESET = 2, 1
"""Bits of the register that controls the time stamp."""


class GigeDevice:
    """One virtual sensor. ``start`` binds its sockets, ``close`` leaves them; also as a context."""

    def __init__(
        self,
        identity: Identity,
        source: Source,
        clock: Clock,
        faults: Faults | None = None,
        points: int = 640,
        profiles: int = 20,
        seed: int = 0,
    ) -> None:
        self.identity, self.clock, self.source = identity, clock, source
        self.faults = faults or Faults()
        self.registers = Registers(identity, description(identity.model), points, profiles)
        self.registers.on_write = {
            Register.STREAM_PACKET_SIZE: self._set_packet_size,
            Register.TIMESTAMP_CONTROL: self._stamp,
            DeviceRegister.ACQUISITION_START: self._start_stream,
            DeviceRegister.ACQUISITION_STOP: self._stop_stream,
            DeviceRegister.MOUNTED: self._mount,
            DeviceRegister.FAULT: self._fault,
        }
        self.registers.on_read = {
            DeviceRegister.MOUNTED: lambda: int(self.source.mounted),
            DeviceRegister.FAULT: lambda: int(self.faults.latest),
        }
        self._seed = seed
        self._power_on = 3.0 + crc32(identity.serial.encode()) % 100_000 / 1000
        """What the sensor's own clock shows when the stand's shows 0: like a real one's, it means nothing."""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def frames(self) -> int:
        """Frames sent since the start."""
        return self._outlet.frames

    @property
    def resent(self) -> int:
        """Packets sent again since the start."""
        return self._outlet.resent

    @property
    def streaming(self) -> bool:
        """Whether it streams."""
        return self.registers.streaming

    @property
    def laser(self) -> int:
        """0 off, 1 reduced, 2 full."""
        return self.registers.value(DeviceRegister.LASER)

    @property
    def controlled(self) -> bool:
        """Whether somebody holds control."""
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
        self._socket.settimeout(LOOK)
        self._outlet = StreamChannel(address, self.registers, self.faults, self._seed)
        self._streamer = Streamer(
            f"sensor {address}", self.clock, self.source, self.registers, self._outlet, self._power_on
        )
        self._control = Control(self.registers, self._released, self._outlet.resend)
        self._thread = threading.Thread(target=self._serve, name=f"control {address}")
        self._thread.start()

    def close(self) -> None:
        """End stream and answers, leave the sockets."""
        if self._thread is None:
            return
        self._stop.set()
        self._thread.join()
        self._thread = None
        self._streamer.stop()
        self._outlet.close()
        self._socket.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _serve(self) -> None:
        while not self._stop.is_set():
            self._control.expire(time.monotonic())
            try:
                data, sender = self._socket.recvfrom(2048)
            except TimeoutError:
                continue
            except OSError:  # an earlier answer met a closed port
                continue
            if FaultKind.UNPLUGGED in self.faults:
                continue
            if FaultKind.HEARTBEAT_IGNORED in self.faults and not _is_resend(data):
                continue
            answer = self._control.answer(data, sender, time.monotonic())
            if answer is not None:
                self._answer(answer, sender)

    def _answer(self, answer: bytes, sender: tuple[str, int]) -> None:
        try:
            self._socket.sendto(answer, sender)
        except OSError:  # whoever asked is gone
            return

    def _released(self, silent: bool) -> None:
        """Control ended: the stream ends; where the controller fell silent, the laser goes off too."""
        self._stop_stream(1)
        self.registers.put(Register.STREAM_PORT, 0)
        if silent:
            self.registers.put(DeviceRegister.LASER, LASER_OFF)

    def _start_stream(self, value: int) -> None:
        if not value:
            return
        if not self.registers.shape.fits or self.registers.value(DeviceRegister.TRANSMISSION) != CONTAINER:
            raise RegisterError(Status.INVALID_PARAMETER)
        self._streamer.start()
        self.registers.streaming = True

    def _stop_stream(self, value: int) -> None:
        if value:
            self._streamer.stop()
            self.registers.streaming = False

    def _set_packet_size(self, value: int) -> None:
        if value & gvcp.FIRE_TEST:
            self._outlet.fire_test(value)

    def _stamp(self, value: int) -> None:
        if value & LATCH:
            ticks = int((self.clock.now() + self._power_on) * TICKS)
            self.registers.put(Register.TIMESTAMP_HIGH, ticks >> 32)
            self.registers.put(Register.TIMESTAMP_LOW, ticks & 0xFFFFFFFF)

    def _mount(self, value: int) -> None:
        try:
            self.source.mount(bool(value))
        except TruestandError:
            raise RegisterError(Status.INVALID_PARAMETER) from None

    def _fault(self, value: int) -> None:
        strength = {FaultKind.LOSE_PACKETS: DeviceRegister.LOSS, FaultKind.LATENCY: DeviceRegister.LATENCY}
        try:
            kind = FaultKind(value)
            of = strength.get(kind)
            given = self.registers.value(of) if of is not None else 0
            self.faults.begin(kind, (given / 1000 if kind is FaultKind.LOSE_PACKETS else given) or None)
        except (ValueError, TruestandError):
            raise RegisterError(Status.INVALID_PARAMETER) from None


def _is_resend(data: bytes) -> bool:
    return data[2:4] == gvcp.Command.PACKET_RESEND.to_bytes(2, "big")
