"""SICK height maps: counts in base64, with scale, origin, intensity and encoder beside them."""

import json
from pathlib import Path

import numpy as np
import pytest

from exports import sick
from truestand.core.errors import UnreadableFile
from truestand.core.scan import interpret
from truestand.core.stand import Stand
from truestand.files.scans.read import info, read_recording

GROOVE = Path(__file__).parents[1] / "data" / "sick" / "groove.json"
REAL = Path(__file__).parents[3] / "shared" / "data" / "sick"


def written(folder, data):
    path = folder / "map.json"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("order", ["big", "little"])
def test_counts_become_mm_and_zero_is_no_data(tmp_path, order):
    recording = read_recording(written(tmp_path, b"\xef\xbb\xbf" + sick(order=order)))
    assert recording.format == "sick json"
    assert np.array_equal(recording.z, [[np.nan, 10.125, 10.25], [1135, 1135.125, 8201.875]], equal_nan=True)
    assert recording.x.tolist() == [[-1.5, -1.0, -0.5]] * 2
    assert recording.y.tolist() == [2.0, 2.25]
    assert recording.encoder.tolist() == [100, 105]
    assert recording.intensity.tolist() == [[7] * 3] * 2
    assert info(recording)["angle_source"] == "encoder"


def test_an_image_alone_is_a_map_without_encoder_and_intensity(tmp_path):
    image = json.loads(sick())[0]
    recording = read_recording(written(tmp_path, json.dumps(image).encode()))
    assert recording.encoder is None
    assert recording.intensity is None


def test_the_encoder_counts_where_y_is_said_to_be_one(tmp_path):
    """Y of a height map is mm; its own encoder column is what such a stand means."""
    scan = interpret(read_recording(written(tmp_path, sick())), Stand(y="encoder", counts_per_turn=3600))
    assert scan.angle.tolist() == pytest.approx([np.pi / 18, np.pi / 18 * 1.05])


def test_an_encoder_that_never_moves_is_none(tmp_path):
    data = sick().replace(b"[100, 105]", b"[100, 100]")
    assert read_recording(written(tmp_path, data)).encoder is None


def groove_of(recording):
    """Width and depth (mm) of the groove in each row that sees it."""
    pitch = float(np.diff(recording.x[0]).mean())
    for z in recording.z:
        floor = np.flatnonzero((z > 60) & (z < 66))
        if floor.size >= 50 and np.count_nonzero(z > 70) > 200:
            yield (floor[-1] - floor[0] + 1) * pitch, np.median(z[z > 70]) - np.median(z[floor])


def test_the_groove_that_ships():
    width, depth = np.median(list(groove_of(read_recording(GROOVE))), axis=0)
    assert width == pytest.approx(7.31, abs=0.15)  # a pixel is 0.1 mm
    assert depth == pytest.approx(12.443, abs=0.02)


def test_the_groove_has_its_published_size_and_scatter():
    if not REAL.is_dir():
        pytest.skip("needs the height maps of SICK beside the project")
    found = np.array(list(groove_of(read_recording(REAL / "StripGroove_image_9.json"))))
    assert len(found) > 500
    assert found[:, 0].mean() == pytest.approx(7.31, abs=0.02)
    assert found[:, 0].std() == pytest.approx(0.11, abs=0.01)
    assert np.median(found[:, 1]) == pytest.approx(12.443, abs=0.005)
    assert 1.4826 * np.median(abs(found[:, 1] - np.median(found[:, 1]))) == pytest.approx(0.009, abs=0.003)
    for name, shape in (("ProfileControl_image_34", (300, 648)), ("ProfileMatching_heightMap", (750, 496))):
        assert read_recording(REAL / f"{name}.json").z.shape == shape


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (sick()[:-40], "no JSON"),
        (sick(Width=4), "12 bytes of pixels, need 16|characters"),
        (sick(Width=2), "12 bytes of pixels, need 8 for 2 x 2"),
        (sick(Width=2**31 - 1, Height=2**31 - 1), "cut off"),
        (sick(Height=True), "True pixels"),
        (sick(Height=-2), "-2 pixels"),
        (sick(ImageType="float32"), "'float32'"),
        (sick(HandleZeroPixels="Default"), "found 0 height maps .*'Default'"),
        (sick(PixelSize={"x": 0, "y": 1, "z": 1}), "a pixel of"),
        (sick(PixelSize={"x": 1e300, "y": 1, "z": 1}), "1e\\+300"),
        (sick(PixelSize={"x": 1}), "malformed"),
        (sick().replace(b"[100, 105]", b"[100, 105, 110]"), "3 encoder counts for 2 rows"),
        (sick().replace(b"[100, 105]", b"[100, 1.5]"), "no whole number"),
        (sick().replace(b"100, 105", b"1e309, 105"), "1e309 in line 1"),
        (b'{"class": "Nothing"}', "found 0 height maps among the images .none."),
        (b'{"format": "truestand.calibration"}', "this is a record of truestand"),
    ],
)
def test_what_is_no_height_map_is_refused_with_the_reason(tmp_path, data, words):
    with pytest.raises(UnreadableFile, match=words):
        read_recording(written(tmp_path, data))


def test_two_height_maps_in_one_file_are_no_scan(tmp_path):
    parts = json.loads(sick())
    with pytest.raises(UnreadableFile, match="found 2 height maps"):
        read_recording(written(tmp_path, json.dumps([parts[0], *parts]).encode()))
