"""The append log: every valid record comes back, damage is reported, nothing invalid is taken for valid."""

import os
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truestand.core.errors import NoSpace, UnreadableFile
from truestand.files.scans import scan_log
from truestand.files.scans.scan_log import MAGIC, Damage, Kind, LogWriter, read_log


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "k1.log"
    with LogWriter(path) as writer:
        writer.append_json(Kind.BEGIN, {"hello": 1}, 0.5)
        for i in range(20):
            writer.append(Kind.FRAME, bytes([i]) * 100, float(i), 1, i, flags=i % 2)
        writer.append_json(Kind.END, {"complete": True}, 99.0)
    return path


def test_records_are_read_as_they_were_written(log):
    begin, *frames, end = read_log(log)
    assert begin.json() == {"hello": 1}
    assert end.json() == {"complete": True}
    assert [(f.number, f.source, f.time, f.flags, f.payload) for f in frames] == [
        (i, 1, float(i), i % 2, bytes([i]) * 100) for i in range(20)
    ]


def test_a_log_is_never_overwritten(log):
    with pytest.raises(FileExistsError):
        LogWriter(log)


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_a_log_cut_anywhere_keeps_all_whole_records(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("log") / "k1.log"
    ends = [len(MAGIC)]
    with LogWriter(path) as writer:
        for i in range(6):
            writer.append(Kind.FRAME, bytes([i]) * data.draw(st.integers(0, 50)), 0.0, 0, i)
            ends.append(path.stat().st_size)
    cut = data.draw(st.integers(len(MAGIC), ends[-1]))
    path.write_bytes(path.read_bytes()[:cut])
    assert len(list(read_log(path))) == sum(end <= cut for end in ends[1:])


@given(st.integers(0, 10**9), st.integers(0, 7))
@settings(max_examples=200, deadline=None)
def test_a_flipped_bit_costs_its_record_and_no_other(tmp_path_factory, place, bit):
    path = tmp_path_factory.mktemp("log") / "k1.log"
    with LogWriter(path) as writer:
        for i in range(5):
            writer.append(Kind.FRAME, bytes([i]) * 40, 0.0, 0, i)
    content = bytearray(path.read_bytes())
    place = len(MAGIC) + place % (len(content) - len(MAGIC))
    content[place] ^= 1 << bit
    path.write_bytes(content)
    damages: list[Damage] = []
    found = [r.number for r in read_log(path, damages)]
    size = (len(content) - len(MAGIC)) // 5
    assert found == [i for i in range(5) if i != (place - len(MAGIC)) // size]
    assert damages == [Damage(len(MAGIC) + (place - len(MAGIC)) // size * size, size)]


def test_a_record_that_claims_four_gigabytes_is_skipped_at_once(tmp_path):
    path = tmp_path / "k1.log"
    path.write_bytes(MAGIC + b"\xf5TSL" + bytes([2, 0, 0, 0]) + b"\xff" * 4 + bytes(20))
    began = time.process_time()
    assert list(read_log(path)) == []
    assert time.process_time() - began < 1.0  # four gigabytes take longer


@pytest.mark.parametrize("content", [b"", b"x", b"\x89HDF\r\n\x1a\n" + bytes(100)])
def test_a_file_that_is_no_log_is_refused(tmp_path, content):
    path = tmp_path / "k1.log"
    path.write_bytes(content)
    with pytest.raises(UnreadableFile, match=r"no truestand scan log"):
        list(read_log(path))


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full, the disk that is always full")  # noqa: PTH110
def test_a_full_disk_is_reported_with_the_remedy(tmp_path, monkeypatch):
    writer = LogWriter(tmp_path / "k1.log")
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, writer._file)
    os.close(full)
    with pytest.raises(NoSpace, match="kept: free some space, then"):
        writer.append(Kind.FRAME, bytes(10), 0.0)
    monkeypatch.setattr(os, "fsync", lambda file: None)
    writer.close()


def test_a_disk_failure_after_the_last_append_is_reported_on_closing(tmp_path, monkeypatch):
    """The system tells such a failure once: the next request to the disk goes well again."""
    failed = threading.Event()

    def fsync(file) -> None:
        if not failed.is_set():
            failed.set()
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(scan_log, "SYNC_INTERVAL_S", 0.0)
    monkeypatch.setattr(os, "fsync", fsync)
    writer = LogWriter(tmp_path / "k1.log")
    assert failed.wait(30.0)
    with pytest.raises(NoSpace, match="Input/output error"):
        writer.close()
