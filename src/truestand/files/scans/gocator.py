r"""Gocator CSV version 2, the export of LMI sensors: sections of lines, each from its name to ``End``.

Surfaces stand in a section ``Part``: a header and values of the frame, then a grid whose first line (``Y\X``) holds X
and whose first column holds Y; a row is a profile. Profiles stand in ``Profile`` (X in the header of the columns) or
``RawProfile`` (lines of X), a line an axis and frame. An empty cell is no data; lengths are mm. Each frame of a surface
and each source of profiles is a recording of its own. Stamp times have no unit in the file, so they are left aside.
"""

import hashlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.lines import BYTE_ORDER_MARK
from truestand.files.scans.columns import counts, running
from truestand.files.text import refuse_infinite, refuse_nul, refuse_words, written_out

Array = NDArray[np.float64]
Row = tuple[int, bytes]
"""A line's number in the file, from 1, and its text."""

FORMAT = "gocator csv"
VERSION = b"2"
CORNER = b"Y\\X"
SURFACE, PROFILES, POINTS = "Part", "Profile", "RawProfile"
ADVICE = "the file is cut off or damaged: export it again"
LARGEST_STAMP = 15
"""Digits of a frame, source or encoder count that float64 still holds."""


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
    found: dict[str, Callable[[], Recording]] = {}
    names = []
    for name, rows in _sections(data, file):
        names.append(name)
        if name == "Info":
            _refuse_other_version(rows, file)
        elif name == SURFACE:
            _add(found, {key: partial(_surface, block, file) for key, block in _frames(rows, file).items()}, file)
        elif name in (PROFILES, POINTS):
            by_source = _sources(name, rows, file)
            _add(found, {key: partial(_profiles, block, rows[2], file) for key, block in by_source.items()}, file)
    if not found:
        raise UnreadableFile(
            f"{file.name}: found the sections {', '.join(names)}, need {SURFACE}, {PROFILES} or {POINTS}; export the "
            "scan itself"
        )
    return found


def _add(found: dict[str, Callable[[], Recording]], more: Mapping[str, Callable[[], Recording]], file: _File) -> None:
    for key in more:
        if key in found:
            raise UnreadableFile(f"{file.name}: found {key} twice, need it once; {ADVICE}")
    found.update(more)


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
    shape = tuple(_stamp(header, values, key, file) for key in (b"Row Count", b"Column Count"))
    if not top[1].startswith(CORNER):
        raise file.refuse(top[0], f"is no first line of a grid, need {CORNER.decode()} and X")
    grid = _numbers([(top[0], b"0" + top[1][len(CORNER) :]), *rows], file, top)
    if grid.shape != (shape[0] + 1, shape[1] + 1):
        raise file.refuse(
            top[0], f"starts {grid.shape[0] - 1} x {grid.shape[1] - 1} cells, need {shape[0]} x {shape[1]}"
        )
    x, y, z = grid[0, 1:], grid[1:, 0], grid[1:, 1:]
    if not np.isfinite(grid[0]).all() or not np.isfinite(y).all():
        raise file.refuse(top[0], "starts a grid that lacks an X or Y")
    return Recording(np.tile(x, (len(y), 1)), z, FORMAT, file.sha256, y=y)


def _sources(section: str, rows: list[Row], file: _File) -> dict[str, list[Row]]:
    """The lines of data of every source of profiles."""
    if len(rows) < 4 or b"Axis" not in _cells(rows[2])[:-1]:
        raise UnreadableFile(f"{file.name}: the section {section} has no data under a header with Axis; {ADVICE}")
    found: dict[str, list[Row]] = {}
    for row in rows[3:]:
        _refuse_other_length(row, rows[2], file)
        source = _stamp(rows[2], row, b"Source", file)
        found.setdefault(f"{section.lower()}-source{source}", []).append(row)
    return found


def _profiles(rows: list[Row], header: Row, file: _File) -> Recording:
    """The profiles of one source: the frames in the order of the file."""
    first = _cells(header).index(b"Axis") + 1
    values = _numbers([_cut(row, first) for row in rows], file, _cut(header, first))
    at: dict[bytes, dict[int, int]] = {b"X": {}, b"Z": {}, b"I": {}}
    for i, row in enumerate(rows):
        axis, frame = _cells(row)[first - 1], _stamp(header, row, b"Frame", file)
        if axis not in at or frame in at[axis]:
            raise file.refuse(
                row[0], f"has axis {axis[:20].decode('latin-1')!r} of frame {frame}, need X, Z, I once each"
            )
        at[axis][frame] = i
    for axis in (b"X", b"I"):
        if at[axis] and at[axis].keys() != at[b"Z"].keys():
            raise file.refuse(rows[0][0], f"starts frames with Z but no {axis.decode()}, or the other way round")
    if not at[b"Z"]:
        raise file.refuse(rows[0][0], "starts frames without Z")
    frames = list(at[b"Z"])
    heads = [rows[at[b"Z"][frame]] for frame in frames]
    encoder = running(np.array([_stamp(header, row, b"Encoder", file) for row in heads], dtype=np.int64))
    return Recording(
        values[[at[b"X"][f] for f in frames]] if at[b"X"] else _positions(header, first, len(frames), file),
        values[[at[b"Z"][f] for f in frames]],
        FORMAT,
        file.sha256,
        encoder=None if encoder is None else counts(encoder, "an encoder count", file.name),
        counter=running(np.array(frames, dtype=np.int64)),
        intensity=values[[at[b"I"][f] for f in frames]] if at[b"I"] else None,
    )


def _positions(header: Row, first: int, profiles: int, file: _File) -> Array:
    """X of resampled profiles, from the names of their columns."""
    x = _numbers([_cut(header, first)], file, _cut(header, first))
    if not np.isfinite(x).all():
        raise file.refuse(header[0], "lacks an X")
    return np.tile(x, (profiles, 1))


def _cells(row: Row) -> list[bytes]:
    return [cell.strip() for cell in row[1].split(b",")]


def _stamp(header: Row, row: Row, key: bytes, file: _File) -> int:
    """The whole number under a name of the header."""
    names, cells = _cells(header), _cells(row)
    cell = cells[names.index(key)] if key in names and names.index(key) < len(cells) else b""
    if not cell.removeprefix(b"-").isdigit() or len(cell) > LARGEST_STAMP:
        raise file.refuse(row[0], f"has {cell[:20].decode('latin-1')!r} as {key.decode()}, need a whole number")
    return int(cell)


def _cut(row: Row, first: int) -> Row:
    """A line from its cell ``first`` on."""
    return row[0], b",".join(row[1].split(b",")[first:])


def _refuse_other_length(row: Row, like: Row, file: _File) -> None:
    found, needed = (text.count(b",") + 1 for _, text in (row, like))
    if found != needed:
        raise file.refuse(row[0], f"has {found} cells, need {needed} as in line {like[0]}")


def _numbers(rows: list[Row], file: _File, like: Row) -> Array:
    """Lines as numbers, each of as many cells as the line ``like``; an empty cell is NaN."""
    cells = like[1].count(b",") + 1
    for row in rows:
        _refuse_other_length(row, like, file)
    filled = [written_out(text, cells) for _, text in rows]
    try:
        values = np.loadtxt(io.BytesIO(b"\n".join(filled)), delimiter=",", ndmin=2, comments=None)
    except ValueError as wrong:
        for (line, _), text in zip(rows, filled, strict=True):
            refuse_words([text], file.name, line)
        raise UnreadableFile(f"{file.name}: lines {rows[0][0]} to {rows[-1][0]}: {wrong}") from wrong
    for (line, _), row in zip(rows, values, strict=True):
        refuse_infinite(row[None], file.name, line)
    return values
