"""CAD models to triangles in mm; anything else is a clear error."""

import importlib.util
import struct

import numpy as np
import pytest
import trimesh

from step import step_box
from truestand.core.errors import BadRecipe, MissingExtra, UnreadableFile
from truestand.files.recipes.parts import read_part
from truestand.files.shapes.meshes import read_mesh

SIZE, AT = (1.5, 2.0, 4.0), (1.0, 2.0, 3.0)


def box():
    mesh = trimesh.creation.box(SIZE)
    mesh.apply_translation(np.array(AT) + np.array(SIZE) / 2)
    return mesh


def written(tmp_path, name, kind):
    path = tmp_path / name
    path.write_bytes(data if isinstance(data := box().export(file_type=kind), bytes) else data.encode())
    return path


def volume_of(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "ply"])
def test_formats_hold_the_same_box(tmp_path, kind):
    mesh = read_mesh(written(tmp_path, "anything.bin", kind))
    assert mesh.vertices.shape == (8, 3)
    assert mesh.faces.shape == (12, 3)
    assert np.allclose(mesh.vertices.min(axis=0), AT)
    assert np.allclose(np.ptp(mesh.vertices, axis=0), SIZE)
    assert volume_of(mesh) == pytest.approx(12.0)


def test_inches_are_inches(tmp_path):
    path = written(tmp_path, "box.stl", "stl")
    assert np.allclose(read_mesh(path, "inch").vertices, 25.4 * read_mesh(path).vertices)


def test_a_model_turned_inside_out_is_turned_back(tmp_path):
    mesh = box()
    mesh.invert()
    (tmp_path / "in.stl").write_bytes(mesh.export(file_type="stl"))
    assert volume_of(read_mesh(tmp_path / "in.stl")) == pytest.approx(12.0)


def test_triangles_that_face_both_ways_are_refused(tmp_path):
    mesh = box()
    faces = mesh.faces.copy()
    faces[:2] = faces[:2, ::-1]
    both = trimesh.Trimesh(mesh.vertices, faces, process=False)
    (tmp_path / "both.stl").write_bytes(both.export(file_type="stl"))
    with pytest.raises(UnreadableFile, match="face both ways"):
        read_mesh(tmp_path / "both.stl")


def stl(count, records):
    return b"\0" * 80 + struct.pack("<I", count) + records


RECORD = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
NOT_A_NUMBER = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, float("nan"), 0, 0, 0, 1, 0, 0)
FAR = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 3e8, 0, 0, 0, 1, 0, 0)
POINT = struct.pack("<12fH", *([0.0] * 12), 0)
HEAD = b"ply\nformat ascii 1.0\nelement vertex %b\nproperty float x\nproperty float y\nproperty float z\n"
FACES = b"element face %b\nproperty list uchar int vertex_indices\nend_header\n"
CORNERS = b"0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "empty"),
        (b"  \n", "empty"),
        (b"hello, this is no model at all", "neither STL, PLY nor STEP"),
        (bytes(range(256)) * 40, "promises"),
        (stl(0, b""), "no triangles"),
        (stl(4_000_000_000, RECORD), "promises 4000000000"),
        (stl(2, RECORD), "promises 2"),
        (stl(1, NOT_A_NUMBER), "no number in vertex 2"),
        (stl(1, FAR), 'unit = "mm"'),
        (stl(1, POINT), "no triangle with an area"),
        (b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "cut off"),
        (b"solid x\nfacet normal 0 0 1\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 q 0\nendfacet\nendsolid x", "'q'"),
        (b"ply\nformat ascii 1.0\n", "header"),
        (HEAD % b"3" + b"end_header\n" + CORNERS, "no vertices and faces"),
        (HEAD % b"999999999999" + FACES % b"1" + CORNERS + b"3 0 1 2\n", "promises 1e\\+12 vertex"),
        (HEAD % b"3" + FACES % b"888888888" + CORNERS + b"3 0 1 2\n", "promises 8.88889e\\+08 face"),
        (HEAD % b"3" + FACES % b"1" + CORNERS + b"3 0 1 7\n", "."),
        (HEAD % b"3" + FACES % b"2" + CORNERS + b"3 0 1 2\n", "."),
        (HEAD % b"3" + FACES % b"1" + b"0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n", "no number in vertex 2"),
    ],
)
def test_what_is_no_model_is_refused(tmp_path, data, says):
    path = tmp_path / "model.stl"
    path.write_bytes(data)
    with pytest.raises(UnreadableFile, match=says):
        read_mesh(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    for path in (tmp_path / "none.stl", tmp_path):
        with pytest.raises(UnreadableFile, match="can't be read"):
            read_mesh(path)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "ply"])
def test_cut_off_anywhere_is_an_error_of_ours(tmp_path, kind):
    whole = written(tmp_path, "box.stl", kind).read_bytes()
    for keep in range(0, len(whole) - 4, 7):
        path = tmp_path / "cut.stl"
        path.write_bytes(whole[:keep])
        with pytest.raises(UnreadableFile):
            read_mesh(path)


def test_step_is_read_in_its_own_unit_and_upright_or_names_its_extra(tmp_path):
    path = tmp_path / "box.step"
    path.write_text(step_box(SIZE, AT))
    if importlib.util.find_spec("cascadio") is None:
        with pytest.raises(MissingExtra, match=r"truestand\[step\]"):
            read_mesh(path)
        return
    mesh = read_mesh(path, "inch")
    assert np.allclose(mesh.vertices.min(axis=0), AT, atol=1e-5)
    assert np.allclose(np.ptp(mesh.vertices, axis=0), SIZE, atol=1e-5)
    assert volume_of(mesh) == pytest.approx(12.0, rel=1e-5)


def test_a_recipe_names_its_model_pose_and_fit(tmp_path):
    written(tmp_path, "box.stl", "stl")
    recipe = tmp_path / "part.toml"
    recipe.write_text(
        'kind = "cad"\nfile = "box.stl"\nunit = "inch"\nfit = "angle_and_height"\nlimits_um = [-20.0, 30.0]\n'
        'reach_mm = 0.5\ndatum = "seat"\nbore_clearance_mm = 0.01\n'
        "[pose]\nx_mm = 1.0\nz_mm = 5.0\nrotation_deg = [90.0, 0.0, 90.0]\n"
    )
    part = read_part(recipe)
    assert (part.name, part.fit, part.reach, part.datum) == ("box", "angle_and_height", 0.5, "seat")
    assert part.limits == (-0.02, 0.03)
    assert part.bore_clearance == 0.01
    # About X first: Y goes to Z, then about Z: X goes to Y.
    expected = [[0, 0, 1, 1], [1, 0, 0, 0], [0, 1, 0, 5], [0, 0, 0, 1]]
    assert np.allclose(part.pose, expected, atol=1e-15)
    assert np.ptp(part.mesh.vertices[:, 2]) == pytest.approx(4.0 * 25.4)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("limits_um = [5.0, -5.0]", "need \\[lower, upper\\]"),
        ('unit = "cm"', "unit"),
        ('fits = "all"', "did you mean 'fit'"),
        ("[pose]\nx = 1.0", "x_mm"),
    ],
)
def test_wrong_keys_are_refused(tmp_path, line, says):
    written(tmp_path, "box.stl", "stl")
    (tmp_path / "part.toml").write_text(f'kind = "cad"\nfile = "box.stl"\n{line}\n')
    with pytest.raises(BadRecipe, match=says):
        read_part(tmp_path / "part.toml")


def test_a_recipe_without_its_model_is_an_unreadable_file(tmp_path):
    (tmp_path / "part.toml").write_text('kind = "cad"\nfile = "gone.stl"\n')
    with pytest.raises(UnreadableFile, match=r"gone\.stl"):
        read_part(tmp_path / "part.toml")
