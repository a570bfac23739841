"""Raw scanCONTROL dumps: what the bytes don't say has to be told, and is checked."""

import numpy as np
import pytest

from exports import scancontrol, scancontrol_profile
from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.scans.read import read_recording
from truestand.files.scans.scancontrol_raw import RawLayout

LAYOUT = RawLayout("29xx-50", 16)


def written(folder, data):
    path = folder / "dump.raw"
    path.write_bytes(data)
    return path


def test_a_dump_reads_as_the_sensor_saw_it(tmp_path):
    z = [0, *range(32768, 32783)]
    path = written(tmp_path, scancontrol(3, z=z))
    recording = read_recording(path, layout=LAYOUT)
    assert recording.format == "scancontrol raw"
    assert recording.x.shape == (3, 16)
    assert np.isnan(recording.z[:, 0]).all()
    assert recording.z[2, 1:4].tolist() == [95.0, 95.002, 95.004]
    assert recording.x[0, 7:10].tolist() == [-0.02, 0.0, 0.02]
    assert recording.counter.tolist() == [0, 1, 2]
    assert recording.encoder.tolist() == [0, 40, 80]
    assert recording.time.tolist() == pytest.approx([0.001, 0.006, 0.011], abs=1e-7)


def test_columns_go_on_where_the_sensor_starts_again(tmp_path):
    """The counter after 2^24 profiles, the clock after 128 s, the encoder after 2^15 counts."""
    data = scancontrol(1000, first=2**24 - 500, start=127.0 - (2**24 - 500) / 200)
    recording = read_recording(written(tmp_path, data), layout=LAYOUT)
    assert np.array_equal(np.diff(recording.counter), np.ones(999))
    assert np.allclose(np.diff(recording.time), 0.005, atol=1e-7)
    assert np.array_equal(np.diff(recording.encoder), np.full(999, 40.0))


def test_lost_profiles_stay_gaps_and_an_encoder_that_never_moves_is_none(tmp_path):
    data = b"".join(scancontrol_profile(i, 16, encoder=7) for i in (3, 4, 9, 10))
    recording = read_recording(written(tmp_path, data), layout=LAYOUT)
    assert recording.counter.tolist() == [3, 4, 9, 10]
    assert recording.encoder is None


def test_without_the_layout_the_error_says_what_to_pass(tmp_path):
    path = written(tmp_path, scancontrol(20, 640))
    with pytest.raises(UnreadableFile, match=r"raw dump .* 640 points.* --raw-type 29xx-50 --points 640"):
        read_recording(path)


@pytest.mark.parametrize(
    ("data", "points", "words"),
    [
        (b"", 16, "empty"),
        (scancontrol()[:-1], 16, "3 profiles of 16 points .* from byte 288 on"),
        (scancontrol(), 8, r"profile 0 \(byte 0\) has no time stamp"),
        (scancontrol(), 32, "profiles of 16 points, given were 32"),
        (scancontrol(5), 80, "profiles of 16 points, given were 80"),
        (scancontrol(2) + bytes(96), 16, r"profile 2 \(byte 192\)"),
        (scancontrol_profile(5, 16) * 2, 16, r"profile 1 \(byte 96\)"),
        (b"1.5,2.5\n" * 12, 16, r"profile 0 \(byte 0\)"),
    ],
)
def test_what_is_no_such_dump_is_refused_with_the_byte(tmp_path, data, points, words):
    with pytest.raises(UnreadableFile, match=words):
        read_recording(written(tmp_path, data), layout=RawLayout("29xx-50", points))


def test_an_unknown_type_a_wrong_number_and_a_missing_file_are_refused(tmp_path):
    path = written(tmp_path, scancontrol())
    with pytest.raises(BadRecipe, match="29xx-50"):
        read_recording(path, layout=RawLayout("2900", 16))
    with pytest.raises(BadRecipe, match="8 to 4096"):
        read_recording(path, layout=RawLayout("29xx-50", 2**31))
    with pytest.raises(UnreadableFile, match="can't be read"):
        read_recording(tmp_path / "nowhere.raw", layout=LAYOUT)
