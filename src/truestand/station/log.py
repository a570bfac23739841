"""The frames of one sensor in memory, from when they are logged until they are decoded."""

import mmap
from collections.abc import Iterator

from truestand.files.scans.scan_log import SUSPECT, Record

MAP_BYTES = 1 << 26
"""Payloads are copied into maps of this size; the system has each back with its last frame, as no heap would do it."""


class Frames:
    """Those that can be decoded, each number once: the last one counts."""

    def __init__(self, frame_bytes: int) -> None:
        self._frame_bytes = frame_bytes
        self._by_number: dict[int, tuple[float, memoryview]] = {}
        self._free = memoryview(b"")
        """What is left of the newest map."""

    def __len__(self) -> int:
        return len(self._by_number)

    def add(self, record: Record) -> None:
        """Copy a frame, unless it has another size or the watch found something wrong with it."""
        size = self._frame_bytes
        if record.flags & SUSPECT or len(record.payload) != size:
            return
        if len(self._free) < size:
            self._free = memoryview(mmap.mmap(-1, max(MAP_BYTES, size)))
        payload, self._free = self._free[:size], self._free[size:]
        payload[:] = record.payload
        self._by_number[record.number] = (record.time, payload)

    def taken_out(self) -> Iterator[tuple[int, float, memoryview]]:
        """Number, arrival (s of the host's clock) and payload of each frame in order; it is forgotten after that."""
        self._free = memoryview(b"")
        for number in sorted(self._by_number):
            arrived, payload = self._by_number.pop(number)
            yield number, arrived, payload
