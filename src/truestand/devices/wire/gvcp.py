"""GigE Vision control protocol (GVCP): UDP messages to and from the device's port 3956, big endian.

Source: GigE Vision 1.2 as implemented and documented by open drivers (aravis, Wireshark's dissector); checked in the
tests against libaravis on both sides. Pure: no sockets here.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from truestand.devices.wire.malformed import Malformed

PORT = 3956
KEY = 0x42
MAX_DATA_BYTES = 536
"""Of memory in one READMEM or WRITEMEM, so that a message fits the smallest datagram that all must accept."""
ACK_REQUIRED = 0x01


class Command(IntEnum):
    """Commands; an acknowledge is its command plus one."""

    DISCOVERY = 0x0002
    PACKET_RESEND = 0x0040
    READ_REGISTER = 0x0080
    WRITE_REGISTER = 0x0082
    READ_MEMORY = 0x0084
    WRITE_MEMORY = 0x0086
    PENDING = 0x0088
    """Only its acknowledge (0x0089) is ever sent: the answer takes longer, by so many ms."""


class Status(IntEnum):
    """Status codes of an acknowledge."""

    SUCCESS = 0x0000
    NOT_IMPLEMENTED = 0x8001
    INVALID_PARAMETER = 0x8002
    INVALID_ADDRESS = 0x8003
    WRITE_PROTECT = 0x8004
    BAD_ALIGNMENT = 0x8005
    ACCESS_DENIED = 0x8006
    BUSY = 0x8007
    PACKET_UNAVAILABLE = 0x800C


class Register(IntEnum):
    """Bootstrap registers of every device."""

    VERSION = 0x0000
    DEVICE_MODE = 0x0004
    MAC_HIGH = 0x0008
    MAC_LOW = 0x000C
    CURRENT_IP = 0x0024
    MANUFACTURER = 0x0048
    MODEL = 0x0068
    DEVICE_VERSION = 0x0088
    MANUFACTURER_INFO = 0x00A8
    SERIAL = 0x00D8
    USER_NAME = 0x00E8
    FIRST_URL = 0x0200
    INTERFACES = 0x0600
    STREAM_CHANNELS = 0x0904
    CAPABILITY = 0x0934
    HEARTBEAT = 0x0938
    """ms."""
    TICKS_LOW = 0x0940
    """Ticks of the time stamp per second, lower half."""
    TIMESTAMP_CONTROL = 0x0944
    TIMESTAMP_HIGH = 0x0948
    TIMESTAMP_LOW = 0x094C
    CONTROL = 0x0A00
    """Control channel privilege (CCP)."""
    STREAM_PORT = 0x0D00
    """Host's port of stream channel 0; 0 closes it."""
    STREAM_PACKET_SIZE = 0x0D04
    """Bytes with IP, UDP and GVSP headers; bit 30 = do not fragment, bit 31 = send a test packet."""
    STREAM_DELAY = 0x0D08
    STREAM_ADDRESS = 0x0D18
    """Host's IPv4 address."""
    STREAM_SOURCE_PORT = 0x0D1C


TEXT_BYTES = {
    Register.MANUFACTURER: 32,
    Register.MODEL: 32,
    Register.DEVICE_VERSION: 32,
    Register.MANUFACTURER_INFO: 48,
    Register.SERIAL: 16,
    Register.USER_NAME: 16,
    Register.FIRST_URL: 512,
}
"""Length of the registers that hold text."""
FIRE_TEST = 1 << 31
DO_NOT_FRAGMENT = 1 << 30
EXCLUSIVE, CONTROL = 1, 2
"""Bits of the control channel privilege."""
RESEND_SUPPORTED = 1 << 2
"""Bit of CAPABILITY. The device answers PACKET_RESEND; written WRITEMEM is bit 1, several registers at once bit 0."""


@dataclass(frozen=True, slots=True)
class Request:
    """A command as it travels."""

    command: int
    id: int
    body: bytes = b""
    flags: int = ACK_REQUIRED

    def encode(self) -> bytes:
        """Header and body."""
        return struct.pack(">BBHHH", KEY, self.flags, self.command, len(self.body), self.id) + self.body


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """An answer as it travels; ``command`` is that of the request."""

    command: int
    id: int
    body: bytes = b""
    status: int = Status.SUCCESS

    def encode(self) -> bytes:
        """Header and body."""
        return struct.pack(">HHHH", self.status, self.command + 1, len(self.body), self.id) + self.body


def decode_request(data: bytes) -> Request:
    """A command.

    Raises:
        Malformed: too short, no key, or a length that isn't there.
    """
    if len(data) < 8 or data[0] != KEY:
        raise Malformed(f"found {data[:8].hex(' ')}, need a GVCP command")
    _, flags, command, length, number = struct.unpack_from(">BBHHH", data)
    return Request(command, number, _body(data, length), flags)


def decode_acknowledge(data: bytes) -> Acknowledge:
    """An answer.

    Raises:
        Malformed: too short, a command, or a length that isn't there.
    """
    if len(data) < 8:
        raise Malformed(f"found {len(data)} bytes, need 8 for a GVCP acknowledge")
    status, command, length, number = struct.unpack_from(">HHHH", data)
    if not command & 1:
        raise Malformed(f"found 0x{command:04x}, need an acknowledge (odd)")
    return Acknowledge(command - 1, number, _body(data, length), status)


def _body(data: bytes, length: int) -> bytes:
    if len(data) < 8 + length:
        raise Malformed(f"found {len(data) - 8} bytes of body, the header promises {length}")
    return data[8 : 8 + length]


def register_body(*addresses: int) -> bytes:
    """Body of READ_REGISTER."""
    return struct.pack(f">{len(addresses)}I", *addresses)


def write_register_body(*pairs: tuple[int, int]) -> bytes:
    """Body of WRITE_REGISTER: pairs of address and value."""
    return b"".join(struct.pack(">II", address, value) for address, value in pairs)


def read_memory_body(address: int, count: int) -> bytes:
    """Body of READ_MEMORY; ``count`` a multiple of 4, at most ``MAX_DATA_BYTES``."""
    return struct.pack(">IHH", address, 0, count)


def write_memory_body(address: int, data: bytes) -> bytes:
    """Body of WRITE_MEMORY."""
    return struct.pack(">I", address) + data


def words(body: bytes) -> tuple[int, ...]:
    """A body as 32 bit numbers.

    Raises:
        Malformed: not a multiple of four bytes.
    """
    if len(body) % 4:
        raise Malformed(f"found {len(body)} bytes, need a multiple of 4")
    return struct.unpack(f">{len(body) // 4}I", body)


@dataclass(frozen=True, slots=True)
class Resend:
    """PACKET_RESEND: packets ``first`` to ``last`` of a block, both included."""

    block: int
    first: int
    last: int
    channel: int = 0
    extended: bool = False
    """Block ids of 64 bit and packet ids of 32 (GigE Vision 2)."""

    def request(self, number: int) -> Request:
        """The command; it asks for no acknowledge."""
        if self.extended:
            body = struct.pack(">HHIIQ", self.channel, 0, self.first, self.last, self.block)
            return Request(Command.PACKET_RESEND, number, body, flags=0x10)
        body = struct.pack(">HHII", self.channel, self.block, self.first & 0xFFFFFF, self.last & 0xFFFFFF)
        return Request(Command.PACKET_RESEND, number, body, flags=0)


def decode_resend(request: Request) -> Resend:
    """The packets that a PACKET_RESEND requests, by standard ids: the virtual sensor sends no others.

    Raises:
        Malformed: a body of the wrong size.
    """
    if len(request.body) < 12:
        raise Malformed(f"found {len(request.body)} bytes, need 12 for PACKET_RESEND")
    channel, block, first, last = struct.unpack_from(">HHII", request.body)
    return Resend(block, first & 0xFFFFFF, last & 0xFFFFFF, channel)


DISCOVERY_BYTES = 248


def text_at(memory: bytes, register: Register) -> str:
    """The text in a bootstrap register of ``memory``, which starts at address 0."""
    raw = memory[register : register + TEXT_BYTES[register]]
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace").strip()


def identity_of(bootstrap: bytes) -> dict[str, str]:
    """Maker, model, serial, ... out of the first 248 bytes of memory, which a discovery acknowledge holds too."""
    mac = bootstrap[Register.MAC_HIGH + 2 : Register.MAC_HIGH + 8]
    address = bootstrap[Register.CURRENT_IP : Register.CURRENT_IP + 4]
    return {
        "manufacturer": text_at(bootstrap, Register.MANUFACTURER),
        "model": text_at(bootstrap, Register.MODEL),
        "version": text_at(bootstrap, Register.DEVICE_VERSION),
        "serial": text_at(bootstrap, Register.SERIAL),
        "name": text_at(bootstrap, Register.USER_NAME),
        "mac": mac.hex(":"),
        "address": ".".join(str(b) for b in address),
    }
