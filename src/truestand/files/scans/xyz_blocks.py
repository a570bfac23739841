"""XYZ blocks, the scanCONTROL export and the paper's K = [X Y Z]: block X, empty line, block Y, empty line, block Z.

One line a profile. A point without data is an empty cell, ``nan``, or left out (lines then differ in length and are
padded with NaN at the end). A separator that ends every line of a block adds no column. Only X and Z are parsed; of Y
the first and the last cell of each line, because Y is one number a profile.
"""

import tempfile
import warnings
from collections.abc import Callable
from math import isinf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.lines import BYTE_ORDER_MARK, Lines
from truestand.files.text import (
    ENOUGH_CELLS,
    Dialect,
    dialect_of,
    normal,
    number,
    refuse_cut_number,
    refuse_infinite,
    refuse_words,
    written_out,
)

Array = NDArray[np.float64]

FORMAT = "xyz blocks"
SAMPLE = 20_000
MOST_FILLED = 100
"""Cells for each that is written, beyond which a line's length is taken for damage: short lines are filled up."""


def is_xyz_blocks(head: bytes) -> bool:
    """Whether a text is a matrix of numbers without a header: the first line holds no letters but nan's."""
    text = head[:SAMPLE].removeprefix(BYTE_ORDER_MARK).replace(b"\r", b"\n").lstrip()
    first = text.split(b"\n", 1)[0].lower().replace(b"nan", b"")
    return bool(first.strip()) and not any(c in b"abcdfghijklmnopqrstuvwxyz\"'{}[]<>" for c in first)


def read_xyz_blocks(path: Path, head: bytes) -> Recording:
    """The recording of an XYZ file that begins with ``head``.

    Raises:
        UnreadableFile: no three blocks of equal shape, no numbers, or an ambiguous decimal comma; with the line.
    """
    name = path.name
    with Lines(path, head) as lines:
        blocks = _blocks(lines, name)
        dialect = _dialect(lines, name)
        x, z = (_matrix(path, lines, b, dialect) for b in (blocks[0], blocks[2]))
        if x is None or z is None or x.shape != z.shape:
            x, z = (_careful(lines, b, dialect, name) for b in (blocks[0], blocks[2]))
            x, z = _same_shape(x, z, lines, blocks, name)
        _whole_last_number(lines, blocks[2], dialect, name)
        return Recording(x, z, FORMAT, lines.sha256, y=_profile_values(lines, blocks[1], dialect, name))


def _dialect(lines: Lines, name: str) -> Dialect:
    """How the file's first lines are written."""
    enough = int(np.searchsorted(lines.ends, SAMPLE)) or 1
    return dialect_of(lines.text(range(min(enough, len(lines)))), name)


def _blocks(lines: Lines, name: str) -> tuple[range, range, range]:
    """The lines of X, Y and Z: two blank lines at a third and two thirds, or blank lines between three groups."""
    last = len(lines)
    while last and lines.blank(last - 1):
        last -= 1
    first = 0
    while first < last and lines.blank(first):
        first += 1
    n, rest = divmod(last - first - 2, 3)
    if rest == 0 and n > 0 and lines.blank(first + n) and lines.blank(first + 2 * n + 1):
        return range(first, first + n), range(first + n + 1, first + 2 * n + 1), range(first + 2 * n + 2, last)
    filled = [i for i in range(first, last) if not lines.blank(i)]
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


def _matrix(path: Path, lines: Lines, block: range, dialect: Dialect) -> Array | None:
    """One block's numbers (profiles, points) as they stand; None where the careful way has to be taken."""
    plain = dialect.decimal == b"." and dialect.separator != b" " and lines.plain
    if not plain or any(lines.blank(i) for i in (block.start, block.stop - 1)):
        return None
    try:
        values = _load(path, dialect.separator, block)
    except ValueError:  # lines of different length, or no numbers: the careful way says which
        return None
    refuse_infinite(values, path.name, block.start + 1)
    return values


def _load(path: Path, separator: bytes, block: range) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            values = np.loadtxt(
                str(path), delimiter=separator.decode(), skiprows=block.start, max_rows=len(block), ndmin=2,
                comments=None, encoding="latin-1",
            )  # fmt: skip
        except UserWarning as wrong:
            raise ValueError(str(wrong)) from wrong
    if values.shape[0] != len(block):
        raise ValueError("lines were left out")
    return values


def _careful(lines: Lines, block: range, dialect: Dialect, name: str) -> Array:
    """Gaps written out as nan, short lines filled up, every line checked."""
    rows = normal(lines.text(block), dialect, name, block.start + 1).split(b"\n")
    if all(row.endswith(b",") or not row.strip() for row in rows):
        rows = [row[:-1] for row in rows]
    cells = [row.count(b",") + 1 for row in rows]
    longest = max(cells)
    if longest * len(rows) > MOST_FILLED * max(sum(cells), MOST_FILLED**2):
        raise UnreadableFile(
            f"{name}: found {longest} values in line {block.start + cells.index(longest) + 1} and fewer than a "
            f"{MOST_FILLED}th of it in most others, need lines of like length; export it again"
        )
    filled = [written_out(row, longest) for row in rows]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "block.csv"
        file.write_bytes(b"\n".join(filled))
        try:
            values = _load(file, b",", range(len(block)))
        except ValueError as wrong:
            refuse_words(filled, name, block.start + 1)
            raise UnreadableFile(f"{name}: lines {block.start + 1} to {block.stop}: {wrong}") from wrong
    refuse_infinite(values, name, block.start + 1)
    return values


def _same_shape(x: Array, z: Array, lines: Lines, blocks: tuple[range, range, range], name: str) -> tuple[Array, Array]:
    """X and Z as matrices of one shape: as many cells in a profile's line of the one block as of the other.

    A last column that is empty in every line of one block only looks like a separator at the end; it is NaN there.

    Raises:
        UnreadableFile: with the line.
    """
    (x_written, x_ended), (z_written, z_ended) = (_cells_by_line(lines, b) for b in (blocks[0], blocks[2]))
    if not (np.array_equal(x_written, z_written) or np.array_equal(x_written - x_ended, z_written - z_ended)):
        row = int(np.flatnonzero(x_written != z_written)[0])
        raise UnreadableFile(
            f"{name}: found {z_written[row]} values in line {blocks[2].start + row + 1} (block Z), need "
            f"{x_written[row]} as in line {blocks[0].start + row + 1} (block X); the file may be cut off"
        )
    width = max(x.shape[1], z.shape[1])
    return _filled_up(x, width), _filled_up(z, width)


def _filled_up(values: Array, width: int) -> Array:
    if values.shape[1] == width:
        return values
    return np.pad(values, ((0, 0), (0, width - values.shape[1])), constant_values=np.nan)


def _cells_by_line(lines: Lines, block: range) -> tuple[NDArray[np.intp], bool]:
    """Values in each line as separators count them, and whether a separator ends every line."""
    sample = lines.text(range(block.start, min(block.start + 50, block.stop)))
    separator = next((s for s in (b";", b"\t") if s in sample), b"," if b" " not in sample.strip() else b" ")
    count: Callable[[bytes], int] = (
        (lambda row: len(row.split())) if separator == b" " else (lambda row: row.count(separator) + 1)
    )
    cells = np.array([0 if lines.blank(i) else count(lines[i]) for i in block], dtype=np.intp)
    return cells, all(lines[i].endswith(separator) for i in block if not lines.blank(i))


def _profile_values(lines: Lines, block: range, dialect: Dialect, name: str) -> Array | None:
    """Y, one number a profile; None where a line's first and last cell differ, or a line has none."""
    values = np.full(len(block), np.nan)
    for i, line in enumerate(block):
        row = normal(lines[line].strip(), dialect, name, line + 1).strip(b",")
        first, last = number(row.split(b",", 1)[0] or b"nan"), number(row.rsplit(b",", 1)[-1] or b"nan")
        if first is None or last is None:
            raise UnreadableFile(f"{name}: found no number in line {line + 1} (block Y); need numbers")
        if isinf(first) or isinf(last):
            refuse_infinite(np.array([[first, last]]), name, line + 1)
        if first != last:
            return None
        values[i] = first
    return values


def _whole_last_number(lines: Lines, block: range, dialect: Dialect, name: str) -> None:
    """Refuse a file that ends inside a number of its last block.

    Raises:
        UnreadableFile: with the last line.
    """
    first = max(block.start, block.stop - ENOUGH_CELLS)
    tail = lines.text(range(first, block.stop))[-2000:]
    if lines.ended or tail.endswith(dialect.separator):
        return
    cells = normal(tail, dialect, name, first + 1).replace(b"\n", b",").split(b",")[1:]
    refuse_cut_number([cell for cell in cells if cell.strip()], name, block.stop)
