"""How an entry gets into the store: nothing else writes to it.

Under the lock: the anchor says what is about to come, the database commits it, is brought to rest and hashed, the
anchor says what there is. A writer that dies anywhere in between leaves an anchor that says so, and the next one checks
the whole chain before it goes on.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from truestand.core.errors import BadStore
from truestand.store import database
from truestand.store.anchor import NAME, Anchor, read_anchor, write_anchor
from truestand.store.entry import Entry, entry_of, genesis, new_entry


def recover(folder: Path) -> Anchor:
    """Finish what a writer that died had begun, the schema too; the anchor of a store that may now be written to.

    Raises:
        BadStore: the database isn't what the anchor says, or its chain is broken.
    """
    anchor = read_anchor(folder)
    if anchor.sealed:
        if database.file_hash(folder) != anchor.file:
            raise _damaged(folder, "changed since the last entry")
        return anchor
    with database.writing(folder) as connection:
        if database.version_of(connection) < len(database.MIGRATIONS):
            database.migrate(connection, anchor.id)
        if connection.execute("PRAGMA integrity_check(1)").fetchone() != ("ok",):
            raise _damaged(folder, "its structure is damaged")
        end = _chain(folder, anchor.id, database.rows_of(connection))
    if end not in ((anchor.number, anchor.head), anchor.pending):
        raise _damaged(folder, f"it ends with entry {end[0]}, the anchor says {anchor.number}")
    return _seal(folder, Anchor(anchor.id, *end))


def append(folder: Path, anchor: Anchor, values: Mapping[str, object]) -> Entry:
    """Add one entry under ``anchor``, as ``recover`` gave it; it is on the disk when this returns."""
    entry, body = new_entry(**values, number=anchor.number + 1, previous=anchor.head)
    following = (entry.number, entry.hash)
    write_anchor(folder, replace(anchor, pending=following))
    with database.writing(folder) as connection:
        connection.execute(
            "INSERT INTO entry VALUES (?, ?, ?, ?, ?)", (entry.number, entry.kind, entry.time, body, entry.hash)
        )
    _seal(folder, Anchor(anchor.id, *following))
    return entry


def create(folder: Path, identity: str) -> None:
    """An empty store in a folder; under the lock."""
    first = genesis(identity)
    write_anchor(folder, Anchor(identity, 0, first, None, (0, first)))
    recover(folder)


def migrate(folder: Path) -> None:
    """Bring an older store's database to this version; the entries stay as they are. Under the lock."""
    anchor = recover(folder)
    write_anchor(folder, replace(anchor, pending=(anchor.number, anchor.head)))
    recover(folder)


def has_anchor(folder: Path) -> bool:
    """Whether there is a store here, or the beginning of one."""
    return (folder / NAME).exists()


def _seal(folder: Path, anchor: Anchor) -> Anchor:
    """Move all that was written into the database's file and put its hash into the anchor."""
    with database.writing(folder) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()  # a long reader leaves the file without a hash
    seal = replace(anchor, file=database.file_hash(folder), pending=None)
    write_anchor(folder, seal)
    return seal


def _chain(folder: Path, identity: str, rows: list[database.Row]) -> tuple[int, str]:
    """Number and hash of the last entry of an unbroken chain."""
    end = (0, genesis(identity))
    for number, _, _, body, stated_hash in rows:
        entry = entry_of(body, stated_hash)
        if (number, entry.number, entry.previous) != (end[0] + 1, end[0] + 1, end[1]):
            raise _damaged(folder, f"entry {number} doesn't follow entry {end[0]}")
        end = (number, stated_hash)
    return end


def _damaged(folder: Path, what: str) -> BadStore:
    return BadStore(f"{folder / database.NAME}: {what}; run truestand audit, then restore a backup")
