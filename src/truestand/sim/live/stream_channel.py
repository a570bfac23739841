"""The virtual sensor's stream channel: frames cut into packets, sent, and sent again on request for a while."""

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

HISTORY_BYTES = 64_000_000
"""Of recent frames, stored for a resend."""
SEND_BUFFER_BYTES = 4_000_000
SWAPPED_SHARE, DUPLICATED_SHARE = 0.3, 0.1
"""Of the packets, that the fault DISORDER swaps with their neighbour and sends twice."""

Packet = tuple[bytes, memoryview]
"""Header and data."""


@dataclass(frozen=True, slots=True)
class SentFrame:
    """A frame as it is sent."""

    block: int
    leader: bytes
    payload: bytes
    trailer: bytes
    data_bytes: int
    """Of a full packet."""

    @property
    def last(self) -> int:
        """Id of the trailer's packet."""
        return -(-len(self.payload) // self.data_bytes) + 1

    def packet(self, number: int) -> Packet:
        """A packet by its id; 0 is the leader."""
        if number == 0:
            return Header(self.block, 0, PacketFormat.LEADER).encode(), memoryview(self.leader)
        if number >= self.last:
            return Header(self.block, self.last, PacketFormat.TRAILER).encode(), memoryview(self.trailer)
        start = (number - 1) * self.data_bytes
        view = memoryview(self.payload)[start : start + self.data_bytes]
        return Header(self.block, number, PacketFormat.PAYLOAD).encode(), view


class StreamChannel:
    """Sends to the address in the registers. Frames come from one thread, requests to send again from another."""

    def __init__(self, address: str, registers: Registers, faults: Faults, seed: int = 0) -> None:
        self.frames = 0
        self.resent = 0
        self._registers, self._faults = registers, faults
        self._random = random.Random(seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((address, 0))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        registers.put(Register.STREAM_SOURCE_PORT, self._socket.getsockname()[1])
        self._lock = threading.Lock()
        self._history: deque[SentFrame] = deque()
        self._history_bytes = 0
        self._queue: deque[tuple[float, SentFrame]] = deque()
        """Frames to be sent, each with its time."""
        self._previous: bytes | None = None
        self._block = 0

    def restart(self) -> None:
        """A new stream: blocks count from 1."""
        with self._lock:
            self._history.clear()
            self._queue.clear()
            self._block, self._history_bytes, self._previous = 0, 0, None

    def queue(self, payload: bytes, frame: FrameFormat, ticks: int) -> None:
        """Send a frame: now, or later by the latency of a slow network."""
        size = gvsp.data_bytes(self._registers.value(Register.STREAM_PACKET_SIZE) & 0xFFFF)
        leader = Leader(ticks, PixelFormat.MONO16, frame.width, frame.height).encode()
        self._block = self._block % gvsp.BLOCKS + 1
        trailer = gvsp.encode_trailer(frame.height)
        sent = SentFrame(self._block, leader, self._with_faults(payload), trailer, size)
        self._queue.append((time.monotonic() + self._faults.strength(FaultKind.LATENCY) / 1000, sent))
        self.flush()

    def flush(self) -> None:
        """Send what is due."""
        now = time.monotonic()
        while self._queue and self._queue[0][0] <= now:
            frame = self._queue.popleft()[1]
            self._store(frame)
            numbers = list(range(frame.last + 1))
            if FaultKind.DISORDER in self._faults:
                numbers = self._disordered(numbers)
            self._send([frame.packet(number) for number in numbers])
            self.frames += 1

    def resend(self, request: Resend) -> None:
        """Send packets again, or say that they are unavailable."""
        if FaultKind.NO_RESEND in self._faults:
            return
        with self._lock:
            frame = next((f for f in reversed(self._history) if f.block == request.block), None)
        if frame is None:
            header = Header(request.block & 0xFFFF, request.first, PacketFormat.PAYLOAD, Status.PACKET_UNAVAILABLE)
            self._send([(header.encode(), memoryview(b""))])
            return
        packets = [frame.packet(number) for number in range(request.first, min(request.last, frame.last) + 1)]
        self._send(packets)
        self.resent += len(packets)

    def fire_test(self, packet_size: int) -> None:
        """A test packet as large as the register says."""
        size = gvsp.data_bytes(packet_size & 0xFFFF)
        self._send([(Header(0, 0, PacketFormat.PAYLOAD).encode(), memoryview(bytes(size)))])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _with_faults(self, payload: bytes) -> bytes:
        if FaultKind.FROZEN in self._faults and self._previous is not None:
            return self._previous
        self._previous = payload
        return self._random.randbytes(len(payload)) if FaultKind.GARBAGE in self._faults else payload

    def _store(self, frame: SentFrame) -> None:
        with self._lock:
            self._history.append(frame)
            self._history_bytes += len(frame.payload)
            while self._history_bytes > HISTORY_BYTES and len(self._history) > 2:
                self._history_bytes -= len(self._history.popleft().payload)

    def _disordered(self, numbers: list[int]) -> list[int]:
        for i in range(len(numbers) - 1):
            if self._random.random() < SWAPPED_SHARE:
                numbers[i], numbers[i + 1] = numbers[i + 1], numbers[i]
        return [n for number in numbers for n in ([number] * (2 if self._random.random() < DUPLICATED_SHARE else 1))]

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
            except OSError:  # nobody there, or no route: a network loses packets silently
                continue
