"""The native scan: small, lossless, readable by any NetCDF-4 tool, and never silently damaged."""

import dataclasses

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.core.scan import Recording
from truestand.core.stand import Sensor, Stand, Table
from truestand.files.scans.native import read_native, write_native
from truestand.files.scans.read import read_recording
from truestand.files.scans.write_scan import write_recording

STAND = Stand(Table(0.3, "cw"), (Sensor("front", 200.0, points=5, range=(70.0, 120.0)),))


def recording(**columns):
    rng = np.random.default_rng(5)
    x = np.round(rng.uniform(-20, 20, (4, 5)), 3)
    z = np.round(rng.uniform(70, 120, (4, 5)) / 0.004) * 4 / 1000
    z[1, 2] = np.nan
    return Recording(x, z, "xyz blocks", "0" * 64, **columns)


def same(a, b):
    for field in dataclasses.fields(a):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if isinstance(one, np.ndarray):
            assert np.array_equal(one, other, equal_nan=True), field.name
        elif field.name not in ("format", "sha256"):
            assert one == other, field.name


def test_everything_comes_back_with_the_stand_inside(tmp_path):
    written = recording(
        time=np.arange(4) * 0.1, angle=np.arange(4) * 0.2, encoder=np.arange(4.0), counter=np.arange(4),
        y=np.arange(4) * 2.0, intensity=np.full((4, 5), 7.5), stand=STAND,
    )  # fmt: skip
    write_native(written, tmp_path / "k.h5", STAND)
    back = read_recording(tmp_path / "k.h5")
    same(written, back)
    assert back.format == "native"


def test_any_netcdf_tool_reads_it(tmp_path):
    """Dimension scales, units, and the scale, offset and fill value of the CF conventions."""
    write_native(recording(), tmp_path / "k.h5", STAND)
    with h5py.File(tmp_path / "k.h5") as file:
        z = file["z"]
        assert z.dtype == np.int16
        assert [d[0].name for d in z.dims] == ["/profile", "/point"]
        assert z.attrs["units"] == "mm"
        stored = z[()]
        values = stored * z.attrs["scale_factor"] + z.attrs["add_offset"]
        values[stored == z.attrs["_FillValue"]] = np.nan
        assert np.allclose(values, recording().z, equal_nan=True, atol=1e-9)
        assert file["profile"].attrs["CLASS"] == b"DIMENSION_SCALE"


def test_the_same_scan_gives_the_same_bytes(tmp_path):
    for name in ("a.h5", "b.h5"):
        write_native(recording(), tmp_path / name, STAND)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_readings_are_compressed_by_a_filter_that_repeats(tmp_path):
    """lzf looks into memory that it has not cleared: most of its files repeat, and some don't."""
    write_native(recording(), tmp_path / "k.h5", STAND)
    with h5py.File(tmp_path / "k.h5") as file:
        assert file["x"].compression == file["z"].compression == "gzip"


@settings(max_examples=60, deadline=None)
@given(
    z=arrays(
        np.float64,
        st.tuples(st.integers(1, 4), st.integers(1, 4)),
        elements=st.floats(-1e6, 1e6) | st.just(np.nan) | st.integers(0, 10**5).map(lambda n: n * 4 / 1000),
    )
)
def test_numbers_come_back_to_the_last_bit(tmp_path_factory, z):
    path = tmp_path_factory.mktemp("native") / "k.h5"
    write_native(Recording(z, z.copy(), "test", ""), path)
    back = read_native(path, "")
    assert np.array_equal(back.z, z, equal_nan=True)  # but for the sign of zero


def test_a_changed_number_fails_its_hash(tmp_path):
    write_native(recording(), tmp_path / "k.h5", STAND)
    with h5py.File(tmp_path / "k.h5", "r+") as file:
        file["z"][2, 2] += 1
    with pytest.raises(UnreadableFile, match="hash"):
        read_recording(tmp_path / "k.h5")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_a_cut_file_is_refused(tmp_path, share):
    write_native(recording(), tmp_path / "k.h5", STAND)
    data = (tmp_path / "k.h5").read_bytes()
    (tmp_path / "k.h5").write_bytes(data[: int(len(data) * share)])
    with pytest.raises(UnreadableFile, match=r"k\.h5"):
        read_recording(tmp_path / "k.h5")


def test_other_hdf5_and_newer_versions_are_refused(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["z"] = np.zeros((2, 2))
    with pytest.raises(UnreadableFile, match="no truestand scan"):
        read_recording(tmp_path / "other.h5")
    write_native(recording(), tmp_path / "new.h5")
    with h5py.File(tmp_path / "new.h5", "r+") as file:
        file.attrs["version"] = 99
    with pytest.raises(UnreadableFile, match="99"):
        read_recording(tmp_path / "new.h5")


def test_a_lying_shape_is_refused_and_not_allocated(tmp_path):
    with h5py.File(tmp_path / "big.h5", "w") as file:
        file.attrs["format"], file.attrs["version"] = "truestand.scan", 1
        for name in ("x", "z"):
            file.create_dataset(name, shape=(10**6, 10**6), dtype="i2", chunks=(1000, 1000))
    with pytest.raises(UnreadableFile, match="matrices"):
        read_recording(tmp_path / "big.h5")


def test_a_raw_scan_is_overwritten_only_by_force(tmp_path):
    write_recording(recording(), tmp_path / "k.h5", STAND)
    with pytest.raises(BadRecipe, match="--force"):
        write_recording(recording(), tmp_path / "k.h5", STAND)
    write_recording(recording(), tmp_path / "k.h5", STAND, force=True)
    with pytest.raises(BadRecipe, match="suffix"):
        write_recording(recording(), tmp_path / "k.doc", STAND)
