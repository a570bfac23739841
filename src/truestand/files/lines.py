"""A text file's lines by position, read when asked for: a scan of a hundred megabytes needs no copy in memory."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from truestand.core.errors import UnreadableFile
from truestand.files.number_text import PIECE
from truestand.files.text import refuse_nul

CHUNK = 1 << 20
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
LONGEST_BLANK = 200
"""Bytes: a line of white space isn't longer."""


class Lines:
    """The lines of an open file, without their line ends; a byte order mark is no part of them."""

    def __init__(self, path: Path, head: bytes) -> None:
        """Find the lines and the hash in one pass; ``head`` is the file's beginning and tells the line end.

        Raises:
            UnreadableFile: NUL bytes, or line ends of another kind inside a line.
        """
        self.marked = head.startswith(BYTE_ORDER_MARK)
        self.end = b"\r" if b"\r" in head and b"\n" not in head else b"\n"
        other = b"\n" if self.end == b"\r" else b"\r"
        ends: list[int] = []
        size, loose, before = 0, 0, b""
        hashed = hashlib.sha256()
        with path.open("rb") as file:
            while chunk := file.read(CHUNK):
                refuse_nul(chunk, path.name, len(ends) + 1)
                hashed.update(chunk)
                at = chunk.find(self.end)
                while at >= 0:
                    ends.append(size + at)
                    at = chunk.find(self.end, at + 1)
                if other in chunk:
                    loose += chunk.count(other)
                if other == b"\r" and loose:  # before a line feed it belongs to the line end
                    loose -= chunk.count(b"\r\n") + (before + chunk[:1] == b"\r\n")
                size, before = size + len(chunk), chunk[-1:]
        self._file = path.open("rb")
        self.sha256 = hashed.hexdigest()
        self.ended = bool(ends) and ends[-1] == size - 1
        if not self.ended:
            ends.append(size)
        self.ends = np.array(ends, dtype=np.intp)
        self.starts = np.concatenate([[len(BYTE_ORDER_MARK) * self.marked], self.ends[:-1] + 1])
        if loose:
            self._refuse_inside(other, path.name)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def __len__(self) -> int:
        return int(self.ends.size)

    def __getitem__(self, i: int) -> bytes:
        return self._read(self.starts[i], self.ends[i]).rstrip(b"\r")

    def text(self, block: range) -> bytes:
        """The lines of ``block`` with ``\\n`` between them."""
        text = self._read(self.starts[block.start], self.ends[block.stop - 1])
        return text.replace(b"\r", b"\n" if self.end == b"\r" else b"")

    def pieces(self, block: range) -> Iterator[bytes]:
        """The lines of ``block`` in pieces of whole lines, ``\\n`` at the end of each line."""
        first = block.start
        while first < block.stop:
            fit = int(np.searchsorted(self.ends, self.starts[first] + PIECE))
            stop = min(max(fit, first + 1), block.stop)
            yield self.text(range(first, stop)) + b"\n"
            first = stop

    def blank(self, i: int) -> bool:
        """Whether line i holds nothing but white space."""
        return self.ends[i] - self.starts[i] < LONGEST_BLANK and not self[i].strip()

    def _refuse_inside(self, other: bytes, name: str) -> None:
        for i in range(len(self)):
            if other in self[i]:
                self._file.close()
                raise UnreadableFile(
                    f"{name}: found {other!r} inside line {i + 1}, need {self.end!r} at the end of every line; the "
                    "file is damaged: export it again"
                )

    def _read(self, start: int, end: int) -> bytes:
        self._file.seek(start)
        return self._file.read(end - start)
