"""The virtual sensor's stream channel: frames cut into packets, sent, kept a while, sent again when asked for."""

import ipaddress
import random
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass

from truestand.devices.wire import gvsp
from truestand.devices.wire.gvcp import Register, Resend, Status
from truestand.devices.wire.gvsp import Header, Leader, PacketFormat, PixelFormat
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.registers import Registers
from truestand.sim.live.scancontrol_frames import FrameFormat

KEPT = 64_000_000
"""Bytes of recent frames kept for a resend."""
SWAPPED, TWICE = 0.3, 0.1
"""Shares of the packets that the fault DISORDER swaps with their neighbour, and sends twice."""

Packet = tuple[bytes, memoryview]
"""Header and data."""


@dataclass(frozen=True, slots=True)
class Sent:
    """A frame as it went out."""

    block: int
    leader: bytes
    payload: bytes
    trailer: bytes
    data_bytes: int
    """In a full packet."""

    @property
    def last(self) -> int:
        """Number of the trailer's packet."""
        return -(-len(self.payload) // self.data_bytes) + 1

    def packet(self, number: int) -> Packet:
        """One packet: 0 is the leader."""
        if number == 0:
            return Header(self.block, 0, PacketFormat.LEADER).encode(), memoryview(self.leader)
        if number >= self.last:
            return Header(self.block, self.last, PacketFormat.TRAILER).encode(), memoryview(self.trailer)
        start = (number - 1) * self.data_bytes
        view = memoryview(self.payload)[start : start + self.data_bytes]
        return Header(self.block, number, PacketFormat.PAYLOAD).encode(), view


class StreamChannel:
    """Sends to where the registers say. Frames come from one thread, requests to send again from another."""

    def __init__(self, address: str, registers: Registers, wrong: Faults, seed: int = 0) -> None:
        self.frames = 0
        self.resent = 0
        self._registers, self._faults = registers, wrong
        self._random = random.Random(seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((address, 0))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4_000_000)
        registers.put(Register.STREAM_SOURCE_PORT, self._socket.getsockname()[1])
        self._lock = threading.Lock()
        self._kept: deque[Sent] = deque()
        self._kept_bytes = 0
        self._late: deque[tuple[float, Sent]] = deque()
        self._before: bytes | None = None
        self._block = 0

    def restart(self) -> None:
        """A new stream: blocks count from 1."""
        with self._lock:
            self._kept.clear()
            self._late.clear()
            self._block, self._kept_bytes, self._before = 0, 0, None

    def offer(self, payload: bytes, shape: FrameFormat, ticks: int) -> None:
        """A frame to be sent: now, or later where the network is slow."""
        size = gvsp.data_bytes(self._registers.value(Register.STREAM_PACKET_SIZE) & 0xFFFF)
        leader = Leader(ticks, PixelFormat.MONO16, shape.width, shape.height).encode()
        self._block = self._block % gvsp.BLOCKS + 1
        frame = Sent(self._block, leader, self._spoiled(payload), gvsp.encode_trailer(shape.height), size)
        self._late.append((time.monotonic() + self._faults.strength(FaultKind.LATENCY) / 1000, frame))
        self.flush()

    def flush(self) -> None:
        """Send what is due."""
        now = time.monotonic()
        while self._late and self._late[0][0] <= now:
            frame = self._late.popleft()[1]
            self._keep(frame)
            numbers = list(range(frame.last + 1))
            if FaultKind.DISORDER in self._faults:
                numbers = self._disordered(numbers)
            self._send([frame.packet(number) for number in numbers])
            self.frames += 1

    def resend(self, asked: Resend) -> None:
        """Send packets again, or say that they are gone."""
        if FaultKind.NO_RESEND in self._faults:
            return
        with self._lock:
            frame = next((f for f in reversed(self._kept) if f.block == asked.block), None)
        if frame is None:
            gone = Header(asked.block & 0xFFFF, asked.first, PacketFormat.PAYLOAD, Status.PACKET_UNAVAILABLE)
            self._send([(gone.encode(), memoryview(b""))])
            return
        packets = [frame.packet(number) for number in range(asked.first, min(asked.last, frame.last) + 1)]
        self._send(packets)
        self.resent += len(packets)

    def fire_test(self, packet_size: int) -> None:
        """A test packet as large as the register says."""
        size = gvsp.data_bytes(packet_size & 0xFFFF)
        self._send([(Header(0, 0, PacketFormat.PAYLOAD).encode(), memoryview(bytes(size)))])

    def close(self) -> None:
        """Leave the socket."""
        self._socket.close()

    def _spoiled(self, payload: bytes) -> bytes:
        if FaultKind.FROZEN in self._faults and self._before is not None:
            return self._before
        self._before = payload
        return self._random.randbytes(len(payload)) if FaultKind.GARBAGE in self._faults else payload

    def _keep(self, frame: Sent) -> None:
        with self._lock:
            self._kept.append(frame)
            self._kept_bytes += len(frame.payload)
            while self._kept_bytes > KEPT and len(self._kept) > 2:
                self._kept_bytes -= len(self._kept.popleft().payload)

    def _disordered(self, numbers: list[int]) -> list[int]:
        for i in range(len(numbers) - 1):
            if self._random.random() < SWAPPED:
                numbers[i], numbers[i + 1] = numbers[i + 1], numbers[i]
        return [n for number in numbers for n in ([number] * (2 if self._random.random() < TWICE else 1))]

    def _send(self, packets: list[Packet]) -> None:
        port = self._registers.value(Register.STREAM_PORT) & 0xFFFF
        if not port:
            return
        to = str(ipaddress.IPv4Address(self._registers.value(Register.STREAM_ADDRESS))), port
        share = self._faults.strength(FaultKind.LOSE_PACKETS)
        for header, data in packets:
            if FaultKind.UNPLUGGED in self._faults or (share and self._random.random() < share):
                continue
            try:
                self._socket.sendmsg([header, data], [], 0, to)
            except OSError:  # nobody there, or no route: a network loses packets without a word
                continue
