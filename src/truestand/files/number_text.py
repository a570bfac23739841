"""Number text (CSV) as float64, many fields at a time; empty fields and lines of different length cost no more.

numpy's text reader takes neither, and filling in the text for it takes as long as reading. Here the digits of a decimal
number make a whole number, its decimal mark a power of ten. Below 10^15 both are exact, so their quotient is the
float64 nearest to the text, as ``float`` gives it. What is written otherwise (exponents, more digits) is left to
numpy's text reader.
"""

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.errors import UnreadableFile
from truestand.files.text import (
    ENOUGH_FIELDS,
    LARGEST,
    NO_NUMBER,
    Dialect,
    normalized,
    refuse_cut_number,
    refuse_too_large,
    refuse_words,
)

Bytes = NDArray[np.uint8]

BLOCK_BYTES = 1 << 18
"""Text parsed at a time, so that the arrays of its fields stay in the processor's cache."""
MOST_DIGITS = 15
"""Whole numbers of more digits are not all exact in float64."""
MOST_CHARACTERS = MOST_DIGITS + 2
"""Of a plain number: digits, sign, decimal mark."""
POWERS_OF_TEN = np.append(10.0 ** np.arange(MOST_CHARACTERS + 1), np.nan)
LOADTXT_COLUMNS = 64
"""Fields a line for numpy's text reader, which takes long for a line and little for a field."""
LINE_END, SPACE, MINUS, ZERO = b"\n -0"
LOWER_CASE = 0x20


@dataclass(frozen=True, slots=True)
class Fields:
    """The fields of consecutive lines, one after the other."""

    values: Array
    """(n,); NaN for an empty field and ``nan``."""
    per_line: Ints
    """Fields in each line, (lines,); an empty line has none."""
    last_empty: Mask
    """Whether the last field of a line is empty, (lines,): a separator ends the line, or the line is empty."""


def read_fields(blocks: Iterable[bytes], dialect: Dialect, name: str, first_line: int) -> Fields:
    """The fields of text that comes in blocks of whole lines, a line end at the end of each.

    Raises:
        UnreadableFile: a field that is no finite number, or has another decimal mark; with the line, counted from
            ``first_line``.
    """
    values, size, parts = np.empty(0), 0, []
    line = first_line
    for text in blocks:
        parsed, per_line, last_empty = _parsed(_without_padding(text, dialect.separator), dialect, name, line)
        start, size = size, size + parsed.size
        if size > values.size:
            values.resize(size + size // 4, refcheck=False)  # in place: a second copy would cost memory and time
        values[start:size] = parsed
        parts.append((per_line, last_empty))
        line += per_line.size
    values.resize(size, refcheck=False)
    per_line, last_empty = (np.concatenate(part) for part in zip(*parts, strict=True))
    empty_line = last_empty & (per_line == 1)
    if empty_line.any():
        values = values[np.repeat(~empty_line, per_line)]
        per_line[empty_line] = 0
    return Fields(values, per_line, last_empty)


def blocks_of_lines(text: bytes) -> Iterator[bytes]:
    """A text in blocks of whole lines, a line end at the end of each."""
    start = 0
    while start < len(text):
        stop = text.find(b"\n", start + BLOCK_BYTES) + 1 or len(text)
        yield text[start:stop] if text[stop - 1] == LINE_END else text[start:stop] + b"\n"
        start = stop


def _without_padding(text: bytes, separator: bytes) -> bytes:
    """The text without white space beside separators and line ends; inside a field a run of it becomes one space."""
    if b"\t" in text and separator not in b"\t ":
        text = text.replace(b"\t", b" ")
    if b" " not in text:
        return text
    raw = np.frombuffer(b"\n" + text, dtype=np.uint8)
    space = raw == SPACE
    before = space | (raw == ord(separator)) | (raw == LINE_END)
    text = raw[1:][~(space[1:] & before[:-1])].tobytes().replace(b" \n", b"\n")
    return text if separator == b" " else text.replace(b" " + separator, separator)


def _parsed(text: bytes, dialect: Dialect, name: str, first_line: int) -> tuple[Array, Ints, Mask]:
    """Values, and for each line how many they are and whether the last one is empty."""
    raw = np.frombuffer(text + bytes(MOST_CHARACTERS), dtype=np.uint8)
    stops = np.flatnonzero((raw == ord(dialect.separator)) | (raw == LINE_END))
    starts = np.concatenate([[0], stops[:-1] + 1])
    lengths = np.minimum(stops - starts, MOST_CHARACTERS + 1).astype(np.uint8)
    ends = np.flatnonzero(raw.take(stops) == LINE_END)
    values, plain = _decimals(raw, starts, lengths, ord(dialect.decimal))
    other = np.flatnonzero(~plain & (lengths > 0))
    other = other[~_is_nan(raw, starts[other], lengths[other])]
    if other.size:
        chosen = np.zeros(values.size, dtype=bool)
        chosen[other] = True
        fields = raw[: len(text)][np.repeat(chosen, np.diff(stops, prepend=-1))]
        try:
            values[other] = _other_numbers(fields, other.size, dialect)
        except ValueError:
            found = zip(starts[other], stops[other], np.searchsorted(ends, other) + first_line, strict=True)
            values[other] = [_number(text[start:stop], dialect, name, int(line)) for start, stop, line in found]
    return values, np.diff(ends, prepend=-1), lengths[ends] == 0


def _decimals(raw: Bytes, starts: Ints, lengths: Bytes, mark: int) -> tuple[Array, Mask]:
    """The value of every field that is a plain decimal number, NaN for the others; and which are plain."""
    longest = min(int(lengths.max()), MOST_CHARACTERS)
    whole: NDArray[Any] = np.zeros(starts.size, dtype=np.uint32 if longest < 10 else np.float64)
    digits, decimals, marks = (np.zeros(starts.size, dtype=np.uint8) for _ in range(3))
    for i in range(longest):  # the i-th character of every field
        character = raw[i:].take(starts)
        inside = lengths > i
        digit = character - np.uint8(ZERO)
        is_digit = (digit < 10) & inside
        whole *= is_digit * np.uint8(9) + np.uint8(1)  # ten where a digit follows
        whole += digit * is_digit
        digits += is_digit
        decimals += is_digit & (marks > 0)
        marks += (character == mark) & inside
    negative = raw.take(starts) == MINUS
    plain = (digits > 0) & (digits <= MOST_DIGITS) & (marks < 2) & (digits + marks + negative == lengths)
    values = whole / POWERS_OF_TEN.take(np.where(plain, decimals, np.uint8(MOST_CHARACTERS + 1)))
    return np.negative(values, out=values, where=negative), plain


def _is_nan(raw: Bytes, starts: Ints, lengths: Bytes) -> Mask:
    """Which fields are ``nan``, in upper or lower case."""
    found: Mask = lengths == 3
    for i, letter in enumerate(b"nan"):
        found &= (raw[i:].take(starts) | LOWER_CASE) == letter
    return found


def _other_numbers(fields: Bytes, count: int, dialect: Dialect) -> Array:
    """The numbers (count,) of fields that are written otherwise, each with the separator or line end after it.

    Raises:
        ValueError: one is no finite number, or has another decimal mark.
    """
    if dialect.decimal == b",":
        if ord(".") in fields:
            raise ValueError
        fields[fields == ord(",")] = ord(".")
    separator = ord(dialect.separator)
    fields[fields == LINE_END] = separator
    fields[np.flatnonzero(fields == separator)[LOADTXT_COLUMNS - 1 :: LOADTXT_COLUMNS]] = LINE_END
    filler = (b"0" + dialect.separator) * (-count % LOADTXT_COLUMNS)  # the last line as long as the others
    table = io.BytesIO((fields.tobytes() + filler)[:-1])
    rows = np.loadtxt(table, delimiter=dialect.separator.decode(), comments=None, encoding="ascii", ndmin=2)
    if (np.abs(rows) > LARGEST).any():
        raise ValueError
    return rows.reshape(-1)[:count]


def _number(field: bytes, dialect: Dialect, name: str, line: int) -> float:
    """The number of one field, NaN if it holds but white space.

    Raises:
        UnreadableFile: as ``read_fields``.
    """
    field = normalized(field, dialect, name, line).strip()
    refuse_words([field], name, line)
    value = float(field or b"nan")
    refuse_too_large(np.array([[value]]), name, line)
    return value


def refuse_cut_table(rows: list[bytes], separator: bytes, name: str, line: int) -> None:
    """Refuse lines (the last has no line end and is number ``line``) that end inside a number of the last column.

    Raises:
        UnreadableFile: with the last line.
    """
    fields = [row.rstrip(separator + b" ").rsplit(separator, 1)[-1] for row in rows[-2 * ENOUGH_FIELDS :]]
    refuse_cut_number([field.replace(b",", b".") for field in fields], name, line)


def read_table(rows: list[bytes], dialect: Dialect, name: str, first_line: int) -> Array:
    """Lines of equally many numbers, none left out, as (n, columns).

    Raises:
        UnreadableFile: words, too large numbers, or rows of different lengths, with the line and of a word the column.
    """
    text = normalized(b"\n".join(rows), dialect, name, first_line)
    plain = [row.rstrip(b", ") for row in text.split(b"\n")]
    if NO_NUMBER.search(text):
        refuse_words(plain, name, first_line)
    wide = plain[0].count(b",")
    for i, row in enumerate(plain):
        if row.count(b",") != wide or not row:
            raise UnreadableFile(
                f"{name}: found {row.count(b',') + bool(row)} numbers in line {first_line + i}, need {wide + 1} as in "
                "the lines before; copy the file again or export it without gaps"
            )
    try:
        fields = b",".join(plain).split(b",")
        values = np.fromiter(map(float, fields), np.float64, len(fields)).reshape(len(plain), wide + 1)
    except ValueError:
        refuse_words(plain, name, first_line)
        raise UnreadableFile(f"{name}: found no numbers; need x y z a line, in mm") from None
    refuse_too_large(values, name, first_line)
    return values
