"""What goes in stays in, as it was, with what it rests on."""

import sqlite3

import pytest

from truestand.core.errors import BadStore
from truestand.store import Store


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path / "results", create=True)


@pytest.fixture
def scan(tmp_path):
    path = tmp_path / "k1.csv"
    path.write_text("1;2;3\n")
    return path


CALIBRATION = {"format": "truestand.calibration", "version": 1, "status": "valid",
               "artefact": {"name": "shaft M", "serial": "7"}}  # fmt: skip
INSPECTION = {"verdict": "conforms", "part": {"name": "gear", "serial": "12", "order": "A1", "operator": "Eva"}}


def test_a_result_comes_back_as_it_was_stored(store, scan):
    entry = store.add("calibration", CALIBRATION, {"scan": scan}, operator="Eva")
    assert (entry.number, entry.kind, entry.part, entry.serial, entry.status) == (
        1,
        "calibration",
        "shaft M",
        "7",
        "valid",
    )
    assert store.entries() == [entry] == [store.entry(1)]
    assert store.record(entry) == CALIBRATION
    assert store.evidence(entry)["scan"].read_text() == scan.read_text()
    assert store.evidence(entry)["scan"].stat().st_mode & 0o222 == 0
    assert store.head() == (1, entry.hash)
    assert store.audit().sound and store.audit().sealed


def test_identity_comes_from_the_record_and_the_operator_may_be_named(store):
    first = store.add("inspection", INSPECTION)
    assert (first.serial, first.order, first.operator, first.status) == ("12", "A1", "Eva", "conforms")
    assert store.add("inspection", INSPECTION, operator="Jan").operator == "Jan"


def test_entries_by_kind_time_and_number(store):
    for day in (1, 2, 3):
        store.add("calibration", CALIBRATION, time=f"2026-01-0{day}T08:00:00Z")
        store.add("inspection", INSPECTION, time=f"2026-01-0{day}T09:00:00Z")
    assert [e.number for e in store.entries("inspection")] == [2, 4, 6]
    assert [e.number for e in store.entries(since="2026-01-02")] == [3, 4, 5, 6]
    assert [e.number for e in store.entries("calibration", last=1)] == [5]


def test_a_correction_stands_in_the_place_of_the_original_which_stays(store):
    wrong = store.add("inspection", INSPECTION)
    right = {**INSPECTION, "verdict": "does_not_conform"}
    first = store.correct(1, {**INSPECTION, "verdict": "undecided"}, reason="typo")
    second = store.correct(first.number, right, reason="wrong drawing", operator="Eva")
    (result,) = store.results("inspection")
    assert result.entry == wrong and result.last == second and not result.withdrawn
    assert store.record(wrong) == INSPECTION and store.record(result.last) == right
    store.correct(1, None, reason="another part was clamped")
    assert store.results("inspection")[0].withdrawn
    assert store.audit().sound


def test_a_withdrawal_can_not_be_withdrawn(store):
    store.add("inspection", INSPECTION)
    withdrawal = store.correct(1, None, reason="another part was clamped")
    with pytest.raises(BadStore, match="entry 2 withdraws entry 1: a withdrawal can't be withdrawn"):
        store.correct(withdrawal.number, None, reason="by mistake")
    with pytest.raises(BadStore, match="entry 1 is withdrawn already, by entry 2"):
        store.correct(1, None, reason="again")
    assert len(store.entries()) == 2


def test_corrections_need_a_result_and_a_reason(store):
    store.note("the lamp was changed")
    store.add("inspection", INSPECTION)
    for number, reason in ((1, "why"), (2, " "), (9, "why")):
        with pytest.raises(BadStore):
            store.correct(number, None, reason=reason)
    with pytest.raises(BadStore, match="kind"):
        store.add("correction", {})
    assert store.note("seen again", about=2).about == 2


def test_the_database_refuses_to_change_what_is_there(store):
    store.add("calibration", CALIBRATION)
    connection = sqlite3.connect(store.folder / "store.db")
    for statement in (
        "UPDATE entry SET body = 'x'", "DELETE FROM entry", "UPDATE meta SET value = 'x'", "DELETE FROM meta",
        "INSERT OR REPLACE INTO entry SELECT * FROM entry", "INSERT OR REPLACE INTO meta VALUES ('id', 'x')",
        "INSERT OR REPLACE INTO entry SELECT 2, kind, time, body, hash FROM entry",
        "INSERT INTO entry VALUES (7, 'note', '', '{}', '')",
    ):  # fmt: skip
        with pytest.raises(sqlite3.IntegrityError, match="append only"):
            connection.execute(statement)
    connection.close()
    assert store.audit().sound


def test_evidence_that_changed_since_the_result_is_refused(store, scan):
    record = {**CALIBRATION, "scan": {"sha256": "0" * 64}}
    with pytest.raises(BadStore, match="another scan"):
        store.add("calibration", record, {"scan": scan})
    assert store.entries() == [] and store.audit().sound


def test_a_missing_file_leaves_the_store_as_it_was(store, tmp_path):
    with pytest.raises(FileNotFoundError):
        store.add("calibration", CALIBRATION, {"scan": tmp_path / "nowhere.csv"})
    assert store.add("calibration", CALIBRATION).number == 1


def test_the_record_has_the_hash_of_its_own_file(store, tmp_path):
    from truestand.files.atomic import write_json_atomic
    from truestand.files.scans.read import sha256_of

    write_json_atomic(tmp_path / "calibration.json", CALIBRATION)
    assert store.add("calibration", CALIBRATION).record == sha256_of(tmp_path / "calibration.json")


def test_one_file_is_kept_once(store, scan):
    for _ in range(3):
        store.add("calibration", CALIBRATION, {"scan": scan})
    assert len(list((store.folder / "evidence").glob("*/*"))) == 2


def test_a_folder_without_a_store_is_refused(tmp_path):
    with pytest.raises(BadStore, match="no results store"):
        Store.open(tmp_path)
    with pytest.raises(BadStore, match="no results store"):
        Store(tmp_path).audit()


def test_a_store_that_is_busy_too_long_is_refused(store):
    from truestand.store.lock import locked

    with locked(store.folder, 1.0), pytest.raises(BadStore, match="another program"):
        Store.open(store.folder, timeout=0.05).add("calibration", CALIBRATION)


def test_a_long_reader_neither_stops_a_writer_nor_hides_an_end_that_was_cut_off(store, monkeypatch):
    monkeypatch.setattr("truestand.store.database.READER_TIMEOUT_S", 0.05)
    store.add("calibration", CALIBRATION)
    reader = sqlite3.connect(f"file:{store.folder / 'store.db'}?mode=ro", uri=True)
    reader.execute("BEGIN")
    reader.execute("SELECT count(*) FROM entry").fetchone()
    entry = store.add("calibration", CALIBRATION)
    report = store.audit()
    assert report.sound and not report.sealed and report.head == (2, entry.hash)
    reader.close()
    (store.folder / "store.db-wal").unlink(missing_ok=True)
    assert [f.what for f in store.audit().findings] == ["end missing"]
    with pytest.raises(BadStore, match="anchor says 2"):
        store.add("calibration", CALIBRATION)
