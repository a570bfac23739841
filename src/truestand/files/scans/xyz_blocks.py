"""XYZ blocks, the scanCONTROL export and the paper's K = [X Y Z]: block X, empty line, block Y, empty line, block Z.

One line a profile. A point without data is an empty cell, ``nan``, or left out (lines then differ in length and are
padded with NaN at the end). A separator that ends every line of a block adds no column. Only X and Z are parsed; of Y
the first and the last field of each line, because Y is one number a profile. Lines are read by position when they are
needed: a scan of a hundred megabytes needs no copy in memory.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.number_text import BLOCK_BYTES, Fields, read_fields
from truestand.files.scans.columns import MOST_FILLED, fill_rows, is_uneven
from truestand.files.text import (
    BYTE_ORDER_MARK,
    ENOUGH_FIELDS,
    LARGEST,
    Dialect,
    dialect_of,
    normalized,
    number_in,
    refuse_cut_number,
    refuse_nul,
    refuse_too_large,
)

FORMAT = "xyz blocks"
SAMPLE_BYTES = 20_000
READ_BYTES = 1 << 20
MOST_BLANK_BYTES = 200
"""A line of white space isn't longer."""


def is_xyz_blocks(head: bytes) -> bool:
    """Whether a text is a matrix of numbers without a header: the first line holds no letters but nan's."""
    text = head[:SAMPLE_BYTES].removeprefix(BYTE_ORDER_MARK).replace(b"\r", b"\n").lstrip()
    first = text.split(b"\n", 1)[0].lower()
    return bool(first) and not any(c in b"abcdfghijklmnopqrstuvwxyz\"'{}[]<>" for c in first.replace(b"nan", b""))


def read_xyz_blocks(path: Path, head: bytes) -> Recording:
    """The recording of an XYZ file that begins with ``head``.

    Raises:
        UnreadableFile: no three blocks of equal shape, no numbers, or an ambiguous decimal comma; with the line.
    """
    name = path.name
    with path.open("rb") as file:
        lines = _Lines(file, head, name)
        x_lines, y_lines, z_lines = _blocks(lines, name)
        dialect = _dialect(lines, name)
        x, z = (read_fields(lines.blocks(b), dialect, name, b.start + 1) for b in (x_lines, z_lines))
        x, z = _same_shape(x, z, x_lines, z_lines, name)
        _refuse_cut_last_number(lines, z_lines, dialect, name)
        y = _profile_values(lines, y_lines, dialect, name)
        return Recording(_matrix(x, x_lines, name), _matrix(z, z_lines, name), FORMAT, lines.sha256, y=y)


class _Lines:
    """The lines of an open file by position, without their line ends; a byte order mark is no part of them."""

    def __init__(self, file: BinaryIO, head: bytes, name: str) -> None:
        """Find the lines and the hash in one pass; ``head`` is the file's beginning and tells the line end.

        Raises:
            UnreadableFile: NUL bytes, or line ends of another kind inside a line.
        """
        self._file = file
        self.line_end = b"\r" if b"\r" in head and b"\n" not in head else b"\n"
        other = b"\n" if self.line_end == b"\r" else b"\r"
        ends: list[int] = []
        size, inside, last = 0, 0, b""
        digest = hashlib.sha256()
        while chunk := file.read(READ_BYTES):
            refuse_nul(chunk, name, len(ends) + 1)
            digest.update(chunk)
            at = chunk.find(self.line_end)
            while at >= 0:
                ends.append(size + at)
                at = chunk.find(self.line_end, at + 1)
            if other in chunk:
                inside += chunk.count(other)
            if other == b"\r" and inside:  # before a line feed it belongs to the line end
                inside -= chunk.count(b"\r\n") + (last + chunk[:1] == b"\r\n")
            size, last = size + len(chunk), chunk[-1:]
        self.sha256 = digest.hexdigest()
        self.complete = bool(ends) and ends[-1] == size - 1
        """Whether the last line has its line end."""
        if not self.complete:
            ends.append(size)
        self.ends = np.array(ends, dtype=np.intp)
        self.starts = np.concatenate([[len(BYTE_ORDER_MARK) * head.startswith(BYTE_ORDER_MARK)], self.ends[:-1] + 1])
        if inside:
            self._refuse_inside(other, name)

    def __len__(self) -> int:
        return int(self.ends.size)

    def __getitem__(self, i: int) -> bytes:
        return self._read(self.starts[i], self.ends[i]).rstrip(b"\r")

    def text(self, lines: range) -> bytes:
        """The text of ``lines`` with ``\\n`` between them."""
        text = self._read(self.starts[lines.start], self.ends[lines.stop - 1])
        return text.replace(b"\r", b"\n" if self.line_end == b"\r" else b"")

    def blocks(self, lines: range) -> Iterator[bytes]:
        """The text of ``lines`` in blocks of whole lines, ``\\n`` at the end of each line."""
        first = lines.start
        while first < lines.stop:
            fit = int(np.searchsorted(self.ends, self.starts[first] + BLOCK_BYTES))
            stop = min(max(fit, first + 1), lines.stop)
            yield self.text(range(first, stop)) + b"\n"
            first = stop

    def is_blank(self, i: int) -> bool:
        """Whether line i holds nothing but white space."""
        return self.ends[i] - self.starts[i] < MOST_BLANK_BYTES and not self[i].strip()

    def _refuse_inside(self, other: bytes, name: str) -> None:
        for i in range(len(self)):
            if other in self[i]:
                raise UnreadableFile(
                    f"{name}: found {other!r} inside line {i + 1}, need {self.line_end!r} at the end of every line; "
                    "the file is damaged: export it again"
                )

    def _read(self, start: int, end: int) -> bytes:
        self._file.seek(start)
        return self._file.read(end - start)


def _dialect(lines: _Lines, name: str) -> Dialect:
    """How the file's first lines are written."""
    enough = int(np.searchsorted(lines.ends, SAMPLE_BYTES)) or 1
    return dialect_of(lines.text(range(min(enough, len(lines)))), name)


def _blocks(lines: _Lines, name: str) -> tuple[range, range, range]:
    """The lines of X, Y and Z: two blank lines at a third and two thirds, or blank lines between three groups."""
    last = len(lines)
    while last and lines.is_blank(last - 1):
        last -= 1
    first = 0
    while first < last and lines.is_blank(first):
        first += 1
    n, rest = divmod(last - first - 2, 3)
    if rest == 0 and n > 0 and lines.is_blank(first + n) and lines.is_blank(first + 2 * n + 1):
        return range(first, first + n), range(first + n + 1, first + 2 * n + 1), range(first + 2 * n + 2, last)
    filled = [i for i in range(first, last) if not lines.is_blank(i)]
    groups = np.split(np.array(filled), np.flatnonzero(np.diff(filled) > 1) + 1) if filled else []
    if len(groups) != 3:
        raise UnreadableFile(
            f"{name}: found {len(groups)} block{'s' * (len(groups) != 1)} of numbers, need three (X, Y, Z) with an "
            "empty line between; the file may be cut off"
        )
    x, y, z = (range(int(g[0]), int(g[-1]) + 1) for g in groups)
    if len(x) != len(z):
        raise UnreadableFile(
            f"{name}: found {len(x)} profiles in block X and {len(z)} in block Z (the file ends in line {last}); "
            "it is cut off: export it again"
        )
    if len(y) != len(x):
        raise UnreadableFile(
            f"{name}: found {len(y)} profiles in block Y (lines {y.start + 1} to {y.stop}), need {len(x)} as in block "
            "X; the file is damaged: export it again"
        )
    return x, y, z


def _without_last(fields: Fields) -> Fields | None:
    """The fields without the empty one after a separator that ends every line; None where not every line ends so."""
    filled = fields.per_line > 0
    if not fields.last_empty[filled].all():
        return None
    last = np.cumsum(fields.per_line)[filled] - 1
    return Fields(np.delete(fields.values, last), fields.per_line - filled, np.zeros_like(fields.last_empty))


def _same_shape(x: Fields, z: Fields, x_lines: range, z_lines: range, name: str) -> tuple[Fields, Fields]:
    """X and Z, as many fields in a profile's line of the one block as of the other.

    A last column that is empty in every line of one block only looks like a separator at the end; it is NaN there.

    Raises:
        UnreadableFile: with the line.
    """
    shorter_x, shorter_z = _without_last(x), _without_last(z)
    same = np.array_equal(x.per_line, z.per_line)
    if not same or (shorter_x and shorter_z):
        x, z = shorter_x or x, shorter_z or z
    if not np.array_equal(x.per_line, z.per_line):
        row = int(np.flatnonzero(x.per_line != z.per_line)[0])
        raise UnreadableFile(
            f"{name}: found {z.per_line[row]} values in line {z_lines.start + row + 1} (block Z), need "
            f"{x.per_line[row]} as in line {x_lines.start + row + 1} (block X); the file may be cut off"
        )
    return x, z


def _matrix(fields: Fields, lines: range, name: str) -> Array:
    """One block's numbers (profiles, points), short lines filled up with NaN.

    Raises:
        UnreadableFile: a line so much longer than the others that it is damage; with the line.
    """
    if is_uneven(fields.per_line):
        raise UnreadableFile(
            f"{name}: found {fields.per_line.max()} values in line {lines.start + int(fields.per_line.argmax()) + 1} "
            f"and fewer than a {MOST_FILLED}th of it in most others, need lines of like length; export it again"
        )
    return fill_rows(fields.values, fields.per_line)


def _profile_values(lines: _Lines, block: range, dialect: Dialect, name: str) -> Array | None:
    """Y, one number a profile; None where a line's first and last field differ, or a line has none."""
    values = np.full(len(block), np.nan)
    for i, line in enumerate(block):
        row = lines[line].strip().strip(dialect.separator)
        ends = row.split(dialect.separator, 1)[0], row.rsplit(dialect.separator, 1)[-1]
        first, last = (number_in(normalized(end, dialect, name, line + 1).strip() or b"nan") for end in ends)
        if first is None or last is None:
            raise UnreadableFile(f"{name}: found no number in line {line + 1} (block Y); need numbers")
        if abs(first) > LARGEST or abs(last) > LARGEST:
            refuse_too_large(np.array([[first, last]]), name, line + 1)
        if first != last:
            return None
        values[i] = first
    return values


def _refuse_cut_last_number(lines: _Lines, block: range, dialect: Dialect, name: str) -> None:
    """Refuse a file that ends inside a number of its last block.

    Raises:
        UnreadableFile: with the last line.
    """
    first = max(block.start, block.stop - ENOUGH_FIELDS)
    tail = lines.text(range(first, block.stop))[-2000:]
    if not lines.complete and not tail.endswith(dialect.separator):
        fields = normalized(tail, dialect, name, first + 1).replace(b"\n", b",").split(b",")[1:]
        refuse_cut_number([field for field in fields if field.strip()], name, block.stop)
