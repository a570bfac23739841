"""Gocator exports: sections up to ``End``, surfaces as grids, profiles as lines an axis."""

from pathlib import Path

import numpy as np
import pytest

from exports import GOCATOR, gocator, gocator_profiles, gocator_surface
from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.scans.read import read_recording, recordings

REAL = Path(__file__).parents[3] / "shared" / "data" / "gocator"
Z = [[np.nan, 27.224, np.nan], [27.11, 26.975, 26.849]]


def written(folder, data):
    path = folder / "export.csv"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_surface_is_its_grid(tmp_path, end, mark):
    recording = read_recording(written(tmp_path, mark + gocator().decode().replace("\n", end)))
    assert recording.format == "gocator csv"
    assert np.array_equal(recording.z, Z, equal_nan=True)
    assert recording.x.tolist() == [[-1.5, -1.2, -0.9]] * 2
    assert recording.y.tolist() == [-2.0, -1.7]
    assert recording.encoder is recording.time is None


def test_several_frames_need_a_choice(tmp_path):
    path = written(tmp_path, gocator(gocator_surface(), gocator_surface(2), gocator_surface(2, 1)))
    with pytest.raises(BadRecipe, match="part-frame1-source0, part-frame2-source0, part-frame2-source1"):
        read_recording(path)
    assert np.array_equal(read_recording(path, "part-frame2-source1").z, Z, equal_nan=True)


@pytest.mark.parametrize("raw", [False, True])
def test_profiles_are_read_frame_by_frame_and_source_by_source(tmp_path, raw):
    path = written(tmp_path, gocator_profiles(raw))
    name = "rawprofile" if raw else "profile"
    assert list(recordings(path)) == [f"{name}-source0", f"{name}-source1"]
    recording = read_recording(path, f"{name}-source1")
    nan = np.nan
    assert np.array_equal(recording.z, [[27.5, nan, 24.25], [27.5, nan, 26.25]], equal_nan=True)
    assert np.array_equal(recording.x, [[-1.5, nan if raw else -1.2, -0.9]] * 2, equal_nan=True)
    assert np.array_equal(recording.intensity, [[200, nan, 101]] * 2, equal_nan=True)
    assert recording.encoder.tolist() == [400, 600]
    assert recording.counter.tolist() == [4, 6]


def test_the_real_export():
    if not REAL.is_dir():
        pytest.skip("needs the Gocator export beside the project")
    path = next(REAL.glob("*.csv"))
    recording = read_recording(path)
    assert recording.z.shape == (428, 452)
    assert np.count_nonzero(np.isfinite(recording.z)) == 55_246
    line = path.read_text().split("\n")[199].split(",")
    assert recording.y[199 - 28] == float(line[0])
    assert [v for v in recording.z[199 - 28] if v == v] == [float(cell) for cell in line[1:] if cell]
    # the sensor's step of 0.003 mm and its offset of 1.694 mm
    steps = (recording.z[np.isfinite(recording.z)] - 1.694) / 0.003
    assert np.abs(steps - np.rint(steps)).max() < 1e-6


TEXT = gocator().decode()
FLAT = gocator_profiles().decode()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TEXT.removesuffix("End\n\n"), "line 19 starts a section .'Part'. that has no End"),
        (TEXT[: TEXT.index("-1.70000") + 20], "line 19 .*has no End"),
        (TEXT.replace("-1.70000,27.11000,26.97500,26.84900\n", ""), "line 22 starts 1 x 3 cells, need 2 x 3"),
        (TEXT.replace("26.97500,", ""), "line 24 has 3 cells, need 4 as in line 22"),
        (TEXT.replace("26.97500", "xx"), "'xx' in line 24"),
        (TEXT.replace("26.97500", "1_0"), "'1_0' in line 24"),
        (TEXT.replace("26.97500", "1e309"), "line 24"),
        (TEXT.replace("26.97500", "26\0"), "NUL bytes in line 24"),
        (TEXT.replace("-1.70000", ""), "lacks an X or Y"),
        (TEXT.replace("-1.20000", ""), "lacks an X or Y"),
        (TEXT.replace("Y\\X", "Z"), "line 22 is no first line of a grid"),
        (TEXT.replace(",0,2,3,", ",0,2147483647,2147483647,"), "need 2147483647 x"),
        (TEXT.replace(",0,2,3,", ",0,x,3,"), "line 21 has 'x' as Row Count"),
        (TEXT.replace("\n2,1,0\n", "\n1,1,0\n"), "CSV version '1', need 2"),
        (GOCATOR, "found the sections Info, DeviceInfo, RecordingFilter, need Part"),
        (GOCATOR + "End\n", "line 19 ends a section that has no beginning"),
        (GOCATOR + "Part\nEnd\n", "doesn't start with the frame's header"),
        (gocator(gocator_surface(), gocator_surface()).decode(), "a frame of a source twice"),
        (FLAT.replace("27.5,,24.25", "27.5,24.25"), "line 23 has 11 cells, need 12 as in line 22"),
        (FLAT.replace("27.5,,24.25", ""), "line 23 has 10 cells, need 12"),
        (FLAT.replace(",-1.5,-1.2,-0.9", ""), "has no data under a header with Axis"),
        (FLAT.replace(",Z,", ",Q,", 1), "line 23 has axis 'Q'"),
        (FLAT.replace(",I,", ",Z,", 1), "line 24 has axis 'Z' of frame 4"),
        (FLAT.replace("6,0,54486,600,0,0,1000.0,0.25,I,200,,100\n", ""), "Z but no I"),
        (FLAT.replace("400,0,0,1000.0,0.25,Z", "4e2,0,0,1000.0,0.25,Z"), "'4e2' as Encoder"),
    ],
)
def test_what_is_no_export_is_refused_with_the_line(tmp_path, text, words):
    path = written(tmp_path, text)
    with pytest.raises(UnreadableFile, match=words) as caught:
        for read in recordings(path).values():
            read()
    assert "\n" not in str(caught.value)
