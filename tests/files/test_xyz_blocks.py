"""XYZ blocks as sensors and spreadsheets write them, and as they come out of a broken transfer."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.scans.read import info, read_recording
from truestand.files.scans.write_scan import write_xyz_blocks

EXPORT = Path(__file__).parents[3] / "shared" / "data" / "scancontrol" / "xyz_blocks.csv"

X = np.array([[-1.5, 0.25, 2.0, 3.125], [-1.5, 0.5, 2.25, 3.0], [-1.25, 0.5, 2.5, 3.5]])
Z = np.array([[95.5, 96.25, 97.0, 98.5], [95.25, np.nan, 97.5, 98.25], [95.125, 96.5, np.nan, np.nan]])


def written(values, separator=",", decimal=".", gap="nan", end="", eol="\n"):
    lines = [
        separator.join(gap if np.isnan(v) else f"{v:.3f}".replace(".", decimal) for v in row) + end for row in values
    ]
    return eol.join(lines) + eol


def file_of(folder, *, x=X, z=Z, y=None, eol="\n", mark="", **dialect):
    times = np.arange(len(x))[:, None] * 0.005 if y is None else y
    blocks = (written(b, eol=eol, **dialect) for b in (x, np.broadcast_to(times, x.shape), z))
    path = folder / "scan.csv"
    path.write_bytes((mark + eol.join(blocks)).encode("utf-8"))
    return path


def refused(path, *words):
    with pytest.raises(UnreadableFile) as caught:
        read_recording(path)
    message = str(caught.value)
    assert "\n" not in message
    assert path.name in message
    for word in words:
        assert word in message, message


@pytest.mark.parametrize(
    "dialect",
    [
        {"separator": ","},
        {"separator": ";"},
        {"separator": "\t"},
        {"separator": " "},
        {"separator": ", "},
        {"separator": ";", "decimal": ","},
        {"separator": "\t", "decimal": ","},
        {"separator": "; ", "decimal": ","},
        {"separator": ";", "end": ";"},
        {"separator": ",", "end": ","},
        {"separator": "\t", "end": "\t"},
        {"separator": ";", "decimal": ",", "end": ";"},
        {"separator": ";", "gap": ""},
        {"separator": ",", "gap": ""},
        {"separator": "\t", "gap": ""},
        {"separator": ",", "gap": "NaN"},
        {"separator": ",", "gap": "NAN"},
        {"separator": ";", "gap": "", "end": ";"},
        {"separator": ",", "eol": "\r\n"},
        {"separator": ";", "eol": "\r\n", "end": ";"},
        {"separator": ",", "eol": "\r"},
        {"separator": ";", "decimal": ",", "mark": "\ufeff", "eol": "\r\n"},
        {"separator": ",", "mark": "\ufeff"},
    ],
    ids=str,
)
def test_every_way_to_write_it_reads_the_same(tmp_path, dialect):
    recording = read_recording(file_of(tmp_path, **dialect))
    assert recording.format == "xyz blocks"
    assert np.array_equal(recording.x, X)
    assert np.array_equal(recording.z, Z, equal_nan=True)
    assert recording.y is not None
    assert np.allclose(recording.y, [0.0, 0.005, 0.01])
    assert len(recording.sha256) == 64


def test_points_that_are_left_out_are_filled_up_at_the_end(tmp_path):
    path = tmp_path / "left_out.csv"
    path.write_text("1.5,2.5,3.5\n1.5,2.5\n\n0,0,0\n1,1\n\n90.5,91.5,92.5\n90.5,93.5\n")
    recording = read_recording(path)
    assert np.array_equal(recording.x, [[1.5, 2.5, 3.5], [1.5, 2.5, np.nan]], equal_nan=True)
    assert np.array_equal(recording.z, [[90.5, 91.5, 92.5], [90.5, 93.5, np.nan]], equal_nan=True)
    assert np.array_equal(recording.y, [0.0, 1.0])


def test_a_profile_without_any_point_is_a_profile_all_the_same(tmp_path):
    path = tmp_path / "gap.csv"
    path.write_text("1.5;2.5\n;\n1.5;2.5\n\n0;0\n1;1\n2;2\n\n90.5;91.5\n;\n90.5;93.5\n")
    recording = read_recording(path)
    assert recording.x.shape == (3, 2)
    assert np.isnan(recording.z[1]).all()


@pytest.mark.parametrize("separator", ["\t", " ", ";", ","])
def test_a_scan_may_begin_with_a_profile_without_any_point(tmp_path, separator):
    x, z = Z.copy(), Z.copy()
    x[0] = z[0] = np.nan
    recording = read_recording(file_of(tmp_path, x=x, z=z, separator=separator))
    assert np.array_equal(recording.x, x, equal_nan=True) and np.array_equal(recording.z, z, equal_nan=True)


def test_a_last_column_that_was_never_seen_is_no_separator_at_the_line_end(tmp_path):
    z = Z.copy()
    z[:, -1] = np.nan
    recording = read_recording(file_of(tmp_path, z=z, separator=";", gap=""))
    assert recording.x.shape == recording.z.shape == (3, 4)
    assert np.isnan(recording.z[:, -1]).all()


def test_a_y_that_changes_along_the_profile_is_left_alone(tmp_path):
    path = tmp_path / "y.csv"
    path.write_text("1.5,2.5\n1.5,2.5\n\n0,1\n0,1\n\n90.5,91.5\n90.5,93.5\n")
    assert read_recording(path).y is None


def test_the_real_export():
    if not EXPORT.exists():
        pytest.skip("the reference data lies beside the project, not in it")
    recording = read_recording(EXPORT)
    facts = info(recording)
    assert (facts["profiles"], facts["points_per_profile"], facts["points_seen"]) == (140, 937, 130_737)
    text = EXPORT.read_text().split("\n\n")
    first = [float(v.replace(",", ".")) for v in text[0].split("\n", 1)[0].strip(";").split(";")]
    assert np.array_equal(recording.x[0, : len(first)], first)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["empty"]),
        (" \n\n\t\n", ["empty"]),
        ("1,5,2,5\n1,5,2,5\n\n0,0\n0,0\n\n9,5,9,5\n9,5,9,5\n", ["commas could be", "';'"]),
        ("1.5;2,5\n\n0;0\n\n9.5;9,5\n", ["decimal points and decimal commas"]),
        ("1.5,2.5\n1.5,2.5\n", ["1 block ", "three"]),
        ("1.5,2.5\n\n0,0\n", ["2 blocks"]),
        ("1.5\n\n0\n\n9\n\n8\n", ["4 blocks"]),
        ("1.5,2.5\n1.5,2.5\n\n0,0\n0,0\n\n9.5,9.5\n", ["2 profiles", "1 in block Z"]),
        ("1.5,2.5\n1.5,2.5\n\n0,0\n0,0\n\n9.5,9.5\n9.5\n", ["line 8", "cut off"]),
        ("1.5,2.5\n1.5,2.x\n\n0,0\n0,0\n\n9.5,9.5\n9.5,9.5\n", ["'x'", "line 2"]),
        ("1.5,2.5\n1.5,2-5\n\n0,0\n0,0\n\n9.5,9.5\n9.5,9.5\n", ["line 2"]),
        ("1.5,2.5\n1.5,1e309\n\n0,0\n0,0\n\n9.5,9.5\n9.5,9.5\n", ["too large", "line 2"]),
        ("1.5,2.5\n1.5,2.5\n\n0,0\n0,0\n\n9.5,9.5\n9.5,inf\n", ["line 8"]),
        ("1.5,2.5\n1.5,2.5\n\n0,0\n0,0\n\n9.5,9.5\n9.5,9\0\n", ["\\x00"]),
        ("<html>\n<p>1</p>", ["this is a web page"]),
        ("PK\x03\x04rest", ["this is a zip archive"]),
    ],
)
def test_what_is_no_scan_is_refused_with_the_reason(tmp_path, text, words):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    refused(path, *words)


def test_nul_bytes_far_into_the_file_are_found(tmp_path):
    path = tmp_path / "late.csv"
    rows = b"1.5,2.5\n" * 20_000
    path.write_bytes(rows + b"\n" + rows + b"\n" + rows[:-4] + b"\0\0\0\n")
    refused(path, "NUL")


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    refused(tmp_path / "nowhere.csv", "can't be read")
    refused(tmp_path, "can't be read")


@pytest.mark.parametrize("lost", [1, 2, 3, 4, 5, 40, 200, 900])
def test_a_file_that_lost_its_end_never_reads_as_whole(tmp_path, lost):
    """The cut falls inside a number, between numbers, between lines, inside a block."""
    values = np.round(90 + np.random.default_rng(1).random((6, 40)), 3)
    text = "\n".join(written(b) for b in (values, np.zeros((6, 40)), values))[:-lost]
    path = tmp_path / "cut.csv"
    path.write_text(text)
    if lost == 1:  # nothing but the last line end
        assert np.array_equal(read_recording(path).z, values)
    else:
        refused(path, "cut off")


readings = arrays(
    np.int64, st.tuples(st.integers(1, 5), st.integers(2, 6)), elements=st.integers(-(10**6), 10**6)
)  # um: what decimal text gives back exactly


@settings(max_examples=40, deadline=None)
@given(z=readings, seed=st.integers(0, 10**6))
def test_what_is_written_is_read_back_to_the_last_bit(tmp_path_factory, z, seed):
    rng = np.random.default_rng(seed)
    x = rng.integers(-(10**5), 10**5, z.shape) / 1000.0
    z = np.where(rng.random(z.shape) < 0.2, np.nan, z / 1000.0)
    path = tmp_path_factory.mktemp("round") / "scan.csv"
    write_xyz_blocks(Recording(x, z, "test", ""), path)
    back = read_recording(path)
    assert np.array_equal(back.x, x)
    assert np.array_equal(back.z, z, equal_nan=True)


def read_slowly(text, separator, decimal):
    """X and Z by the rules of docs/formats.md, a cell at a time."""

    def number(cell):
        return float(cell.replace(decimal, ".")) if cell.strip() else np.nan

    def matrix(block):
        rows = block.split("\n") if separator == " " else [row.rstrip(" ") for row in block.split("\n")]
        if all(row.endswith(separator) for row in rows):
            rows = [row[:-1] for row in rows]
        return [[number(cell) for cell in (row.split() if separator == " " else row.split(separator))] for row in rows]

    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n").strip("\n")
    x, _, z = (matrix(block) for block in text.split("\n\n"))
    width = max(map(len, x + z))
    return [np.array([row + [np.nan] * (width - len(row)) for row in rows]) for rows in (x, z)]


@st.composite
def tables(draw):
    """An XYZ file with gaps and lines of different length in any dialect, and its separator and decimal mark."""
    separator, decimal = draw(st.sampled_from([",.", ";.", ";,", "\t.", "\t,", " .", " ,"]))
    number = st.integers(-(10**6), 10**6).map(lambda um: f"{um / 1000:.3f}") | st.sampled_from(["7", "-0.0", "2.5e-1"])
    gap = st.sampled_from(["nan", "NaN"] + [""] * (separator != " "))
    lengths = draw(st.lists(st.integers(2, 9), min_size=1, max_size=6))
    end, padding = draw(st.sampled_from(["", separator])), draw(st.sampled_from(["", " "]))
    blocks = []
    for cells in (number | gap, st.just("3"), number | gap):
        rows = [["1.5", "-2.5", *draw(st.lists(cells, min_size=n - 2, max_size=n - 2))] for n in lengths]
        blocks.append("".join((separator + padding).join(row).replace(".", decimal) + end + "\n" for row in rows))
    eol, mark = draw(st.sampled_from(["\n", "\r\n", "\r"])), draw(st.sampled_from(["", "\ufeff"]))
    return mark + "\n".join(blocks).replace("\n", eol), separator, decimal


@settings(max_examples=100, deadline=None)
@given(table=tables(), piece=st.sampled_from([1, 20, 1 << 18]))
def test_any_table_reads_as_a_slow_reader_reads_it(tmp_path_factory, table, piece):
    path = tmp_path_factory.mktemp("slow") / "scan.csv"
    path.write_bytes(table[0].encode())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("truestand.files.scans.xyz_blocks.BLOCK_BYTES", piece)
        recording = read_recording(path)
    x, z = read_slowly(*table)
    assert np.array_equal(recording.x, x, equal_nan=True)
    assert np.array_equal(recording.z, z, equal_nan=True)


def test_gaps_uneven_lines_and_decimal_commas_are_not_read_field_by_field(tmp_path, monkeypatch):
    """That took most of the time with files as sensors write them."""
    monkeypatch.setattr("truestand.files.number_text._other_numbers", None)
    path = tmp_path / "uneven.csv"
    path.write_text("1,5;2,5;3,5;\n1,5;;\n\n0;0;0\n1;1\n\n90,5;;92,5;\n;93,5;\n")
    recording = read_recording(path)
    assert np.array_equal(recording.x, [[1.5, 2.5, 3.5], [1.5, np.nan, np.nan]], equal_nan=True)
    assert np.array_equal(recording.z, [[90.5, np.nan, 92.5], [np.nan, 93.5, np.nan]], equal_nan=True)
