"""JoeScan recordings: several heads in one file, profiles of different length, packed."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from exports import joescan, joescan_profile, packed
from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.files.scans.read import info_of_several, read_recording, recordings
from truestand.files.scans.write_scan import write_recording

LOG = Path(__file__).parents[1] / "data" / "joescan" / "log.raw"
WHOLE = Path(__file__).parents[3] / "shared" / "data" / "joescan" / "2022_6_24_12_45_45.raw"


def written(folder, data):
    path = folder / "log.raw"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("pack", [packed, bytes])
def test_no_point_is_lost_and_none_is_moved(tmp_path, pack):
    recording = read_recording(written(tmp_path, pack(joescan(1))))
    nan = np.nan
    assert recording.format == "joescan raw"
    assert np.array_equal(recording.x, [[0.254, nan, nan], [0.508] * 2 + [nan], [0.762] * 3], equal_nan=True)
    assert np.array_equal(recording.z, [[2.54, nan, nan], [5.08] * 2 + [nan], [7.62] * 3], equal_nan=True)
    assert np.array_equal(recording.intensity, [[9, nan, nan], [9, 9, nan], [9, 9, 9]], equal_nan=True)
    assert recording.encoder.tolist() == [5, 10, 15]
    assert recording.counter.tolist() == [8, 9, 10]
    assert recording.time.tolist() == [1571.754885552] * 3


def test_hundredths_of_an_inch_are_mm_to_the_last_bit(tmp_path):
    points = [(raw, -raw, 0) for raw in range(-32767, 32768, 7)]
    recording = read_recording(written(tmp_path, joescan_profile(points)))
    assert recording.x[0].tolist() == [float(f"{raw * 254 / 1000:.3f}") for raw, _, _ in points]
    assert np.array_equal(recording.z, -recording.x)


def test_several_heads_need_a_choice_and_are_named(tmp_path):
    path = written(tmp_path, packed(joescan() + joescan_profile([(1, 2, 3)], head=4, laser=1)))
    with pytest.raises(BadRecipe, match=r"3 recordings: head0-camera0, head0-camera1, head4-camera0; .*--pick head0"):
        read_recording(path)
    with pytest.raises(BadRecipe, match="did you mean 'head0-camera1'"):
        read_recording(path, "head0-camera2")
    assert read_recording(path, "head0-camera1").z[0, 0] == 2.286
    facts = info_of_several(recordings(path))
    assert [one["pick"] for one in facts["recordings"]] == ["head0-camera0", "head0-camera1", "head4-camera0"]
    assert (facts["profiles"], facts["points_per_profile"], facts["points_seen"]) == (7, 3, 13)


def test_lasers_of_one_camera_are_told_apart(tmp_path):
    path = written(tmp_path, joescan_profile([(1, 2, 3)]) + joescan_profile([(4, 5, 6)], laser=1))
    assert list(recordings(path)) == ["head0-camera0-laser0", "head0-camera0-laser1"]


def test_a_sequence_that_never_counts_is_no_counter_and_no_encoder_is_none(tmp_path):
    recording = read_recording(written(tmp_path, joescan_profile([(1, 2, 3)], encoders=()) * 3))
    assert recording.counter is None
    assert recording.encoder is None


def test_the_log_that_ships_reads_and_imports_to_the_last_bit(tmp_path):
    for name, read in recordings(LOG).items():
        recording = read()
        assert recording.x.shape[0] == 4, name
        write_recording(recording, tmp_path / f"{name}.h5")
        back = read_recording(tmp_path / f"{name}.h5")
        for field in ("x", "z", "time", "encoder", "intensity"):
            assert np.array_equal(getattr(back, field), getattr(recording, field), equal_nan=True), field


def test_the_whole_log_and_how_its_heads_overlap():
    if not WHOLE.exists():
        pytest.skip("needs the JoeScan recording beside the project")
    found = {name: read() for name, read in recordings(WHOLE).items()}
    assert sum(recording.x.shape[0] for recording in found.values()) == 7930
    assert sum(np.count_nonzero(np.isfinite(recording.z)) for recording in found.values()) == 975_476

    def distances(one, other):
        for n in range(400, 1300, 30):
            here, there = (np.c_[found[name].x[n], found[name].z[n]] for name in (one, other))
            here, there = (points[np.isfinite(points[:, 1])] for points in (here, there))
            yield from cKDTree(there).query(here)[0]

    for head in range(3):  # both cameras of a head look at the same line
        between = np.fromiter(distances(f"head{head}-camera0", f"head{head}-camera1"), float)
        assert np.median(between) < 1.4
    apart = np.fromiter(distances("head0-camera0", "head2-camera0"), float)
    assert 0.15 < np.mean(apart < 8) < 0.3  # a fifth of the log's outline is seen by both
    assert np.median(apart[apart < 8]) < 1.3


@pytest.mark.parametrize("lost", [1, 4, 5, 20, 40])
def test_a_file_that_lost_its_end_is_refused_with_the_profile_and_the_byte(tmp_path, lost):
    data = joescan(1)
    with pytest.raises(UnreadableFile, match=r"profile 2 .*byte \d+ .*cut off"):
        read_recording(written(tmp_path, data[:-lost]))
    with pytest.raises(UnreadableFile, match=r"packed data ends at byte \d+ .*cut off"):
        read_recording(written(tmp_path, packed(data)[:-lost]))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (joescan(1) + b"rubbish" * 20, "profile 3 .*magic"),
        (joescan_profile() * 3, "3 profiles without a point"),
        (joescan_profile([(1, 2, 3)]) + joescan_profile([(1, 2, 3)], encoders=()), "with and without an encoder"),
        (joescan_profile([(1, 2, 3)], encoders=(2**60,)) * 2, "2\\^53"),
        (
            joescan_profile([(1, 2, 3)]) * 20_000 + joescan_profile([(1, 2, 3)] * 30_000),
            "30000 points in profile 20000",
        ),
        (gzip.compress(b"1 2 3\n" * 9, mtime=0), "gzip file that is no JoeScan"),
    ],
)
def test_what_is_no_recording_is_refused_with_the_reason(tmp_path, data, words):
    with pytest.raises(UnreadableFile, match=words):
        read_recording(written(tmp_path, data))
