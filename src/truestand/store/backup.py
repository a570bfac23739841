"""A copy of the store while others use it: the database as it is at one moment, then the evidence it names."""

from pathlib import Path

from truestand.core.errors import BadStore
from truestand.files.atomic import replacing
from truestand.store import database, ledger, lock
from truestand.store.anchor import Anchor, read_anchor, write_anchor
from truestand.store.entry import Entry, entry_of, genesis
from truestand.store.evidence import EVIDENCE, INCOMING, evidence_path, keep_file
from truestand.store.lock import locked


def back_up(folder: Path, target: Path, timeout: float) -> int:
    """Copy a store or bring its copy up to date; the number of entries in the copy.

    The copy is whole at any moment: a backup that was interrupted is finished by the next one.

    Raises:
        BadStore: the store is damaged, or ``target`` holds something else.
    """
    if not (folder / database.NAME).is_file():
        raise BadStore(f"{folder}: found no results store; name the folder of one")
    target.mkdir(parents=True, exist_ok=True)
    with locked(target, timeout), replacing(target / database.NAME) as copy:
        with locked(folder, timeout):
            anchor = ledger.recover(folder)
            end = _end_of_copy(folder, target, anchor)
            entries = _copy_database(folder, copy)
        _copy_evidence(folder, target, entries)
        write_anchor(target, Anchor(anchor.id, *end, None, (anchor.number, anchor.head)))
    with locked(target, timeout):
        return ledger.recover(target).number


def _end_of_copy(folder: Path, target: Path, anchor: Anchor) -> tuple[int, str]:
    """Number and hash of the last entry in the copy so far.

    Raises:
        BadStore: ``target`` is no earlier copy of this store.
    """
    start = (0, genesis(anchor.id))
    if not ledger.has_anchor(target):
        begun = (lock.NAME, EVIDENCE, INCOMING)
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
    with database.reading(folder) as source, database.copying(copy) as destination:
        source.backup(destination)
        return [entry_of(row[3], row[4]) for row in database.rows_of(source)]


def _copy_evidence(folder: Path, target: Path, entries: list[Entry]) -> None:
    """What the copied entries name and the target lacks; each file is checked on its way."""
    for sha256 in dict.fromkeys(sha256 for entry in entries for sha256 in entry.files):
        if evidence_path(target, sha256).exists():
            continue
        source = evidence_path(folder, sha256)
        if not source.exists():
            raise BadStore(f"{source}: missing; run truestand audit")
        if keep_file(target, source) != sha256:
            raise BadStore(f"{source}: changed since it was kept; run truestand audit")
