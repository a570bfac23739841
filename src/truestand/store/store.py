"""A results store: a folder in which results are kept with their evidence, and nothing is ever changed."""

import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

from truestand.core.errors import BadStore
from truestand.core.message import Message
from truestand.files.atomic import record_text, replacing
from truestand.files.records.record import SOFTWARE, Record, now
from truestand.store import database, evidence, ledger, lock
from truestand.store.anchor import Anchor, read_anchor, write_anchor
from truestand.store.audit import Advance, Report, audit
from truestand.store.entry import RESULTS, Entry, entry_of, genesis, identity_of
from truestand.store.lock import is_read_only, locked
from truestand.store.standing import Results

WRITER_TIMEOUT_S = 60.0
"""Wait for another writer."""


def _end_of_copy(folder: Path, target: Path, anchor: Anchor) -> tuple[int, str]:
    """Number and hash of the last entry in the copy so far.

    Raises:
        BadStore: ``target`` is no earlier copy of this store.
    """
    start = (0, genesis(anchor.id))
    if not ledger.has_anchor(target):
        begun = (lock.NAME, evidence.EVIDENCE, evidence.INCOMING)
        if any(p.name not in begun and not p.name.startswith(f".{database.NAME}.") for p in target.iterdir()):
            raise BadStore(f"{target}: found something else; give an empty folder or an earlier backup of this store")
        return start
    copied = read_anchor(target)
    end = copied.pending or (copied.number, copied.head)
    with database.reading(folder) as connection:
        known = {(number, stated_hash) for number, _, _, _, stated_hash in database.rows_of(connection)} | {start}
    if copied.id != anchor.id or not {end, (copied.number, copied.head)} <= known:
        raise BadStore(f"{target}: found another store; give an empty folder or an earlier backup of this store")
    return copied.number, copied.head


def _copy_database(folder: Path, copy: Path) -> list[Entry]:
    """Copy the database as it is at this moment; its entries."""
    with database.reading(folder) as source, database.connected(copy) as destination:
        source.backup(destination)
        return [entry_of(row[3], row[4]) for row in database.rows_of(source)]


def _copy_evidence(folder: Path, target: Path, entries: list[Entry]) -> None:
    """What the copied entries name and the target lacks; each file is checked on its way."""
    for sha256 in dict.fromkeys(sha256 for entry in entries for sha256 in entry.files):
        if evidence.evidence_path(target, sha256).exists():
            continue
        source = evidence.evidence_path(folder, sha256)
        if not source.exists():
            raise BadStore(f"{source}: missing; run truestand audit")
        if evidence.keep_file(target, source) != sha256:
            raise BadStore(f"{source}: changed since it was kept; run truestand audit")


@dataclass(frozen=True, slots=True)
class Result:
    """A stored result with what corrections made of it."""

    entry: Entry
    """As it was stored."""
    last: Entry
    """Its last correction, or the entry itself."""
    doubts: tuple[Message, ...] = ()
    """What became of the calibration that it rests on, where that speaks against it."""

    @property
    def withdrawn(self) -> bool:
        """Whether a correction took it back without another record."""
        return self.last.record is None

    @property
    def corrected(self) -> bool:
        """Whether another entry stands in its place."""
        return self.last.number != self.entry.number

    @property
    def verdict(self) -> str:
        """Verdict or status as last corrected; ``withdrawn`` where it was taken back."""
        return "withdrawn" if self.withdrawn else self.last.status or ""


@dataclass(frozen=True, slots=True)
class Store:
    """The store in ``folder``. It holds nothing open: several processes and threads may use it at once."""

    folder: Path
    timeout: float = WRITER_TIMEOUT_S

    @classmethod
    def open(cls, folder: Path | str, *, create: bool = False, timeout: float = WRITER_TIMEOUT_S) -> "Store":
        """The store of a folder; an older one is brought to this version where it may be written.

        Raises:
            BadStore: no store (without ``create``), a newer one, a damaged one, or one that is busy too long.
        """
        store = cls(Path(folder), timeout)
        if create and not (ledger.has_anchor(store.folder) and (store.folder / database.NAME).exists()):
            store.folder.mkdir(parents=True, exist_ok=True)
            with locked(store.folder, timeout):
                store._create()
        with database.reading(store.folder) as connection:
            old = database.version_of(connection) < len(database.MIGRATIONS)
        if old and not is_read_only(store.folder):
            with locked(store.folder, timeout):
                ledger.migrate(store.folder)
        return store

    def add(
        self, kind: str, record: Mapping[str, Any], evidence: Mapping[str, Path] | None = None, *,
        operator: str | None = None, text: str | None = None, time: str | None = None,
    ) -> Entry:  # fmt: skip
        """Keep a result: its record, and a copy of each file that it rests on, by role. On the disk on return.

        ``kind`` is calibration, verification, inspection or scan; ``time`` is ISO, the present one if left out.

        Raises:
            BadStore: another kind, a file that isn't the one the record names, a damaged or busy store.
        """
        if kind not in RESULTS:
            raise BadStore(f"found kind {kind!r}, need one of {', '.join(RESULTS)}")
        return self._append(kind, record, evidence or {}, operator=operator, text=text, time=time)

    def correct(
        self, number: int, record: Mapping[str, Any] | None, evidence: Mapping[str, Path] | None = None, *,
        reason: str, operator: str | None = None, time: str | None = None,
    ) -> Entry:  # fmt: skip
        """Put another record, or none (the result is withdrawn), in the place of an entry, which stays.

        Raises:
            BadStore: no such entry, or one that is no result; no reason; a withdrawal of what is withdrawn.
        """
        corrected = self.entry(number)
        if corrected.kind == "note" or not reason.strip():
            raise BadStore(
                f"found {'a note' if reason.strip() else 'no reason'}; a correction corrects a result, for a reason"
            )
        if record is None:
            self._refuse_second_withdrawal(corrected)
        return self._append(
            "correction", record, evidence or {}, about=number, operator=operator, text=reason, time=time
        )

    def note(
        self, text: str, about: int | None = None, *, operator: str | None = None, time: str | None = None
    ) -> Entry:
        """Add a remark, on an entry or on the store as a whole.

        Raises:
            BadStore: no such entry, or a damaged or busy store.
        """
        if about is not None:
            self.entry(about)
        return self._append("note", None, {}, about=about, operator=operator, text=text, time=time)

    def entries(self, kind: str | None = None, since: str | None = None, last: int | None = None) -> list[Entry]:
        """Entries in their order, as stored; of one kind, from an ISO time on, the ``last`` so many only.

        Raises:
            BadStore: no store, or one that is damaged.
        """
        tests = {"kind = ?": kind, "time >= ?": since}
        given = {test: value for test, value in tests.items() if value is not None}
        where = f"WHERE {' AND '.join(given)}" if given else ""
        with database.reading(self.folder) as connection:
            rows = database.rows_of(connection, where, tuple(given.values()))
        first_row = 0 if last is None else max(len(rows) - last, 0)
        return [entry_of(body, stated_hash) for *_, body, stated_hash in rows[first_row:]]

    def entry(self, number: int) -> Entry:
        """One entry.

        Raises:
            BadStore: there is none of this number.
        """
        with database.reading(self.folder) as connection:
            rows = database.rows_of(connection, "WHERE number = ?", (number,))
        if not rows:
            raise BadStore(f"{self.folder}: found no entry {number}; truestand history lists them")
        return entry_of(rows[0][3], rows[0][4])

    def results(self, kind: str, since: str | None = None) -> list[Result]:
        """Results of one kind with what corrections made of them, in the order of the originals.

        Raises:
            BadStore: no store, or one that is damaged.
        """
        known, now = self.standing(), datetime.now(UTC)
        originals = self.entries(kind, since)
        return [Result(e, known.last(e.number), known.doubts(known.last(e.number).number, now)) for e in originals]

    def standing(self) -> Results:
        """All results, and what each is worth today.

        Raises:
            BadStore: no store, or one that is damaged.
        """
        return Results(self.entries(), self._read_record)

    def record(self, entry: Entry) -> Record:
        """The record of an entry, as it was stored.

        Raises:
            BadStore: it has none (a note, a withdrawal), or the evidence is missing or changed.
        """
        if entry.record is None:
            raise BadStore(f"entry {entry.number} ({entry.kind}) has no record")
        return self._read_record(entry.record)

    def evidence(self, entry: Entry) -> dict[str, Path]:
        """The files that an entry rests on, by role, and its record."""
        files = dict(entry.evidence) | ({} if entry.record is None else {"record": entry.record})
        return {role: evidence.evidence_path(self.folder, sha256) for role, sha256 in files.items()}

    def head(self) -> tuple[int, str]:
        """Number and hash of the last entry. Noted elsewhere, it lets ``audit`` find an end that was cut off.

        Raises:
            BadStore: no store, or one that is damaged.
        """
        with database.reading(self.folder) as connection:
            last = connection.execute("SELECT number, hash FROM entry ORDER BY number DESC LIMIT 1").fetchone()
            (identity,) = connection.execute("SELECT value FROM meta WHERE name = 'id'").fetchone()
            return last or (0, genesis(identity))

    def backup(self, target: Path | str) -> int:
        """Copy the store into a folder while others use it, or bring an earlier copy up to date; entries in the copy.

        The copy is whole at any moment: a backup that was interrupted is finished by the next one.

        Raises:
            BadStore: the store is damaged, or the folder holds something else.
        """
        target = Path(target)
        if not (self.folder / database.NAME).is_file():
            raise BadStore(f"{self.folder}: found no results store; name the folder of one")
        target.mkdir(parents=True, exist_ok=True)
        with locked(target, self.timeout), replacing(target / database.NAME) as copy:
            with locked(self.folder, self.timeout):
                anchor = ledger.recover(self.folder)
                end = _end_of_copy(self.folder, target, anchor)
                entries = _copy_database(self.folder, copy)
            _copy_evidence(self.folder, target, entries)
            write_anchor(target, Anchor(anchor.id, *end, None, (anchor.number, anchor.head)))
        with locked(target, self.timeout):
            return ledger.recover(target).number

    def audit(self, noted: tuple[str, ...] = (), advance: Advance = lambda done, total: None) -> Report:
        """Check every hash; ``noted``: heads written down earlier, which must be in the chain.

        ``advance`` is called with the files done and their number.
        """
        return audit(self.folder, noted, self.timeout, advance)

    def _refuse_second_withdrawal(self, entry: Entry) -> None:
        if entry.record is None:
            raise BadStore(
                f"entry {entry.number} withdraws entry {entry.about}: a withdrawal can't be withdrawn; "
                f"measure again, or give entry {entry.about} a record (truestand store correct)"
            )
        last = self.standing().last(entry.number)
        if last.record is None:
            raise BadStore(f"entry {entry.number} is withdrawn already, by entry {last.number}; nothing is left to do")

    def _read_record(self, sha256: str) -> Record:
        record: Record = json.loads(evidence.read_evidence(self.folder, sha256))
        return record

    def _append(
        self, kind: str, record: Mapping[str, Any] | None, files: Mapping[str, Path], *,
        about: int | None = None, operator: str | None, text: str | None, time: str | None,
    ) -> Entry:  # fmt: skip
        identity = identity_of(record or {})
        with locked(self.folder, self.timeout):
            evidence.remove_incoming(self.folder)
            anchor = ledger.recover(self.folder)
            kept = {role: evidence.keep_file(self.folder, Path(path)) for role, path in files.items()}
            _refuse_other_evidence(record or {}, kept)
            # the bytes of the record's own file, so that both have one hash
            sha256 = None if record is None else evidence.keep(self.folder, BytesIO(record_text(record).encode()))
            values = identity | {
                "kind": kind, "time": time or now(), "operator": operator or identity["operator"], "record": sha256,
                "evidence": kept, "about": about, "text": text, "software": SOFTWARE,
            }  # fmt: skip
            return ledger.append(self.folder, anchor, values)

    def _create(self) -> None:
        """Make the store, or finish one whose maker died; another process may have been faster."""
        if ledger.has_anchor(self.folder):
            ledger.recover(self.folder)
        elif (self.folder / database.NAME).exists():
            raise BadStore(f"{self.folder}: found a database without its anchor; run truestand audit")
        else:
            ledger.create(self.folder, secrets.token_hex(16))


def _refuse_other_evidence(record: Mapping[str, Any], kept: Mapping[str, str]) -> None:
    """Refuse evidence that isn't the file the record was made from."""
    for role in ("scan", "calibration"):
        named = (record.get(role) or {}).get("sha256")
        if named and kept.get(role, named) != named:
            raise BadStore(
                f"found another {role} ({kept[role][:12]}) than the result was made from ({named[:12]}): "
                "the file changed since; run the command again"
            )
