"""The characteristics of an inspection as CSV (RFC 4180), one a line, for spreadsheets and statistics.

Texts of others never begin like a formula: a spreadsheet would run it.
"""

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from truestand.core.inspection import Characteristic, Inspection
from truestand.files.atomic import write_bytes_atomic

COLUMNS = (
    "name", "flank", "tooth", "section", "value", "unit", "U", "k", "lower_limit", "upper_limit", "grade", "verdict",
    "status", "coverage", "standard",
)  # fmt: skip
K = 2
UM = 1000.0
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "|", "%")
"""Spreadsheets take a cell that begins so for a formula, or may (OWASP, CSV injection)."""


def characteristics_csv(inspection: Inspection) -> str:
    """The text: sizes in mm, deviations in um, with all digits of the record; empty where there is no number."""
    return csv_of(inspection.characteristics)


def csv_of(characteristics: Iterable[Characteristic]) -> str:
    """The same of lines that come from anywhere."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\r\n")
    writer.writerow(COLUMNS)
    writer.writerows(_row(c) for c in characteristics)
    return out.getvalue()


def write_characteristics(path: Path | str, inspection: Inspection) -> None:
    """The file, UTF-8, as a whole or not at all."""
    write_bytes_atomic(path, characteristics_csv(inspection).encode("utf-8"))


def _row(c: Characteristic) -> list[str]:
    low, high = c.limits or (None, None)
    numbers = [_number(v, 1.0 if c.size else UM) for v in (c.value, c.U, low, high)]
    value, U, lower, upper = numbers
    return [
        _text(c.name), c.flank or "", "" if c.tooth is None else str(c.tooth), _text(c.section),
        value, "mm" if c.size else "um", U, str(K) if U else "", lower, upper, "" if c.grade is None else str(c.grade),
        c.verdict or "", c.status, _number(c.coverage), _text(c.standard),
    ]  # fmt: skip


def _number(value: float | None, scale: float = 1.0) -> str:
    return "" if value is None else repr(float(scale * value))


def _text(words: str | None) -> str:
    """A text from outside; an apostrophe before what would be a formula."""
    told = (words or "").replace("\x00", "\N{REPLACEMENT CHARACTER}")
    return f"'{told}" if told.lstrip(" ").startswith(FORMULA) else told
