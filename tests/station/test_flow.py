"""A frame goes from sensor to log to native file without being read back; `recover` makes the same file."""

import mmap
import weakref
from dataclasses import fields

import numpy as np
import pytest

from lab import lab
from truestand.core.scan import interpret
from truestand.files.scans import read
from truestand.files.scans.read import read_recording
from truestand.files.scans.scan_log import SUSPECT, Kind, Record
from truestand.station import jobs
from truestand.station import log as log_module
from truestand.station.convert import convert
from truestand.station.log import Frames, load_log
from truestand.station.scan import write_scans


@pytest.fixture
def no_reading(monkeypatch):
    """Where nothing reads a log or a native file."""

    def refused(*arguments):
        raise AssertionError("read back")

    with monkeypatch.context() as inside:
        inside.setattr(log_module, "read_log", refused)
        inside.setattr(read, "read_native", refused)
        yield inside


def differing(one, other) -> list[str]:
    """The fields in which two recordings or scans differ."""

    def same(a, b) -> bool:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)
        return type(a) is type(b) and a == b

    return [f.name for f in fields(one) if not same(getattr(one, f.name), getattr(other, f.name))]


@pytest.mark.parametrize("encoder", [True, pytest.param(False, marks=pytest.mark.stand)])
def test_a_scan_is_recorded_without_reading_and_recovered_byte_by_byte(tmp_path, no_reading, encoder):
    with lab(tmp_path, pace=2.0, turns=0.1, sensors=("front", "back"), encoder=encoder) as stand:
        taken = stand.take(keep_log=True)
    no_reading.undo()
    recovered = write_scans(convert(load_log(tmp_path / "k1.log")), tmp_path / "again.h5")
    assert len(taken.written) == len(recovered) == 2
    for one, again in zip(taken.written, recovered, strict=True):
        assert one.path.read_bytes() == again.path.read_bytes()
        assert differing(one.scan.recording, read_recording(one.path)) == []


@pytest.mark.stand
def test_a_job_evaluates_its_scan_without_reading_the_file(tmp_path, no_reading):
    with lab(tmp_path, pace=2.0, turns=0.1) as stand:
        (scan,) = jobs._scans(
            jobs.Job("calibrate", stand.recipe, tmp_path / "job"), jobs.Observer(), tmp_path / "job" / "shaft.h5"
        )
    no_reading.undo()
    assert differing(scan, interpret(read_recording(tmp_path / "job" / "shaft.h5"))) == []


def frame(number: int, content: bytes, flags: int = 0) -> Record:
    return Record(Kind.FRAME, 0, number, float(number), content, flags)


def test_frames_are_taken_out_once_in_order_without_suspect_and_short_ones():
    frames = Frames(2)
    for record in (frame(3, b"cc"), frame(1, b"xx"), frame(2, b"bb", SUSPECT), frame(4, b"d"), frame(1, b"aa")):
        frames.add(record)
    assert len(frames) == 2
    assert [(n, at, bytes(payload)) for n, at, payload in frames.taken_out()] == [(1, 1.0, b"aa"), (3, 3.0, b"cc")]
    assert len(frames) == 0


def test_frames_release_their_memory_as_they_are_taken_out(monkeypatch):
    real, maps = mmap.mmap, weakref.WeakSet()

    def mapped(file, size):
        made = real(file, size)
        maps.add(made)
        return made

    monkeypatch.setattr(mmap, "mmap", mapped)
    monkeypatch.setattr(log_module, "MAP_BYTES", 1000)
    frames = Frames(100)
    for number in range(100):
        frames.add(frame(number, bytes(100)))
    assert len(maps) == 10
    assert [len(maps) for _ in frames.taken_out()] == [10 - i // 10 for i in range(100)]
    del frames
    assert not maps
