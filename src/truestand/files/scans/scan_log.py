"""The log that a scan is recorded to: append only, a checksum for every record, readable after any crash.

    file    := MAGIC record*
    record  := mark "\\xf5TSL" | kind u8 | source u8 | flags u16 | length u32 | number u64 | time f64 | crc32 u32
               | payload

Little endian; the checksum covers kind to time and the payload. Every record is one write to the operating system, so a
killed process loses at most the record that it was writing; records before and after damage are still found by their
marks. An HDF5 file would not survive that (docs/decisions/0014-recording.md).
"""

import json
import mmap
import os
import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from zlib import crc32

from truestand.core.errors import NoSpace, UnreadableFile

MAGIC = b"truestand scan log 1\n"
MARK = b"\xf5TSL"
HEADER = struct.Struct("<4sBBHIQdI")
CHECKED = struct.Struct("<BBHIQd")
MOST_PAYLOAD_BYTES = 1 << 28
"""A header that claims more is damage."""
SYNC_INTERVAL_S = 1.0
"""Between two requests to put the log onto the disk itself, against loss of power."""


class Kind(IntEnum):
    """What a record holds."""

    BEGIN = 1
    """JSON: what is recorded and how to read it; the first record."""
    FRAME = 2
    """A sensor's frame as it came; source = the sensor's place in BEGIN, number = the frame's."""
    TABLE = 3
    """``TABLE``: the table's position and state."""
    EVENT = 4
    """JSON: a change of state, a fault."""
    END = 5
    """JSON: how it ended; only this record can prove a scan complete."""


KINDS = frozenset(Kind)

INCOMPLETE = 1
"""Flag of a FRAME: bytes are missing from its payload."""
SUSPECT = 2
"""Flag of a FRAME: the watch found something wrong with it; it is kept, but no scan is made of it."""
TABLE = struct.Struct("<ddB")
"""Position (rad), uncertainty of the time (s), moving 0 or 1."""


@dataclass(frozen=True, slots=True)
class Record:
    """One record. ``time``: s of the recording host's monotonic clock."""

    kind: Kind
    source: int
    number: int
    time: float
    payload: bytes
    flags: int = 0

    def json(self) -> dict[str, Any]:
        """The payload of BEGIN, EVENT and END.

        Raises:
            UnreadableFile: no JSON object.
        """
        try:
            content = json.loads(self.payload)
        except (ValueError, RecursionError) as wrong:
            raise UnreadableFile(f"the log's {self.kind.name} record holds no JSON ({wrong})") from wrong
        if not isinstance(content, dict):
            raise UnreadableFile(f"the log's {self.kind.name} record holds no JSON object")
        return content


class LogWriter:
    """Appends records, from any thread; ``written`` is called with each once it is in the file, in the file's order.

    Raises:
        NoSpace: the disk is full or read-only, at any append; what was written before stays valid.
        FileExistsError: a log is never overwritten.
    """

    def __init__(self, path: Path, written: Callable[[Record], None] = lambda record: None) -> None:
        self.path = path
        self._written = written
        self._lock = threading.Lock()
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0))
        self._ended = threading.Event()
        self._unsynced: OSError | None = None
        self._write(MAGIC)
        self._syncing = threading.Thread(target=self._sync, name="log to disk", daemon=True)
        self._syncing.start()

    def append(self, kind: Kind, payload: bytes, time: float, source: int = 0, number: int = 0, flags: int = 0) -> None:
        """Add a record."""
        covered = CHECKED.pack(kind, source, flags, len(payload), number, time)
        checksum = crc32(payload, crc32(covered))
        head = HEADER.pack(MARK, kind, source, flags, len(payload), number, time, checksum)
        with self._lock:
            self._write(head + payload)
            self._written(Record(kind, source, number, time, payload, flags))

    def append_json(self, kind: Kind, content: dict[str, Any], time: float) -> None:
        """Add a BEGIN, EVENT or END record."""
        self.append(kind, json.dumps(content, allow_nan=False).encode(), time)

    def close(self) -> None:
        """Put everything onto the disk.

        Raises:
            NoSpace: the disk failed, now or since the last append.
        """
        if self._ended.is_set():
            return
        self._ended.set()
        self._syncing.join()
        try:
            if self._unsynced is not None:
                raise self._unsynced
            os.fsync(self._file)
        except OSError as wrong:
            raise self._failure(wrong) from wrong
        finally:
            os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, wrong: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _write(self, data: bytes) -> None:
        """All of it: a short write means that the disk is just full, and the rest then fails with the reason."""
        try:
            if self._unsynced is not None:
                raise self._unsynced
            written = os.write(self._file, data)
            while written < len(data):
                written += os.write(self._file, data[written:])
        except OSError as wrong:
            raise self._failure(wrong) from wrong

    def _failure(self, wrong: OSError) -> NoSpace:
        return NoSpace(
            f"{self.path}: can't go on recording ({wrong.strerror or wrong}); what was recorded so far is kept: "
            "free some space, then `truestand recover` it"
        )

    def _sync(self) -> None:
        while not self._ended.wait(SYNC_INTERVAL_S):
            try:
                os.fsync(self._file)
            except OSError as wrong:
                self._unsynced = wrong
                return


@dataclass(frozen=True, slots=True)
class Damage:
    """A stretch of a log that holds no valid record."""

    start: int
    bytes: int


def read_log(path: Path, damages: list[Damage] | None = None) -> Iterator[Record]:
    """The valid records of a log in their order; what is not valid is skipped and listed in ``damages``.

    Raises:
        UnreadableFile: missing, empty, or no log.
    """
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise UnreadableFile(f"{path.name}: no truestand scan log; give the .log file that `acquire` left")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                yield from _records(data, [] if damages is None else damages)
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong}); check the path") from wrong


def _records(data: mmap.mmap, damages: list[Damage]) -> Iterator[Record]:
    place = len(MAGIC)
    while place < len(data):
        record, end = _record_at(data, place)
        if record is None:
            end = _next_valid(data, place + 1)
            damages.append(Damage(place, end - place))
        else:
            yield record
        place = end


def _next_valid(data: mmap.mmap, place: int) -> int:
    """Where the next valid record starts, or the end."""
    while (place := data.find(MARK, place)) >= 0:
        if _record_at(data, place)[0] is not None:
            return place
        place += 1
    return len(data)


def _record_at(data: mmap.mmap, place: int) -> tuple[Record | None, int]:
    if len(data) - place < HEADER.size:
        return None, place
    mark, kind, source, flags, length, number, time, checksum = HEADER.unpack_from(data, place)
    start, end = place + HEADER.size, place + HEADER.size + length
    if mark != MARK or length > MOST_PAYLOAD_BYTES or end > len(data):
        return None, place
    payload = data[start:end]
    covered = CHECKED.pack(kind, source, flags, length, number, time)
    if crc32(payload, crc32(covered)) != checksum or kind not in KINDS:
        return None, place
    return Record(Kind(kind), source, number, time, payload, flags), end
