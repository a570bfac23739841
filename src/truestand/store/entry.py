"""One entry of the store: who measured what, when, on what evidence, chained to the entry before it.

The body is canonical JSON, and its SHA-256 is the entry's hash. A body once written never changes, not by a migration
either; a reader understands the bodies of every version ever written.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

from truestand.core.errors import BadStore

VERSION = 1
RESULTS = ("calibration", "verification", "inspection", "scan")


@dataclass(frozen=True, slots=True)
class Entry:
    """What the store knows of one result without opening its record."""

    number: int
    """From 1, without a gap."""
    kind: str
    """One of ``RESULTS``, or correction, or note."""
    time: str
    """ISO, UTC."""
    previous: str
    """Hash of the entry before; of the store's id for the first."""
    hash: str
    operator: str | None = None
    order: str | None = None
    serial: str | None = None
    """Of the part or the artefact."""
    part: str | None = None
    """Name of the part or the artefact."""
    status: str | None = None
    """The record's verdict or status."""
    record: str | None = None
    """SHA-256 of the record's file; None: a note, or a withdrawal."""
    evidence: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """SHA-256 by role: scan, stand, artefact, part, calibration, report."""
    about: int | None = None
    """The entry that a correction replaces or a note speaks of."""
    text: str | None = None
    """The reason of a correction, the note."""
    software: str = ""
    version: int = VERSION

    @property
    def files(self) -> tuple[str, ...]:
        """SHA-256 of all that it rests on, its record first."""
        return (*(() if self.record is None else (self.record,)), *self.evidence.values())


def canonical(value: Mapping[str, Any]) -> str:
    """The one way to write a JSON object: keys sorted, no spaces, no NaN."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def hash_of(text: str) -> str:
    """SHA-256 of a text in UTF-8."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def genesis(identity: str) -> str:
    """What the first entry of the store with this id is chained to."""
    return hash_of(f"truestand.store {identity}")


def new_entry(**values: Any) -> tuple[Entry, str]:
    """A new entry and its body; values left out are null."""
    keys = (f.name for f in fields(Entry) if f.name != "hash")
    body = canonical({key: values.get(key) for key in keys} | {"version": VERSION})
    return entry_of(body, hash_of(body)), body


def entry_of(body: str, stated_hash: str) -> Entry:
    """The entry of a stored body.

    Raises:
        BadStore: the body isn't the one that ``stated_hash`` is of, or was written by a newer version.
    """
    if hash_of(body) != stated_hash:
        raise BadStore(f"an entry of the store differs from its hash {stated_hash[:12]}; run truestand audit")
    values = json.loads(body)
    if values["version"] > VERSION:
        raise BadStore(
            f"found an entry of version {values['version']}, this truestand reads up to {VERSION}; update it"
        )
    evidence = MappingProxyType(dict(values.pop("evidence") or {}))
    return Entry(hash=stated_hash, evidence=evidence, **values)


def identity_of(record: Mapping[str, Any]) -> dict[str, str | None]:
    """Part, serial, order, operator and status, as the record of any kind has them."""
    about: Mapping[str, Any] = record.get("part") or record.get("artefact") or {}
    found = {key: about.get(key) for key in ("serial", "order", "operator")}
    found |= {"part": about.get("name"), "status": record.get("verdict") or record.get("status")}
    return {key: None if value is None else str(value) for key, value in found.items()}
