"""Point files: exact, or refused with the line."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truestand.core.errors import UnreadableFile
from truestand.files.points import read_ply, read_points

TWO = [[1.5, -2.0, 3.0], [4.0, 5.0, 6e-3]]

GOOD = {
    "spaces": b"1.5 -2 3\n4 5 6e-3\n",
    "more columns": b"1.5 -2 3 9 9\n4 5 6e-3 9 9\n",
    "tabs": b"1.5\t-2\t3\n4\t5\t6e-3",
    "aligned": b"  1.5 \t -2.0  3.0\n  4.0 \t  5.0  6e-3\n",
    "commas": b"1.5,-2.0,3.0\n4.0,5.0,6e-3\n",
    "decimal commas": b"1,5;-2;3\r\n4;5;0,006\r\n",
    "decimal commas, spaces": b"1,5 -2,0 3,0\n4,0 5,0 0,006\n",
    "old Mac": b"1.5 -2 3\r4 5 6e-3\r",
    "byte order mark": b"\xef\xbb\xbf1.5 -2 3\n4 5 6e-3\n",
    "names": b"x;y;z\n1.5;-2;3\n4;5;6e-3\n",
    "comment": b"# scanned by Karol\n1.5 -2 3\n4 5 6e-3\n\n",
    "NIST": b"2\n1.5 -2 3\n4 5 6e-3\n",
    "ascii ply": b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float64 x\nproperty double y\nproperty double z\n"
    b"element face 0\nproperty list uchar int vertex_indices\nend_header\n1.5 -2 3\n4 5 6e-3\n",
    "big-endian ply": b"ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty uchar red\nproperty double x\n"
    b"property double y\nproperty double z\nend_header\n" + struct.pack(">BdddBddd", 7, *TWO[0], 8, *TWO[1]),
}
BAD = {
    "empty": (b"", "empty"),
    "only names": (b"x y z\n", "empty"),
    "NUL": (b"1 2 3\n\x004 5 6", "NUL"),
    "ragged": (b"1 2 3\n4 5\n", "line 2"),
    "a gap": (b"1 2 3\n\n4 5 6\n", "line 2"),
    "a word": (b"1 2 3\n4 5 many\n", "line 2"),
    "cut off": (b"1 2 3\n4 5 6e\n", "line 2"),
    "too large": (b"1 2 3\n4 5 1e309\n", "line 2"),
    "hexadecimal": (b"1 2 3\n4 5 0x10\n", "line 2"),
    "underscore": (b"1 2 3\n4 5 1_0\n", "line 2"),
    "two columns": (b"1 2\n3 4\n", "need x y z"),
    "ambiguous": (b"1,2,3\n4,5,6\n", "decimal marks or separators"),
    "NIST cut off": (b"3\n1 2 3\n4 5 6\n", "promises 3"),
    "binary": (b"\x89PNG\r\n\x1a\n1234", "need numbers"),
    "ply of huge count": (
        b"ply\nformat binary_little_endian 1.0\nelement vertex 2147483648\nproperty float x\nend_header\n",
        "cut off",
    ),
    "ascii ply of huge count": (
        b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n1\n",
        "cut off",
    ),
    "ply without z": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n",
        "no z",
    ),
    "ply with lists": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n1 2\n",
        "plain",
    ),
    "ply, faces first": (b"ply\nformat ascii 1.0\nelement face 1\nelement vertex 1\nend_header\n", "first element"),
    "ply without end": (b"ply\nformat ascii 1.0\nelement vertex 1\n", "header"),
}


@pytest.mark.parametrize("name", GOOD)
def test_read(tmp_path, name):
    (tmp_path / "p").write_bytes(GOOD[name])
    assert read_points(tmp_path / "p").tolist() == TWO


@pytest.mark.parametrize("name", BAD)
def test_refused(tmp_path, name):
    data, message = BAD[name]
    (tmp_path / "p").write_bytes(data)
    with pytest.raises(UnreadableFile, match=message):
        read_points(tmp_path / "p")


def test_missing(tmp_path):
    with pytest.raises(UnreadableFile, match="check the path"):
        read_points(tmp_path / "none")


def test_not_seen_stays_not_seen(tmp_path):
    (tmp_path / "p").write_bytes(b"nan nan nan\n1 2 3\n")
    assert np.isnan(read_points(tmp_path / "p")[0]).all()


@settings(deadline=None, max_examples=300)
@given(
    st.one_of(st.binary(max_size=300), st.sampled_from(list(GOOD.values()) + [b for b, _ in BAD.values()])), st.data()
)
def test_any_bytes_are_points_or_a_typed_error(tmp_path_factory, data, draw):
    if data and draw.draw(st.booleans()):
        at = draw.draw(st.integers(0, len(data) - 1))
        data = data[:at] + draw.draw(st.binary(max_size=4)) + data[at + draw.draw(st.integers(0, 3)) :]
    file = tmp_path_factory.getbasetemp() / "fuzz"
    file.write_bytes(data)
    for read in (read_points, read_ply):
        try:
            read(file)
        except UnreadableFile as refused:
            assert "fuzz" in str(refused)
