"""What all records share: the scan they rest on, their time, and how they are read back."""

import math
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from truestand._version import __version__
from truestand.core.assumptions import Assumption, better
from truestand.core.calibration import ScanSummary
from truestand.core.errors import UnreadableFile
from truestand.core.message import UNTIED, Message
from truestand.files.json_text import parse_json

Record = dict[str, Any]

NO_CODE = "uncoded"
"""Of a reason or remark of a record of version 1, or of the user's own."""
CODES_OF_VERSION_1 = {str(UNTIED): UNTIED.code}
"""Codes of the sentences of version 1 that decide something."""
SOFTWARE = f"truestand {__version__}"
"""What wrote a record."""


def now() -> str:
    """The time as records carry it: ISO, UTC, seconds."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def is_past(until: str | None, now: datetime) -> bool:
    """Whether an ISO date is over; a day without a time counts to its end, and what is no date is over."""
    if not until:
        return False
    try:
        end = datetime.fromisoformat(until if "T" in until else f"{until}T23:59:59")
    except ValueError:
        return True
    return now > (end if end.tzinfo else end.replace(tzinfo=UTC))


def read_json(path: Path) -> Record:
    """A JSON object from a file.

    Raises:
        UnreadableFile: missing, no JSON, or no object.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong})") from wrong
    except UnicodeDecodeError as wrong:
        raise UnreadableFile(f"{path}: no JSON ({wrong})") from wrong
    record = parse_json(text, str(path), "give a record written by truestand")
    if not isinstance(record, dict):
        raise UnreadableFile(f"{path}: found JSON that is no object; give a record written by truestand")
    return record


def scan_record(s: ScanSummary) -> Record:
    """Which scan a record rests on."""
    return {
        "sha256": s.sha256,
        "profiles": s.profiles,
        "points": s.points,
        "revolutions": s.revolutions,
        "seen": s.seen,
    }


def messages_record(messages: Iterable[str]) -> list[Record]:
    """Reasons or remarks, each with its code; a plain sentence of the user's own has none."""
    return [{"code": m.code if isinstance(m, Message) else NO_CODE, "text": str(m)} for m in messages]


def assumptions_record(assumptions: Iterable[Assumption]) -> list[Record]:
    """What nobody stated: each with value, unit and source, which says how to do better, too."""
    return [
        {"name": a.name, "value": a.value, "unit": a.unit, "source": "; ".join(filter(None, (a.source, better((a,)))))}
        for a in assumptions
    ]


def read_messages(items: Iterable[Any]) -> tuple[Message, ...]:
    """Reasons or remarks of a record, of records of version 1 too, which have no codes.

    Raises:
        TypeError, KeyError: they are neither.
    """
    return tuple(
        Message(CODES_OF_VERSION_1.get(item, NO_CODE), item)
        if isinstance(item, str)
        else Message(str(item["code"]), str(item["text"]))
        for item in items
    )


def texts_of(record: Mapping[str, Any], key: str = "reasons") -> list[str]:
    """The sentences of a record's reasons or remarks, of any version."""
    return [str(m) for m in read_messages(record.get(key) or ())]


def without_nan(record: Record) -> Record:
    """The record with null where a number is not known: never NaN or infinity in a record."""
    return {key: _finite(value) for key, value in record.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return without_nan(value)
    if isinstance(value, list):
        return [_finite(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
