"""Frames from stream packets: in order, each packet used once, missing ones requested again, then reported.

Pure: the bytes of a packet and the time go in, frames and requests come out. The size of a frame and of its packets are
known before the stream begins, so that a packet is used only where its length and its place fit; others are counted.
Sources: GigE Vision as in ``wire/gvsp.py``.

Most packets follow the one before: their path through ``take`` is short, because it runs 27,000 times a second at
10,000 profiles/s.
"""

import re
import struct
from math import inf

from truestand.devices.sensor import Frame, StreamStatistics
from truestand.devices.wire import gvsp
from truestand.devices.wire.gvcp import Resend
from truestand.devices.wire.gvsp import PacketFormat
from truestand.devices.wire.malformed import Malformed

MAX_PACKET_BYTES = 65_536
MAX_OPEN_FRAMES = 32
"""That may be incomplete at a time; with more, the oldest is closed."""
RESEND_DELAY_S = 0.004
"""That a packet may be out of order before it is requested again."""
RESEND_INTERVAL_S = 0.02
GAP_TIMEOUT_S = 0.12
"""After a gap was seen: later packets are too late for a live display, and the frame reports what it lacks."""
GAP_TIMEOUT_WITHOUT_RESEND_S = 0.02
"""Where the device doesn't send again: the time for packets out of order."""
FRAME_END_TIMEOUT_S = 0.2
"""Without packets, after which the last ones of the newest frame count as lost; a slow trigger may stretch a frame."""
_HEADER = struct.Struct(">HHI")
_PAYLOAD = PacketFormat.PAYLOAD << 24
_NOT_RECEIVED = re.compile(rb"[^\x01]+")
"""A run in the ``status`` of a frame."""


class _OpenFrame:
    """A frame that is being assembled. Packets of data are 1 ... n."""

    __slots__ = (
        "buffer", "completed", "expected", "gap_seen", "last_change", "missing", "missing_before", "number", "places",
        "requests", "status", "wire",
    )  # fmt: skip

    def __init__(self, number: int, wire: int, buffer: bytearray, places: list[memoryview]) -> None:
        self.number = number
        self.wire = wire
        """Block id."""
        self.buffer = buffer
        self.places = places
        """Where the data of each packet belongs; the first place stands for the leader."""
        self.status = bytearray(len(places))
        """Of each packet: 1 = received, 2 = requested again, 3 = the device can't send it again."""
        self.missing = len(places) - 1
        """Number of data packets not yet received."""
        self.expected = _PAYLOAD | 1
        """Format and id of the next packet in order."""
        self.missing_before = self.missing
        self.last_change = inf
        """Time of the first ``tick`` that saw the present number of missing packets."""
        self.gap_seen = inf
        """Time of the first ``tick`` that saw a gap."""
        self.requests = 0
        self.completed = 0.0
        """Time when its last byte was received."""


class Assembler:
    """Assembles frames from packets; one stream, one thread."""

    def __init__(
        self,
        payload: int,
        packet_size: int,
        row: int = 1,
        resend: bool = True,
        frame_end_timeout: float = FRAME_END_TIMEOUT_S,
    ) -> None:
        """For frames of ``payload`` bytes in rows of ``row`` (a profile is used whole or not at all)."""
        self.packet = bytearray(MAX_PACKET_BYTES)
        """Where the next packet is to be received."""
        self.frames: list[Frame] = []
        """Frames that are ready, in order; the caller takes them out."""
        self.foreign = 0
        """Packets from other addresses; counted by the receiver."""
        self._payload, self._packet_size, self._row = payload, packet_size, row
        self._resend, self._frame_end_timeout = resend, frame_end_timeout
        self._view = memoryview(self.packet)
        self._open: dict[int, _OpenFrame] = {}
        self._blocks = gvsp.BLOCKS
        self._newest = -1
        """Number of the newest frame; -1 = none yet."""
        self._newest_wire = 0
        self._next = 0
        """Number of the next frame to be ready."""
        self._complete = self._lost = self._incomplete = self._resent = 0
        self._packets = self._duplicates = self._malformed = 0
        self._set_packets(extended=False)

    def _set_packets(self, extended: bool) -> None:
        self._extended = extended
        self._head = gvsp.EXTENDED_HEADER if extended else gvsp.HEADER
        self._data_bytes = max(gvsp.data_bytes(self._packet_size, extended), 1)
        self._count = -(-self._payload // self._data_bytes)
        self._full = self._head + self._data_bytes if not extended else -1  # extended ids take the longer path
        self._data = self._view[self._head : self._head + self._data_bytes]
        self._free: list[tuple[bytearray, list[memoryview]]] = []
        self._current = self._none = self._new_frame(-1, -1)

    def _new_frame(self, number: int, wire: int) -> _OpenFrame:
        if not self._free:
            buffer = bytearray(self._payload)
            view = memoryview(buffer)
            places = [view[i : i + self._data_bytes] for i in range(0, self._payload, self._data_bytes)]
            self._free.append((buffer, [view[:0], *places]))
        return _OpenFrame(number, wire, *self._free.pop())

    def take(self, size: int, now: float) -> None:
        """Use the ``size`` bytes in ``packet``, received at ``now`` (s)."""
        self._packets += 1
        block = self._current
        if size == self._full:
            status, wire, word = _HEADER.unpack_from(self.packet)
            if word == block.expected and wire == block.wire and not status and block.missing > 1:
                id_ = word & 0xFFFFFF
                if not block.status[id_] and id_ < self._count:
                    block.places[id_][:] = self._data
                    block.status[id_] = 1
                    block.missing -= 1
                    block.expected = word + 1
                    return
        self._take_any(size, now)

    def _take_any(self, size: int, now: float) -> None:
        """Use any packet: of any frame, in any order, or bytes that are none."""
        try:
            header = gvsp.decode_header(self._view[:size])
            self._check(header, size)
        except Malformed:
            self._malformed += 1
            return
        if header.status & gvsp.FAILED:
            self._note_refusal(header)
            return
        block = self._frame_of(header.block, now)
        if header.kind == PacketFormat.PAYLOAD:
            self._store(block, header, now)
        elif header.kind == PacketFormat.TRAILER and block is not None:
            block.expected = _PAYLOAD | self._count + 1

    def _note_refusal(self, header: gvsp.Header) -> None:
        """Note that the device can't send a packet again."""
        block = self._open.get(self._number_of(header.block))
        if block is None or not 1 <= header.packet <= self._count:
            self._malformed += 1
        elif block.status[header.packet] != 1:
            block.status[header.packet] = 3

    def _check(self, header: gvsp.Header, size: int) -> None:
        """Refuse a packet that can't be one of this stream.

        Raises:
            Malformed: it can't.
        """
        if header.extended != self._extended:
            if self._newest >= 0:
                raise Malformed("found both standard and extended ids")
            self._set_packets(header.extended)
        data = size - self._head
        if header.status & gvsp.FAILED:
            return
        if header.kind == PacketFormat.LEADER:
            leader = gvsp.decode_leader(self._view[self._head : size])
            if leader.payload_bytes != self._payload or header.packet != 0:
                raise Malformed(f"found a frame of {leader.payload_bytes} bytes, need {self._payload}")
        elif header.kind == PacketFormat.PAYLOAD:
            last = self._payload - (self._count - 1) * self._data_bytes
            needed = self._data_bytes if header.packet < self._count else last
            if not 1 <= header.packet <= self._count or data != needed:
                raise Malformed(f"found {data} bytes in packet {header.packet} of {self._count}")
        elif header.kind != PacketFormat.TRAILER or header.packet != self._count + 1:
            raise Malformed(f"found packet {header.packet} of kind {header.kind}")

    def _frame_of(self, wire: int, now: float) -> _OpenFrame | None:
        """The frame with block id ``wire``, opened if it is new; None for one that is closed."""
        if self._current.wire == wire:
            return self._current
        number = self._number_of(wire)
        if number < self._next:
            return None
        if number > self._newest:
            self._open_to(number, wire, now)
        return self._open[number]

    def _number_of(self, wire: int) -> int:
        """Frame number of a block id, which wraps: the one nearest to the newest."""
        if self._newest < 0:
            return 0
        if self._extended:
            return self._newest + wire - self._newest_wire
        if wire == 0:
            self._blocks = gvsp.BLOCKS + 1
        step = (wire - self._newest_wire) % self._blocks
        return self._newest + (step if step <= self._blocks // 2 else step - self._blocks)

    def _open_to(self, number: int, wire: int, now: float) -> None:
        """Open frame ``number``, and those before it that were not seen yet: they may still arrive."""
        if number - self._next >= MAX_OPEN_FRAMES:
            first = number - MAX_OPEN_FRAMES + 1
            while (old := self._open.get(self._next)) is not None and old.number < first:
                self._close(old, now)
            self._lost += max(0, first - self._next)
            self._next = max(first, self._next)
        for between in range(max(self._newest + 1, self._next), number + 1):
            behind = number - between
            self._open[between] = self._new_frame(between, self._wire_before(wire, behind))
        self._newest, self._newest_wire = number, wire
        self._current = self._open[number]

    def _wire_before(self, wire: int, steps: int) -> int:
        if self._extended:
            return wire - steps
        if self._blocks > gvsp.BLOCKS:
            return (wire - steps) % self._blocks
        return (wire - 1 - steps) % self._blocks + 1

    def _store(self, block: _OpenFrame | None, header: gvsp.Header, now: float) -> None:
        id_ = header.packet
        if block is None or block.status[id_] == 1:
            self._duplicates += 1
            return
        self._resent += block.status[id_] >= 2
        place = block.places[id_]
        place[:] = self._view[self._head : self._head + len(place)]
        block.status[id_] = 1
        block.missing -= 1
        block.expected = max(block.expected, _PAYLOAD | id_ + 1)
        if not block.missing:
            block.completed = now
            self._collect()

    def _collect(self) -> None:
        """Move the frames that are complete, and have none open before them, to ``frames``; the oldest left is not."""
        while (block := self._open.get(self._next)) is not None and not block.missing:
            self._complete += 1
            self._finish(block, Frame(block.number, block.completed, bytes(block.buffer)))

    def _finish(self, block: _OpenFrame, frame: Frame | None) -> None:
        if frame is not None:
            self.frames.append(frame)
        del self._open[block.number]
        self._free.append((block.buffer, block.places))
        self._next = block.number + 1
        if self._current is block:
            self._current = self._none

    def _close(self, block: _OpenFrame, now: float) -> None:
        """Close the oldest frame, which is not complete, with what was received of it."""
        if block.missing == self._count:
            self._lost += 1
            self._finish(block, None)
        else:
            missing = [i for i in range(1, len(block.status)) if block.status[i] != 1]
            for id_ in missing:
                start = (id_ - 1) * self._data_bytes
                end = start + len(block.places[id_])
                start, end = start // self._row * self._row, -(-end // self._row) * self._row
                block.buffer[start:end] = bytes(min(end, self._payload) - start)
            self._incomplete += 1
            size = sum(len(block.places[i]) for i in missing)
            self._finish(block, Frame(block.number, now, bytes(block.buffer), size))
        self._collect()

    def tick(self, now: float) -> list[Resend]:
        """Check the open frames, every few ms: close those that are overdue; returns the packets to request again."""
        requests: list[Resend] = []
        for block in list(self._open.values()):
            if not block.missing:
                continue
            if block.missing != block.missing_before or block.last_change == inf:
                block.last_change, block.missing_before = now, block.missing
            gaps = self._gaps(block, now)
            if gaps:
                block.gap_seen = min(block.gap_seen, now)
                requests += self._requests(block, gaps, now)
        timeout = GAP_TIMEOUT_S if self._resend else GAP_TIMEOUT_WITHOUT_RESEND_S
        while (oldest := self._open.get(self._next)) is not None:
            refused = oldest.missing == oldest.status.count(3, 1)
            if not refused and now - oldest.gap_seen < timeout:
                break
            self._close(oldest, now)
        return requests

    def _gaps(self, block: _OpenFrame, now: float) -> list[tuple[int, int]]:
        """First and last id of each run of data packets that are overdue."""
        end = len(block.status)
        if block.number == self._newest and now - block.last_change < self._frame_end_timeout:
            end = block.expected & 0xFFFFFF
        return [(run.start(), run.end() - 1) for run in _NOT_RECEIVED.finditer(block.status, 1, end)]

    def _requests(self, block: _OpenFrame, gaps: list[tuple[int, int]], now: float) -> list[Resend]:
        """The requests that are due for ``gaps`` now."""
        if not self._resend or now - block.gap_seen < RESEND_DELAY_S + block.requests * RESEND_INTERVAL_S:
            return []
        block.requests += 1
        due = [(first, last) for first, last in gaps if block.status[first] != 3]
        for first, last in due:
            for i in range(first, last + 1):
                block.status[i] = max(block.status[i], 2)
        return [Resend(block.wire, first, last, extended=self._extended) for first, last in due]

    def flush(self, now: float) -> None:
        """Close all frames: the stream has ended."""
        while (block := self._open.get(self._next)) is not None:
            self._close(block, now)

    def statistics(self) -> StreamStatistics:
        """Counts of the stream so far."""
        return StreamStatistics(
            frames=self._complete + self._incomplete,
            lost=self._lost,
            incomplete=self._incomplete,
            resent=self._resent,
            packets=self._packets,
            duplicates=self._duplicates,
            foreign=self.foreign,
            malformed=self._malformed,
        )
