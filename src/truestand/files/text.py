"""Number text of unknown dialect: which separator, which decimal mark, and nothing guessed.

Works on bytes: a scan is a hundred megabytes, and only its first lines are needed to know its dialect.
"""

import re
from dataclasses import dataclass

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import UnreadableFile

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
ENOUGH_FIELDS = 20
"""Numbers that tell how many decimals a file is written with."""
LARGEST = 1e300
"""Of a number in text: in another unit, or taken from one of the other sign, it stays a finite float64."""
MM_PER_UNIT = {"mm": 1.0, "um": 1e-3, "m": 1e3}
"""By the unit of length at the end of a column's name."""
NO_NUMBER = re.compile(rb"[^0-9eE+\-.,;\t \r\nnNaAiIfF\"]")
"""A character that no number has."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a number file is written."""

    separator: bytes
    decimal: bytes


def column_names(header: bytes) -> list[str]:
    """The names in a header, in lower case, without quotes."""
    text = header.decode("utf-8", "replace").strip().lower()
    separator = next((s for s in ";\t," if s in text), None)
    return [n.strip().strip('"') for n in text.split(separator)]


def names_profiles(names: list[str]) -> bool:
    """Whether columns of these names hold a scan, profile by profile, and not points."""
    return "profile" in names and any(n == "x" or n.startswith("x_") for n in names)


def dialect_of(sample: bytes, name: str) -> Dialect:
    """The dialect of some lines of numbers.

    Raises:
        UnreadableFile: no numbers, or a comma that could be decimal mark or separator.
    """
    if b";" in sample or b"\t" in sample:
        separator = b";" if b";" in sample else b"\t"
        if b"," in sample and b"." in sample:
            raise UnreadableFile(f"{name}: found decimal points and decimal commas together; export it again")
        return Dialect(separator, b"," if b"," in sample else b".")
    if b"," not in sample:
        return Dialect(b" ", b".")
    if b" " in sample.strip() and re.search(rb"\d,\d+[ ]+[-+]?\d", sample):
        return Dialect(b" ", b",")
    if b"." not in sample and re.search(rb"\d,\d", sample):
        raise UnreadableFile(
            f"{name}: commas could be decimal marks or separators; export with ';' or tab between values, "
            "or with decimal points"
        )
    return Dialect(b",", b".")


def normalized(block: bytes, dialect: Dialect, name: str, first_line: int) -> bytes:
    """The block with decimal points and one comma between values; the same object where it already is so.

    Raises:
        UnreadableFile: a decimal mark that is not the dialect's, with the line.
    """
    if dialect.separator != b",":
        other = b"." if dialect.decimal == b"," else b","
        if other in block:
            line = first_line + line_number(block, block.find(other)) - 1
            raise UnreadableFile(
                f"{name}: found {other.decode()!r} in line {line}, need "
                f"{dialect.decimal.decode()!r} as decimal mark as in the first lines; export it again"
            )
    if dialect.decimal == b",":
        block = block.replace(b",", b".")
    if dialect.separator in (b";", b"\t"):
        block = block.replace(dialect.separator, b",")
    elif dialect.separator == b" ":
        block = re.sub(rb"[ ]+", b",", re.sub(rb"(?m)^[ ]+|[ ]+$", b"", block))
    return block


def check_text(data: bytes, name: str) -> None:
    """Refuse what is no number text.

    Raises:
        UnreadableFile: empty, NUL bytes, or characters that no number has, with the line.
    """
    if not data.strip():
        raise UnreadableFile(f"{name}: the file is empty; need a scan")
    wrong = re.search(rb"\0", data) or NO_NUMBER.search(data)
    if wrong:
        raise UnreadableFile(
            f"{name}: found {wrong[0]!r} in line {line_number(data, wrong.start())}, need numbers; see docs/formats.md"
        )


def line_number(data: bytes, position: int) -> int:
    """Line number, from 1, of a byte."""
    return max(data.count(b"\n", 0, position), data.count(b"\r", 0, position)) + 1


def refuse_nul(data: bytes, name: str, first_line: int = 1) -> None:
    """Refuse bytes that no text holds.

    Raises:
        UnreadableFile: NUL bytes, with the line.
    """
    if (wrong := data.find(b"\0")) >= 0:
        line = first_line + line_number(data, wrong) - 1
        raise UnreadableFile(f"{name}: found NUL bytes in line {line}, need text; the file is damaged or no text")


def refuse_too_large(values: Array, name: str, first_line: int) -> None:
    """Refuse numbers beyond ``LARGEST``.

    Raises:
        UnreadableFile: with the line.
    """
    wrong = np.flatnonzero((np.abs(values) > LARGEST).any(axis=1))
    if wrong.size:
        line = first_line + wrong[0]
        raise UnreadableFile(f"{name}: found a number too large in line {line}; need at most {LARGEST:.0e}")


def refuse_words(rows: list[bytes], name: str, first_line: int) -> None:
    """Refuse the first field of comma-separated rows that is no number.

    Raises:
        UnreadableFile: with its line, and its column where there are several.
    """
    for i, row in enumerate(rows):
        for j, field in enumerate(row.split(b",") if row.strip() else ()):
            if number_in(field) is None:
                shown = repr(field.strip()[:20].decode("utf-8", "replace")) if field.strip() else "an empty cell"
                column = f", column {j + 1}" if b"," in row else ""
                raise UnreadableFile(
                    f"{name}: found {shown} in line {first_line + i}{column}, need numbers alone; see docs/formats.md"
                )


def number_in(field: bytes) -> float | None:
    """A field's number; None where it is none. Python would read 1_0 as ten."""
    try:
        return None if b"_" in field else float(field)
    except ValueError:
        return None


def refuse_cut_number(fields: list[bytes], name: str, line: int) -> None:
    """Refuse a file that ends inside a number, which shows where its numbers have a fixed count of decimals.

    ``fields`` end with the file's last number and hold some that are written like it; ``line`` is its line.

    Raises:
        UnreadableFile: with the line.
    """
    decimals = [len(field.strip().partition(b".")[2]) for field in fields if b"n" not in field.lower()]
    if len(decimals) > ENOUGH_FIELDS and len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]:
        raise UnreadableFile(
            f"{name}: the last number ({fields[-1].strip().decode('latin-1')}, line {line}) has fewer digits than the "
            "others and no line end: the file is cut off; export it again"
        )
