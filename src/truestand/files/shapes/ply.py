"""The vertices of PLY files, binary or ascii, with whatever properties they have."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import UnreadableFile
from truestand.files.number_text import read_table, refuse_cut_table
from truestand.files.text import Dialect, refuse_nul

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_START = re.compile(rb"\s*ply[ \t]*(\r\n|\n|\r)")
_HEADER_END = re.compile(rb"[\r\n]end_header[ \t]*\r?\n")
_HEADER_END_MAC = re.compile(rb"\rend_header[ \t]*\r")
"""Where the first line ends so: a binary body may start with a line feed."""
_COUNT = re.compile(r"[0-9]{1,18}")
MOST_HEADER_BYTES = 65_536


@dataclass(frozen=True, slots=True)
class PlyHeader:
    """How a PLY holds its vertices."""

    byte_order: str
    """As numpy writes it; empty for ascii."""
    count: int
    record: "np.dtype[Any]"
    """The properties of one vertex."""
    size: int
    """Bytes of the header, after which the vertices start."""


def is_ply(data: bytes) -> bool:
    """Whether a file starts like a PLY."""
    return _START.match(data) is not None


def ply_header(data: bytes, name: str) -> PlyHeader:
    """The header at the beginning of a PLY.

    Raises:
        UnreadableFile: no PLY, no vertices first, or a list among their properties.
    """
    start = _START.match(data)
    pattern = _HEADER_END_MAC if start and start[1] == b"\r" else _HEADER_END
    end = pattern.search(data, 0, MOST_HEADER_BYTES)
    if start is None or end is None:
        raise UnreadableFile(f"{name}: the PLY's header is missing or cut off; copy the file again")
    return _layout(data[: end.end()], name)


def _layout(header: bytes, name: str) -> PlyHeader:
    """What a header says, whose first element must be the vertices."""
    order, count, element = None, None, ""
    fields: list[tuple[str, str]] = []
    for words in ([word.decode("latin-1") for word in line.split()] for line in re.split(rb"[\r\n]+", header)):
        match words:
            case ["format", encoding, _] if encoding in _BYTE_ORDERS and order is None:
                order = _BYTE_ORDERS[encoding]
            case ["format", *_]:
                raise UnreadableFile(f"{name}: found {' '.join(words)!r}, need one known format; export the PLY again")
            case ["element", "vertex", number] if _COUNT.fullmatch(number) and not element:
                element, count = "vertex", int(number)
            case ["element", *_]:
                element = element and "other"
                if not element:
                    raise UnreadableFile(f"{name}: the PLY's first element is not its vertices; export points only")
            case ["property", kind, field] if element == "vertex" and kind in _TYPES:
                fields.append((field, _TYPES[kind]))
            case ["property", *_] if element == "vertex":
                raise UnreadableFile(f"{name}: found {' '.join(words)!r} among the PLY's vertices, need plain numbers")
    if order is None or count is None or not fields or len({f for f, _ in fields}) < len(fields):
        raise UnreadableFile(f"{name}: the PLY's header names no format or no vertices; export it again")
    return PlyHeader(order, count, np.dtype([(field, order + kind) for field, kind in fields]), len(header))


def ply_vertices(data: bytes, name: str) -> dict[str, NDArray[Any]]:
    """The vertices of a PLY by property, each (n,).

    Raises:
        UnreadableFile: no PLY, no vertices first, a list among their properties, or cut off.
    """
    header = ply_header(data, name)
    if not header.byte_order:
        return _ascii_vertices(data, header, name)
    if len(data) - header.size < header.count * header.record.itemsize:
        raise UnreadableFile(f"{name}: the PLY promises {header.count} vertices and is cut off before; copy it again")
    vertices = np.frombuffer(data, dtype=header.record, count=header.count, offset=header.size)
    return {field: vertices[field] for field in header.record.names or ()}


def _ascii_vertices(data: bytes, header: PlyHeader, name: str) -> dict[str, NDArray[Any]]:
    count, fields = header.count, header.record.names or ()
    first_line = 1 + len(data[: header.size].splitlines())
    body = data[header.size :]
    refuse_nul(body, name, first_line)
    body = re.sub(rb"\r\n?", b"\n", body).replace(b"\t", b" ")
    rows = body.split(b"\n", count)[:count] if count <= len(body) else []
    if len(rows) < count or (count and not rows[-1].strip()):
        raise UnreadableFile(f"{name}: the PLY promises {count} vertices and is cut off before; copy it again")
    values = read_table(rows, Dialect(b" ", b"."), name, first_line) if rows else np.empty((0, len(fields)))
    if values.shape[1] != len(fields):
        raise UnreadableFile(f"{name}: found {values.shape[1]} numbers a vertex, need {len(fields)}")
    if rows and len(body.rstrip(b" ")) == len(b"\n".join(rows).rstrip(b" ")):
        refuse_cut_table(rows, b" ", name, first_line + count - 1)
    return {
        field: _as_declared(values[:, i], header.record[field], field, name, first_line)
        for i, field in enumerate(fields)
    }


def _as_declared(values: Array, dtype: "np.dtype[Any]", field: str, name: str, first_line: int) -> NDArray[Any]:
    """Numbers of a property as the header declares it.

    Raises:
        UnreadableFile: a number that the property can't hold, with the line.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        cast = values.astype(dtype)
        held = np.isfinite(cast) | np.isnan(values) if dtype.kind == "f" else cast == values
    if not held.all():
        row = int(np.flatnonzero(~held)[0])
        raise UnreadableFile(
            f"{name}: found {values[row]:.12g} in line {first_line + row}, which property {field!r} ({dtype.name}) "
            "can't hold; export it again"
        )
    return cast
