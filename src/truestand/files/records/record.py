"""What all records share: the scan they rest on, their time, and how they are read back."""

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from truestand._version import __version__
from truestand.core.calibration import ScanSummary
from truestand.core.errors import UnreadableFile
from truestand.files.json_text import parse_json

Record = dict[str, Any]

SOFTWARE = f"truestand {__version__}"
"""What wrote a record."""


def now() -> str:
    """The time as records carry it: ISO, UTC, seconds."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


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
