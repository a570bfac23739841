"""kill -9 in the middle of whatever it is, several writers at once, a backup meanwhile."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from truestand.core.errors import BadStore
from truestand.store import Store

WRITER = Path(__file__).with_name("writer.py")


def start(folder, scan, name, count, *dies_at):
    command = [sys.executable, str(WRITER), str(folder), str(scan), name, str(count), *dies_at]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def scan(tmp_path):
    path = tmp_path / "k1.csv"
    path.write_text("1;2;3\n" * 20000)
    return path


def kill_often(folder, scan, times, seed):
    """Kill a writer at random moments; each time the store opens, is sound and has all that was acknowledged."""
    chance = random.Random(seed)
    acknowledged, interrupted = {}, 0
    for k in range(times):
        writer = start(folder, scan, f"w{k}", 1000)
        if k % 4:  # otherwise also while it starts and creates
            acknowledged |= told([writer.stdout.readline()])
        time.sleep(chance.uniform(0.0, 0.06) if k % 4 else chance.uniform(0.1, 0.4))
        os.kill(writer.pid, signal.SIGKILL)
        out, err = writer.communicate()
        assert "Traceback" not in err
        acknowledged |= told(out.splitlines())
        if (folder / "anchor.json").exists() and (folder / "store.db").exists():
            interrupted += not Store(folder).audit().sealed
        store = Store.open(folder, create=True)
        found = {e.number: e.hash for e in store.entries()}
        assert acknowledged.items() <= found.items(), k
        assert store.audit().sound, store.audit()
        number = store.note(f"after kill {k}").number
        acknowledged[number] = store.entry(number).hash
        report = store.audit()
        assert report.sound and report.sealed and not list((folder / "incoming").glob("*"))
    return len(acknowledged), interrupted


def told(lines):
    words = [line.split() for line in lines if line.endswith("\n") or len(line.split()) == 2]
    return {int(number): stated for number, stated in (w for w in words if len(w) == 2 and len(w[1]) == 64)}


@pytest.mark.more
@pytest.mark.skipif(os.name == "nt", reason="kill -9")
def test_kill_9_in_the_middle_of_a_write_loses_nothing_acknowledged(tmp_path, scan):
    kept, _ = kill_often(tmp_path / "results", scan, 8, seed=1)
    assert kept > 8


@pytest.mark.skipif(os.name == "nt", reason="kill -9")
@pytest.mark.parametrize(
    ("dies_at", "sealed", "entries"),
    [("write_anchor 1", True, 1), ("writing 1", False, 1), ("writing 2", False, 2), ("write_anchor 2", False, 2)],
)  # fmt: skip
def test_what_a_writer_had_begun_when_it_died_is_finished_or_undone(tmp_path, scan, dies_at, sealed, entries):
    store = Store.open(tmp_path / "results", create=True)
    store.note("before")
    writer = start(store.folder, scan, "w", 1, dies_at)
    assert writer.communicate(timeout=30) == ("", "") and writer.returncode == -signal.SIGKILL
    assert store.audit().sound and store.audit().sealed == sealed
    assert store.note("after").number == entries + 1
    assert store.audit().sound and store.audit().sealed and not list((store.folder / "incoming").glob("*"))


@pytest.mark.slow
def test_kill_9_a_hundred_times(tmp_path, scan):
    kept, interrupted = kill_often(tmp_path / "results", scan, 100, seed=2)
    print(f"\n{kept} acknowledged entries kept, {interrupted} of 100 kills left a write to finish")


def test_several_processes_write_one_chain_while_a_backup_is_taken(tmp_path, scan):
    folder, target = tmp_path / "results", tmp_path / "backup"
    Store.open(folder, create=True)
    writers = [start(folder, scan, name, 12) for name in ("a", "b", "c")]
    counts = []
    while any(w.poll() is None for w in writers):
        counts.append(Store.open(folder).backup(target))
        assert Store.open(target).audit().sound
    acknowledged = {}
    for writer in writers:
        out, err = writer.communicate()
        assert writer.returncode == 0, err
        acknowledged |= told(out.splitlines())
    entries = Store.open(folder).entries()
    assert len(entries) == 36 and acknowledged == {e.number: e.hash for e in entries}
    assert Store.open(folder).audit().sound
    assert counts == sorted(counts) and Store.open(folder).backup(target) == 36
    copy = Store.open(target)
    assert copy.entries() == entries and copy.audit().sealed and copy.record(entries[-1])["x"]


def test_a_backup_refuses_another_folder_another_store_and_damage(tmp_path, scan):
    store = Store.open(tmp_path / "results", create=True)
    store.add("calibration", {}, {"scan": scan})
    other = Store.open(tmp_path / "other", create=True)
    other.note("another store")
    with pytest.raises(BadStore, match="another store"):
        store.backup(other.folder)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "me.png").write_text("x")
    with pytest.raises(BadStore, match="something else"):
        store.backup(tmp_path / "photos")
    evidence = store.evidence(store.entry(1))["scan"]
    evidence.chmod(0o644)
    evidence.write_text("x")
    with pytest.raises(BadStore, match="changed since"):
        store.backup(tmp_path / "copy")
    assert not (tmp_path / "copy" / "store.db").exists()


def test_an_interrupted_backup_is_finished_by_the_next(tmp_path, scan, monkeypatch):
    from truestand.store import store as store_module

    store = Store.open(tmp_path / "results", create=True)
    for k in range(3):
        scan.write_text(str(k))
        store.add("calibration", {"k": k}, {"scan": scan})

    def dies(*_):
        raise KeyboardInterrupt

    for step in ("_copy_evidence", "write_anchor"):
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(store_module, step, dies)
            store.backup(tmp_path / "copy")
    assert store.backup(tmp_path / "copy") == 3
    assert Store.open(tmp_path / "copy").audit().sound
