"""The last entry and the database's hash, kept beside the database: it alone can't show that its end was cut off.

``anchor.json`` names the last entry and the SHA-256 of the database file. It is replaced as a whole, before a write
(with what is about to come) and after it. Its text has one possible form, so that a change of any bit is noticed.
"""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from truestand.core.errors import BadStore
from truestand.files.atomic import write_text_atomic
from truestand.store.entry import canonical, hash_of

NAME = "anchor.json"
FORMAT = "truestand.store"


@dataclass(frozen=True, slots=True)
class Anchor:
    """How the store ends."""

    id: str
    number: int
    """Of the last entry; 0: none yet."""
    head: str
    """Its hash."""
    file: str | None = None
    """SHA-256 of the database; None: not known, because another program was reading it."""
    pending: tuple[int, str] | None = None
    """Number and hash of the entry that is being written; stays where the writer died."""

    @property
    def sealed(self) -> bool:
        """Whether the hash of the whole database is known and no write was interrupted."""
        return self.file is not None and self.pending is None


def anchor_text(anchor: Anchor) -> str:
    """The one text of an anchor."""
    body = {"format": FORMAT, **asdict(anchor)}
    return canonical(body | {"check": hash_of(canonical(body))}) + "\n"


def read_anchor(folder: Path) -> Anchor:
    """The store's anchor.

    Raises:
        FileNotFoundError: there is none.
        BadStore: it isn't as it was written.
    """
    data = (folder / NAME).read_bytes()
    try:
        values: dict[str, Any] = json.loads(data.decode("utf-8"))
        pending = None if values["pending"] is None else (values["pending"][0], values["pending"][1])
        anchor = Anchor(values["id"], values["number"], values["head"], values["file"], pending)
        if anchor_text(anchor).encode("utf-8") == data:
            return anchor
    except (ValueError, KeyError, TypeError, IndexError, RecursionError):
        pass
    raise BadStore(f"{folder / NAME}: changed since it was written; run truestand audit, then restore a backup")


def write_anchor(folder: Path, anchor: Anchor) -> None:
    """Replace the anchor, on the disk when this returns."""
    write_text_atomic(folder / NAME, anchor_text(anchor))
    sync_folder(folder)


def sync_folder(folder: Path) -> None:
    """Make sure that the names in a folder are on the disk; Windows does so by itself."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
