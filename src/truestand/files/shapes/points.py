"""Points (n, 3) mm from text (x y z), PLY, PCD, NPY, STL and NIST's .ds, told apart by their content.

Names place the columns, and give their units; text without names holds x y z first, in mm. What names can't place is
refused, because another column reads as a coordinate too, and a factor of a thousand is nobody's guess.
"""

import re
from pathlib import Path

from truestand.core.errors import UnreadableFile
from truestand.files.kinds import refuse_other_kind
from truestand.files.number_text import read_table, refuse_cut_table
from truestand.files.shapes.ply import is_ply, ply_vertices
from truestand.files.shapes.point_columns import (
    ANGLES,
    AXES,
    RADII,
    Choice,
    PointFile,
    listed,
    numbered,
    stems,
    units_told,
)
from truestand.files.shapes.point_tables import point_table
from truestand.files.text import (
    BYTE_ORDER_MARK,
    column_names,
    dialect_of,
    names_profiles,
    number_in,
    refuse_nul,
)

_WORDS = re.compile(rb"[A-Za-z_]{2,}|^[\s\"]*[A-Za-z]\b.*[A-Za-z]")
_COMMENT = re.compile(rb"\A\s*(#|//)[#/\s]*(\w+:)?")
"""Its mark, and a label such as ``columns:``."""
_BRACKETS = re.compile(rb" ?(?:[\[(] ?(\w+) ?[\])]|/ ?(\w+))")
"""A unit as in ``x [um]``, ``x (um)`` and ``x/um``."""
_MICRO = re.compile(rb"\xc2\xb5|\xce\xbc|\xb5")
"""The micro sign and the Greek letter in UTF-8, the micro sign in Latin-1."""
_WITH_UNIT = re.compile(rb"[-+]?[0-9.]*[0-9](mm|um|m|nm|cm|in|inch|deg|rad|[\x80-\xff]+m)", re.IGNORECASE)
"""A number that a unit follows, which is no number to read, and no name either."""
_TABLE_COMMENT = re.compile(rb"^(?:comment|obj_info|#)[ \t]*([^\r\n]*)", re.MULTILINE)
_TABLE_BODY = re.compile(rb"^(?:end_header|DATA )", re.MULTILINE)
HEAD_BYTES = 65_536
_COUNT = re.compile(rb"[0-9]{1,18}")


def read_points(
    path: Path | str, columns: str | None = None, unit: str | None = None, planar: bool = False
) -> PointFile:
    """The points of a file in mm; further columns or properties are left aside.

    ``columns`` says which are x, y and z, by names or by numbers from 1: ``"east,north,up"``, ``"2,3,4"``. ``unit``
    (mm, um, m) is that of columns whose names give none; without it a comment may tell it, else they are in mm.
    ``planar``: points of a plane will do, x and y alone, or polar by their names: ``angle_deg`` or ``angle_rad`` and
    ``radius``.

    Raises:
        UnreadableFile: missing, empty, cut off, no numbers, or ambiguous; with the line where there is one. Columns
            that can't be placed by their names or without, or units that are not known or contradict ``unit``.
        BadRecipe: ``columns`` are not three, or two of a plane.
    """
    wanted = None if columns is None else _names(columns.encode())
    path = Path(path)
    try:
        data = path.read_bytes().removeprefix(BYTE_ORDER_MARK)
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong}); check the path") from wrong
    asked = Choice(wanted, unit, planar, path.name)
    table = ply_vertices(data, path.name) if is_ply(data) else point_table(data, path.name)
    if table is not None:
        return asked.points([field.lower() for field in table], list(table.values()), _comments(data))
    refuse_other_kind(data[:HEAD_BYTES], path.name, "points: text, PLY, PCD, NPY or STL")
    return _text_points(data, asked)


def _text_points(data: bytes, asked: Choice) -> PointFile:
    name = asked.file
    refuse_nul(data, name)
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    rows = (data if b";" in data else re.sub(rb"[ \t]+", b" ", data)).split(b"\n")
    first = 0
    while first < len(rows) and _is_heading(rows[first]):
        first += 1
    heading = data.split(b"\n", first)[:first]
    if asked.wanted is None and names_profiles(names := _names(rows[0])) and "y" not in stems(names):
        raise UnreadableFile(
            f"{name}: found a scan (profile, x, z), need points; pass --calibration CALIBRATION.json, or roll it up"
        )
    body = rows[first:]
    while body and not body[-1].strip():
        body.pop()
    if not data.strip():
        raise UnreadableFile(f"{name}: the file is empty; need points, x y z a line, in mm")
    if not body:
        words = next(line for line in heading if line.strip())[:60].decode("utf-8", "replace")
        raise UnreadableFile(f"{name}: found {words!r} and no line of numbers; need points, x y z a line, in mm")
    if _COUNT.fullmatch(body[0].strip()):
        (promised, *body), first = body, first + 1
        if len(body) != int(promised):
            raise UnreadableFile(f"{name}: promises {int(promised)} points and holds {len(body)}; copy it again")
    if not body:
        raise UnreadableFile(f"{name}: holds no points; need x y z a line, in mm")
    dialect = dialect_of(b"\n".join(body[:50]), name)
    values = read_table(body, dialect, name, first + 1)
    if not data.endswith(b"\n"):
        refuse_cut_table(body, dialect.separator, name, first + len(body))
    named_by = _header(heading, values.shape[1])
    names = _text_names(named_by, values.shape[1], asked)
    return asked.points(names, values.T, [_lower(line) for line in heading if line is not named_by])


def _text_names(header: bytes | None, width: int, asked: Choice) -> list[str]:
    """Names of the columns of lines of ``width`` numbers under a header; their numbers where there is none.

    Raises:
        UnreadableFile: the header names another number of columns, unless numbers and a unit are given.
    """
    numbers, names = numbered(width), None if header is None else _names(header)
    if names is None or len(names) == width:
        return names or numbers
    if asked.wanted is None or asked.unit is None or not set(asked.wanted) <= set(numbers):
        raise UnreadableFile(
            f"{asked.file}: found {len(names)} column names, {listed(names)}, and {width} numbers a line, need as "
            "many; pass --columns by number and --unit"
        )
    return numbers


def _header(heading: list[bytes], width: int) -> bytes | None:
    """The last line of column names above the numbers; a comment only where no other line holds names."""
    found = None
    for line in sorted(heading, key=_is_comment, reverse=True):  # comments first
        names = _names(line)
        axes = len(stems(names) & {*AXES, *ANGLES, *RADII})
        fits = len(names) == width and not (axes == 0 and units_told(_lower(line)))
        if axes + fits > 2 if _is_comment(line) else axes > 1 or fits:
            found = line
    return found


def _names(line: bytes) -> list[str]:
    """Column names with units as in ``x_um``, however they are written, or from a comment."""
    text = _MICRO.sub(b"u", _COMMENT.sub(b"", line))
    return column_names(_BRACKETS.sub(rb"_\1\2", text).rstrip(b";, \t"))


def _comments(data: bytes) -> list[str]:
    """The comments in the header of a PLY or PCD."""
    end = _TABLE_BODY.search(data, 0, HEAD_BYTES)
    return [] if end is None else [_lower(line) for line in _TABLE_COMMENT.findall(data, 0, end.start())]


def _lower(line: bytes) -> str:
    """A line in lower case, the micro sign as ``u``."""
    return _MICRO.sub(b"u", line).decode("utf-8", "replace").lower()


def _is_comment(line: bytes) -> bool:
    return _COMMENT.match(line) is not None


def _is_heading(row: bytes) -> bool:
    """An empty line, a comment, or a line of column names."""
    row = row.strip()
    if not row or _is_comment(row):
        return True
    fields = [field for field in re.split(rb"[\s;,]+", row) if field]
    numbers = sum(number_in(field) is not None or _WITH_UNIT.fullmatch(field) is not None for field in fields)
    mostly_numbers = 2 * numbers > len(fields)
    return _WORDS.search(row) is not None and not mostly_numbers
