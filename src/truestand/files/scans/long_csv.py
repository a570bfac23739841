"""The long CSV: a header naming profile, x, z and optionally point, angle, encoder, time, counter, intensity.

Units stand in the name (``x_mm``, ``angle_deg``, ``time_s``); a length, angle or time without one is refused, because a
factor of a thousand is nobody's guess. One row a reading; what has no row was not seen.
"""

import hashlib
from collections.abc import Mapping
from math import radians
from pathlib import Path

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.number_text import blocks_of_lines, read_fields
from truestand.files.text import (
    BYTE_ORDER_MARK,
    MM_PER_UNIT,
    Dialect,
    column_names,
    dialect_of,
    line_number,
    names_profiles,
    refuse_cut_number,
    refuse_nul,
)

FORMAT = "long csv"
UNITS: Mapping[str, Mapping[str, float]] = {
    "x": MM_PER_UNIT,
    "z": MM_PER_UNIT,
    "angle": {"deg": radians(1.0), "rad": 1.0},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
UNITLESS = ("profile", "point", "encoder", "counter", "intensity")
COUNT_RANGES = {"profile": (-(2**31), 2**31), "point": (0, 2**31), "counter": (-(2**53), 2**53)}
"""Lowest and highest number of the columns that count; beyond 2^53 float64 skips whole numbers."""
MOST_EMPTY = 1000
"""Readings without data for each with data, beyond which the numbering is taken for a mistake."""


def is_long_csv(head: bytes) -> bool:
    """Whether a text starts with a header that names a profile and an x."""
    return names_profiles(column_names(_header(head)))


def read_long_csv(path: Path) -> Recording:
    """The recording of a long CSV.

    Raises:
        UnreadableFile: NUL bytes, a missing or unknown unit, a column missing or twice there, a value that is no
            number.
    """
    name, data = path.name, path.read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    refuse_nul(data, name)
    data = data.removeprefix(BYTE_ORDER_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    header, _, body = data.partition(b"\n")
    columns = _columns(column_names(header), name)
    dialect = _dialect(header, body, name)
    table, lines = _numbers(body, dialect, len(column_names(header)), name)
    return _recording({key: table[:, i] * factor for key, (i, factor) in columns.items()}, lines, name, sha256)


def _header(data: bytes) -> bytes:
    return data[:4096].removeprefix(BYTE_ORDER_MARK).split(b"\n", 1)[0].split(b"\r", 1)[0]


def _columns(names: list[str], file: str) -> dict[str, tuple[int, float]]:
    """Column index and factor to mm, rad, s of every quantity that the header names."""
    found: dict[str, tuple[int, float]] = {}
    for i, full in enumerate(names):
        key, _, unit = full.partition("_")
        if full in UNITLESS:
            factor = 1.0
        elif key in UNITS:
            if unit not in UNITS[key]:
                known = ", ".join(f"{key}_{u}" for u in UNITS[key])
                raise UnreadableFile(f"{file}: column {full!r} has no unit that is known; name it one of {known}")
            factor = UNITS[key][unit]
        else:
            continue
        if key in found:
            raise UnreadableFile(f"{file}: column {key!r} stands twice in the header; keep one")
        found[key] = (i, factor)
    missing = [key for key in ("profile", "x", "z") if key not in found]
    if missing:
        raise UnreadableFile(f"{file}: the header lacks {', '.join(missing)}; need profile, x_mm, z_mm at least")
    return found


def _dialect(header: bytes, body: bytes, name: str) -> Dialect:
    separator = next((s for s in (b";", b"\t", b",") if s in header), b",")
    if separator == b",":
        return Dialect(b",", b".")
    return Dialect(separator, dialect_of(body[:20_000], name).decimal)


def _numbers(body: bytes, dialect: Dialect, columns: int, name: str) -> tuple[Array, Ints]:
    """All readings (n, columns), and the line in the file of each."""
    if not body.strip():
        raise UnreadableFile(f"{name}: found a header and no readings; need at least one profile")
    _refuse_cut_last_number(body, dialect, name)
    fields = read_fields(blocks_of_lines(body), dialect, name, 2)
    other = np.flatnonzero((fields.per_line != columns) & (fields.per_line > 0))
    if other.size:
        raise UnreadableFile(
            f"{name}: found {fields.per_line[other[0]]} values in line {other[0] + 2}, the header names {columns}; the "
            "file may be cut off"
        )
    return fields.values.reshape(-1, columns), np.flatnonzero(fields.per_line) + 2


def _refuse_cut_last_number(body: bytes, dialect: Dialect, name: str) -> None:
    """Refuse a file that ends inside a number of its last column.

    Raises:
        UnreadableFile: with the last line.
    """
    if not body.endswith(b"\n"):
        rows = body[-10_000:].split(b"\n")[1:]
        fields = [row.rsplit(dialect.separator, 1)[-1].replace(dialect.decimal, b".") for row in rows]
        refuse_cut_number([field for field in fields if field.strip()], name, line_number(body, len(body)) + 1)


def _recording(columns: dict[str, Array], lines: Ints, name: str, sha256: str) -> Recording:
    for key in COUNT_RANGES:
        if key in columns:
            _refuse_fractions(columns[key], key, lines, name)
    first = columns["profile"].min()
    if first > 1 and not {"angle", "encoder"} & columns.keys():
        raise UnreadableFile(
            f"{name}: found profile {first:.0f} as the first and no angle, need to know how far the table had turned; "
            "number the scan's first profile 0 or 1, with empty x and z where nothing was seen"
        )
    row = np.asarray(columns["profile"] - first, dtype=np.intp)
    point = _points(columns.get("point"), row)
    shape = profiles, points = int(row.max()) + 1, int(point.max()) + 1
    if profiles * points > max(MOST_EMPTY * row.size, MOST_EMPTY**2):
        raise UnreadableFile(
            f"{name}: found {row.size} readings, profile and point numbers for {profiles} x {points}; check them"
        )
    seen = np.zeros(shape, dtype=bool)
    seen[row, point] = True
    if np.count_nonzero(seen) < row.size:
        raise UnreadableFile(f"{name}: found the same profile and point twice; check columns 'profile' and 'point'")

    def matrix(values: Array) -> Array:
        full = np.full(shape, np.nan)
        full[row, point] = values
        return full

    def one_a_profile(key: str) -> Array | None:
        if key not in columns:
            return None
        values = np.full(profiles, np.nan)
        values[row[::-1]] = columns[key][::-1]  # the first reading of a profile counts
        off = np.flatnonzero(columns[key] != values[row])
        if off.size:
            raise UnreadableFile(f"{name}: {key} changes within a profile (line {lines[off[0]]}); need one a profile")
        known = np.flatnonzero(np.isfinite(values))
        # profiles without any reading have no row: they lie between their neighbours
        return np.asarray(np.interp(np.arange(profiles), known, values[known]))

    counter = one_a_profile("counter")
    return Recording(
        matrix(columns["x"]),
        matrix(columns["z"]),
        FORMAT,
        sha256,
        time=one_a_profile("time"),
        angle=one_a_profile("angle"),
        encoder=one_a_profile("encoder"),
        counter=None if counter is None else counter.astype(np.int64),
        intensity=matrix(columns["intensity"]) if "intensity" in columns else None,
    )


def _refuse_fractions(values: Array, key: str, lines: Ints, name: str) -> None:
    """Refuse readings without a profile, point or counter number, or with one that counts nothing.

    Raises:
        UnreadableFile: with the line.
    """
    lowest, highest = COUNT_RANGES[key]
    wrong = np.flatnonzero(~((values == np.floor(values)) & (values >= lowest) & (values <= highest)))
    if wrong.size:
        found = values[wrong[0]]
        shown = f"no {key} number" if np.isnan(found) else f"{key} number {found:.12g}"
        raise UnreadableFile(
            f"{name}: line {lines[wrong[0]]} has {shown}, need a whole number from {lowest} to {highest}; check column "
            f"{key!r}"
        )


def _points(point: Array | None, row: Ints) -> Ints:
    """Column of every reading: its point number (from 0 or 1), or its place among its profile's readings."""
    if point is None:
        order = np.argsort(row, kind="stable")
        first = np.searchsorted(row[order], row[order])
        column = np.empty(row.size, dtype=np.intp)
        column[order] = np.arange(row.size) - first
        return column
    return point.astype(np.intp) - (1 if point.min() >= 1 else 0)
