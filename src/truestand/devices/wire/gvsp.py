"""GigE Vision stream protocol (GVSP): a frame is a leader, numbered payload packets and a trailer. Big endian.

Standard ids (16 bit blocks from 1 to 65535, 24 bit packets) and extended ids (64 and 32 bit) are both read.
Source as in ``gvcp.py``. Pure: no sockets here.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

from truestand.devices.wire.malformed import Malformed

HEADER, EXTENDED_HEADER = 8, 20
IP_UDP_HEADERS = 28
"""Bytes that the packet size of a device counts beside the header of GVSP and the data."""
BLOCKS = 65535
"""Standard block ids run from 1 to this and again from 1; some devices count from 0 to it instead."""
FAILED = 0x8000
"""Bit of a packet's status: the device can't send it again."""


class PacketFormat(IntEnum):
    """Packet formats."""

    LEADER = 1
    TRAILER = 2
    PAYLOAD = 3


class PixelFormat(IntEnum):
    """Pixel formats of range sensors."""

    MONO16 = 0x01100007


IMAGE = 1
"""Payload type of the leader."""


@dataclass(frozen=True, slots=True)
class Header:
    """Header of a packet."""

    block: int
    packet: int
    kind: int
    status: int = 0
    extended: bool = False

    def encode(self) -> bytes:
        """Bytes."""
        if self.extended:
            return struct.pack(">HHIQI", self.status, 0, (self.kind | 0x80) << 24, self.block, self.packet)
        return struct.pack(">HHI", self.status, self.block, self.kind << 24 | self.packet)


def decode_header(data: bytes | bytearray | memoryview) -> Header:
    """The header of a packet.

    Raises:
        Malformed: too short.
    """
    if len(data) < HEADER:
        raise Malformed(f"found {len(data)} bytes, need {HEADER} for a GVSP header")
    status, block, word = struct.unpack_from(">HHI", data)
    kind = word >> 24
    if not kind & 0x80:
        return Header(block, word & 0xFFFFFF, kind & 0x7F, status)
    if len(data) < EXTENDED_HEADER:
        raise Malformed(f"found {len(data)} bytes, need {EXTENDED_HEADER} for an extended GVSP header")
    block, packet = struct.unpack_from(">QI", data, 8)
    return Header(block, packet, kind & 0x7F, status, extended=True)


@dataclass(frozen=True, slots=True)
class Leader:
    """Announces an image."""

    timestamp: int
    """Device ticks."""
    pixel_format: int
    width: int
    height: int

    @property
    def payload_bytes(self) -> int:
        """Size of the image."""
        return self.width * self.height * (self.pixel_format >> 16 & 0xFF) // 8

    def encode(self) -> bytes:
        """What follows the header."""
        return struct.pack(
            ">HHQIIIIIHH", 0, IMAGE, self.timestamp, self.pixel_format, self.width, self.height, 0, 0, 0, 0
        )


def decode_leader(data: bytes | memoryview) -> Leader:
    """A leader's content, without the header.

    Raises:
        Malformed: too short, or no image.
    """
    if len(data) < 36:
        raise Malformed(f"found {len(data)} bytes, need 36 for an image leader")
    _, payload_type, timestamp, pixel_format, width, height = struct.unpack_from(">HHQIII", data)
    if payload_type & 0x3FFF != IMAGE:
        raise Malformed(f"found payload type {payload_type}, need an image ({IMAGE})")
    return Leader(timestamp, pixel_format, width, height)


def encode_trailer(height: int) -> bytes:
    """What follows the header of a trailer."""
    return struct.pack(">HHI", 0, IMAGE, height)


def data_bytes(packet_size: int, extended: bool = False) -> int:
    """Payload bytes in one full packet of a device whose packet size register says ``packet_size``."""
    return packet_size - IP_UDP_HEADERS - (EXTENDED_HEADER if extended else HEADER)
