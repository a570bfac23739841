"""Scans of any readable format, told apart by their content, never by their suffix."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.core.scan import Recording, Scan, interpret, table_angle
from truestand.core.stand import Stand
from truestand.files.lines import BYTE_ORDER_MARK
from truestand.files.long_csv import is_long_csv, read_long_csv
from truestand.files.native import is_native, read_native
from truestand.files.text import check_text
from truestand.files.xyz_blocks import is_xyz_blocks, read_xyz_blocks

HEAD = 65_536


def read_scan(path: Path | str, stand: Stand | None = None, start_angle: float | None = None) -> Scan:
    """A scan file as seen on ``stand`` (default: the stand that a native file carries).

    ``start_angle`` (rad): table angle of the first profile, for scans without an angle of their own.

    Raises:
        UnreadableFile: no scan.
        BadRecipe: no stand, or one that lacks what the angle needs.
    """
    return interpret(read_recording(path), stand, start_angle)


def read_recording(path: Path | str) -> Recording:
    """A scan file's own content, before a stand says what it means.

    Raises:
        UnreadableFile: missing, empty, truncated, binary, foreign or ambiguous; with the line where there is one.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
        if is_native(head):
            return read_native(path, sha256_of(path))
        if is_long_csv(head):
            return read_long_csv(path)
        check_text(head.removeprefix(BYTE_ORDER_MARK), path.name)
        if is_xyz_blocks(head):
            return read_xyz_blocks(path, head)
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong}); check the path") from wrong
    raise UnreadableFile(f"{path.name}: the format is not known; readable scans are listed in docs/formats.md")


def sha256_of(path: Path | str) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def info(recording: Recording) -> dict[str, Any]:
    """What is in a scan (CONTRACT.md, ``info --json``); turns and angle source are null where no stand tells them."""
    revolutions, source = None, _own_source(recording)
    if recording.stand is not None:
        try:
            _, source = table_angle(recording, recording.stand)
            revolutions = interpret(recording).revolutions
        except BadRecipe:
            pass  # a stand that leaves the angle open: the scan is readable all the same
    elif recording.angle is not None:
        span = np.unwrap(recording.angle)
        n = span.size
        revolutions = float(abs(span[-1] - span[0]) / (2 * np.pi) * n / max(n - 1, 1))
    return {
        "format": recording.format,
        "profiles": int(recording.x.shape[0]),
        "points_per_profile": int(recording.x.shape[1]),
        "points_seen": int(np.count_nonzero(np.isfinite(recording.z) & np.isfinite(recording.x))),
        "revolutions": revolutions,
        "angle_source": source,
        "sha256": recording.sha256,
        **_recorded(recording),
    }


def _recorded(recording: Recording) -> dict[str, Any]:
    """What truestand said of its own recording; nothing for files that others wrote."""
    if recording.acquisition is None:
        return {}
    told = recording.acquisition
    return {key: told[key] for key in ("complete", "reasons", "lost_profiles", "recorded") if key in told}


def _own_source(recording: Recording) -> str | None:
    columns = (("encoder", recording.encoder), ("angle", recording.angle), ("time", recording.time))
    return next((name for name, values in columns if values is not None), None)
