"""What older versions wrote stays readable."""

import json
import shutil
import sqlite3
from pathlib import Path

import jsonschema
import pytest

from truestand.core.errors import BadStore
from truestand.files.records.calibration_record import read_calibration
from truestand.files.records.schemas import schema_text
from truestand.store import Store, database

RELEASED = Path(__file__).parents[1] / "released"
STORES = sorted(RELEASED.glob("store-*"))
CALIBRATIONS = sorted(RELEASED.glob("calibration-*.json"))


@pytest.fixture
def copy(tmp_path, request):
    return Path(shutil.copytree(request.param, tmp_path / "results"))


@pytest.mark.parametrize("path", CALIBRATIONS, ids=lambda p: p.stem)
def test_every_calibration_ever_written_is_read(path):
    calibration = read_calibration(path)
    assert calibration.status == "valid" and calibration.uncertainty["phi_deg"].U > 0
    assert calibration.artefact is not None and calibration.scan is not None


@pytest.mark.parametrize("name", ["calibration", "verification", "inspection"])
def test_every_record_still_fits_the_schema(name):
    found = sorted(RELEASED.glob(f"{name}-*.json"))
    assert found
    for path in found:
        jsonschema.validate(json.loads(path.read_text(encoding="utf-8")), json.loads(schema_text(name)))


@pytest.mark.parametrize("copy", STORES, indirect=True, ids=lambda p: p.name)
def test_every_store_ever_written_is_read_audited_and_written_to(copy):
    store = Store.open(copy)
    assert store.audit().sound and store.audit().head == store.head()
    before = store.entries()
    assert [e.kind for e in before] == ["calibration", "verification", "inspection", "correction", "note"]
    assert before[2].serial == "12" and store.results("inspection")[0].last == before[3]
    assert store.record(before[0])["status"] == "valid"
    store.add("calibration", {"status": "valid"})
    assert store.entries()[:5] == before and store.audit().sound


@pytest.mark.parametrize("copy", STORES[:1], indirect=True, ids=lambda p: p.name)
def test_a_migration_leaves_the_entries_as_they_are(copy, monkeypatch):
    before = Store.open(copy).entries()
    later = "CREATE INDEX entry_by_time ON entry (time);"
    monkeypatch.setattr(database, "MIGRATIONS", (*database.MIGRATIONS, later))
    store = Store.open(copy)
    connection = sqlite3.connect(copy / "store.db")
    assert connection.execute("PRAGMA user_version").fetchone() == (len(database.MIGRATIONS),)
    connection.close()
    assert store.entries() == before and store.audit().sound and store.audit().sealed
    monkeypatch.undo()
    with pytest.raises(BadStore, match="update it"):
        Store.open(copy)
    with pytest.raises(BadStore, match="update it"):
        store.audit()


@pytest.mark.parametrize("copy", STORES[:1], indirect=True, ids=lambda p: p.name)
def test_a_migration_that_died_is_done_again(copy, monkeypatch):
    monkeypatch.setattr(database, "MIGRATIONS", (*database.MIGRATIONS, "CREATE INDEX entry_by_time ON entry (time);"))

    def dies(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(database, "migrate", dies)
        Store.open(copy)
    assert Store(copy).audit().sound and not Store(copy).audit().sealed
    assert Store.open(copy).audit().sealed


@pytest.mark.parametrize("copy", STORES[:1], indirect=True, ids=lambda p: p.name)
def test_a_store_that_can_only_be_read_is_read_and_audited(copy, monkeypatch):
    for name in ("truestand.store.store", "truestand.store.audit", "truestand.store.database"):
        monkeypatch.setattr(f"{name}.is_read_only", lambda folder: True)
    (copy / "lock").unlink()
    before = sorted(p.name for p in copy.rglob("*"))
    store = Store.open(copy)
    assert store.record(store.entry(1)) and store.audit().sound
    assert sorted(p.name for p in copy.rglob("*")) == before
