"""The stream of the virtual sensor: exposures by the stand's clock, frames filled, cut into packets and sent.

Packets are sent again on request for a while. One thread fills and sends; requests come from the control thread.
"""

import ipaddress
import random
import socket
import threading
import time
from collections import deque
from math import inf

import numpy as np

from truestand.core.arrays import Array
from truestand.devices.wire import gvsp
from truestand.devices.wire.gvcp import Register, Resend, Status
from truestand.devices.wire.gvsp import Header, Leader, PacketFormat, PixelFormat
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.profile_source import SimulatedSource
from truestand.sim.live.registers import (
    ENCODER_ACTIVE,
    EXTERNAL,
    LASER_OFF,
    TICKS_PER_S,
    TRIGGER_BY_ENCODER,
    TRIGGER_MODE,
    DeviceRegister,
    Registers,
)
from truestand.sim.live.scancontrol_frames import FrameFormat, frame_bytes

CLOCK_LEAD_S = 0.05
"""Of the stand's clock: by which it may run ahead of the next exposure that is due; as late as real frames come."""
STOP_POLL_INTERVAL_S = 0.02
"""Real time: longest wait without a check whether to stop."""
MAX_BLOCK = 32
"""Profiles computed at once, where the computation is late."""
MAX_BLOCK_S = 0.05
"""Of the stand's clock: longest wait before a part of a frame is computed, if that is more than one profile."""
TRIGGER_RESOLUTION_S = 2e-5
"""Of the begin of a triggered exposure."""
TRIGGER_POLL_INTERVAL_S = 5e-3
"""Of the stand's clock, between two checks for triggers."""
HISTORY_BYTES = 64_000_000
"""Of recent frames, stored for a resend."""
SEND_BUFFER_BYTES = 4_000_000
SWAPPED_SHARE, DUPLICATED_SHARE = 0.3, 0.1
"""Of the packets, that the fault DISORDER swaps with their neighbour and sends twice."""

Packet = tuple[bytes, memoryview]
"""Header and data."""


def packets_of(block: int, leader: Leader, payload: bytes, data_bytes: int) -> list[Packet]:
    """The packets of frame ``block`` by their ids: leader, payload in pieces of ``data_bytes``, trailer."""
    view = memoryview(payload)
    packets = [(Header(block, 0, PacketFormat.LEADER).encode(), memoryview(leader.encode()))]
    for start in range(0, len(payload), data_bytes):
        header = Header(block, len(packets), PacketFormat.PAYLOAD)
        packets.append((header.encode(), view[start : start + data_bytes]))
    trailer = memoryview(gvsp.encode_trailer(leader.height))
    packets.append((Header(block, len(packets), PacketFormat.TRAILER).encode(), trailer))
    return packets


class StreamChannel:
    """Sends to the address in the registers. Frames come from one thread, requests to send again from another."""

    def __init__(self, address: str, registers: Registers, faults: Faults, seed: int = 0) -> None:
        self.frames = 0
        """Frames sent since the start."""
        self.resent = 0
        self._registers, self._faults = registers, faults
        self._random = random.Random(seed)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((address, 0))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        registers.put(Register.STREAM_SOURCE_PORT, self._socket.getsockname()[1])
        self._lock = threading.Lock()
        self._history: deque[tuple[int, list[Packet]]] = deque()
        """Frames that were sent, by block."""
        self._queue: deque[tuple[float, int, list[Packet]]] = deque()
        """Frames to be sent, each with its time and block."""
        self._previous: bytes | None = None
        self._block = 0

    def restart(self, frame_bytes: int) -> None:
        """A new stream of frames of this size: blocks count from 1."""
        with self._lock:
            self._history = deque(maxlen=max(HISTORY_BYTES // frame_bytes, 2))
            self._queue.clear()
            self._block, self._previous = 0, None

    def queue(self, payload: bytes, frame: FrameFormat, ticks: int) -> None:
        """Send a frame: now, or later by the latency of a slow network."""
        size = gvsp.data_bytes(self._registers.value(Register.STREAM_PACKET_SIZE) & 0xFFFF)
        leader = Leader(ticks, PixelFormat.MONO16, frame.width, frame.height)
        self._block = self._block % gvsp.BLOCKS + 1
        packets = packets_of(self._block, leader, self._with_faults(payload), size)
        due = time.monotonic() + self._faults.strength(FaultKind.LATENCY) / 1000
        self._queue.append((due, self._block, packets))
        self.flush()

    def flush(self) -> None:
        """Send what is due."""
        now = time.monotonic()
        while self._queue and self._queue[0][0] <= now:
            _, block, packets = self._queue.popleft()
            with self._lock:
                self._history.append((block, packets))
            self._send(self._disordered(packets) if FaultKind.DISORDER in self._faults else packets)
            self.frames += 1

    def resend(self, request: Resend) -> None:
        """Send packets again, or a packet with the status unavailable."""
        if FaultKind.NO_RESEND in self._faults:
            return
        with self._lock:
            sent = next((packets for block, packets in reversed(self._history) if block == request.block), None)
        if sent is None:
            header = Header(request.block & 0xFFFF, request.first, PacketFormat.PAYLOAD, Status.PACKET_UNAVAILABLE)
            self._send([(header.encode(), memoryview(b""))])
            return
        packets = sent[request.first : request.last + 1]
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

    def _disordered(self, packets: list[Packet]) -> list[Packet]:
        swapped = packets.copy()
        for i in range(len(swapped) - 1):
            if self._random.random() < SWAPPED_SHARE:
                swapped[i], swapped[i + 1] = swapped[i + 1], swapped[i]
        return [p for packet in swapped for p in ([packet] * (2 if self._random.random() < DUPLICATED_SHARE else 1))]

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


class Exposures:
    """One exposure after the other, or one at every step of the encoder that finds the sensor ready."""

    def __init__(self, ready: float, registers: Registers, source: SimulatedSource) -> None:
        self.ready = ready
        """s of the stand's clock: the earliest begin of the next exposure."""
        self._registers, self._source = registers, source

    def next_poll(self, height: int) -> float:
        """When to call ``begun`` next, s: a frame of ``height`` profiles, or a part of one, may be there."""
        exposure, idle = self._registers.timing
        if self._triggered:
            return self.ready + max(exposure + idle, TRIGGER_POLL_INTERVAL_S)
        needed = min(height, max(int(MAX_BLOCK_S / (exposure + idle)), 1))
        return self.ready + (needed - 1) * (exposure + idle) + exposure

    def begun(self, now: float) -> Array:
        """Begins (n,) of the next exposures that have ended at ``now``, ``MAX_BLOCK`` of them at most."""
        exposure, idle = self._registers.timing
        if self._triggered:
            return self._at_steps(now - exposure, exposure + idle)
        due = int((now - self.ready - exposure) / (exposure + idle) + 1e-6) + 1
        begins: Array = self.ready + np.arange(min(due, MAX_BLOCK), dtype=np.float64) * (exposure + idle)
        self.ready += begins.size * (exposure + idle)
        return begins

    @property
    def _triggered(self) -> bool:
        return bool(self._registers.value(DeviceRegister.TRIGGER) & EXTERNAL)

    def _at_steps(self, until: float, period: float) -> Array:
        """Steps of the encoder before ``until`` that find the sensor ready; other triggers never come."""
        if until - self.ready < TRIGGER_RESOLUTION_S:
            return np.empty(0)
        times = np.arange(self.ready - TRIGGER_RESOLUTION_S, until, TRIGGER_RESOLUTION_S)
        steps = np.empty(0)
        if self._registers.value(DeviceRegister.TRIGGER) & TRIGGER_MODE == TRIGGER_BY_ENCODER:
            steps = times[1:][np.diff(self._source.counts(times)) != 0]
        begins: list[float] = []
        ready = self.ready
        while len(begins) < MAX_BLOCK and (at := int(np.searchsorted(steps, ready))) < steps.size:
            begins.append(float(steps[at]))
            ready = begins[-1] + period
        self.ready = ready if len(begins) == MAX_BLOCK else max(ready, float(times[-1]))
        return np.array(begins)


class Streamer:
    """Streams from ``start`` until ``stop``; ``counter`` continues from stream to stream as that of a real sensor."""

    def __init__(
        self,
        name: str,
        clock: Clock,
        source: SimulatedSource,
        registers: Registers,
        channel: StreamChannel,
        power_on: float,
    ) -> None:
        self.counter = 0
        self._name, self._clock, self._source = name, clock, source
        self._registers, self._channel, self._power_on = registers, channel, power_on
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin: the first exposure is now."""
        self.stop()
        self._stop.clear()
        frame = self._registers.format
        self._channel.restart(frame.frame_bytes)
        self._thread = threading.Thread(target=self._run, args=(self._clock.now(), frame), name=self._name)
        self._thread.start()

    def stop(self) -> None:
        """End; a frame not yet full is lost."""
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None

    def _run(self, start: float, frame: FrameFormat) -> None:
        exposures = Exposures(start, self._registers, self._source)
        data, begins = bytearray(), np.empty(0)
        try:
            while self._await(exposures.next_poll(frame.height)):
                new = exposures.begun(self._clock.now())
                if not new.size:
                    continue
                data += self._profiles(new, frame)
                begins = np.concatenate([begins, new])
                while len(data) >= frame.frame_bytes:
                    ticks = int((begins[frame.height - 1] + self._power_on) * TICKS_PER_S)
                    self._channel.queue(bytes(data[: frame.frame_bytes]), frame, ticks)
                    del data[: frame.frame_bytes]
                    begins = begins[frame.height :]
        finally:
            self._clock.allow(self._name, inf)

    def _await(self, moment: float) -> bool:
        """Wait until the stand's clock shows ``moment``; False where the stream is to end."""
        self._clock.allow(self._name, moment + CLOCK_LEAD_S)
        while wait := self._clock.real_until(moment):
            if self._stop.wait(min(wait, STOP_POLL_INTERVAL_S)):
                return False
            self._channel.flush()
        return not self._stop.is_set()

    def _profiles(self, begins: Array, frame: FrameFormat) -> bytes:
        """The bytes of the profiles whose exposure began at ``begins`` (n,)."""
        exposure, _ = self._registers.timing
        lit = self._registers.value(DeviceRegister.LASER) != LASER_OFF
        raw, encoder = self._source.profiles(begins + exposure / 2, frame, lit)
        if not self._registers.value(DeviceRegister.MAINTENANCE) & ENCODER_ACTIVE:
            encoder = np.zeros_like(encoder)
        counter = self.counter + np.arange(begins.size)
        self.counter += begins.size
        opened = begins + self._power_on
        return frame_bytes(raw, frame, counter, opened, opened + exposure, encoder)
