"""``store.db``: the entries in SQLite. Nothing is ever updated or deleted; triggers refuse it.

Readers open it read-only and leave every byte as it is. Writers hold the store's lock; what they write is moved from
the log into the file before they let go, so that the file at rest is one file with one hash.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from truestand.core.errors import BadStore
from truestand.files.scans.read import sha256_of
from truestand.store.lock import is_read_only

NAME = "store.db"
READER_TIMEOUT_S = 5.0
"""Wait for a reader; a longer one leaves the database unsealed until the next entry."""

_FIRST = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE entry (number INTEGER PRIMARY KEY, kind TEXT NOT NULL, time TEXT NOT NULL, body TEXT NOT NULL,
  hash TEXT NOT NULL UNIQUE);
CREATE INDEX entry_by_kind ON entry (kind, time);
CREATE TRIGGER meta_update BEFORE UPDATE ON meta BEGIN SELECT RAISE(ABORT, 'append only'); END;
CREATE TRIGGER meta_delete BEFORE DELETE ON meta BEGIN SELECT RAISE(ABORT, 'append only'); END;
CREATE TRIGGER meta_insert BEFORE INSERT ON meta WHEN EXISTS (SELECT 1 FROM meta WHERE name = NEW.name)
  BEGIN SELECT RAISE(ABORT, 'append only'); END;
CREATE TRIGGER entry_update BEFORE UPDATE ON entry BEGIN SELECT RAISE(ABORT, 'append only'); END;
CREATE TRIGGER entry_delete BEFORE DELETE ON entry BEGIN SELECT RAISE(ABORT, 'append only'); END;
CREATE TRIGGER entry_order BEFORE INSERT ON entry
  WHEN NEW.number IS NOT (SELECT coalesce(max(number), 0) + 1 FROM entry)
    OR EXISTS (SELECT 1 FROM entry WHERE hash = NEW.hash)
  BEGIN SELECT RAISE(ABORT, 'append only'); END;
"""
MIGRATIONS: tuple[str, ...] = (_FIRST,)
"""Statements that lead from schema version 0 to 1, from 1 to 2 and so on."""

Row = tuple[int, str, str, str, str]
"""number, kind, time, body, hash."""


@contextmanager
def reading(folder: Path) -> Iterator[sqlite3.Connection]:
    """A connection that can't change a byte; where the folder can only be read, it is taken that nobody writes.

    Raises:
        BadStore: no store, or no database.
    """
    path = (folder / NAME).absolute()
    if not path.is_file():
        raise BadStore(f"{folder}: found no results store; name the folder of one, or create it by storing a result")
    with connected(path, f"?mode=ro{'&immutable=1' * is_read_only(folder)}") as connection:
        yield connection


@contextmanager
def writing(folder: Path) -> Iterator[sqlite3.Connection]:
    """A connection to write with, under the store's lock: statements count at once unless in a transaction.

    Raises:
        BadStore: SQLite's errors in one line.
    """
    with connected(folder / NAME, isolation_level=None) as connection:
        connection.executescript(
            "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; "
            "PRAGMA wal_autocheckpoint = 0; PRAGMA trusted_schema = OFF;"
        )
        yield connection


@contextmanager
def connected(path: Path, query: str = "", **options: Any) -> Iterator[sqlite3.Connection]:
    """A connection to a database's file that is closed in the end; ``query`` is that of its URI.

    Raises:
        BadStore: SQLite's errors in one line.
    """
    uri = path.absolute().as_uri() + query
    try:
        with closing(sqlite3.connect(uri, uri=True, timeout=READER_TIMEOUT_S, **options)) as connection:
            yield connection
    except (sqlite3.Error, UnicodeDecodeError) as wrong:
        raise BadStore(f"{path}: {wrong}; run truestand audit") from wrong


def migrate(connection: sqlite3.Connection, identity: str) -> None:
    """Bring the schema to this version in one transaction; a new database gets its id."""
    found = version_of(connection)
    script = "".join(MIGRATIONS[found:])
    named = f"INSERT INTO meta VALUES ('id', '{identity}');" if found == 0 else ""
    connection.executescript(f"BEGIN IMMEDIATE;{script}{named}PRAGMA user_version = {len(MIGRATIONS)};COMMIT;")


def version_of(connection: sqlite3.Connection) -> int:
    """The schema version of a database; 0: empty.

    Raises:
        BadStore: it is newer than this truestand.
    """
    found = int(connection.execute("PRAGMA user_version").fetchone()[0])
    if found > len(MIGRATIONS):
        raise BadStore(f"found a store of version {found}, this truestand reads up to {len(MIGRATIONS)}; update it")
    return found


def rows_of(connection: sqlite3.Connection, where: str = "", values: tuple[object, ...] = ()) -> list[Row]:
    """Entries in their order."""
    return list(connection.execute(f"SELECT number, kind, time, body, hash FROM entry {where} ORDER BY number", values))


def file_hash(folder: Path) -> str | None:
    """SHA-256 of the database; None where there is none, or where a log beside it holds more."""
    path, log = folder / NAME, folder / f"{NAME}-wal"
    unknown = not path.is_file() or (log.exists() and log.stat().st_size > 0)
    return None if unknown else sha256_of(path)
