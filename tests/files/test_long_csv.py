"""The long CSV: units in the names, one row a reading, columns of its own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
        "profile\tpoint\tx_mm\tz_mm\n1\t1\t1.5\t90\n1\t2\t2.5\t91\n2\t2\t2.75\t92\n",
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


def test_profiles_may_begin_with_any_number_where_the_scan_has_its_own_angle(tmp_path):
    recording = read(tmp_path, "profile,angle_deg,x_mm,z_mm\n40,10,1,2\n41,11,1,2\n")
    assert recording.x.shape == (2, 1) and np.allclose(recording.angle, np.radians([10, 11]))


def test_a_first_profile_without_readings_has_a_row_of_its_own(tmp_path):
    recording = read(tmp_path, "profile,x_mm,z_mm\n0,,\n2,1,2\n")
    assert np.array_equal(recording.x, [[np.nan], [np.nan], [1.0]], equal_nan=True)


def test_without_point_numbers_readings_keep_their_order(tmp_path):
    recording = read(tmp_path, "profile,x_mm,z_mm\n1,1.5,90\n1,2.5,91\n3,1.25,93\n")
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
        ("profile,x_mm,z_mm\n0,1\n0,1\n", ["2 values in line 2", "3"]),
        ("profile,x_mm,z_mm\n0,1,two\n", ["two", "line 2"]),
        ("profile,x_mm,z_mm\n0.5,1,2\n", ["profile number"]),
        ("profile,x_mm,z_mm\n,1,2\n", ["line 2", "no profile number"]),
        ("profile,point,x_mm,z_mm\n0,-1,1,2\n", ["point number"]),
        ("profile,point,x_mm,z_mm\n0,0,1,2\n0,0,1,3\n", ["twice"]),
        ("profile,angle_deg,x_mm,z_mm\n0,10,1,2\n0,11,1,3\n", ["angle changes", "line 3"]),
        ("profile,x_mm,z_mm\n0,1,2\n2000000000,1,2\n", ["check them"]),
        ("profile,x_mm,z_mm\n40,1,2\n41,1,2\n", ["profile 40 as the first", "0 or 1"]),
        ("profile,time_s,x_mm,z_mm\n2,0.1,1,2\n", ["profile 2 as the first"]),
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
    x[[0, 2, 4]], x[1] = np.nan, 1.0  # profiles that saw nothing have their columns too
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


NAMES = ["profile", "point", "x_mm", "z_mm", "intensity"]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_any_table_reads_as_a_slow_reader_reads_it(tmp_path_factory, data):
    separator, mark = data.draw(st.sampled_from([",.", ";.", ";,", "\t,"]))
    eol, padding = data.draw(st.sampled_from(["\n", "\r\n", "\r"])), data.draw(st.sampled_from(["", " "]))
    number = st.integers(-(10**6), 10**6).map(lambda um: f"{um / 1000:.3f}") | st.sampled_from(["", "nan", "5", "1e-3"])
    places = data.draw(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 4)), unique=True, min_size=1))
    places = [(profile - min(places)[0], point) for profile, point in places]
    expected = np.full((3, 4, 5), np.nan)
    rows = [NAMES]
    for profile, point in places:
        cells = [data.draw(number) for _ in range(3)]
        expected[:, profile, point] = [float(cell or "nan") for cell in cells]
        rows.append([str(profile), str(point), *(cell.replace(".", mark) for cell in cells)])
    path = tmp_path_factory.mktemp("slow") / "long.csv"
    blank = data.draw(st.sampled_from(["", eol]))
    path.write_bytes(eol.join([*((separator + padding).join(row) + blank for row in rows), ""]).encode())
    recording = read_recording(path)
    profiles, points = zip(*places, strict=True)
    seen = np.s_[min(profiles) : max(profiles) + 1, min(min(points), 1) : max(points) + 1]
    for found, values in zip((recording.x, recording.z, recording.intensity), expected, strict=True):
        assert np.array_equal(found, values[seen], equal_nan=True)


def test_a_file_with_gaps_that_was_cut_off_is_refused(tmp_path):
    rows = "".join(f"0,{i}.125,{'' if i % 3 else '2.125'}\n" for i in range(90))
    refused(tmp_path, f"profile,x_mm,z_mm\n{rows}0,7.125,2.1", "line 92", "cut off")
