r"""Gocator CSV version 2, the export of LMI sensors: sections of lines, each from its name to ``End``.

Surfaces stand in a section ``Part``: a header and values of the frame, then a grid whose first line (``Y\X``) holds X
and whose first column holds Y; a row is a profile. Profiles stand in ``Profile`` (X in the header of the columns) or
``RawProfile`` (lines of X), a line an axis and frame. An empty field is no data; lengths are mm. Each frame of a
surface and each source of profiles is a recording of its own. Stamp times have no unit in the file, so they are left
aside.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.number_text import blocks_of_lines, read_fields
from truestand.files.scans.columns import drop_constant, encoder_counts
from truestand.files.text import BYTE_ORDER_MARK, Dialect, refuse_nul

Row = tuple[int, bytes]
"""A line's number in the file, from 1, and its text."""

FORMAT = "gocator csv"
VERSION = b"2"
CORNER = b"Y\\X"
COMMA = Dialect(b",", b".")
SURFACE, PROFILES, POINTS = "Part", "Profile", "RawProfile"
ADVICE = "the file is cut off or damaged: export it again"
MOST_STAMP_DIGITS = 15
"""Of a frame, source or encoder count: float64 still holds them."""


@dataclass(frozen=True, slots=True)
class _File:
    """A file's name and hash, for its messages and recordings."""

    name: str
    sha256: str

    def refuse(self, line: int, found: str) -> UnreadableFile:
        return UnreadableFile(f"{self.name}: line {line} {found}; {ADVICE}")


def is_gocator(head: bytes) -> bool:
    """Whether a text starts with a section ``Info`` that tells its CSV version."""
    lines = head[:4096].removeprefix(BYTE_ORDER_MARK).replace(b"\r", b"\n").split()
    return len(lines) > 2 and lines[0] == b"Info" and lines[1] + b" " + lines[2][:7] == b"CSV Version"


def gocator_recordings(path: Path) -> Mapping[str, Callable[[], Recording]]:
    """What a file holds by name (``part-frame1-source0``, ``profile-source0``), each to be built when called for.

    Raises:
        UnreadableFile: another version, a section without its end, none that holds a scan, a value that is no number,
            or lines that don't fit; with the line.
    """
    data = path.read_bytes()
    file = _File(path.name, hashlib.sha256(data).hexdigest())
    refuse_nul(data, file.name)
    recordings: dict[str, Callable[[], Recording]] = {}
    sections = _sections(data, file)
    for section, rows in sections:
        if section == "Info":
            _refuse_other_version(rows, file)
        for name, read in _recordings_in(section, rows, file).items():
            if name in recordings:
                raise UnreadableFile(f"{file.name}: found {name} twice, need it once; {ADVICE}")
            recordings[name] = read
    if not recordings:
        raise UnreadableFile(
            f"{file.name}: found the sections {', '.join(name for name, _ in sections)}, need {SURFACE}, {PROFILES} or "
            f"{POINTS}; export the scan itself"
        )
    return recordings


def _recordings_in(section: str, rows: list[Row], file: _File) -> dict[str, Callable[[], Recording]]:
    """What a section holds, by name; empty where it holds no scan."""
    if section == SURFACE:
        return {name: partial(_surface, frame, file) for name, frame in _frames(rows, file).items()}
    if section in (PROFILES, POINTS):
        by_source = _sources(section, rows, file)
        return {name: partial(_profiles, source, rows[2], file) for name, source in by_source.items()}
    return {}


def _sections(data: bytes, file: _File) -> list[tuple[str, list[Row]]]:
    """Name and filled lines of every section."""
    text = data.removeprefix(BYTE_ORDER_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    sections: list[tuple[str, list[Row]]] = []
    rows: list[Row] = []
    for row in enumerate(text.split(b"\n"), start=1):
        if row[1].strip(b" ,\t") == b"End":
            if not rows:
                raise file.refuse(row[0], "ends a section that has no beginning")
            sections.append((rows[0][1].strip(b" ,\t").decode("latin-1")[:40], rows[1:]))
            rows = []
        elif row[1].strip():
            rows.append(row)
    if rows:
        raise file.refuse(rows[0][0], f"starts a section ({rows[0][1][:20].decode('latin-1')!r}) that has no End")
    return sections


def _refuse_other_version(rows: list[Row], file: _File) -> None:
    version = rows[1][1].split(b",", 1)[0].strip() if len(rows) > 1 else b""
    if version != VERSION:
        raise UnreadableFile(
            f"{file.name}: found CSV version {version[:20].decode('latin-1')!r}, need {VERSION.decode()}; export it "
            "again with firmware that writes it"
        )


def _frames(rows: list[Row], file: _File) -> dict[str, list[Row]]:
    """The lines of every frame of surfaces."""
    starts = [i for i, (_, text) in enumerate(rows) if text.startswith(b"Frame,")]
    if not starts or starts[0] > 0:
        raise UnreadableFile(f"{file.name}: the section {SURFACE} doesn't start with the frame's header; {ADVICE}")
    blocks = [rows[i:j] for i, j in zip(starts, [*starts[1:], len(rows)], strict=True)]
    found = {}
    for block in blocks:
        if len(block) < 4:
            raise file.refuse(block[0][0], f"starts a frame of {len(block)} lines")
        frame, source = (_stamp(block[0], block[1], key, file) for key in (b"Frame", b"Source"))
        found[f"part-frame{frame}-source{source}"] = block
    if len(found) < len(blocks):
        raise UnreadableFile(f"{file.name}: found a frame of a source twice, need it once; {ADVICE}")
    return found


def _surface(block: list[Row], file: _File) -> Recording:
    header, values, top, *rows = block
    rows_needed, columns_needed = (_stamp(header, values, key, file) for key in (b"Row Count", b"Column Count"))
    if not top[1].startswith(CORNER):
        raise file.refuse(top[0], f"is no first line of a grid, need {CORNER.decode()} and X")
    grid = _numbers([(top[0], b"0" + top[1][len(CORNER) :]), *rows], file, top)
    x, y, z = grid[0, 1:], grid[1:, 0], grid[1:, 1:]
    if z.shape != (rows_needed, columns_needed):
        raise file.refuse(top[0], f"starts {z.shape[0]} x {z.shape[1]} cells, need {rows_needed} x {columns_needed}")
    if not np.isfinite(grid[0]).all() or not np.isfinite(y).all():
        raise file.refuse(top[0], "starts a grid that lacks an X or Y")
    return Recording(np.tile(x, (len(y), 1)), z, FORMAT, file.sha256, y=y)


def _sources(section: str, rows: list[Row], file: _File) -> dict[str, list[Row]]:
    """The lines of data of every source of profiles."""
    if len(rows) < 4 or b"Axis" not in _fields(rows[2])[:-1]:
        raise UnreadableFile(f"{file.name}: the section {section} has no data under a header with Axis; {ADVICE}")
    found: dict[str, list[Row]] = {}
    for row in rows[3:]:
        _refuse_other_length(row, rows[2], file)
        source = _stamp(rows[2], row, b"Source", file)
        found.setdefault(f"{section.lower()}-source{source}", []).append(row)
    return found


def _profiles(rows: list[Row], header: Row, file: _File) -> Recording:
    """The profiles of one source: the frames in the order of the file."""
    first = _fields(header).index(b"Axis") + 1
    values = _numbers([_cut(row, first) for row in rows], file, _cut(header, first))
    row_of: dict[bytes, dict[int, int]] = {b"X": {}, b"Z": {}, b"I": {}}
    for i, row in enumerate(rows):
        axis, frame = _fields(row)[first - 1], _stamp(header, row, b"Frame", file)
        if axis not in row_of or frame in row_of[axis]:
            raise file.refuse(
                row[0], f"has axis {axis[:20].decode('latin-1')!r} of frame {frame}, need X, Z, I once each"
            )
        row_of[axis][frame] = i
    for axis in (b"X", b"I"):
        if row_of[axis] and row_of[axis].keys() != row_of[b"Z"].keys():
            raise file.refuse(rows[0][0], f"starts frames with Z but no {axis.decode()}, or the other way round")
    frames = list(row_of[b"Z"])
    encoder = [_stamp(header, rows[i], b"Encoder", file) for i in row_of[b"Z"].values()]
    return Recording(
        values[[row_of[b"X"][f] for f in frames]] if row_of[b"X"] else _positions(header, first, len(frames), file),
        values[[row_of[b"Z"][f] for f in frames]],
        FORMAT,
        file.sha256,
        encoder=encoder_counts(drop_constant(np.array(encoder, dtype=np.int64)), file.name),
        counter=drop_constant(np.array(frames, dtype=np.int64)),
        intensity=values[[row_of[b"I"][f] for f in frames]] if row_of[b"I"] else None,
    )


def _positions(header: Row, first: int, profiles: int, file: _File) -> Array:
    """X of resampled profiles, from the names of their columns."""
    x = _numbers([_cut(header, first)], file, _cut(header, first))
    if not np.isfinite(x).all():
        raise file.refuse(header[0], "lacks an X")
    return np.tile(x, (profiles, 1))


def _fields(row: Row) -> list[bytes]:
    return [field.strip() for field in row[1].split(b",")]


def _stamp(header: Row, row: Row, key: bytes, file: _File) -> int:
    """The whole number under a name of the header."""
    named = zip(_fields(header), _fields(row), strict=False)
    field = next((field for name, field in named if name == key), b"")
    if not field.removeprefix(b"-").isdigit() or len(field) > MOST_STAMP_DIGITS:
        raise file.refuse(row[0], f"has {field[:20].decode('latin-1')!r} as {key.decode()}, need a whole number")
    return int(field)


def _cut(row: Row, first: int) -> Row:
    """A line from its field ``first`` on."""
    return row[0], b",".join(row[1].split(b",")[first:])


def _refuse_other_length(row: Row, like: Row, file: _File) -> None:
    found, needed = (text.count(b",") + 1 for _, text in (row, like))
    if found != needed:
        raise file.refuse(row[0], f"has {found} cells, need {needed} as in line {like[0]}")


def _numbers(rows: list[Row], file: _File, like: Row) -> Array:
    """Lines as numbers, each of as many fields as the line ``like``; an empty field is NaN.

    Raises:
        UnreadableFile: another number of fields, or a field that is no finite number; with the line.
    """
    lines, before = [], rows[0][0] - 1
    for row in rows:
        _refuse_other_length(row, like, file)
        lines.append(b"\n" * (row[0] - before - 1) + (row[1].strip() or b"nan"))  # other lines between are left blank
        before = row[0]
    text = b"\n".join(lines)
    return read_fields(blocks_of_lines(text), COMMA, file.name, rows[0][0]).values.reshape(len(rows), -1)
