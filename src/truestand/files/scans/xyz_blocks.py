"""XYZ blocks, the scanCONTROL export and the paper's K = [X Y Z]: block X, empty line, block Y, empty line, block Z.

One line a profile. A point without data is an empty cell, ``nan``, or left out (lines then differ in length and are
padded with NaN at the end). A separator that ends every line of a block adds no column. Only X and Z are parsed; of Y
the first and the last cell of each line, because Y is one number a profile.
"""

from math import isinf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.lines import BYTE_ORDER_MARK, Lines
from truestand.files.number_text import Cells, read_cells
from truestand.files.text import (
    ENOUGH_CELLS,
    Dialect,
    dialect_of,
    normal,
    number,
    refuse_cut_number,
    refuse_infinite,
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
        x, z = (read_cells(lines.pieces(b), dialect, name, b.start + 1) for b in (blocks[0], blocks[2]))
        x, z = _same_shape(x, z, blocks, name)
        _whole_last_number(lines, blocks[2], dialect, name)
        y = _profile_values(lines, blocks[1], dialect, name)
        return Recording(_matrix(x, blocks[0], name), _matrix(z, blocks[2], name), FORMAT, lines.sha256, y=y)


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


def _closed(cells: Cells) -> Cells | None:
    """The cells without the empty one after a separator that ends every line; None where not every line ends so."""
    filled = cells.per_line > 0
    if not cells.open[filled].all():
        return None
    last = np.cumsum(cells.per_line)[filled] - 1
    return Cells(np.delete(cells.values, last), cells.per_line - filled, np.zeros_like(cells.open))


def _same_shape(x: Cells, z: Cells, blocks: tuple[range, range, range], name: str) -> tuple[Cells, Cells]:
    """X and Z, as many cells in a profile's line of the one block as of the other.

    A last column that is empty in every line of one block only looks like a separator at the end; it is NaN there.

    Raises:
        UnreadableFile: with the line.
    """
    closed_x, closed_z = _closed(x), _closed(z)
    same = np.array_equal(x.per_line, z.per_line)
    if not same or (closed_x and closed_z):
        x, z = closed_x or x, closed_z or z
    if not np.array_equal(x.per_line, z.per_line):
        row = int(np.flatnonzero(x.per_line != z.per_line)[0])
        raise UnreadableFile(
            f"{name}: found {z.per_line[row]} values in line {blocks[2].start + row + 1} (block Z), need "
            f"{x.per_line[row]} as in line {blocks[0].start + row + 1} (block X); the file may be cut off"
        )
    return x, z


def _matrix(cells: Cells, block: range, name: str) -> Array:
    """One block's numbers (profiles, points), short lines filled up with NaN.

    Raises:
        UnreadableFile: a line so much longer than the others that it is damage; with the line.
    """
    longest = int(cells.per_line.max())
    if longest * len(block) > MOST_FILLED * max(cells.values.size, MOST_FILLED**2):
        raise UnreadableFile(
            f"{name}: found {longest} values in line {block.start + int(cells.per_line.argmax()) + 1} and fewer than a "
            f"{MOST_FILLED}th of it in most others, need lines of like length; export it again"
        )
    if (cells.per_line == longest).all():
        return cells.values.reshape(len(block), longest)
    values = np.full((len(block), longest), np.nan)
    values[np.arange(longest) < cells.per_line[:, None]] = cells.values
    return values


def _profile_values(lines: Lines, block: range, dialect: Dialect, name: str) -> Array | None:
    """Y, one number a profile; None where a line's first and last cell differ, or a line has none."""
    values = np.full(len(block), np.nan)
    for i, line in enumerate(block):
        row = lines[line].strip().strip(dialect.separator)
        cells = row.split(dialect.separator, 1)[0], row.rsplit(dialect.separator, 1)[-1]
        first, last = (number(normal(cell, dialect, name, line + 1).strip() or b"nan") for cell in cells)
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
