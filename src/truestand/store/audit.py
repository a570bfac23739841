"""Whether a store is what it was: every byte of the database and the anchor, every entry and its chain, every file."""

import sqlite3
from collections.abc import Callable
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from truestand.core.errors import BadStore
from truestand.files.scans.read import sha256_of
from truestand.store import anchor as anchors
from truestand.store import database
from truestand.store.entry import Entry, entry_of, genesis, hash_of
from truestand.store.evidence import EVIDENCE, evidence_path
from truestand.store.lock import is_read_only, locked

Advance = Callable[[int, int], None]
"""Called with the files done and their number."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that isn't as it was written."""

    what: str
    """A key of ``FINDINGS``."""
    where: str
    """File, entry, or both."""
    detail: str = ""


FINDINGS = {
    "anchor missing": "anchor.json is gone: nothing says how the store ended",
    "anchor changed": "anchor.json isn't as it was written",
    "database changed": "store.db differs from the hash that the anchor has",
    "database unreadable": "SQLite can't read store.db, or finds its structure damaged",
    "protection removed": "the triggers that refuse changes, or the tables, aren't as they were made",
    "entry changed": "an entry differs from its own hash",
    "chain broken": "an entry isn't chained to the one before: one was removed, moved or put in",
    "end missing": "the store ends before the entry that the anchor names, or with another one",
    "evidence missing": "a file that an entry rests on is gone",
    "evidence changed": "a file isn't what its name says",
    "noted head missing": "an entry whose hash was written down elsewhere isn't in the store",
}


@dataclass(frozen=True, slots=True)
class Report:
    """What an audit found and how far it could look."""

    findings: tuple[Finding, ...]
    entries: int
    files: int
    head: tuple[int, str] | None
    """Number and hash of the last entry."""
    sealed: bool
    """False: a write was interrupted; the entries were checked, the database's bytes between them weren't."""

    @property
    def sound(self) -> bool:
        """Whether nothing was found."""
        return not self.findings


def audit(
    folder: Path, noted: tuple[str, ...] = (), timeout: float = 60.0, advance: Advance = lambda done, total: None
) -> Report:
    """Check a store against itself and against heads that were noted elsewhere. It writes nothing.

    Raises:
        BadStore: no store here, one of a newer version, or one that is busy too long.
    """
    if not (folder / database.NAME).is_file() and not (folder / anchors.NAME).is_file():
        raise BadStore(f"{folder}: found no results store; name the folder of one")
    findings: list[Finding] = []
    with nullcontext() if is_read_only(folder) else locked(folder, timeout):  # no writer meanwhile
        anchor = _anchor(folder, findings)
        if anchor is not None and anchor.sealed and database.file_hash(folder) != anchor.file:
            findings.append(Finding("database changed", database.NAME))
        rows = _rows(folder, findings)
    entries = _chain(rows, anchor, findings)
    end = (entries[-1].number, entries[-1].hash) if entries else None
    _end(end, anchor, findings)
    hashes = {e.hash for e in entries}
    findings += [Finding("noted head missing", h) for h in noted if not any(x.startswith(h) for x in hashes if h)]
    files = _evidence(folder, entries, findings, advance)
    return Report(tuple(findings), len(entries), files, end, anchor is not None and anchor.sealed)


def _anchor(folder: Path, findings: list[Finding]) -> anchors.Anchor | None:
    try:
        return anchors.read_anchor(folder)
    except FileNotFoundError:
        findings.append(Finding("anchor missing", anchors.NAME))
    except BadStore:
        findings.append(Finding("anchor changed", anchors.NAME))
    return None


def _rows(folder: Path, findings: list[Finding]) -> list[database.Row]:
    """All entries that SQLite can read, after it looked at the file's structure."""
    try:
        with database.reading(folder) as connection:
            return _readable(connection, findings)
    except BadStore as wrong:
        if "update it" in str(wrong) and not findings:
            raise
        findings.append(Finding("database unreadable", database.NAME, str(wrong)))
        return []


def _readable(connection: sqlite3.Connection, findings: list[Finding]) -> list[database.Row]:
    version = database.version_of(connection)
    problems = [str(line) for (line,) in connection.execute("PRAGMA integrity_check(10)") if line != "ok"]
    findings += [Finding("database unreadable", database.NAME, problem) for problem in problems]
    if _schema(connection) != _schema_as_made(version):
        findings.append(Finding("protection removed", database.NAME))
    return database.rows_of(connection)


def _schema(connection: sqlite3.Connection) -> list[object]:
    return sorted(connection.execute("SELECT type, name, tbl_name, sql FROM sqlite_master").fetchall(), key=str)


def _schema_as_made(version: int) -> list[object]:
    with closing(sqlite3.connect(":memory:")) as made:
        made.executescript("".join(database.MIGRATIONS[:version]))
        return _schema(made)


def _chain(rows: list[database.Row], anchor: anchors.Anchor | None, findings: list[Finding]) -> list[Entry]:
    """The entries that are what their hash says; the chain is followed over those that aren't.

    A damaged database may hold anything anywhere: nothing of a row is taken for what it ought to be.
    """
    entries = []
    previous = None if anchor is None else genesis(anchor.id)
    expected = 1
    for row in rows:
        where = f"entry {row[0]}"
        entry = _entry(row)
        if entry is None:
            findings.append(Finding("entry changed", where))
        else:
            entries.append(entry)
            if previous is not None and entry.previous != previous:
                findings.append(Finding("chain broken", where, "it isn't chained to the entry before"))
        if row[0] != expected:
            findings.append(Finding("chain broken", where, f"it stands where entry {expected} should"))
        expected, previous = (entry.number if entry is not None else expected) + 1, row[4]
    return entries


def _entry(row: database.Row) -> Entry | None:
    number, kind, time, body, stated_hash = row
    try:
        if not isinstance(body, str) or hash_of(body) != stated_hash:
            return None
        entry = entry_of(body, stated_hash)
    except (KeyError, TypeError, ValueError):
        return None
    return entry if (entry.number, entry.kind, entry.time) == (number, kind, time) else None


def _end(end: tuple[int, str] | None, anchor: anchors.Anchor | None, findings: list[Finding]) -> None:
    """Hold the last entry against the anchor: what a shortened chain alone doesn't show."""
    if anchor is None:
        return
    found = end or (0, genesis(anchor.id))
    if found not in [(anchor.number, anchor.head), anchor.pending]:
        findings.append(Finding("end missing", f"entry {anchor.number}", f"the store ends with entry {found[0]}"))


def _evidence(folder: Path, entries: list[Entry], findings: list[Finding], advance: Advance) -> int:
    """Hash every file there is, and look for those that ought to be; how many there are."""
    needed: dict[str, int] = {}
    for entry in entries:
        for sha256 in entry.files:
            needed.setdefault(sha256, entry.number)
    found = sorted(p for p in (folder / EVIDENCE).glob("*/*") if p.is_file())
    for k, path in enumerate(found):
        advance(k, len(found))
        if sha256_of(path) != path.name or path != evidence_path(folder, path.name):
            by = f", entry {needed[path.name]}" if path.name in needed else ""
            findings.append(Finding("evidence changed", f"{EVIDENCE}/{path.parent.name}/{path.name}{by}"))
    present = {path.name for path in found}
    for sha256, number in needed.items():
        if sha256 not in present:
            findings.append(Finding("evidence missing", f"{EVIDENCE}/{sha256[:2]}/{sha256}, entry {number}"))
    return len(found)
