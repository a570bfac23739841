"""The long CSV: units in the names, one row a reading, columns of its own."""

import numpy as np
import pytest

from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.scans.read import info, read_recording
from truestand.files.scans.write_scan import write_long_csv


def read(folder, text, encoding="utf-8"):
    path = folder / "long.csv"
    path.write_bytes(text.encode(encoding))
    return read_recording(path)


def refused(folder, text, *words):
    with pytest.raises(UnreadableFile) as caught:
        read(folder, text)
    for word in ("long.csv", *words):
        assert word in str(caught.value), str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "profile,point,x_mm,z_mm\n0,0,1.5,90\n0,1,2.5,91\n1,1,2.75,92\n",
        "profile,point,x_um,z_m\n0,0,1500,0.09\n0,1,2500,0.091\n1,1,2750,0.092\n",
        "profile;point;x_mm;z_mm\n0;0;1,5;90\n0;1;2,5;91\n1;1;2,75;92\n",
        "profile\tpoint\tx_mm\tz_mm\n7\t1\t1.5\t90\n7\t2\t2.5\t91\n8\t2\t2.75\t92\n",
        '"profile","point","z_mm","x_mm"\r\n0,0,90,1.5\r\n0,1,91,2.5\r\n1,1,92,2.75\r\n',
        "\ufeffProfile,Point,X_mm,Z_mm,remark\n0,0,1.5,90,1\n0,1,2.5,91,1\n1,1,2.75,92,1\n",
        "profile,point,x_mm,z_mm\r0,0,1.5,90\r0,1,2.5,91\r1,0,,\r1,1,2.75,92",
        "profile,point,x_mm,z_mm\n1,1,2.75,92\n0,1,2.5,91\n0,0,1.5,90\n\n",
    ],
)
def test_every_way_to_write_it_reads_the_same(tmp_path, text):
    recording = read(tmp_path, text)
    assert recording.format == "long csv"
    assert np.allclose(recording.x, [[1.5, 2.5], [np.nan, 2.75]], equal_nan=True, rtol=1e-12)
    assert np.allclose(recording.z, [[90, 91], [np.nan, 92]], equal_nan=True, rtol=1e-12)


def test_without_point_numbers_readings_keep_their_order(tmp_path):
    recording = read(tmp_path, "profile,x_mm,z_mm\n4,1.5,90\n4,2.5,91\n6,1.25,93\n")
    assert np.array_equal(recording.x, [[1.5, 2.5], [np.nan, np.nan], [1.25, np.nan]], equal_nan=True)


def test_columns_of_its_own_come_in_rad_and_seconds(tmp_path):
    recording = read(
        tmp_path,
        "profile,counter,time_ms,angle_deg,encoder,x_mm,z_mm,intensity\n"
        "0,17,0,350,100,1.5,90,200\n0,17,0,350,100,2.5,91,100\n1,19,5,10,200,1.5,92,150\n",
    )
    assert np.allclose(recording.angle, np.radians([350, 10]))
    assert np.allclose(recording.time, [0, 0.005])
    assert recording.counter.tolist() == [17, 19]
    assert recording.encoder.tolist() == [100, 200]
    assert np.array_equal(recording.intensity, [[200, 100], [150, np.nan]], equal_nan=True)
    assert info(recording)["angle_source"] == "encoder"
    assert info(recording)["revolutions"] == pytest.approx(2 * 20 / 360)  # two profiles, 20 degrees apart


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("profile,x,z\n0,1,2\n", ["'x'", "x_mm"]),
        ("profile,x_mm,z_inch\n0,1,2\n", ["'z_inch'", "z_mm"]),
        ("profile,x_mm\n0,1\n", ["lacks z"]),
        ("profile,x_mm,x_um,z_mm\n0,1,1,1\n", ["twice"]),
        ("profile,angle,x_mm,z_mm\n0,1,1,1\n", ["angle_deg"]),
        ("profile,x_mm,z_mm\n", ["no readings"]),
        ("profile,x_mm,z_mm\n0,1,2\n0,1\n", ["2 values in line 3", "3"]),
        ("profile,x_mm,z_mm\n0,1\n0,1\n", ["2 values a line", "3"]),
        ("profile,x_mm,z_mm\n0,1,two\n", ["two", "line 2"]),
        ("profile,x_mm,z_mm\n0.5,1,2\n", ["profile number"]),
        ("profile,x_mm,z_mm\n,1,2\n", ["line 2", "no profile number"]),
        ("profile,point,x_mm,z_mm\n0,-1,1,2\n", ["point number"]),
        ("profile,point,x_mm,z_mm\n0,0,1,2\n0,0,1,3\n", ["twice"]),
        ("profile,angle_deg,x_mm,z_mm\n0,10,1,2\n0,11,1,3\n", ["angle changes", "line 3"]),
        ("profile,x_mm,z_mm\n0,1,2\n2000000000,1,2\n", ["check them"]),
        ("profile,x_mm,z_mm\n0,1,1e309\n", ["too large"]),
        ("profile,x_mm,z_mm\n0,1,2\n1e300,1,2\n", ["profile number"]),
        ("profile,point,x_mm,z_mm\n0,1e300,1,2\n", ["point number"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, words):
    refused(tmp_path, text, *words)


def test_what_is_written_is_read_back(tmp_path):
    rng = np.random.default_rng(2)
    x, z = np.round(rng.normal(0, 9, (5, 7)), 3), np.round(rng.normal(95, 9, (5, 7)), 3)
    x[rng.random(x.shape) < 0.3] = np.nan
    x[:, 0] = 1.0  # every profile has a reading, else its columns have no row
    z[np.isnan(x)] = np.nan
    written = Recording(
        x, z, "test", "", time=np.arange(5) * 0.005, angle=np.linspace(0, 3, 5), counter=np.arange(5) + 3,
        encoder=np.arange(5) * 7.0, intensity=np.where(np.isnan(x), np.nan, 50.0),
    )  # fmt: skip
    write_long_csv(written, tmp_path / "k.csv")
    back = read_recording(tmp_path / "k.csv")
    for name in ("x", "z", "time", "counter", "encoder", "intensity"):
        assert np.array_equal(getattr(back, name), getattr(written, name), equal_nan=True), name
    assert np.allclose(back.angle, written.angle, rtol=0, atol=1e-11)
