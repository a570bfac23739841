"""Frames from stream packets: in order, each packet used once, what is missing asked for again, then reported.

Pure: the bytes of a packet and the time go in, frames and requests come out. The size of a frame and of its packets are
known before the stream begins, so that a packet is used only where its length and its place fit; the rest is counted.
Sources: GigE Vision as in ``wire/gvsp.py``.

The usual packet is the one right after the one before: that way through ``take`` is kept short, because it is gone
27,000 times a second at 10,000 profiles/s.
"""

import struct
from collections.abc import Iterator
from math import inf

from truestand.devices.sensor import Frame, StreamStatistics
from truestand.devices.wire import gvsp
from truestand.devices.wire.gvcp import Resend
from truestand.devices.wire.gvsp import PacketFormat
from truestand.devices.wire.malformed import Malformed

LARGEST_PACKET = 65_536
MOST_OPEN = 32
"""Frames that may be incomplete at a time; with more, the oldest is given up."""
ASK_AFTER = 0.004
"""s that a packet may come out of order before it is asked for."""
ASK_AGAIN = 0.02
"""s."""
GIVE_UP = 0.12
"""s after a gap was seen. What comes later is too late for a live display, and the frame says what it lacks."""
GIVE_UP_AT_ONCE = 0.02
"""s, where the device doesn't send again: just the time for packets out of order."""
SILENCE = 0.2
"""s after which the last packets of the newest frame count as lost; a slow trigger may stretch a frame."""
_HEADER = struct.Struct(">HHI")
_PAYLOAD = PacketFormat.PAYLOAD << 24


class _Block:
    """A frame that is being put together. Packets of data are 1 ... n."""

    __slots__ = (
        "asked", "behind", "buffer", "done", "expected", "got", "left", "left_before", "moved", "number", "places",
        "wire",
    )  # fmt: skip

    def __init__(self, number: int, wire: int, buffer: bytearray, places: list[memoryview]) -> None:
        self.number = number
        self.wire = wire
        """Block id."""
        self.buffer = buffer
        self.places = places
        """Where the data of each packet goes; the first place stands for the leader."""
        self.got = bytearray(len(places))
        """1 = here, 2 = asked for again, 3 = the device can't send it again."""
        self.left = len(places) - 1
        """Packets of data still to come."""
        self.expected = _PAYLOAD | 1
        """PacketFormat and id of the packet that should be next."""
        self.left_before = self.left
        self.moved = inf
        """When ``tick`` first saw it as it is."""
        self.behind = inf
        """When ``tick`` first saw a gap."""
        self.asked = 0
        self.done = 0.0
        """When its last byte was there."""


class Assembler:
    """Puts frames together out of packets; one stream, one thread."""

    def __init__(
        self, payload: int, packet_size: int, row: int = 1, resend: bool = True, silence: float = SILENCE
    ) -> None:
        """For frames of ``payload`` bytes in rows of ``row`` (a profile is used whole or not at all)."""
        self.packet = bytearray(LARGEST_PACKET)
        """Where the next packet is to be received."""
        self.frames: list[Frame] = []
        """Those to hand on, in order; the caller takes them out."""
        self.foreign = 0
        """Counted by the one who knows where packets come from."""
        self._payload, self._packet_size, self._row = payload, packet_size, row
        self._resend, self._silence = resend, silence
        self._view = memoryview(self.packet)
        self._open: dict[int, _Block] = {}
        self._blocks = gvsp.BLOCKS
        self._newest = -1
        """Number of the newest frame; -1 = none yet."""
        self._newest_wire = 0
        self._next = 0
        """Number of the next frame to hand on."""
        self._complete = self._lost = self._incomplete = self._resent = 0
        self._packets = self._duplicates = self._malformed = 0
        self._set_packets(extended=False)
        self._current = self._nothing = self._new_block(-1, -1)

    def _set_packets(self, extended: bool) -> None:
        self._extended = extended
        self._head = gvsp.EXTENDED_HEADER if extended else gvsp.HEADER
        self._chunk = max(gvsp.data_bytes(self._packet_size, extended), 1)
        self._count = -(-self._payload // self._chunk)
        self._full = self._head + self._chunk if not extended else -1  # extended ids go the longer way
        self._data = self._view[self._head : self._head + self._chunk]
        self._free: list[tuple[bytearray, list[memoryview]]] = []

    def _new_block(self, number: int, wire: int) -> _Block:
        if not self._free:
            buffer = bytearray(self._payload)
            view = memoryview(buffer)
            places = [view[i : i + self._chunk] for i in range(0, self._payload, self._chunk)]
            self._free.append((buffer, [view[:0], *places]))
        return _Block(number, wire, *self._free.pop())

    def take(self, size: int, now: float) -> None:
        """Use the ``size`` bytes that stand in ``packet``, received at ``now``."""
        self._packets += 1
        block = self._current
        if size == self._full:
            status, wire, word = _HEADER.unpack_from(self.packet)
            if word == block.expected and wire == block.wire and not status and block.left > 1:
                id_ = word & 0xFFFFFF
                if not block.got[id_] and id_ < self._count:
                    block.places[id_][:] = self._data
                    block.got[id_] = 1
                    block.left -= 1
                    block.expected = word + 1
                    return
        self._take_any(size, now)

    def _take_any(self, size: int, now: float) -> None:
        """Any packet: of any frame, in any order, or none at all."""
        try:
            header = gvsp.decode_header(self._view[:size])
            self._check(header, size)
        except Malformed:
            self._malformed += 1
            return
        if header.status & gvsp.FAILED:
            self._refuse(header)
            return
        block = self._block_of(header.block, now)
        if header.kind == PacketFormat.PAYLOAD:
            self._use(block, header, now)
        elif header.kind == PacketFormat.TRAILER and block is not None:
            block.expected = _PAYLOAD | self._count + 1

    def _refuse(self, header: gvsp.Header) -> None:
        """Note that the device can't send a packet again."""
        block = self._open.get(self._number_of(header.block))
        if block is None or not 1 <= header.packet <= self._count:
            self._malformed += 1
        elif block.got[header.packet] != 1:
            block.got[header.packet] = 3

    def _check(self, header: gvsp.Header, size: int) -> None:
        """Whether the packet can be one of this stream.

        Raises:
            Malformed: it can't.
        """
        if header.extended != self._extended:
            if self._newest >= 0:
                raise Malformed("found both standard and extended ids")
            self._set_packets(header.extended)
            self._current = self._nothing = self._new_block(-1, -1)
        data = size - self._head
        if header.status & gvsp.FAILED:
            return
        if header.kind == PacketFormat.LEADER:
            leader = gvsp.decode_leader(self._view[self._head : size])
            if leader.payload_bytes != self._payload or header.packet != 0:
                raise Malformed(f"found a frame of {leader.payload_bytes} bytes, need {self._payload}")
        elif header.kind == PacketFormat.PAYLOAD:
            last = self._payload - (self._count - 1) * self._chunk
            if not 1 <= header.packet <= self._count or data != (self._chunk if header.packet < self._count else last):
                raise Malformed(f"found {data} bytes in packet {header.packet} of {self._count}")
        elif header.kind != PacketFormat.TRAILER or header.packet != self._count + 1:
            raise Malformed(f"found packet {header.packet} of kind {header.kind}")

    def _block_of(self, wire: int, now: float) -> _Block | None:
        """The frame with block id ``wire``, begun if it is new; None for one that is done with."""
        if self._current.wire == wire:
            return self._current
        number = self._number_of(wire)
        if number < self._next:
            return None
        if number > self._newest:
            self._begin(number, wire, now)
        return self._open[number]

    def _number_of(self, wire: int) -> int:
        """Over the wrap of the id: the number nearest to the newest."""
        if self._newest < 0:
            return 0
        if self._extended:
            return self._newest + wire - self._newest_wire
        if wire == 0:
            self._blocks = gvsp.BLOCKS + 1
        step = (wire - self._newest_wire) % self._blocks
        return self._newest + (step if step <= self._blocks // 2 else step - self._blocks)

    def _begin(self, number: int, wire: int, now: float) -> None:
        """Open frame ``number``, and those before it that were not seen yet: they may still come."""
        if number - self._next >= MOST_OPEN:
            first = number - MOST_OPEN + 1
            while (old := self._open.get(self._next)) is not None and old.number < first:
                self._give_up(old, now)
            self._lost += max(0, first - self._next)
            self._next = max(first, self._next)
        for between in range(max(self._newest + 1, self._next), number + 1):
            behind = number - between
            self._open[between] = self._new_block(between, self._wire_before(wire, behind))
        self._newest, self._newest_wire = number, wire
        self._current = self._open[number]

    def _wire_before(self, wire: int, steps: int) -> int:
        if self._extended:
            return wire - steps
        if self._blocks > gvsp.BLOCKS:
            return (wire - steps) % self._blocks
        return (wire - 1 - steps) % self._blocks + 1

    def _use(self, block: _Block | None, header: gvsp.Header, now: float) -> None:
        id_ = header.packet
        if block is None or block.got[id_] == 1:
            self._duplicates += 1
            return
        self._resent += block.got[id_] >= 2
        place = block.places[id_]
        place[:] = self._view[self._head : self._head + len(place)]
        block.got[id_] = 1
        block.left -= 1
        block.expected = max(block.expected, _PAYLOAD | id_ + 1)
        if not block.left:
            block.done = now
            self._hand_on()

    def _hand_on(self) -> None:
        """Put the frames that are complete, and have none open before them, among ``frames``."""
        while (block := self._open.get(self._next)) is not None and not block.left:
            self._complete += 1
            self._finish(block, Frame(block.number, block.done, bytes(block.buffer)))

    def _finish(self, block: _Block, frame: Frame | None) -> None:
        if frame is not None:
            self.frames.append(frame)
        del self._open[block.number]
        self._free.append((block.buffer, block.places))
        self._next = block.number + 1
        if self._current is block:
            self._current = self._nothing

    def _give_up(self, block: _Block, now: float) -> None:
        """Hand on what there is of the oldest frame."""
        if not block.left:
            self._hand_on()
            return
        if block.left == self._count:
            self._lost += 1
            self._finish(block, None)
            return
        missing = [i for i in range(1, len(block.got)) if block.got[i] != 1]
        for id_ in missing:
            start = (id_ - 1) * self._chunk
            end = start + len(block.places[id_])
            start, end = start // self._row * self._row, -(-end // self._row) * self._row
            block.buffer[start:end] = bytes(min(end, self._payload) - start)
        self._incomplete += 1
        size = sum(len(block.places[i]) for i in missing)
        self._finish(block, Frame(block.number, now, bytes(block.buffer), size))

    def tick(self, now: float) -> list[Resend]:
        """Look at the open frames, every few ms: give up what is overdue; what to ask for again."""
        requests: list[Resend] = []
        for block in list(self._open.values()):
            if not block.left:
                continue
            if block.left != block.left_before or block.moved == inf:
                block.moved, block.left_before = now, block.left
            gaps = list(self._gaps(block, now))
            if gaps:
                block.behind = min(block.behind, now)
                requests += self._asked(block, gaps, now)
        patience = GIVE_UP if self._resend else GIVE_UP_AT_ONCE
        while (oldest := self._open.get(self._next)) is not None:
            if oldest.left:
                hopeless = 0 < oldest.left == oldest.got.count(3, 1)
                if not hopeless and now - oldest.behind < patience:
                    break
            self._give_up(oldest, now)
        return requests

    def _gaps(self, block: _Block, now: float) -> Iterator[tuple[int, int]]:
        """First and last id of each run of data packets that should be here and are not."""
        end = len(block.got)
        if block.number == self._newest and now - block.moved < self._silence:
            end = block.expected & 0xFFFFFF
        if block.got.count(1, 1, end) == end - 1:
            return
        i = 1
        while i < end:
            if block.got[i] == 1:
                i += 1
                continue
            first = i
            while i < end and block.got[i] != 1:
                i += 1
            yield first, i - 1

    def _asked(self, block: _Block, gaps: list[tuple[int, int]], now: float) -> list[Resend]:
        """The requests that are due for ``gaps``."""
        if not self._resend or now - block.behind < ASK_AFTER + block.asked * ASK_AGAIN:
            return []
        block.asked += 1
        due = [(first, last) for first, last in gaps if block.got[first] != 3]
        for first, last in due:
            for i in range(first, last + 1):
                block.got[i] = max(block.got[i], 2)
        return [Resend(block.wire, first, last, extended=self._extended) for first, last in due]

    def flush(self, now: float) -> None:
        """Hand on what there is: the stream has ended."""
        while (block := self._open.get(self._next)) is not None:
            self._give_up(block, now)

    def statistics(self) -> StreamStatistics:
        """How it went so far."""
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
