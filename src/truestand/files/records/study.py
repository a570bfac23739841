"""The table of a Gage R&R study: CSV with a header naming operator, part and value; others (trial) are left aside.

Columns are parted by ``;``, tab or ``,``; with ``;`` and tab a decimal comma is read as one.
"""

import csv
import math
from pathlib import Path

from truestand.core.errors import UnreadableFile

NEEDED = ("operator", "part", "value")


def read_study(path: Path) -> list[tuple[str, str, float]]:
    """Rows (operator, part, value), trials of one operator and part in their order.

    Raises:
        UnreadableFile: no text, columns missing, or a value that is no finite number; with the line.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong})") from wrong
    except UnicodeDecodeError as wrong:
        raise UnreadableFile(f"{path}: no UTF-8 text ({wrong.reason} at byte {wrong.start})") from wrong
    head = lines[0] if lines else ""
    mark = next((m for m in ";\t" if m in head), ",")
    names = [name.strip().lower() for name in next(csv.reader([head], delimiter=mark), [])]
    if not set(NEEDED) <= set(names):
        raise UnreadableFile(f"{path}: found columns {', '.join(names) or 'none'}, need {', '.join(NEEDED)}")
    columns = [names.index(name) for name in NEEDED]
    rows = []
    for number, cells in enumerate(csv.reader(lines[1:], delimiter=mark), 2):
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(names):
            raise UnreadableFile(f"{path}: found {len(cells)} cells in line {number}, need {len(names)}")
        operator, part, value = (cells[k].strip() for k in columns)
        rows.append((operator, part, _number(value, mark, path, number)))
    return rows


def _number(text: str, mark: str, path: Path, line: int) -> float:
    try:
        value = float(text.replace(",", ".") if mark != "," else text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UnreadableFile(f"{path}: found {text[:40]!r} in line {line}, need a finite number")
    return value
