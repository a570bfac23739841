"""Point files: exact, or refused with the line."""

import struct
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.shapes.ply import ply_vertices
from truestand.files.shapes.points import read_points


def npy(array):
    file = BytesIO()
    np.save(file, array)
    return file.getvalue()


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
    "names in another order": b"n;Z;Y;X\n1;3;-2;1.5\n2;6e-3;5;4\n",
    "names below a title": b"Ring of 3\nid,x,y,z,nx,ny,nz\n1,1.5,-2,3,0,0,1\n2,4,5,6e-3,0,0,1\n",
    "names in a comment": b"# by Karol\n# columns: z y x\n3 -2 1.5\n6e-3 5 4\n",
    "names above a comment": b"z y x\n# x y z\n3 -2 1.5\n6e-3 5 4\n",
    "quoted names": b'"id","X [um]","Y [mm]","Z [m]"\n1,1500.0,-2,3e-3\n2,4000.0,5,6e-6\n',
    "units, between spaces": b"x [mm] y (mm) z_mm\n1.5 -2 3\n4 5 6e-3\n",
    "micro sign": "x (\u00b5m)\ty (\u03bcm)\tz (um)\n1500\t-2000\t3000\n4000\t5000\t6\n".encode(),
    "micro sign, Latin-1": b"x_\xb5m y_\xb5m z_\xb5m\n1500 -2000 3000\n4000 5000 6\n",
    "metres": b"x_m;y_m;z_m\n0,0015;-0,002;0,003\n0,004;0,005;0,000006\n",
    "a unit in a comment": b"# units: um\n1500 -2000 3000\n4000 5000 6\n",
    "a unit in a title": b"xyz_um\n1500 -2000 3000\n4000 5000 6\n",
    "a unit below the names": b"x;y;z\n[um];[um];[um]\n1500;-2000;3000\n4000;5000;6\n",
    "a unit in a comment, and another's": b"# noise 5 nm\n# unit = m\nx y z\n.0015 -.002 .003\n.004 5e-3 6e-6\n",
    "units after a stroke": b"x/um,y / mm,z/m\n1500.0,-2,3e-3\n4000.0,5,6e-6\n",
    "units after a stroke, in a comment": b"# x/um y/um z/um\n1500 -2000 3000\n4000 5000 6\n",
    "another unit of what names place": b"# noise 5 um\nx_mm y_mm z_mm\n1.5 -2 3\n4 5 6e-3\n",
    "a title": b"Points of ring 3\n1.5 -2 3\n4 5 6e-3\n",
    "a comment that names an axis": b"# turned about z\n1.5 -2 3\n4 5 6e-3\n",
    "a cloud of ours as text": b"profile,point,x,y,z\n0,0,1.5,-2,3\n0,1,4,5,6e-3\n",
    "a word that may be a unit": b"# in my lab\n1.5 -2 3\n4 5 6e-3\n",
    "comment": b"# scanned by Karol\n1.5 -2 3\n4 5 6e-3\n\n",
    "NIST": b"2\n1.5 -2 3\n4 5 6e-3\n",
    "ascii ply": b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float64 x\nproperty double y\nproperty double z\n"
    b"element face 0\nproperty list uchar int vertex_indices\nend_header\n1.5 -2 3\n4 5 6e-3\n",
    "big-endian ply": b"ply\nformat binary_big_endian 1.0\nelement vertex 2\nproperty uchar red\nproperty double x\n"
    b"property double y\nproperty double z\nend_header\n" + struct.pack(">BdddBddd", 7, *TWO[0], 8, *TWO[1]),
}
PCD = b"""# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS rgb x y z
SIZE 4 8 8 8
TYPE U F F F
COUNT 1 1 1 1
WIDTH 2
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 2
DATA %b
"""
GOOD |= {
    "ascii PCD": PCD % b"ascii" + b"7 1.5 -2 3\n8 4 5 6e-3\n",
    "binary PCD": PCD % b"binary" + struct.pack("<IdddIddd", 7, *TWO[0], 8, *TWO[1]),
    "numpy array": npy(np.array(TWO)),
    "numpy array with names": npy(np.array([(*row[::-1],) for row in TWO], dtype=[(c, "f8") for c in "zyx"])),
    "text STL": b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 1.5 -2 3\nvertex 4 5 6e-3\nvertex 4 5 6e-3\n"
    b"endloop\nendfacet\nendsolid a\n",
}
BAD = {
    "empty": (b"", "empty"),
    "only names": (b"x y z\n", "found 'x y z' and no line of numbers"),
    "NUL": (b"1 2 3\n\x004 5 6", "NUL"),
    "ragged": (b"1 2 3\n4 5\n", "line 2"),
    "a gap": (b"1 2 3\n\n4 5 6\n", "line 2"),
    "a word": (b"1 2 3\n4 5 many\n", "line 2"),
    "a unit in a cell": (b"x,y,z\n1.5,2,3\n1.5,35.0mm,3\n", "found '35.0mm' in line 3, column 2"),
    "units in all cells": (b"35.0mm 1.0mm 2um\n35.1mm 1.1mm 2um\n", "found '35.0mm' in line 1, column 1"),
    "units in the first line": (b"35.0mm 1.0mm 2um\n35.1 1.1 2\n", "found '35.0mm' in line 1, column 1"),
    "an empty cell": (b"1.5;2;3\n4;;6\n", "found an empty cell in line 2, column 2"),
    "a mark of what was not seen": (b"1 2 3\n4 5 -1e38\n1e38 5 6\n", r"found 1e\+38 mm in point 2 \(2 such points\)"),
    "cut off": (b"1 2 3\n4 5 6e\n", "line 2"),
    "too large": (b"1 2 3\n4 5 1e309\n", "line 2"),
    "hexadecimal": (b"1 2 3\n4 5 0x10\n", "line 2"),
    "underscore": (b"1 2 3\n4 5 1_0\n", "line 2"),
    "two columns": (b"1 2\n3 4\n", "need x y z"),
    "ambiguous": (b"1,2,3\n4,5,6\n", "decimal marks or separators"),
    "NIST cut off": (b"3\n1 2 3\n4 5 6\n", "promises 3"),
    "PCD cut off": (PCD % b"binary" + b"1234", "promises 2 points"),
    "PCD of fewer points": (PCD % b"ascii" + b"7 1.5 -2 3\n", "promises 2 points and holds 1"),
    "compressed PCD": (PCD % b"binary_compressed" + b"1234", "need ascii or binary"),
    "PCD without fields": (b"VERSION 0.7\nPOINTS 2\nDATA ascii\n1 2 3\n", "header can't be read"),
    "numpy objects": (npy(np.array([{}], dtype=object)), "can't be read"),
    "numpy cut off": (npy(np.array(TWO))[:-8], "can't be read"),
    "numpy cube": (npy(np.zeros((2, 3, 3))), r"shape \(2, 3, 3\)"),
    "Excel": (
        b"PK\x03\x04" + b"\0" * 26 + b"[Content_Types].xml" + b"\0" * 40 + b"xl/workbook.xml",
        "this is an Excel workbook, need points",
    ),
    "STEP": (b"ISO-10303-21;\nHEADER;\n", "this is a STEP model"),
    "OFF": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "this is an OFF mesh"),
    "OBJ": (b"# by hand\n\nmtllib a.mtl\no part\nv 0 0 0\nv 1 0 0\n", "this is an OBJ model"),
    "VTK": (b"# vtk DataFile Version 3.0\nring\nASCII\n1 2 3\n", "this is a VTK file"),
    "DXF": (b"  0\r\nSECTION\r\n  2\r\nHEADER\r\n", "this is a DXF drawing"),
    "JSON": (b'{"points": [[1, 2, 3]]}', "this is JSON"),
    "UTF-16": ("x y z\n1 2 3\n".encode("utf-16"), "this is text in UTF-16"),
    "MATLAB": (b"MATLAB 5.0 MAT-file, Platform: GLNXA64\n1 2 3\n", "this is a MATLAB file"),
    "many empty lines": (b"\n" * 60_000 + b"w", "in line 60001"),
    "binary": (b"\x89PNG\r\n\x1a\n1234", "this is a picture, need points"),
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
        "no column 'z'",
    ),
    "ply with lists": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n1 2\n",
        "plain",
    ),
    "ply, faces first": (b"ply\nformat ascii 1.0\nelement face 1\nelement vertex 1\nend_header\n", "first element"),
    "no y": (b"x,z,intensity\n1.5,2,3\n", "no column 'y' among 'x, z, intensity'"),
    "no y in a comment": (b"# x z intensity\n1.5 2 3\n", "no column 'y'"),
    "no names of ours": (b"east north up\n1 2 3\n", "no column 'x'"),
    "a title of as many words as numbers": (b"Points of ring\n1 2 3\n", "no column 'x'"),
    "x twice": (b"x,y,z,x_um\n1.5,2,3,4\n", "2 columns 'x'"),
    "an unknown unit": (b"x_inch,y_inch,z_inch\n1.5,2,3\n", "no column 'x' among 'x_inch"),
    "an unknown unit in brackets": (b"x [in] y [in] z [in]\n1 2 3\n", "no column 'x' among 'x_in,"),
    "a unit for some": (b"x, y, z [um]\n1.5,2,3\n", "on each"),
    "a unit that may be another thing's": (b"# noise 5 um\n1 2 3\n", "found '# noise 5 um' .* pass --unit"),
    "a long word for a unit": (b"# in micrometres\n1 2 3\n", "pass --unit"),
    "um without a micro sign": (b"# my\n1 2 3\n", "found .# my. .* pass --unit"),
    "a stated unit that is unknown": (b"# units: inch\n1 2 3\n", "pass --unit"),
    "a part of a mm": (b"# in 1/1000 mm\n1 2 3\n", "pass --unit"),
    "two units": (b"# units: um\n# units: mm\n1 2 3\n", "pass --unit"),
    "a unit other than the names'": (b"# units: um\nx_mm y_mm z_mm\n1 2 3\n", "'um' above .* pass --unit"),
    "a unit in a comment of a ply": (
        b"ply\nformat ascii 1.0\ncomment step 5 um\nelement vertex 1\nproperty float x\nproperty float y\n"
        b"property float z\nend_header\n1 2 3\n",
        "'step 5 um' above the numbers",
    ),
    "more names": (b"id x y z\n1 2 3\n", "4 column names"),
    "fewer names": (b"x y z\n1 2 3 4\n", "3 column names"),
    "names in a sentence": (b"# x y z in um\n1 2 3\n", "5 column names"),
    "a scan": (b"profile,point,x_mm,z_mm\n0,0,1,2\n", "found a scan"),
    "a scan that can't be told by its first line": (b"# k1\nprofile;point;x;z\n0;0;1;2\n", "no column 'y'"),
    "too large in mm": (b"x_m y_m z_m\n1 2 1e308\n", "line 2"),
    "ply without end": (b"ply\nformat ascii 1.0\nelement vertex 1\n", "header"),
}


@pytest.mark.parametrize("name", GOOD)
def test_points_read_as_written(tmp_path, name):
    (tmp_path / "p").write_bytes(GOOD[name])
    assert read_points(tmp_path / "p").points.tolist() == TWO


@pytest.mark.parametrize("name", BAD)
def test_a_damaged_or_ambiguous_file_is_refused(tmp_path, name):
    data, message = BAD[name]
    (tmp_path / "p").write_bytes(data)
    with pytest.raises(UnreadableFile, match=message):
        read_points(tmp_path / "p")


@pytest.mark.parametrize(
    ("data", "columns", "unit"),
    [
        (b"n a b c\n7 1.5 -2 3\n8 4 5 6e-3\n", "A,B,C", None),
        (b"n a b c\n7 1.5 -2 3\n8 4 5 6e-3\n", "2,3,4", None),
        (b"n a b_um c\n7 1500 -2000 3000\n8 4000 5000 6\n", "a,b,c", "um"),
        (b"x_inch y_inch z_inch\n1.5 -2 3\n4 5 6e-3\n", "1,y_inch,3", "mm"),
        (b"7 3 -2 1.5\n8 6e-3 5 4\n", "4,3,2", "mm"),
        (b"0.0015 -0.002 0.003\n0.004 0.005 0.000006\n", None, "m"),
        (b"# x y z in um\n1500 -2000 3000\n4000 5000 6\n", "1,2,3", "um"),
        (b"# noise 5 um\n1.5 -2 3\n4 5 6e-3\n", None, "mm"),
        (b"# units: um\nx_mm y_mm z_mm\n1.5 -2 3\n4 5 6e-3\n", None, "mm"),
        (GOOD["ascii ply"].replace(b" x", b" A"), "a,y,z", None),
        (GOOD["big-endian ply"], "2,3,4", "mm"),
    ],
)
def test_columns_and_unit_are_those_given(tmp_path, data, columns, unit):
    (tmp_path / "p").write_bytes(data)
    assert read_points(tmp_path / "p", columns, unit).points.tolist() == TWO


@pytest.mark.parametrize(
    ("data", "columns", "unit", "message"),
    [
        (b"1 2 3\n", "x,y,z", None, "no column 'x' among '1, 2, 3'"),
        (b"1 2 3\n", "1,2,4", None, "no column '4'"),
        (b"1 2 3\n", "0,1,2", None, "no column '0'"),
        (b"1 2 3\n", "1,2", None, "need three"),
        (b"1 2 3\n", "1,2,2", None, "need three"),
        (b"x_um y_um z_um\n1 2 3\n", None, "mm", "--unit mm"),
        (b"x_um y_um z_um\n1 2 3\n", "1,2,3", "mm", "--unit mm"),
        (b"x_inch y_inch z_inch\n1 2 3\n", "1,2,3", None, "on each"),
        (b"x_inch y_inch z_inch\n1 2 3\n", None, "mm", "no column 'x'"),
        (b"# x y z in um\n1 2 3\n", "1,2,3", None, "5 column names"),
        (GOOD["big-endian ply"], "a,y,z", None, "no column 'a' among 'red, x, y, z'"),
    ],
)
def test_columns_and_unit_that_do_not_fit_are_refused(tmp_path, data, columns, unit, message):
    (tmp_path / "p").write_bytes(data)
    with pytest.raises((UnreadableFile, BadRecipe), match=message):
        read_points(tmp_path / "p", columns, unit)


@pytest.mark.parametrize("planar", [False, True])
def test_an_array_of_coordinates_side_by_side_is_read_as_its_columns(tmp_path, planar):
    """(3, n) was read as three points of x y z, and n - 3 columns beside."""
    points = np.random.default_rng(0).normal(size=(3 - planar, 72))
    (tmp_path / "p.npy").write_bytes(npy(points))
    assert np.array_equal(read_points(tmp_path / "p.npy", planar=planar).points[:, : 3 - planar], points.T)


@pytest.mark.parametrize("shape", [(3, 3), (3, 4), (3, 16), (4, 72), (1, 72), (20, 40)])
def test_an_array_that_may_lie_either_way_is_refused(tmp_path, shape):
    (tmp_path / "p.npy").write_bytes(npy(np.random.default_rng(0).normal(size=shape)))
    with pytest.raises(UnreadableFile, match=r"shape .* save it as \(points, 3\)"):
        read_points(tmp_path / "p.npy")


def test_columns_without_names_beside_the_first_three_are_remarked_on(tmp_path):
    (tmp_path / "p").write_bytes(GOOD["more columns"])
    assert [r.code for r in read_points(tmp_path / "p").remarks] == ["columns_without_names"]
    assert read_points(tmp_path / "p", "1,2,3").remarks == ()
    for file in ("spaces", "a cloud of ours as text", "numpy array"):
        (tmp_path / "p").write_bytes(GOOD[file])
        assert read_points(tmp_path / "p").remarks == ()


@pytest.mark.parametrize(
    "first", [np.arange(6) * 0.1, np.arange(6) + 0.5 * np.sin(np.arange(6)), np.repeat([0, 1], 3), np.zeros(6)]
)
def test_a_time_or_number_before_x_y_z_without_names_is_no_coordinate(tmp_path, first):
    points = np.random.default_rng(0).normal(size=(6, 3))
    np.savetxt(tmp_path / "p", np.column_stack([first, points]), fmt="%.18g")
    with pytest.raises(UnreadableFile, match=r"rising like .* pass --columns 2,3,4"):
        read_points(tmp_path / "p")
    assert np.array_equal(read_points(tmp_path / "p", "2,3,4").points, points)


def test_a_table_of_many_columns_without_names_is_refused(tmp_path):
    np.savetxt(tmp_path / "p", np.random.default_rng(0).normal(size=(40, 40)))
    with pytest.raises(UnreadableFile, match="found 40 numbers a point, need x y z"):
        read_points(tmp_path / "p")


@pytest.mark.parametrize("last", [20, 90, 359])
def test_degrees_that_are_named_radians_are_refused(tmp_path, last):
    np.savetxt(tmp_path / "p", np.column_stack([np.linspace(0, last, 360), np.full(360, 5)]), header="angle_rad radius")
    with pytest.raises(UnreadableFile, match=r"turns in the column 'angle_rad', need 3 .* angle_deg"):
        read_points(tmp_path / "p", planar=True)


def test_a_trace_of_some_turns_is_read(tmp_path):
    for name, end in (("angle_rad", 2.9 * 2 * np.pi), ("theta_deg", 20 * 360)):
        angle = np.linspace(0, end, 720)
        np.savetxt(tmp_path / "p", np.column_stack([angle, np.full(720, 5)]), header=f"{name} radius")
        assert np.allclose(np.linalg.norm(read_points(tmp_path / "p", planar=True).points, axis=1), 5)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(UnreadableFile, match="check the path"):
        read_points(tmp_path / "none")


def test_not_seen_stays_not_seen(tmp_path):
    (tmp_path / "p").write_bytes(b"nan nan nan\n1 2 3\n")
    assert np.isnan(read_points(tmp_path / "p").points[0]).all()


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
    for read in (read_points, lambda path: ply_vertices(path.read_bytes(), path.name)):
        try:
            read(file)
        except UnreadableFile as refused:
            assert "fuzz" in str(refused)


def test_only_fields_of_one_number_a_point_are_columns(tmp_path):
    fields = [("x", "f8"), ("y", "f8"), ("z", "f8"), ("name", "U3"), ("normal", "f4", (3,)), ("phase", "c8")]
    points = np.zeros(2, fields)
    for name, column in zip("xyz", np.transpose(TWO), strict=True):
        points[name] = column
    (tmp_path / "p.npy").write_bytes(npy(points))
    assert read_points(tmp_path / "p.npy").points.tolist() == TWO
    (tmp_path / "p.npy").write_bytes(npy(np.zeros(2, [("x", "f8"), ("X", "f8"), ("y", "f8"), ("z", "f8")])))
    with pytest.raises(UnreadableFile, match="2 columns 'x'"):
        read_points(tmp_path / "p.npy")
