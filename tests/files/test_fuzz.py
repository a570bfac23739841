"""Every reader against damaged files: a valid object or a typed error, in time and memory that the file justifies.

The readers, and what makes their result valid, stand in bench/fuzz.py, where a coverage-guided fuzzer uses them too.
"""

import json
import re
import struct
import time
import tracemalloc

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from exports import gocator, joescan, joescan_profile, packed, sick
from fuzz import FORMATS, PLY, TOKENS, calibration, edit_native, native, read_or_refused
from truestand.core.errors import TruestandError
from truestand.files.records.calibration_record import read_calibration
from truestand.files.scans.read import read_recording
from truestand.files.shapes.points import read_points

SEPARATORS = [",", ";", "\t", " ", ", "]
ENDS = ["\n", "\r\n", "\r"]
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
numbers = st.integers(-(10**6), 10**6).map(lambda n: f"{n / 1000:.3f}") | st.sampled_from(["nan", "0", "1e-3", ""])


@st.composite
def tables(draw, columns=None, cells=numbers):
    """Lines of cells, and how they are written: separator, line end, byte order mark, decimal comma."""
    width = columns or draw(st.integers(1, 4))
    rows = draw(st.lists(st.lists(cells, min_size=width, max_size=width), min_size=1, max_size=5))
    separator, end = draw(st.sampled_from(SEPARATORS)), draw(st.sampled_from(ENDS))
    text = end.join(separator.join(row) for row in rows)
    comma = draw(st.booleans()) and "," not in separator
    return (text.replace(".", ",") if comma else text), separator, end


@st.composite
def xyz(draw):
    text, _, end = draw(tables())
    return draw(marks) + (end * 2).join([text, text, text]).encode() + draw(st.sampled_from([b"", end.encode()]))


@st.composite
def long_csv(draw):
    columns = ["point", "time_s", "angle_deg", "counter", "encoder", "intensity"]
    names = ["profile", "x_mm", "z_um", *draw(st.lists(st.sampled_from(columns), unique=True))]
    separator, end = draw(st.sampled_from(SEPARATORS[:3])), draw(st.sampled_from(ENDS))
    rows = [names]
    for profile in draw(st.lists(st.integers(0, 9), unique=True, min_size=1, max_size=4)):
        its = {name: str(draw(st.integers(0, 99))) for name in columns} | {"profile": str(profile)}
        for point in range(draw(st.integers(1, 3))):
            reading = its | {"point": str(point)} | {k: draw(numbers) for k in ("x_mm", "z_um", "intensity")}
            rows.append([reading[name] for name in names])
    text = end.join(separator.join(row) for row in rows) + draw(st.sampled_from(["", end]))
    comma = draw(st.booleans()) and separator != ","
    return draw(marks) + (text.replace(".", ",") if comma else text).encode()


@st.composite
def point_text(draw, count=False):
    text, _, end = draw(tables(draw(st.integers(3, 4)), numbers.filter(bool)))
    heads = ["", "x y z" + end, "z_um x_m y_mm" + end, "# c" + end]
    head = f"{len(text.splitlines())}{end}" if count else draw(st.sampled_from(heads))
    return draw(marks) + (head + text + end).encode()


@st.composite
def ply(draw):
    order, end = (
        draw(st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"])),
        draw(st.sampled_from(ENDS)),
    )
    kinds = {"float": "f4", "double": "f8", "uchar": "u1", "int": "i4"}
    fields = [(name, draw(st.sampled_from(list(kinds)))) for name in draw(st.permutations(["x", "y", "z", "red"]))]
    count = draw(st.integers(0, 4))
    lines = [
        "ply",
        f"format {order} 1.0",
        f"element vertex {count}",
        *(f"property {k} {n}" for n, k in fields),
        "end_header",
    ]
    body = draw(st.binary(min_size=32 * count, max_size=32 * count))
    if order == "ascii":
        rows = draw(st.lists(st.lists(st.integers(0, 255), min_size=4, max_size=4), min_size=count, max_size=count))
        body = end.join(" ".join(map(str, row)) for row in rows).encode()
    return draw(marks) + (end.join(lines) + end).encode() + body


@st.composite
def records(draw):
    """A calibration record with some values of it replaced by others."""
    record = json.loads(calibration())
    for _ in range(draw(st.integers(0, 3))):
        place, key = record, None
        while isinstance(place, dict | list) and place:
            key = draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
            parent, place = place, place[key]
            if draw(st.integers(0, 3)) == 0:
                break
        if key is not None:
            parent[key] = draw(
                st.sampled_from([None, True, "x", "up", -1, 0, 2, 1e300, -1e18, 10**400, [], {}, [1], [[]]])
            )
    return json.dumps(record).encode()


marks = st.sampled_from([b"", b"", b"", BYTE_ORDER_MARK])
edits = st.lists(st.integers(0, 60), max_size=6).map(bytes)
WHOLE = {
    "xyz": xyz(),
    "long": long_csv(),
    "native": edits,
    "points": point_text(),
    "ds": point_text(count=True),
    "ply": ply(),
    "calibration": records(),
}


@st.composite
def damaged(draw, whole):
    """A file with up to three of the things done to it that transfers, editors and disks do."""
    data = draw(whole)
    for _ in range(draw(st.integers(0, 3))):
        at, to = sorted(draw(st.tuples(*[st.integers(0, len(data))] * 2)))
        token = draw(st.sampled_from(TOKENS))
        lines = data.split(b"\n")
        i, j = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
        match draw(st.sampled_from(["flip", "insert", "delete", "cut", "swap", "repeat", "number", "number"])):
            case "flip" if at < len(data):
                data = data[:at] + bytes([data[at] ^ 1 << draw(st.integers(0, 7))]) + data[at + 1 :]
            case "insert":
                data = data[:at] + token + data[at:]
            case "delete":
                data = data[:at] + data[to:]
            case "cut":
                data = data[:at]
            case "swap":
                lines[i], lines[j] = lines[j], lines[i]
                data = b"\n".join(lines)
            case "repeat":
                data = b"\n".join([*lines[:i], lines[j], *lines[i:]])
            case "number":
                data = _replaced(data, at, token)
    return data


def _replaced(data, at, token):
    """The first number from ``at`` on, replaced."""
    found = re.compile(rb"[-+.\d][-+.\deE]*").search(data, at)
    return data if found is None else data[: found.start()] + token + data[found.end() :]


@pytest.mark.parametrize("kind", FORMATS)
def test_whatever_a_file_holds_it_is_read_or_refused(tmp_path_factory, kind):
    path = tmp_path_factory.mktemp("fuzz") / "file"
    whole = st.sampled_from(FORMATS[kind].whole())

    @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])
    @given(damaged(whole | WHOLE[kind] if kind in WHOLE else whole))
    def read(data):
        path.write_bytes(data)
        read_or_refused(kind, path)

    read()


def ply_of(count, body, kind="double"):
    head = PLY.decode().replace("%s", "ascii").replace("vertex 2", f"vertex {count}").replace("short z", f"{kind} z")
    return head + body


def record(old, new):
    return calibration().decode().replace(old, new)


def record_with(key, value):
    return json.dumps(json.loads(calibration()) | {key: value})


def row(number, *, end="\n"):
    return f"0.500 1.500 {number}{end}"


ROWS = [row(f"{i}.125") for i in range(30)]
BLOCK = "1.5,2.5\n" * 3
LATE = "1.5;2\n" * 5000
"""Longer than the first lines from which a reader takes the separator and the decimal mark."""
LYING = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]
AWAY = [[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
REFUSED = {  # kind, content, what the message must say
    "xyz, 1e309 after a byte order mark": ("xyz", f"\ufeff1.5,2.5\n1.5,1e309\n\n{BLOCK[:16]}\n{BLOCK[:16]}", "line 2"),
    "xyz, 1e309 in block Y": ("xyz", "1.5,2.5\n\n1e309,1e309\n\n1.5,2.5\n", "line 3"),
    "xyz, underscore in block Y": ("xyz", f"{LATE}\n{LATE[:-6]}1_0;1_0\n\n{LATE}", "line 10001"),
    "xyz, NUL": ("xyz", f"{LATE}\n{LATE}\n{LATE[:-4]}\0;2\n", "line 15002"),
    "xyz, a line end of another kind": ("xyz", "1.5,2.5\n1.5,\r2.5\n\n0,0\n0,0\n\n1.5,2.5\n1.5,2.5\n", "line 2"),
    "xyz, a line feed among carriage returns": ("xyz", ("1.5 2.5\r" * 9000 + "\r") * 3 + "1.5 \n2.5", "line 27004"),
    "xyz, decimal comma after points": ("xyz", f"{LATE}\n{LATE}\n{LATE[:-6]}1,5;2\n", "line 15002"),
    "xyz, block Y of another length": ("xyz", "1.5,2.5\n1.5,2.5\n\n0,0\n\n1.5,2.5\n1.5,2.5\n", "lines 4 to 4"),
    "long, 1e309": ("long", "profile,x_mm,z_mm\n\n0,1,2\n0,1,1e309\n", "line 4"),
    "long, NUL": ("long", "profile,x_mm,z_mm\r0,1,2\r0,1,\0\r", "line 3"),
    "long, decimal point among commas": ("long", "profile;x_mm;z_mm\n" + "0;1,5;2\n" * 4000 + "1;1.5;2\n", "line 4002"),
    "long, comma for both": ("long", "profile,x_mm,z_mm\n0,1,5,2,5\n", "line 2"),
    "long, a fraction of a counter": ("long", "profile,counter,x_mm,z_mm\n\n0,1.5,1,2\n", "line 3"),
    "long, a counter beyond all": ("long", "profile,counter,x_mm,z_mm\n0,1e300,1,2\n", "line 2"),
    "long, times infinitely apart": ("long", "profile,x_mm,z_mm,time_s\n0,1,2,-1e308\n2,1,2,1e308\n", "line 2"),
    "long, a length too large in mm": ("long", "profile,x_m,z_mm\n0,1,2\n0,1e308,2\n", "line 3"),
    "long, cut off": ("long", "profile,x_mm,z_mm\n" + "0,1.125,2.125\n" * 30 + "0,1.125,2.1", "line 32"),
    "points, a word in the first line": ("points", "1.5 xx 3\n4 5 6\n", "line 1"),
    "points, infinity in the first line": ("points", "1.5 2 inf\n4 5 6\n", "line 1"),
    "points, marks mixed": ("points", "1,5;2;3\n" * 60 + "1.5;2;3\n", "line 61"),
    "points, NUL": ("points", "1 2 3\r1 2 3\r1 2 \0\r", "line 3"),
    "points, cut off": ("points", "".join(ROWS) + row("7.1", end=""), "line 31"),
    "ds, cut off": ("ds", "31\n" + "".join(ROWS) + row("7.12", end=""), "line 32"),
    "ds, a count of thousands of digits": ("ds", "9" * 5000 + "\n1 2 3\n", "line"),
    "ply, cut off": ("ply", ply_of("31", "".join(ROWS) + row("7.12", end="")), "line 38"),
    "ply, 1e309": ("ply", ply_of("2", "1 2 3\n1 2 1e309\n"), "line 9"),
    "ply, NUL": ("ply", ply_of("2", "1 2 3\n1 2 \0\n"), "line 9"),
    "ply, decimal comma": ("ply", ply_of("2", "1 2 3\n1 2 3,5\n"), "line 9"),
    "ply, underscore": ("ply", ply_of("1", "1 2 1_0\n"), "line 8"),
    "ply, more than a property holds": ("ply", ply_of("2", "1 2 3\n1 2 300\n", "uchar"), "line 9"),
    "ply, a fraction for a whole number": ("ply", ply_of("1", "1 2 3.5\n", "int"), "line 8"),
    "ply, beyond float": ("ply", ply_of("1", "1 2 1e39\n", "float"), "line 8"),
    "ply, a count of thousands of digits": ("ply", ply_of("9" * 5000, "1 2 3\n"), "element"),
    "ply, two formats": (
        "ply",
        "ply\nformat ascii 1.0\n" + ply_of("1", "1 2 3\n")[4:].replace("ascii", "binary_big_endian"),
        "one known format",
    ),
    "stand, 1e309": ("stand", "[table]\nspeed_rad_per_s = 1e309\n[[sensor]]\n", "speed_rad_per_s"),
    "stand, NUL": ("stand", "[table]\nstart = '\0'\n", "line 2"),
    "stand, old Mac line ends": ("stand", "[table]\rstart = 'home'\r[[sensor]]\r", "line 1"),
    "stand, decimal comma": ("stand", "[table]\nspeed_rad_per_s = 0,3\n", "line 2"),
    "stand, thousands of digits": ("stand", "[scan]\ncounts_per_turn = " + "9" * 5000, "digits"),
    "stand, thousands of levels": ("stand", "a = " + "[" * 5000, "recursion"),
    "shaft, 1e309": ("shaft", '[[cylinder]]\nname = "a"\nfrom_mm = 0\nto_mm = 1e309\ndiameter_mm = 5\n', "to_mm"),
    "record, 1e309": ("calibration", record('"points": 4', '"points": 1e309'), "line 15"),
    "record, NaN": ("calibration", record('"points": 4', '"points": NaN'), "NaN in line 15"),
    "record, thousands of digits": ("calibration", record('"points": 4', '"points": ' + "9" * 5000), "line 15"),
    "record, NUL": ("calibration", '{\n"a": "\0"}', "line 2"),
    "record, decimal comma": ("calibration", '{\n"a": 1,5}', "line 2"),
    "record, a direction that is none": (
        "calibration",
        record('"ccw"', '"CCW"').replace('"stand": {', '"none": {'),
        "'CCW'",
    ),
    "record, a word for a number": ("calibration", record('"points": 100', '"points": "100"'), "residuals.points"),
    "record, a covariance that is no matrix": (
        "calibration",
        record_with("covariance", {"matrix": [[1, 2]]}),
        "square",
    ),
    "record, a shaft that lies": ("calibration", record_with("shaft", {"shaft_from_rotor": LYING}), "lies across"),
    "record, a shaft far away": ("calibration", record_with("shaft", {"shaft_from_rotor": AWAY}), "1e+300"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_would_read_as_something_else_is_refused_with_its_place(tmp_path, name):
    kind, text, place = REFUSED[name]
    (tmp_path / "file").write_text(text, encoding="utf-8", newline="")
    assert place in (read_or_refused(kind, tmp_path / "file") or "read")


SAME = {
    "xyz, line ends doubled by a transfer": (
        "xyz",
        "1.5,2.5\r\r\n" * 2 + "\r\r\n0,0\r\r\n1,1\r\r\n\r\r\n" + "9.5,8.5\r\r\n" * 2,
    ),
    "xyz, a byte order mark and old Mac line ends": (
        "xyz",
        "\ufeff" + "1,5;2,5\r" * 2 + "\r0;0\r1;1\r\r" + "9,5;8,5\r" * 2,
    ),
    "points, a gap in the first line": ("points", "# one\n1.5 nan 3\n4 5 6\n"),
    "points, no line end": ("points", "1.5 nan 3\n4 5 6"),
    "points, line ends of two kinds": ("points", "1.5\tnan\t3\r\n4\t5\t6\r"),
    "ply, a byte order mark": ("ply", "\ufeff" + ply_of("2", "1.5 nan 3\n4 5 6\n")),
    "ply, a blank line before": ("ply", "\n" + ply_of("2", "1.5 nan 3\n4 5 6\n")),
    "ply, old Mac line ends": ("ply", ply_of("2", "1.5 nan 3\n4 5 6\n").replace("\n", "\r")),
    "ply, tabs": ("ply", ply_of("2", "1.5\tnan\t3 \n4\t5\t6\n")),
    "ply, words of other languages in a comment": (
        "ply",
        ply_of("2", "1.5 nan 3\n4 5 6\n").replace("ply\n", "ply\ncomment \x85property list x\n"),
    ),
    "ply, axes in another order": (
        "ply",
        "\ufeff" + ply_of("2", "nan 1.5 3\n5 4 6\n").replace("float x", "float y", 1).replace("double y", "double x"),
    ),
}


@pytest.mark.parametrize("name", SAME)
def test_what_is_only_written_in_another_way_reads_the_same(tmp_path, name):
    kind, text = SAME[name]
    path = tmp_path / "file"
    path.write_text(text, encoding="utf-8", newline="")
    assert read_or_refused(kind, path) is None
    if kind == "xyz":
        recording = read_recording(path)
        assert recording.x.tolist() == [[1.5, 2.5]] * 2
        assert recording.z.tolist() == [[9.5, 8.5]] * 2
        assert recording.y.tolist() == [0, 1]
    else:
        assert np.array_equal(read_points(path).points, [[1.5, np.nan, 3], [4, 5, 6]], equal_nan=True)


def test_the_byte_order_of_a_ply_may_stand_after_its_properties(tmp_path):
    lines = (PLY % b"binary_big_endian").splitlines(keepends=True)
    (tmp_path / "p").write_bytes(
        b"".join([lines[0], *lines[2:-1], lines[1], lines[-1]]) + struct.pack(">fdhfdh", 1.5, 2, 3, 4, 5, 6)
    )
    assert read_points(tmp_path / "p").points.tolist() == [[1.5, 2, 3], [4, 5, 6]]


def test_a_record_with_a_byte_order_mark_is_the_record(tmp_path):
    (tmp_path / "c.json").write_bytes(BYTE_ORDER_MARK + calibration())
    assert read_calibration(tmp_path / "c.json").residuals.points == 100


def hollow(path, **shapes):
    """A native scan whose datasets have a shape and not one number."""
    path.write_bytes(native())
    with h5py.File(path, "r+") as file:
        for name, shape in shapes.items():
            del file[name]
            file.create_dataset(name, shape=shape, dtype="i2", chunks=(2**15, *[1] * (len(shape) - 1)))
            file[name].attrs["sha256"] = "0" * 64


HUGE = 2**31 - 1
CLAIMS = {
    "joescan, points": ("joescan", lambda path: path.write_bytes(joescan_profile()[:-4] + struct.pack("<i", HUGE))),
    "joescan, encoders": (
        "joescan",
        lambda path: path.write_bytes(joescan()[:14] + struct.pack("<i", HUGE) + joescan()[18:]),
    ),
    "joescan, a bomb": ("joescan", lambda path: path.write_bytes(packed(joescan_profile() * 150_000))),
    "joescan, a bomb of nothing": ("joescan", lambda path: path.write_bytes(packed(joescan() + bytes(10**8)))),
    "joescan, one long profile": (
        "joescan",
        lambda path: path.write_bytes(joescan_profile() * 5_000 + joescan_profile([(1, 2, 3)] * 5_000)),
    ),
    "sick": ("sick", lambda path: path.write_bytes(sick(Width=HUGE, Height=HUGE))),
    "gocator": ("gocator", lambda path: path.write_bytes(gocator().replace(b",2,3,", b",%d,%d," % (HUGE, HUGE)))),
    "gocator, a frame's number": (
        "gocator",
        lambda path: path.write_bytes(gocator().replace(b"\n1,0,", b"\n" + b"9" * 5000 + b",0,")),
    ),
    "ply": ("ply", lambda path: path.write_bytes((PLY % b"binary_little_endian").replace(b"x 2", b"x %d" % HUGE))),
    "ascii ply": ("ply", lambda path: path.write_text(ply_of(HUGE, "1 2 3\n"))),
    "ds": ("ds", lambda path: path.write_text(f"{HUGE}\n1 2 3\n")),
    "long": ("long", lambda path: path.write_text(f"profile,x_mm,z_mm\n0,1,2\n{HUGE},1,2\n")),
    "long, points": ("long", lambda path: path.write_text(f"profile,point,x_mm,z_mm\n0,0,1,2\n0,{HUGE},1,2\n")),
    "native": ("native", lambda path: hollow(path, x=(HUGE, 1), z=(HUGE, 1))),
    "native, no numbers": ("native", lambda path: hollow(path, x=(2**16, 2**14), z=(2**16, 2**14))),
    "native, a column": ("native", lambda path: hollow(path, time=(HUGE,))),
    "native, intensity": ("native", lambda path: hollow(path, intensity=(HUGE, 1))),
    "xyz, one long line": (
        "xyz",
        lambda path: path.write_text("1\n" * 20000 + ";" * 20000 + "\n\n0\n\n" + "1\n" * 20001),
    ),
}


@pytest.mark.parametrize("name", CLAIMS)
def test_a_claim_of_two_to_the_31_is_refused_at_once_and_in_little_memory(tmp_path, name):
    kind, write = CLAIMS[name]
    path = tmp_path / "file"
    write(path)
    assert read_or_refused(kind, path)  # what is imported once is no part of the time
    began = time.process_time()
    assert read_or_refused(kind, path)
    assert time.process_time() - began < 1.0  # to count through what is claimed would take minutes
    tracemalloc.start()
    try:
        assert read_or_refused(kind, path)
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


def test_one_long_number_among_many_takes_no_memory(tmp_path):
    (tmp_path / "p").write_text("1 2 3\n" * 20_000 + "1 2 0." + "0" * 100_000 + "\n")
    tracemalloc.start()
    try:
        assert read_points(tmp_path / "p").points[-1].tolist() == [1, 2, 0]
        assert tracemalloc.get_traced_memory()[1] < 30e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", ["xyz", "long", "points", "ds", "ply"])
@pytest.mark.parametrize("lost", range(1, 6))
def test_a_file_cut_inside_its_last_number_is_refused_with_the_line(tmp_path, kind, lost):
    body = "".join(ROWS)
    text = {
        "xyz": "\n".join([body.replace(" ", ";")] * 3),
        "long": "profile,x_mm,z_mm\n" + "".join(f"{i},0.500,{i}.125\n" for i in range(30)),
        "points": body,
        "ds": "30\n" + body,
        "ply": ply_of(30, body),
    }[kind]
    (tmp_path / "file").write_text(text.rstrip("\n")[:-lost])
    told = read_or_refused(kind, tmp_path / "file")
    assert told
    assert re.search(rf"line {len(text.splitlines())}\b", told), told


def test_native_values_that_were_edited_are_refused(tmp_path):
    """A step or an offset that was changed, a column of another length: the hashes of the counts still hold."""
    path = tmp_path / "file"
    for name, value in (("scale_factor", 0.0040001), ("add_offset", float("nan")), ("scale_factor", 0.0)):
        path.write_bytes(native())
        with h5py.File(path, "r+") as file:
            file["z"].attrs[name] = value
        with pytest.raises(TruestandError, match=name):
            read_recording(path)
    path.write_bytes(native())
    edit_native(path, [6, 0])
    assert read_recording(path).counter is None
