"""The memory of the virtual sensor: registers of GigE Vision and of a scanCONTROL, the description. No sockets."""

import ipaddress
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from truestand.devices.wire.gvcp import (
    CONTROL,
    DO_NOT_FRAGMENT,
    EXCLUSIVE,
    FIRE_TEST,
    RESEND_SUPPORTED,
    TEXT_BYTES,
    Register,
    Status,
)
from truestand.devices.wire.gvsp import PixelFormat
from truestand.sim.live.scancontrol_frames import FrameFormat, default_format

TICKS_PER_S = 1_000_000_000
DEFAULT_HEARTBEAT_MS = 3000
"""Of the standard."""
MIN_PACKET_BYTES, MAX_PACKET_BYTES, DEFAULT_PACKET_BYTES = 220, 16404, 1500
BOOTSTRAP_BYTES, DESCRIPTION_ADDRESS = 0x1000, 0x00100000
DEFAULT_POINTS, DEFAULT_PROFILES = 640, 20
MAX_TIME_10US = 4095
"""Of exposure and idle time, in 10 us."""
TIME_UNIT_S = 1e-5


class DeviceRegister(IntEnum):
    """Registers of the virtual sensor; those from 0xf0f00000 on are a scanCONTROL's own."""

    ACQUISITION_MODE = 0xA000
    ACQUISITION_START = 0xA004
    ACQUISITION_STOP = 0xA008
    PIXEL_FORMAT = 0xA00C
    PAYLOAD_SIZE = 0xA010
    TRANSMISSION = 0xA014
    FAULT = 0xA100
    MOUNTED = 0xA104
    LOSS = 0xA108
    """Share of packets to lose, 1/1000; read when FAULT is written."""
    LATENCY = 0xA10C
    """ms by which to send frames later; read when FAULT is written."""
    IDLE = 0xF0F00800
    REARRANGEMENT = 0xF0F0080C
    EXPOSURE = 0xF0F0081C
    LASER = 0xF0F00824
    TRIGGER = 0xF0F00830
    MAINTENANCE = 0xF0F0088C
    DIGITAL_IO = 0xF0F008C0
    SIZE = 0xF0E0070C


PROFILE, CONTAINER = 0, 1
"""Values of TRANSMISSION. A sensor starts up with PROFILE, which the virtual one can't stream."""
LASER_OFF, LASER_FULL = 0, 2
EXTERNAL, TRIGGER_MODE, TRIGGER_BY_ENCODER = 1 << 25, 3 << 16, 3 << 16
"""Bits of TRIGGER: wait for a trigger; mask of its kind; steps of the encoder."""
ENCODER_ACTIVE = 1 << 3
"""Bit of MAINTENANCE: the stamps hold the encoder's count, not the state of the digital inputs (here 0)."""

WRITABLE: dict[int, tuple[int, int]] = {
    Register.HEARTBEAT: (500, 600_000),
    Register.TIMESTAMP_CONTROL: (0, 3),
    Register.CONTROL: (0, EXCLUSIVE | CONTROL),
    Register.STREAM_PORT: (0, 0xFFFFFFFF),
    Register.STREAM_PACKET_SIZE: (0, 0xFFFFFFFF),
    Register.STREAM_DELAY: (0, 0xFFFFFFFF),
    Register.STREAM_ADDRESS: (0, 0xFFFFFFFF),
    DeviceRegister.ACQUISITION_MODE: (0, 0),
    DeviceRegister.ACQUISITION_START: (0, 1),
    DeviceRegister.ACQUISITION_STOP: (0, 1),
    DeviceRegister.PIXEL_FORMAT: (PixelFormat.MONO16, PixelFormat.MONO16),
    DeviceRegister.TRANSMISSION: (PROFILE, CONTAINER),
    DeviceRegister.FAULT: (0, 255),
    DeviceRegister.MOUNTED: (0, 1),
    DeviceRegister.LOSS: (0, 1000),
    DeviceRegister.LATENCY: (0, 60_000),
    DeviceRegister.IDLE: (1, MAX_TIME_10US),
    DeviceRegister.REARRANGEMENT: (0, 0xFFFFFFFF),
    DeviceRegister.EXPOSURE: (1, MAX_TIME_10US),
    DeviceRegister.LASER: (LASER_OFF, LASER_FULL),
    DeviceRegister.TRIGGER: (0, 0xFFFFFFFF),
    DeviceRegister.MAINTENANCE: (0, 0xFFFFFFFF),
    DeviceRegister.DIGITAL_IO: (0, 0xFFFFFFFF),
    DeviceRegister.SIZE: (0, 0xFFFFFFFF),
}
"""Lowest and highest value of each register that can be written."""
LOCKED_WHILE_STREAMING = (
    DeviceRegister.REARRANGEMENT, DeviceRegister.SIZE, DeviceRegister.TRANSMISSION, DeviceRegister.PIXEL_FORMAT,
    DeviceRegister.ACQUISITION_MODE,
)  # fmt: skip


class RegisterError(Exception):
    """A read or write that the device refuses; never leaves ``sim.live``."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


@dataclass(frozen=True, slots=True)
class Identity:
    """Identification of the device."""

    address: str
    """IPv4."""
    model: str = "scanCONTROL 29xx-50"
    serial: str = "V0000001"
    name: str = ""
    """Defined by the user."""


class Registers:
    """The device's memory.

    ``on_write`` maps an address to what happens before a new value is stored; it may refuse it with ``RegisterError``.
    ``on_read`` gives the value of a register that changes by itself.
    """

    def __init__(self, identity: Identity, description: bytes, points: int = DEFAULT_POINTS) -> None:
        self.on_write: dict[int, Callable[[int], None]] = {}
        self.on_read: dict[int, Callable[[], int]] = {}
        self.streaming = False
        self._words: dict[int, int] = dict.fromkeys((*range(0, BOOTSTRAP_BYTES, 4), *DeviceRegister), 0)
        self._bootstrap(identity, len(description))
        self._put_bytes(DESCRIPTION_ADDRESS, description)
        initial = default_format(points, DEFAULT_PROFILES)
        self._words.update(
            {
                DeviceRegister.PIXEL_FORMAT: PixelFormat.MONO16,
                DeviceRegister.REARRANGEMENT: initial.rearrangement,
                DeviceRegister.SIZE: initial.width << 16 | initial.height,
                DeviceRegister.EXPOSURE: 100,
                DeviceRegister.IDLE: 400,
                DeviceRegister.PAYLOAD_SIZE: initial.frame_bytes,
            }
        )

    def _bootstrap(self, identity: Identity, size: int) -> None:
        ip = int(ipaddress.IPv4Address(identity.address))
        for address, value in (
            (Register.VERSION, 0x00010002),
            (Register.DEVICE_MODE, 0x80000001),
            (Register.MAC_HIGH, 0x0200),  # locally administered
            (Register.MAC_LOW, ip),
            (0x0010, 0x80000004),
            (0x0014, 0x00000004),
            (Register.CURRENT_IP, ip),
            (0x0034, 0xFF000000),
            (Register.INTERFACES, 1),
            (Register.STREAM_CHANNELS, 1),
            (Register.CAPABILITY, 1 << 31 | 1 << 30 | RESEND_SUPPORTED | 0b11),
            (Register.HEARTBEAT, DEFAULT_HEARTBEAT_MS),
            (Register.TICKS_LOW, TICKS_PER_S),
            (Register.STREAM_PACKET_SIZE, DEFAULT_PACKET_BYTES),
        ):
            self.put(address, value)
        for register, text in (
            (Register.MANUFACTURER, "truestand (virtual)"),
            (Register.MODEL, identity.model),
            (Register.DEVICE_VERSION, "1.0"),
            (Register.MANUFACTURER_INFO, "simulated"),
            (Register.SERIAL, identity.serial),
            (Register.USER_NAME, identity.name),
            (Register.FIRST_URL, f"Local:truestand_virtual.xml;{DESCRIPTION_ADDRESS:x};{size:x}"),
        ):
            self._put_bytes(register, text.encode()[: TEXT_BYTES[register] - 1])

    def value(self, address: int) -> int:
        """The value of a register.

        Raises:
            RegisterError: there is none.
        """
        return int.from_bytes(self.read(address, 4), "big")

    def put(self, address: int, value: int) -> None:
        """Set a register from within the device: no limits, no action."""
        self._words[address] = value

    def _put_bytes(self, address: int, data: bytes) -> None:
        """Set registers from within the device; zeros fill up the last one."""
        for offset in range(0, len(data), 4):
            self.put(address + offset, int.from_bytes(data[offset : offset + 4].ljust(4, b"\0"), "big"))

    def read(self, address: int, count: int) -> bytes:
        """``count`` bytes.

        Raises:
            RegisterError: not there, or not on a boundary of four bytes.
        """
        if address % 4 or count % 4:
            raise RegisterError(Status.BAD_ALIGNMENT)
        try:
            return b"".join(self._word(at).to_bytes(4, "big") for at in range(address, address + count, 4))
        except KeyError:
            raise RegisterError(Status.INVALID_ADDRESS) from None

    def _word(self, address: int) -> int:
        return self.on_read[address]() if address in self.on_read else self._words[address]

    def write(self, address: int, value: int) -> None:
        """Write a register, and do what that brings about.

        Raises:
            RegisterError: not there, not to be written, not with this value, not now.
        """
        if address not in WRITABLE:
            self.read(address, 4)
            raise RegisterError(Status.WRITE_PROTECT)
        lowest, highest = WRITABLE[address]
        if not lowest <= value <= highest:
            raise RegisterError(Status.INVALID_PARAMETER)
        if self.streaming and address in LOCKED_WHILE_STREAMING:
            raise RegisterError(Status.BUSY)
        if address == Register.STREAM_PACKET_SIZE:
            value = value & FIRE_TEST | _packet_size(value)
        if address in self.on_write:
            self.on_write[address](value)
        self.put(address, value & ~FIRE_TEST if address == Register.STREAM_PACKET_SIZE else value)
        if address == DeviceRegister.SIZE:
            self.put(DeviceRegister.PAYLOAD_SIZE, self.format.frame_bytes)

    def write_memory(self, address: int, data: bytes) -> None:
        """Write registers one after the other, or the user-defined name.

        Raises:
            RegisterError: as ``write``.
        """
        if address % 4 or len(data) % 4:
            raise RegisterError(Status.BAD_ALIGNMENT)
        end = Register.USER_NAME + TEXT_BYTES[Register.USER_NAME]
        if address >= Register.USER_NAME and address + len(data) <= end:
            self._put_bytes(address, data)
            return
        for offset in range(0, len(data), 4):
            self.write(address + offset, int.from_bytes(data[offset : offset + 4], "big"))

    @property
    def format(self) -> FrameFormat:
        """Format of a frame."""
        size = self.value(DeviceRegister.SIZE)
        return FrameFormat(self.value(DeviceRegister.REARRANGEMENT), size >> 16, size & 0xFFFF)

    @property
    def timing(self) -> tuple[float, float]:
        """Exposure and idle time, s."""
        return self.value(DeviceRegister.EXPOSURE) * TIME_UNIT_S, self.value(DeviceRegister.IDLE) * TIME_UNIT_S


def _packet_size(value: int) -> int:
    """As the device stores it: bytes within its limits, a multiple of four; a test packet is requested only once."""
    size = min(max(value & 0xFFFF, MIN_PACKET_BYTES), MAX_PACKET_BYTES) & ~3
    return value & DO_NOT_FRAGMENT | size
