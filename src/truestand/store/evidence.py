"""Files by what they hold: ``evidence/ab/ab12...``, named by SHA-256, written once, read-only.

They are copied to ``incoming/`` first, hashed on the way, brought to the disk and only then given their name.
"""

import hashlib
import os
import tempfile
from pathlib import Path
from typing import IO

from truestand.core.errors import BadStore
from truestand.files.scans.read import sha256_of
from truestand.store.anchor import sync_folder

EVIDENCE, INCOMING = "evidence", "incoming"
BLOCK_BYTES = 1 << 20


def evidence_path(folder: Path, sha256: str) -> Path:
    """Where the evidence with this hash lies."""
    return folder / EVIDENCE / sha256[:2] / sha256


def keep_file(folder: Path, source: Path) -> str:
    """Keep a copy of a file; its SHA-256.

    Raises:
        BadStore: what the store already holds under this name isn't what it was.
    """
    with source.open("rb") as file:
        return keep(folder, file)


def read_evidence(folder: Path, sha256: str) -> bytes:
    """What was kept under this hash.

    Raises:
        BadStore: missing, or not what it was.
    """
    path = evidence_path(folder, sha256)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise BadStore(f"{path}: missing; restore it from a backup") from None
    if hashlib.sha256(data).hexdigest() != sha256:
        raise BadStore(f"{path}: changed since it was kept; run truestand audit and restore it from a backup")
    return data


def remove_incoming(folder: Path) -> None:
    """Remove the incomplete files of writers that died; only under the lock."""
    for path in (*(folder / INCOMING).glob("*"), *folder.glob(".*.part")):
        path.unlink(missing_ok=True)


def keep(folder: Path, source: IO[bytes]) -> str:
    """Keep what an open file holds; its SHA-256.

    Raises:
        BadStore: as ``keep_file``.
    """
    (folder / INCOMING).mkdir(exist_ok=True)
    digest = hashlib.sha256()
    with tempfile.NamedTemporaryFile(dir=folder / INCOMING, delete=False) as file:
        temporary = Path(file.name)
        try:
            while block := source.read(BLOCK_BYTES):
                digest.update(block)
                file.write(block)
            file.flush()
            os.fsync(file.fileno())
            file.close()
            return _name(folder, temporary, digest.hexdigest())
        finally:
            temporary.unlink(missing_ok=True)


def _name(folder: Path, temporary: Path, sha256: str) -> str:
    path = evidence_path(folder, sha256)
    if path.exists():
        if sha256_of(path) != sha256:
            raise BadStore(f"{path}: changed since it was kept; run truestand audit and restore it from a backup")
        return sha256
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary.chmod(0o444)
    temporary.replace(path)
    for changed in (path.parent, folder / EVIDENCE, folder):
        sync_folder(changed)
    return sha256
