"""Clouds: only what was seen, with where it came from, in mm."""

import importlib.util

import numpy as np
import pytest

from truestand.core.errors import BadRecipe, MissingExtra, UnreadableFile
from truestand.files.shapes.clouds import write_cloud
from truestand.files.shapes.ply import ply_vertices


def cloud(profiles=1030, points=3):
    rng = np.random.default_rng(3)
    x, y, z = rng.normal(0, 20, (3, profiles, points))
    z[rng.random(z.shape) < 0.3] = np.nan
    return x, y, z


def test_ply_holds_the_points_that_were_seen(tmp_path):
    x, y, z = cloud()
    seen = np.isfinite(z)
    assert write_cloud(tmp_path / "c.ply", x, y, z, deviation=1000 * z) == seen.sum()
    back = ply_vertices((tmp_path / "c.ply").read_bytes(), "c.ply")
    assert list(back) == ["x", "y", "z", "profile", "point", "deviation"]
    assert np.array_equal(back["x"], x[seen].astype(np.float32))
    assert np.array_equal(back["deviation"], (1000 * z[seen]).astype(np.float32))
    profile, point = np.nonzero(seen)
    assert np.array_equal(back["profile"], profile)
    assert np.array_equal(back["point"], point)
    assert back["profile"].dtype == np.int32


def test_the_formats_hold_the_same(tmp_path):
    x, y, z = cloud(20)
    for name in ("c.xyz", "c.npz", "c.ply", "c.PLY"):
        write_cloud(tmp_path / name, x, y, z)
    text, packed, ply = (
        np.loadtxt(tmp_path / "c.xyz"),
        np.load(tmp_path / "c.npz"),
        ply_vertices((tmp_path / "c.ply").read_bytes(), "c.ply"),
    )
    for i, axis in enumerate("xyz"):
        assert np.allclose(text[:, i], packed[axis], atol=1e-5, rtol=0)
        assert np.allclose(ply[axis], packed[axis], atol=1e-5)
    assert np.array_equal(packed["profile"], ply["profile"])


def test_an_empty_cloud_is_a_cloud(tmp_path):
    nothing = np.full((2, 2), np.nan)
    for name in ("c.ply", "c.xyz", "c.npz"):
        assert write_cloud(tmp_path / name, nothing, nothing, nothing) == 0
    assert ply_vertices((tmp_path / "c.ply").read_bytes(), "c.ply")["x"].size == 0


def test_e57_counts_in_metres_or_names_its_extra(tmp_path):
    x, y, z = cloud(20)
    if importlib.util.find_spec("pye57") is None:
        with pytest.raises(MissingExtra, match=r"truestand\[e57\]"):
            write_cloud(tmp_path / "c.e57", x, y, z)
        assert not list(tmp_path.iterdir())
        return
    import pye57

    write_cloud(tmp_path / "c.e57", x, y, z)
    data = pye57.E57(str(tmp_path / "c.e57")).read_scan_raw(0)
    assert np.allclose(data["cartesianX"] * 1000, x[np.isfinite(z)], atol=1e-4)


def test_unknown_suffixes_and_broken_plys_are_refused(tmp_path):
    x, y, z = cloud(5)
    with pytest.raises(BadRecipe, match=r"\.ply"):
        write_cloud(tmp_path / "c.obj", x, y, z)
    write_cloud(tmp_path / "c.ply", x, y, z)
    data = (tmp_path / "c.ply").read_bytes()
    (tmp_path / "c.ply").write_bytes(data[:-7])
    with pytest.raises(UnreadableFile, match="cut off"):
        ply_vertices((tmp_path / "c.ply").read_bytes(), "c.ply")
    (tmp_path / "c.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(UnreadableFile, match="no vertices"):
        ply_vertices((tmp_path / "c.ply").read_bytes(), "c.ply")
