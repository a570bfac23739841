"""Fields of number text: the same float64 as ``float`` gives, field by field, or a refusal that names the line."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from truestand.core.errors import UnreadableFile
from truestand.files import number_text
from truestand.files.number_text import blocks_of_lines, read_fields
from truestand.files.text import LARGEST, Dialect

POINT, COMMA = Dialect(b";", b"."), Dialect(b";", b",")


def read(text, dialect=POINT, first_line=1):
    return read_fields(blocks_of_lines(text), dialect, "scan.csv", first_line)


def bits(values):
    """What tells -0.0 from 0.0; one pattern for all NaN."""
    return np.where(np.isnan(values), np.nan, values).view(np.int64).tolist()


decimals = st.builds(
    "{}{}{}".format,
    st.sampled_from(["", "", "-", "+", "0", "-00"]),
    st.integers(0, 10**20) | st.integers(0, 10**5),
    st.sampled_from(["", "."]) | st.integers(0, 10**12).map(".{}".format),
)
others = st.sampled_from(["", "nan", "NaN", "NAN", "-nan", ".5", "-.5", "5.", "1e-3", "-1.5E+10", " 7.25 ", "1e-400"])
damaged = st.text("0123456789.,-+eEnaN_x \x0b", max_size=20).filter(lambda text: text.strip(" ") == text)


@given(st.lists(decimals | others | st.floats(-LARGEST, LARGEST).map(repr), min_size=1, max_size=30))
def test_a_number_is_the_float_nearest_to_its_text(written):
    expected = bits(np.array([float(field) if field else np.nan for field in written]))
    for mark, dialect in ((".", POINT), (",", COMMA)):
        line = ";".join(written).replace(".", mark).encode()
        assert bits(read(line + b";0", dialect).values)[:-1] == expected


@given(damaged, st.integers(0, 3))
@example("1.2.3", 0)
@example("-", 0)
@example(".", 1)
@example("--1", 2)
@example("1-", 0)
@example("1_0", 1)
@example("0x10", 0)
@example("1 2", 3)
@example("inf", 2)
@example("1e301", 2)
@example("1e309", 2)
@example("9" * 400, 2)
def test_what_is_no_number_is_refused_with_its_line(field, line):
    try:
        expected = float(field.strip() or "nan") if "_" not in field else math.inf
    except ValueError:
        expected = math.inf
    text = b"1.5;2.5\n" * line + b"0.5;" + field.encode() + b"\n1.5;2.5\n"
    if abs(expected) > LARGEST:
        with pytest.raises(UnreadableFile, match=rf"line {line + 7}\b"):
            read(text, first_line=7)
    else:
        assert bits(read(text).values[2 * line + 1 : 2 * line + 2]) == bits(np.array([expected]))


def test_the_other_decimal_mark_is_refused_with_its_line():
    for field, dialect in ((b"1.5", COMMA), (b"1,5", POINT), (b"1.5e3", COMMA)):
        with pytest.raises(UnreadableFile, match=r"line 2, need '.' as decimal mark"):
            read(b"1;2\n3;" + field + b"\n", dialect)


@pytest.mark.parametrize("size", [1, 7, 40, 1000])
def test_lines_are_counted_across_blocks(monkeypatch, size):
    monkeypatch.setattr(number_text, "BLOCK_BYTES", size)
    rows = ["1;2;3", ";;", "", "4;5;", "-6.25", "   ", ";7"] * 5
    found = read("\n".join(rows).encode())
    assert found.per_line.tolist() == [3, 3, 0, 3, 1, 0, 2] * 5
    assert found.last_empty.tolist() == [False, True, True, True, False, True, False] * 5
    nan = np.nan
    assert np.array_equal(found.values, [1, 2, 3, nan, nan, nan, 4, 5, nan, -6.25, nan, 7] * 5, equal_nan=True)
    with pytest.raises(UnreadableFile, match="line 34"):
        read("\n".join([*rows[:-2], "8;x", rows[-1]]).encode())


@pytest.mark.parametrize("separator", [b",", b";", b"\t", b" "])
def test_white_space_beside_a_separator_is_no_part_of_a_number(separator):
    text = b"  1.5  %s 2.5%s3.5 \n 4.5%s\t5.5 %s   6.5\n" % (4 * (separator,))
    if separator == b"\t":
        text = text.replace(b"\t5.5", b"5.5")
    elif separator == b" ":
        text = text.replace(b"\t", b"")
    assert read(text, Dialect(separator, b".")).values.tolist() == [1.5, 2.5, 3.5, 4.5, 5.5, 6.5]
