"""Each thing that can be wrong is found and named; each flipped bit of a store at rest is found."""

import random
import shutil
import sqlite3
from pathlib import Path

import pytest

from truestand.core.errors import BadStore
from truestand.store import Store
from truestand.store.audit import FINDINGS

RELEASED = Path(__file__).parents[1] / "released" / "store-1"


@pytest.fixture
def folder(tmp_path):
    copied = Path(shutil.copytree(RELEASED, tmp_path / "results"))
    for path in copied.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    return copied


def found(folder, *noted):
    return {f.what for f in Store(folder).audit(noted).findings}


def tamper(folder, *statements):
    """What someone with a database tool does."""
    connection = sqlite3.connect(folder / "store.db")
    for trigger in ("entry_update", "entry_delete", "entry_order"):
        connection.execute(f"DROP TRIGGER {trigger}")
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()


def without_anchor(folder):
    """Findings of the entries alone: as if the tamperer had known about the anchor's hash of the file."""
    return found(folder) - {"database changed", "protection removed"}


def test_a_sound_store_has_no_findings(folder):
    report = Store(folder).audit()
    assert report.sound and report.sealed and report.entries == 5 and report.files == 7


def test_what_is_wrong_is_named(folder):
    (folder / "anchor.json").write_text((folder / "anchor.json").read_text().replace('"number":5', '"number":4'))
    assert found(folder) == {"anchor changed"}
    (folder / "anchor.json").unlink()
    assert found(folder) == {"anchor missing"}
    with pytest.raises(FileNotFoundError):
        Store(folder).note("no")


@pytest.mark.parametrize("statement, words", [
    ("UPDATE entry SET body = replace(body, 'Eva', 'Iva') WHERE number = 2", {"entry changed"}),
    ("UPDATE entry SET time = '2020-01-01' WHERE number = 2", {"entry changed"}),
    ("DELETE FROM entry WHERE number = 2", {"chain broken"}),
    ("DELETE FROM entry WHERE number = 5", {"end missing"}),
    ("DELETE FROM entry", {"end missing"}),
    ("UPDATE entry SET number = 7 WHERE number = 5", {"entry changed", "chain broken", "end missing"}),
])  # fmt: skip
def test_a_changed_history_is_named(folder, statement, words):
    tamper(folder, statement)
    assert found(folder) - words == {"database changed", "protection removed"} and words <= found(folder)
    with pytest.raises(BadStore, match="changed since the last entry"):
        Store(folder).note("no")


def test_a_rewritten_chain_is_found_by_a_noted_head_only(folder, tmp_path):
    """Who may write the folder can rebuild it all, or put an older copy back: what was noted elsewhere tells."""
    head = Store(folder).head()[1]
    assert found(folder, head) == set() == found(folder, head[:16])
    older = Store.open(tmp_path / "older", create=True)
    older.note("another history")
    assert found(older.folder) == set() and found(older.folder, head) == {"noted head missing"}


def test_damaged_evidence_is_named_with_its_entry(folder):
    store = Store(folder)
    record = store.evidence(store.entry(1))["record"]
    record.write_bytes(record.read_bytes()[:-1])
    (finding,) = store.audit().findings
    assert finding.what == "evidence changed" and "entry 1" in finding.where
    with pytest.raises(BadStore, match="changed since"):
        store.record(store.entry(1))
    record.unlink()
    (finding,) = store.audit().findings
    assert finding.what == "evidence missing" and "entry 1" in finding.where


def test_a_database_that_is_none_is_named(folder):
    (folder / "store.db").write_bytes(b"no database" * 1000)
    assert "database unreadable" in found(folder)
    (folder / "store.db").unlink()
    assert {"database changed", "database unreadable"} <= found(folder)


def test_writes_past_the_store_are_found_in_the_log_too(folder):
    connection = sqlite3.connect(folder / "store.db", isolation_level=None)
    connection.execute("CREATE TABLE mine (x)")
    assert {"database changed", "protection removed"} <= found(folder)
    connection.close()
    assert {"database changed", "protection removed"} <= found(folder)


def test_every_finding_is_explained():
    source = (Path(__file__).parents[2] / "src/truestand/store/audit.py").read_text(encoding="utf-8")
    assert all(source.count(f'"{word}"') >= 2 for word in FINDINGS)


def flip_and_audit(folder, times, seed):
    """How many of so many flipped bits, anywhere in the store at rest, were found; where those were that weren't."""
    chance = random.Random(seed)
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.stat().st_size and "-" not in p.name)
    sizes = [p.stat().st_size for p in files]
    missed = []
    for k in range(times):
        # every second flip in the database or its anchor, which are small beside the evidence
        (path,) = chance.choices(files, sizes) if k % 2 else [folder / chance.choice(("store.db", "anchor.json"))]
        data = path.read_bytes()
        byte, bit = chance.randrange(len(data)), 1 << chance.randrange(8)
        path.write_bytes(data[:byte] + bytes([data[byte] ^ bit]) + data[byte + 1 :])
        try:
            if Store(folder).audit().sound:
                missed.append((path.name, byte, bit))
        except BadStore:
            pass  # refuses to open
        for log in folder.glob("store.db-*"):  # SQLite's, made anew by whoever opens the database first
            log.unlink()
        path.write_bytes(data)
    assert Store(folder).audit().sound
    return missed


def test_every_flipped_bit_is_found(folder):
    assert flip_and_audit(folder, 300, seed=1) == []


@pytest.mark.slow
def test_ten_thousand_flipped_bits_are_found(folder):
    assert flip_and_audit(folder, 10_000, seed=2) == []
