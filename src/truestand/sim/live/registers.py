"""The memory of the virtual sensor: bootstrap, its own and a scanCONTROL's registers, the description. No sockets."""

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

TICKS = 1_000_000_000
"""Per second."""
HEARTBEAT = 3000
"""ms; the standard's default."""
SMALLEST_PACKET, LARGEST_PACKET, FIRST_PACKET = 220, 16404, 1500
DESCRIPTION_AT = 0x00100000
LONGEST = 4095
"""Of exposure and idle time, in 10 us."""
TEN_US = 1e-5


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
"""What may be transmitted. A sensor wakes up with PROFILE, which the virtual one can't stream."""
LASER_OFF, LASER_FULL = 0, 2
EXTERNAL, TRIGGER_MODE, BY_ENCODER = 1 << 25, 3 << 16, 3 << 16
"""Of TRIGGER: wait for a trigger; of which kind; the encoder's steps."""
ENCODER_ACTIVE = 1 << 3
"""Of MAINTENANCE: the stamps hold the encoder's count, not the state of the digital inputs (here 0)."""

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
    DeviceRegister.IDLE: (1, LONGEST),
    DeviceRegister.REARRANGEMENT: (0, 0xFFFFFFFF),
    DeviceRegister.EXPOSURE: (1, LONGEST),
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
    """A read or write that the device does not do; never leaves ``sim.live``."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.name)
        self.status = status


@dataclass(frozen=True, slots=True)
class Identity:
    """What the device says of itself."""

    address: str
    """IPv4."""
    model: str = "scanCONTROL 29xx-50"
    serial: str = "V0000001"
    name: str = ""
    """Given by the user."""
    manufacturer: str = "truestand (virtual)"
    version: str = "1.0"


class Registers:
    """The device's memory.

    ``on_write`` maps an address to what happens before a new value is stored; it may refuse it with ``RegisterError``.
    ``on_read`` gives the value of a register that changes by itself.
    """

    def __init__(self, identity: Identity, description: bytes, points: int = 640, profiles: int = 20) -> None:
        self.on_write: dict[int, Callable[[int], None]] = {}
        self.on_read: dict[int, Callable[[], int]] = {}
        self.streaming = False
        self._description = description.ljust(-(-len(description) // 4) * 4, b"\0")
        self._low = bytearray(0x1000)
        self._words: dict[int, int] = dict.fromkeys(DeviceRegister, 0)
        self._bootstrap(identity, len(description))
        shape = default_format(points, profiles)
        self._words.update(
            {
                DeviceRegister.PIXEL_FORMAT: PixelFormat.MONO16,
                DeviceRegister.REARRANGEMENT: shape.rearrangement,
                DeviceRegister.SIZE: shape.width << 16 | shape.height,
                DeviceRegister.EXPOSURE: 100,
                DeviceRegister.IDLE: 400,
                DeviceRegister.PAYLOAD_SIZE: shape.frame_bytes,
            }
        )

    def _bootstrap(self, identity: Identity, size: int) -> None:
        address = int(ipaddress.IPv4Address(identity.address))
        for where, value in (
            (Register.VERSION, 0x00010002),
            (Register.DEVICE_MODE, 0x80000001),
            (Register.MAC_HIGH, 0x0200),  # locally administered
            (Register.MAC_LOW, address),
            (0x0010, 0x80000004),
            (0x0014, 0x00000004),
            (Register.CURRENT_IP, address),
            (0x0034, 0xFF000000),
            (Register.INTERFACES, 1),
            (Register.STREAM_CHANNELS, 1),
            (Register.CAPABILITY, 1 << 31 | 1 << 30 | RESEND_SUPPORTED | 0b11),
            (Register.HEARTBEAT, HEARTBEAT),
            (Register.TICKS_LOW, TICKS),
            (Register.STREAM_PACKET_SIZE, FIRST_PACKET),
        ):
            self.put(where, value)
        for register, text in (
            (Register.MANUFACTURER, identity.manufacturer),
            (Register.MODEL, identity.model),
            (Register.DEVICE_VERSION, identity.version),
            (Register.MANUFACTURER_INFO, "simulated"),
            (Register.SERIAL, identity.serial),
            (Register.USER_NAME, identity.name),
            (Register.FIRST_URL, f"Local:truestand_virtual.xml;{DESCRIPTION_AT:x};{size:x}"),
        ):
            raw = text.encode()[: TEXT_BYTES[register] - 1]
            self._low[register : register + TEXT_BYTES[register]] = raw.ljust(TEXT_BYTES[register], b"\0")

    def value(self, address: int) -> int:
        """A register as it stands.

        Raises:
            RegisterError: there is none.
        """
        return int.from_bytes(self.read(address, 4), "big")

    def put(self, address: int, value: int) -> None:
        """Set a register from within: no limits, nothing happens."""
        if address < len(self._low):
            self._low[address : address + 4] = value.to_bytes(4, "big")
        else:
            self._words[address] = value

    def read(self, address: int, count: int) -> bytes:
        """``count`` bytes.

        Raises:
            RegisterError: not there, or not on a boundary of four bytes.
        """
        if address % 4 or count % 4:
            raise RegisterError(Status.BAD_ALIGNMENT)
        if address + count <= len(self._low):
            return bytes(self._low[address : address + count])
        offset = address - DESCRIPTION_AT
        if offset >= 0 and offset + count <= len(self._description):
            return self._description[offset : offset + count]
        try:
            return b"".join(self._word(at).to_bytes(4, "big") for at in range(address, address + count, 4))
        except KeyError:
            raise RegisterError(Status.INVALID_ADDRESS) from None

    def _word(self, address: int) -> int:
        return self.on_read[address]() if address in self.on_read else self._words[address]

    def write(self, address: int, value: int) -> None:
        """Write a register, and let happen what that brings about.

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
            self.put(DeviceRegister.PAYLOAD_SIZE, self.shape.frame_bytes)

    def write_memory(self, address: int, data: bytes) -> None:
        """Write registers one after the other, or the user's name.

        Raises:
            RegisterError: as ``write``.
        """
        if address % 4 or len(data) % 4:
            raise RegisterError(Status.BAD_ALIGNMENT)
        end = Register.USER_NAME + TEXT_BYTES[Register.USER_NAME]
        if address >= Register.USER_NAME and address + len(data) <= end:
            self._low[address : address + len(data)] = data
            return
        for offset in range(0, len(data), 4):
            self.write(address + offset, int.from_bytes(data[offset : offset + 4], "big"))

    @property
    def shape(self) -> FrameFormat:
        """What a frame consists of."""
        size = self.value(DeviceRegister.SIZE)
        return FrameFormat(self.value(DeviceRegister.REARRANGEMENT), size >> 16, size & 0xFFFF)

    @property
    def timing(self) -> tuple[float, float]:
        """Exposure and idle time, s."""
        return self.value(DeviceRegister.EXPOSURE) * TEN_US, self.value(DeviceRegister.IDLE) * TEN_US


def _packet_size(value: int) -> int:
    """As the device keeps it: bytes within its limits, a multiple of four; a test packet is asked for but once."""
    size = min(max(value & 0xFFFF, SMALLEST_PACKET), LARGEST_PACKET) & ~3
    return value & DO_NOT_FRAGMENT | size
