"""Outputs are old or new, never half."""

import json
import os
import stat
import sys

import pytest

from truestand.files.atomic import replacing, write_json_atomic, write_text_atomic


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "out.txt"
    write_text_atomic(target, "old")
    with pytest.raises(RuntimeError), replacing(target) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert target.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out.txt"]


@pytest.mark.skipif(sys.platform == "win32", reason="file modes")
def test_a_file_gets_the_mode_of_any_new_one_and_the_umask_is_left_alone(tmp_path, monkeypatch):
    before = os.umask(0o027)
    try:
        with monkeypatch.context() as patched:
            patched.setattr(os, "umask", None)  # it is the whole process's: other threads' files would get it too
            write_text_atomic(tmp_path / "out.txt", "new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "out.txt").stat().st_mode) == 0o640


def test_an_interrupt_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "out.txt") as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


def test_only_a_file_is_replaced(tmp_path):
    (tmp_path / "folder").mkdir()
    targets = [tmp_path / "folder"]
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        targets.append(tmp_path / "pipe")
    for target in targets:
        with pytest.raises(OSError, match="no file"):
            write_text_atomic(target, "x")
    assert sorted(tmp_path.iterdir()) == sorted(targets) and not any(target.is_file() for target in targets)


def test_folders_are_made_and_unicode_survives(tmp_path):
    target = tmp_path / "a" / "ü b" / "out.json"
    write_json_atomic(target, {"name": "Klarák µm"})
    assert json.loads(target.read_text(encoding="utf-8")) == {"name": "Klarák µm"}


def test_a_record_holds_no_nan(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json_atomic(tmp_path / "out.json", {"x": float("nan")})
    assert not list(tmp_path.iterdir())
