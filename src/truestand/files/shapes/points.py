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

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.number_text import read_table, refuse_cut_table
from truestand.files.shapes.ply import is_ply, ply_vertices
from truestand.files.text import (
    BYTE_ORDER_MARK,
    MM_PER_UNIT,
    column_names,
    dialect_of,
    names_profiles,
    number_in,
    refuse_nul,
)

_WORDS = re.compile(rb"[A-Za-z_]{2,}|^[\s\"]*[A-Za-z]\b.*[A-Za-z]")
_COMMENT = re.compile(rb"\A\s*(#|//)[#/\s]*(\w+:)?")
"""Its mark, and a label such as ``columns:``."""
_BRACKETS = re.compile(rb" ?[\[(] ?(\w+) ?[\])]")
_MICRO = re.compile(rb"\xc2\xb5|\xce\xbc|\xb5")
"""The micro sign and the Greek letter in UTF-8, the micro sign in Latin-1."""
AXES = ["x", "y", "z"]
_COUNT = re.compile(rb"[0-9]{1,18}")


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
    return (_ply_points if is_ply(data) else _text_points)(data, wanted, unit, path.name)


def _ply_points(data: bytes, wanted: list[str] | None, unit: str | None, name: str) -> Array:
    vertices = ply_vertices(data, name)
    points = _in_mm(
        list(vertices.values()), _columns([field.lower() for field in vertices], wanted or AXES, unit, name)
    )
    infinite = np.flatnonzero(np.isinf(points).any(axis=1))
    if infinite.size:
        raise UnreadableFile(f"{name}: found a number too large in vertex {infinite[0] + 1}; need finite numbers")
    return points


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
    body = rows[first:]
    while body and not body[-1].strip():
        body.pop()
    if not body:
        raise UnreadableFile(f"{name}: the file is empty; need points, x y z a line, in mm")
    if _COUNT.fullmatch(body[0].strip()):
        (promised, *body), first = body, first + 1
        if len(body) != int(promised):
            raise UnreadableFile(f"{name}: promises {int(promised)} points and holds {len(body)}; copy it again")
    if not body:
        raise UnreadableFile(f"{name}: holds no points; need x y z a line, in mm")
    dialect = dialect_of(b"\n".join(body[:50]), name)
    values = read_table(body, dialect, name, first + 1)
    if values.shape[1] < 3:
        raise UnreadableFile(f"{name}: found {values.shape[1]} numbers a line, need x y z; add the missing coordinate")
    if not data.endswith(b"\n"):
        refuse_cut_table(body, dialect.separator, name, first + len(body))
    return _in_mm(values.T, _text_columns(heading, values.shape[1], wanted, unit, name))


def _text_columns(
    heading: list[bytes], width: int, wanted: list[str] | None, unit: str | None, file: str
) -> list[tuple[int, float]]:
    """Index and factor to mm of x, y and z in lines of ``width`` numbers under a heading.

    Raises:
        UnreadableFile: the heading names another number of columns, unless numbers and a unit are given.
    """
    numbers = [str(i + 1) for i in range(width)]
    names = _header(heading, width)
    if names is not None and len(names) == width:
        return _columns(names, wanted or AXES, unit, file)
    if names is not None and (wanted is None or unit is None or not set(wanted) <= set(numbers)):
        raise UnreadableFile(
            f"{file}: found {len(names)} column names, {_listed(names)}, and {width} numbers a line, need as many; "
            "pass --columns by number and --unit"
        )
    return _columns(numbers, wanted or numbers[:3], unit, file)


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


def _columns(names: list[str], wanted: list[str], unit: str | None, file: str) -> list[tuple[int, float]]:
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
            f"{file}: found the columns {_listed(chosen)}, need a unit (_mm, _um, _m) on each; name it or pass --unit"
        )
    if unit is not None and not {unit, None}.issuperset(units):
        raise UnreadableFile(
            f"{file}: found --unit {unit} and the columns {_listed(chosen)}, need the same; leave --unit out"
        )
    return [(i, MM_PER_UNIT[named or unit or "mm"]) for i, named in zip(indices, units, strict=True)]


def _index(names: list[str], wanted: str, file: str) -> int:
    """Where a column stands that is named, with or without its unit, or given by its number."""
    found = [i for i, name in enumerate(names) if wanted in (str(i + 1), name, _split_unit(name)[0])]
    if len(found) != 1:
        raise UnreadableFile(
            f"{file}: found {len(found) or 'no'} column{'s' * (len(found) > 1)} {wanted!r} among {_listed(names)}, "
            "need one; name x, y and z in the header (x_mm, x_um, x_m; x alone is mm), or pass --columns and --unit"
        )
    return found[0]


def _split_unit(name: str) -> tuple[str, str | None]:
    """A name without its unit of length, and the unit; None where it has none that is known."""
    stem, _, unit = name.rpartition("_")
    return (stem, unit) if stem and unit in MM_PER_UNIT else (name, None)


def _listed(names: list[str]) -> str:
    return repr(", ".join(names)[:100])


def _in_mm(columns: "Sequence[NDArray[Any]] | NDArray[Any]", chosen: Iterable[tuple[int, float]]) -> Array:
    """Points (n, 3) mm; a signalling NaN is a NaN, and no warning."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.column_stack([np.multiply(columns[i], factor, dtype=np.float64) for i, factor in chosen])


def _is_heading(row: bytes) -> bool:
    """An empty line, a comment, or a line of column names."""
    row = row.strip()
    if not row or _is_comment(row):
        return True
    fields = [field for field in re.split(rb"[\s;,]+", row) if field]
    mostly_numbers = 2 * sum(number_in(field) is not None for field in fields) > len(fields)
    return _WORDS.search(row) is not None and not mostly_numbers
