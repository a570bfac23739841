"""Cartesian points (n, 3) mm from text (x y z), PLY and NIST's .ds, told apart by their content."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import UnreadableFile
from truestand.files.lines import BYTE_ORDER_MARK
from truestand.files.text import Dialect, check_text, dialect_of, normal, refuse_infinite, refuse_nul, refuse_words

Array = NDArray[np.float64]

_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_HEADER_END = re.compile(rb"end_header[ \t]*\r?\n")
_WORDS = re.compile(rb"[A-Za-z_]{2,}|^[\s\"]*[xX]\b")
LONGEST_HEADER = 65_536


def read_points(path: Path | str) -> Array:
    """The points of a file, (n, 3) mm; further columns or properties are left aside.

    Raises:
        UnreadableFile: missing, empty, cut off, no numbers, or ambiguous; with the line where there is one.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong}); check the path") from wrong
    if data.startswith(b"ply"):
        vertices = read_ply(path)
        missing = [axis for axis in "xyz" if axis not in vertices]
        if missing:
            raise UnreadableFile(f"{path.name}: the PLY's vertices have no {missing[0]}; need x, y and z")
        points = np.column_stack([vertices[axis].astype(np.float64) for axis in "xyz"])
        refuse_infinite(points, path.name, 1)
        return points
    return _text_points(data.removeprefix(BYTE_ORDER_MARK), path.name)


def read_ply(path: Path | str) -> dict[str, NDArray[Any]]:
    """The vertices of a PLY, binary or ascii, by property.

    Raises:
        UnreadableFile: no PLY, no vertices, a list among their properties, or cut off.
    """
    path = Path(path)
    data = path.read_bytes()
    end = _HEADER_END.search(data, 0, LONGEST_HEADER)
    if not data.startswith(b"ply") or end is None:
        raise UnreadableFile(f"{path.name}: the PLY's header is missing or cut off")
    order, count, kind = _ply_layout(data[: end.start()].decode("latin-1"), path.name)
    if not order:
        return _ascii_vertices(data[end.end() :], count, kind, path.name)
    if len(data) - end.end() < count * kind.itemsize:
        raise UnreadableFile(f"{path.name}: the PLY promises {count} vertices and is cut off before; copy it again")
    vertices = np.frombuffer(data, dtype=kind, count=count, offset=end.end())
    return {name: vertices[name] for name in kind.names or ()}


def _ply_layout(head: str, name: str) -> tuple[str, int, "np.dtype[Any]"]:
    """Byte order, count and record of the vertices, which must be the first element."""
    order, count, element = None, None, ""
    fields: list[tuple[str, str]] = []
    for words in (line.split() for line in head.splitlines()):
        match words:
            case ["format", found, _] if found in _PLY_ORDERS:
                order = _PLY_ORDERS[found]
            case ["element", "vertex", number] if number.isdecimal() and not element:
                element, count = "vertex", int(number)
            case ["element", *_]:
                element = element and "other"
                if not element:
                    raise UnreadableFile(f"{name}: the PLY's first element is not its vertices; export points only")
            case ["property", kind, field] if element == "vertex" and kind in _PLY_TYPES:
                fields.append((field, (order or "") + _PLY_TYPES[kind]))
            case ["property", *_] if element == "vertex":
                raise UnreadableFile(f"{name}: found {' '.join(words)!r} among the PLY's vertices, need plain numbers")
    if order is None or count is None or not fields or len({f for f, _ in fields}) < len(fields):
        raise UnreadableFile(f"{name}: the PLY's header names no format or no vertices; export it again")
    return order, count, np.dtype(fields)


def _ascii_vertices(body: bytes, count: int, kind: "np.dtype[Any]", name: str) -> dict[str, NDArray[Any]]:
    rows = body.split(b"\n", count)[:count] if count <= len(body) else []
    if len(rows) < count or (count and not rows[-1].strip()):
        raise UnreadableFile(f"{name}: the PLY promises {count} vertices and is cut off before; copy it again")
    names = kind.names or ()
    values = _numbers(rows, Dialect(b" ", b"."), name, 1) if rows else np.empty((0, len(names)))
    if values.shape[1] != len(names):
        raise UnreadableFile(f"{name}: found {values.shape[1]} numbers a vertex, need {len(names)}")
    return {field: values[:, i].astype(kind[field]) for i, field in enumerate(names)}


def _text_points(data: bytes, name: str) -> Array:
    refuse_nul(data, name)
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    rows = (data if b";" in data else re.sub(rb"[ \t]+", b" ", data)).split(b"\n")
    first = 0
    while first < len(rows) and _is_heading(rows[first]):
        first += 1
    kept = rows[first:]
    while kept and not kept[-1].strip():
        kept.pop()
    if not kept:
        raise UnreadableFile(f"{name}: the file is empty; need points, x y z a line, in mm")
    promised = int(kept[0]) if kept[0].strip().isdigit() else None
    if promised is not None:
        kept, first = kept[1:], first + 1
        if len(kept) != promised:
            raise UnreadableFile(f"{name}: promises {promised} points and holds {len(kept)}; copy it again")
    if not kept:
        raise UnreadableFile(f"{name}: holds no points; need x y z a line, in mm")
    check_text(b"\n" * first + b"\n".join(kept), name)
    values = _numbers(kept, dialect_of(b"\n".join(kept[:50]), name), name, first + 1)
    if values.shape[1] < 3:
        raise UnreadableFile(f"{name}: found {values.shape[1]} numbers a line, need x y z; add the missing coordinate")
    return values[:, :3]


def _is_heading(row: bytes) -> bool:
    """An empty line, a comment, or a line of column names."""
    row = row.strip()
    words = _WORDS.search(row) is not None and not re.match(rb"[-+]?(nan|inf)", row, re.IGNORECASE)
    return not row or row.startswith((b"#", b"//")) or words


def _numbers(rows: list[bytes], dialect: Dialect, name: str, first_line: int) -> Array:
    """All rows as numbers (n, columns).

    Raises:
        UnreadableFile: words, too large numbers, or rows of different lengths, with the line.
    """
    text = normal(b"\n".join(rows), dialect)
    plain = [row.rstrip(b", ") for row in text.split(b"\n")]
    wide = plain[0].count(b",")
    for i, row in enumerate(plain):
        if row.count(b",") != wide or not row:
            raise UnreadableFile(
                f"{name}: found {row.count(b',') + bool(row)} numbers in line {first_line + i}, need {wide + 1} as in "
                "the lines before; copy the file again or export it without gaps"
            )
    try:
        values = np.array(b",".join(plain).split(b","), dtype="S").astype(np.float64).reshape(len(plain), wide + 1)
    except ValueError:
        refuse_words(plain, name, first_line)
        raise UnreadableFile(f"{name}: found no numbers; need x y z a line, in mm") from None
    refuse_infinite(values, name, first_line)
    return values
