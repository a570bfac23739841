"""Cartesian points (n, 3) mm from text (x y z), PLY and NIST's .ds, told apart by their content.

Names place the columns, and give their units; text without names holds x y z first, in mm. What names can't place is
refused, because another column reads as a coordinate too, and a factor of a thousand is nobody's guess.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.text import (
    BYTE_ORDER_MARK,
    ENOUGH_FIELDS,
    MM_PER_UNIT,
    Dialect,
    check_text,
    column_names,
    dialect_of,
    names_profiles,
    normalized,
    number_in,
    refuse_cut_number,
    refuse_infinite,
    refuse_nul,
    refuse_words,
)

Array = NDArray[np.float64]

_PLY_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_PLY_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_PLY_START = re.compile(rb"\s*ply[ \t]*(\r\n|\n|\r)")
_HEADER_END = re.compile(rb"[\r\n]end_header[ \t]*\r?\n")
_HEADER_END_MAC = re.compile(rb"\rend_header[ \t]*\r")
"""Where the first line ends so: a binary body may start with a line feed."""
_WORDS = re.compile(rb"[A-Za-z_]{2,}|^[\s\"]*[A-Za-z]\b.*[A-Za-z]")
_COMMENT = re.compile(rb"\A\s*(#|//)[#/\s]*(\w+:)?")
"""Its mark, and a label such as ``columns:``."""
_BRACKETS = re.compile(rb" ?[\[(] ?(\w+) ?[\])]")
_MICRO = re.compile(rb"\xc2\xb5|\xce\xbc|\xb5")
"""The micro sign and the Greek letter in UTF-8, the micro sign in Latin-1."""
AXES = ["x", "y", "z"]
_COUNT = re.compile(r"[0-9]{1,18}")
LONGEST_HEADER = 65_536


def read_points(path: Path | str, columns: str | None = None, unit: str | None = None) -> Array:
    """The points of a file, (n, 3) mm; further columns or properties are left aside.

    ``columns`` says which are x, y and z, by names or by numbers from 1: ``"east,north,up"``, ``"2,3,4"``. ``unit``
    (mm, um, m) is that of columns whose names give none; without it they are in mm.

    Raises:
        UnreadableFile: missing, empty, cut off, no numbers, or ambiguous; with the line where there is one. Names that
            don't place x, y and z, or units that are not known or contradict ``unit``.
        BadRecipe: ``columns`` are not three.
    """
    wanted = None if columns is None else _names(columns.encode())
    path = Path(path)
    try:
        data = path.read_bytes().removeprefix(BYTE_ORDER_MARK)
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong}); check the path") from wrong
    if _PLY_START.match(data):
        vertices = _vertices(data, path.name)
        places = _places([name.lower() for name in vertices], wanted or AXES, unit, path.name)
        points = _in_mm(list(vertices.values()), places)
        _refuse_infinite_vertex(points, path.name)
        return points
    return _text_points(data, wanted, unit, path.name)


def read_ply(path: Path | str) -> dict[str, NDArray[Any]]:
    """The vertices of a PLY, binary or ascii, by property.

    Raises:
        UnreadableFile: no PLY, no vertices, a list among their properties, or cut off.
    """
    path = Path(path)
    return _vertices(path.read_bytes().removeprefix(BYTE_ORDER_MARK), path.name)


def _vertices(data: bytes, name: str) -> dict[str, NDArray[Any]]:
    start = _PLY_START.match(data)
    pattern = _HEADER_END_MAC if start and start[1] == b"\r" else _HEADER_END
    end = pattern.search(data, 0, LONGEST_HEADER)
    if start is None or end is None:
        raise UnreadableFile(f"{name}: the PLY's header is missing or cut off; copy the file again")
    order, count, kind = _ply_layout(re.split(rb"[\r\n]+", data[: end.start()]), name)
    if not order:
        first_line = 1 + len(data[: end.end()].splitlines())
        return _ascii_vertices(data[end.end() :], count, kind, name, first_line)
    if len(data) - end.end() < count * kind.itemsize:
        raise UnreadableFile(f"{name}: the PLY promises {count} vertices and is cut off before; copy it again")
    vertices = np.frombuffer(data, dtype=kind, count=count, offset=end.end())
    return {field: vertices[field] for field in kind.names or ()}


def _refuse_infinite_vertex(points: Array, name: str) -> None:
    wrong = np.flatnonzero(np.isinf(points).any(axis=1))
    if wrong.size:
        raise UnreadableFile(f"{name}: found a number too large in vertex {wrong[0] + 1}; need finite numbers")


def _ply_layout(head: list[bytes], name: str) -> tuple[str, int, "np.dtype[Any]"]:
    """Byte order, count and record of the vertices, which must be the first element."""
    order, count, element = None, None, ""
    fields: list[tuple[str, str]] = []
    for words in ([word.decode("latin-1") for word in line.split()] for line in head):
        match words:
            case ["format", found, _] if found in _PLY_ORDERS and order is None:
                order = _PLY_ORDERS[found]
            case ["format", *_]:
                raise UnreadableFile(f"{name}: found {' '.join(words)!r}, need one known format; export the PLY again")
            case ["element", "vertex", number] if _COUNT.fullmatch(number) and not element:
                element, count = "vertex", int(number)
            case ["element", *_]:
                element = element and "other"
                if not element:
                    raise UnreadableFile(f"{name}: the PLY's first element is not its vertices; export points only")
            case ["property", kind, field] if element == "vertex" and kind in _PLY_TYPES:
                fields.append((field, _PLY_TYPES[kind]))
            case ["property", *_] if element == "vertex":
                raise UnreadableFile(f"{name}: found {' '.join(words)!r} among the PLY's vertices, need plain numbers")
    if order is None or count is None or not fields or len({f for f, _ in fields}) < len(fields):
        raise UnreadableFile(f"{name}: the PLY's header names no format or no vertices; export it again")
    return order, count, np.dtype([(field, order + kind) for field, kind in fields])


def _ascii_vertices(
    body: bytes, count: int, kind: "np.dtype[Any]", name: str, first_line: int
) -> dict[str, NDArray[Any]]:
    refuse_nul(body, name, first_line)
    body = re.sub(rb"\r\n?", b"\n", body).replace(b"\t", b" ")
    rows = body.split(b"\n", count)[:count] if count <= len(body) else []
    if len(rows) < count or (count and not rows[-1].strip()):
        raise UnreadableFile(f"{name}: the PLY promises {count} vertices and is cut off before; copy it again")
    names = kind.names or ()
    values = _numbers(rows, Dialect(b" ", b"."), name, first_line) if rows else np.empty((0, len(names)))
    if values.shape[1] != len(names):
        raise UnreadableFile(f"{name}: found {values.shape[1]} numbers a vertex, need {len(names)}")
    if rows and len(body.rstrip(b" ")) == len(b"\n".join(rows).rstrip(b" ")):
        _whole_last_number(rows, b" ", name, first_line + count - 1)
    return {field: _as_kind(values[:, i], kind[field], field, name, first_line) for i, field in enumerate(names)}


def _as_kind(values: Array, kind: "np.dtype[Any]", field: str, name: str, first_line: int) -> NDArray[Any]:
    """Numbers of a property as the header declares it.

    Raises:
        UnreadableFile: a number that the property can't hold, with the line.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        cast = values.astype(kind)
        held = np.isfinite(cast) | np.isnan(values) if kind.kind == "f" else cast == values
    if not held.all():
        row = int(np.flatnonzero(~held)[0])
        raise UnreadableFile(
            f"{name}: found {values[row]:.12g} in line {first_line + row}, which property {field!r} ({kind.name}) "
            "can't hold; export it again"
        )
    return cast


def _text_points(data: bytes, wanted: list[str] | None, unit: str | None, name: str) -> Array:
    refuse_nul(data, name)
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    rows = (data if b";" in data else re.sub(rb"[ \t]+", b" ", data)).split(b"\n")
    first = 0
    while first < len(rows) and _is_heading(rows[first]):
        first += 1
    heading = data.split(b"\n", first)[:first]
    if wanted is None and names_profiles(names := _names(rows[0])) and "y" not in _stems(names):
        raise UnreadableFile(
            f"{name}: found a scan (profile, x, z), need points; pass --calibration CALIBRATION.json, or roll it up"
        )
    kept = rows[first:]
    while kept and not kept[-1].strip():
        kept.pop()
    if not kept:
        raise UnreadableFile(f"{name}: the file is empty; need points, x y z a line, in mm")
    promised = int(kept[0]) if _COUNT.fullmatch(kept[0].strip().decode("latin-1")) else None
    if promised is not None:
        kept, first = kept[1:], first + 1
        if len(kept) != promised:
            raise UnreadableFile(f"{name}: promises {promised} points and holds {len(kept)}; copy it again")
    if not kept:
        raise UnreadableFile(f"{name}: holds no points; need x y z a line, in mm")
    dialect = dialect_of(b"\n".join(kept[:50]), name)
    values = _numbers(kept, dialect, name, first + 1)
    if values.shape[1] < 3:
        raise UnreadableFile(f"{name}: found {values.shape[1]} numbers a line, need x y z; add the missing coordinate")
    if not data.endswith(b"\n"):
        _whole_last_number(kept, dialect.separator, name, first + len(kept))
    points = _in_mm(values.T, _text_places(heading, values.shape[1], wanted, unit, name))
    refuse_infinite(points, name, first + 1)
    return points


def _text_places(
    heading: list[bytes], width: int, wanted: list[str] | None, unit: str | None, file: str
) -> list[tuple[int, float]]:
    """Index and factor to mm of x, y and z in lines of ``width`` numbers under a heading.

    Raises:
        UnreadableFile: the heading names another number of columns, unless numbers and a unit are given.
    """
    numbers = [str(i + 1) for i in range(width)]
    names = _header(heading, width)
    if names is not None and len(names) != width:
        if wanted is None or unit is None or not set(wanted) <= set(numbers):
            raise UnreadableFile(
                f"{file}: found {len(names)} column names, {_shown(names)}, and {width} numbers a line, need as many; "
                "pass --columns by number and --unit"
            )
        names = None
    if names is None:
        return _places(numbers, wanted or numbers[:3], unit, file)
    return _places(names, wanted or AXES, unit, file)


def _header(heading: list[bytes], width: int) -> list[str] | None:
    """The last column names among the lines above the numbers; those in a comment only where there are no others."""
    found = None
    for line in sorted(heading, key=_is_comment, reverse=True):  # comments first
        names = _names(line)
        axes, fits = len(_stems(names) & set(AXES)), len(names) == width
        if axes + fits > 2 if _is_comment(line) else axes > 1 or fits:
            found = names
    return found


def _names(line: bytes) -> list[str]:
    """Column names with units as in ``x_um``, from ``x [um]`` and ``x (um)`` too, or from a comment."""
    text = _MICRO.sub(b"u", _COMMENT.sub(b"", line))
    return column_names(_BRACKETS.sub(rb"_\1", text).rstrip(b";, \t"))


def _is_comment(line: bytes) -> bool:
    return _COMMENT.match(line) is not None


def _stems(names: list[str]) -> set[str]:
    """What the names begin with, up to an ending that may be a unit."""
    return {name.partition("_")[0] for name in names}


def _places(names: list[str], wanted: list[str], unit: str | None, file: str) -> list[tuple[int, float]]:
    """Index and factor to mm of the wanted columns x, y and z.

    Raises:
        UnreadableFile: a column that is missing or twice there, a unit that is not known or contradicts ``unit``.
        BadRecipe: not three columns.
    """
    indices = [_index(names, one, file) for one in wanted]
    if len(set(indices)) != 3 or len(indices) != 3:
        raise BadRecipe(f"found --columns {','.join(wanted)}, need three, of x, y and z, such as 2,3,4")
    chosen = [names[i] for i in indices]
    units = [_split_unit(name)[1] for name in chosen]
    if unit is None and None in units and any("_" in name for name in chosen):
        raise UnreadableFile(
            f"{file}: found the columns {_shown(chosen)}, need a unit (_mm, _um, _m) on each; name it or pass --unit"
        )
    if unit is not None and not {unit, None}.issuperset(units):
        raise UnreadableFile(
            f"{file}: found --unit {unit} and the columns {_shown(chosen)}, need the same; leave --unit out"
        )
    return [(i, MM_PER_UNIT[own or unit or "mm"]) for i, own in zip(indices, units, strict=True)]


def _index(names: list[str], wanted: str, file: str) -> int:
    """Where a column stands that is named, with or without its unit, or given by its number."""
    found = [i for i, name in enumerate(names) if wanted in (str(i + 1), name, _split_unit(name)[0])]
    if len(found) != 1:
        raise UnreadableFile(
            f"{file}: found {len(found) or 'no'} column{'s' * (len(found) > 1)} {wanted!r} among {_shown(names)}, need "
            "one; name x, y and z in the header (x_mm, x_um, x_m; x alone is mm), or pass --columns and --unit"
        )
    return found[0]


def _split_unit(name: str) -> tuple[str, str | None]:
    """A name without its unit of length, and the unit; None where it has none that is known."""
    stem, _, unit = name.rpartition("_")
    return (stem, unit) if stem and unit in MM_PER_UNIT else (name, None)


def _shown(names: list[str]) -> str:
    return repr(", ".join(names)[:100])


def _in_mm(columns: "Sequence[NDArray[Any]] | NDArray[Any]", places: Iterable[tuple[int, float]]) -> Array:
    """Points (n, 3) mm; a signalling NaN is a NaN, and no warning."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.column_stack([np.multiply(columns[i], factor, dtype=np.float64) for i, factor in places])


def _is_heading(row: bytes) -> bool:
    """An empty line, a comment, or a line of column names."""
    row = row.strip()
    if not row or _is_comment(row):
        return True
    cells = [cell for cell in re.split(rb"[\s;,]+", row) if cell]
    mostly_numbers = 2 * sum(number_in(cell) is not None for cell in cells) > len(cells)
    return _WORDS.search(row) is not None and not mostly_numbers


def _whole_last_number(rows: list[bytes], separator: bytes, name: str, line: int) -> None:
    """Refuse a file without a line end that ends inside a number of its last column.

    Raises:
        UnreadableFile: with the last line.
    """
    cells = [row.rstrip(separator + b" ").rsplit(separator, 1)[-1] for row in rows[-2 * ENOUGH_FIELDS :]]
    refuse_cut_number([cell.replace(b",", b".") for cell in cells], name, line)


def _numbers(rows: list[bytes], dialect: Dialect, name: str, first_line: int) -> Array:
    """All rows as numbers (n, columns).

    Raises:
        UnreadableFile: words, too large numbers, or rows of different lengths, with the line.
    """
    text = b"\n".join(rows)
    check_text(b"\n" * (first_line - 1) + text, name)
    text = normalized(text, dialect, name, first_line)
    plain = [row.rstrip(b", ") for row in text.split(b"\n")]
    wide = plain[0].count(b",")
    for i, row in enumerate(plain):
        if row.count(b",") != wide or not row:
            raise UnreadableFile(
                f"{name}: found {row.count(b',') + bool(row)} numbers in line {first_line + i}, need {wide + 1} as in "
                "the lines before; copy the file again or export it without gaps"
            )
    try:
        cells = b",".join(plain).split(b",")
        values = np.fromiter(map(float, cells), np.float64, len(cells)).reshape(len(plain), wide + 1)
    except ValueError:
        refuse_words(plain, name, first_line)
        raise UnreadableFile(f"{name}: found no numbers; need x y z a line, in mm") from None
    refuse_infinite(values, name, first_line)
    return values
