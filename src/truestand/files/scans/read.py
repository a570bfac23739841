"""Scans of any readable format, told apart by their content, never by their suffix."""

import difflib
import hashlib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.core.scan import Recording, Scan, interpret, table_angle
from truestand.core.stand import Stand
from truestand.files.kinds import refuse_other_kind
from truestand.files.scans.gocator import gocator_recordings, is_gocator
from truestand.files.scans.joescan import GZIP, is_joescan, joescan_recordings
from truestand.files.scans.long_csv import is_long_csv, read_long_csv
from truestand.files.scans.native import is_native, read_native
from truestand.files.scans.scancontrol_raw import RawLayout, points_of, read_scancontrol_raw
from truestand.files.scans.sick_json import is_sick_json, read_sick_json
from truestand.files.scans.xyz_blocks import is_xyz_blocks, read_xyz_blocks
from truestand.files.text import BYTE_ORDER_MARK, check_text

HEAD_BYTES = 65_536
ACQUIRED = ("complete", "reasons", "lost_profiles", "recorded")
"""What truestand says of its own recordings, and files that others wrote don't."""
PER_RECORDING = ("profiles", "points_per_profile", "points_seen", "revolutions", "angle_source")
Recordings = Mapping[str, Callable[[], Recording]]
"""What a file holds, by name, each to be read when called for; the name is empty where a format holds but one."""


def read_scan(
    path: Path | str, stand: Stand | None = None, start_angle: float | None = None, view: str | None = None
) -> Scan:
    """A scan file as seen on ``stand`` (default: the stand that a native file carries).

    ``start_angle`` (rad): table angle of the first profile, for scans without an angle of their own; ``view``: which of
    several sensors took it, where the file doesn't say.

    Raises:
        UnreadableFile: no scan.
        BadRecipe: no stand, or one that lacks what the angle needs.
    """
    return interpret(read_recording(path), stand, start_angle, view)


def read_recording(path: Path | str, pick: str | None = None, layout: RawLayout | None = None) -> Recording:
    """A scan file's own content, before a stand says what it means.

    ``pick`` names one recording of a file that holds several; ``layout`` is what a raw dump doesn't say of itself.

    Raises:
        UnreadableFile: missing, empty, truncated, binary, foreign or ambiguous; with the line where there is one.
        BadRecipe: no such recording, or several and no choice; the message names them.
    """
    path = Path(path)
    try:
        return _picked(recordings(path, layout), pick, path.name)()
    except OSError as wrong:
        raise _unopened(path, wrong) from wrong


def recordings(path: Path | str, layout: RawLayout | None = None) -> Recordings:
    """What a scan file holds.

    Raises:
        UnreadableFile, BadRecipe: as ``read_recording``, here or when a recording is called for.
    """
    path = Path(path)
    try:
        if layout is not None:
            return {"": partial(read_scancontrol_raw, path, layout)}
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        return _by_content(path, head)
    except OSError as wrong:
        raise _unopened(path, wrong) from wrong


def _by_content(path: Path, head: bytes) -> Recordings:
    if is_joescan(head):
        return joescan_recordings(path)
    if is_gocator(head):
        return gocator_recordings(path)
    for known, read in (
        (is_native, lambda: read_native(path, sha256_of(path))),
        (is_long_csv, partial(read_long_csv, path)),
        (is_sick_json, partial(read_sick_json, path)),
    ):
        if known(head):
            return {"": read}
    _refuse_binary(path, head)
    if is_xyz_blocks(head):
        return {"": partial(read_xyz_blocks, path, head)}
    raise UnreadableFile(f"{path.name}: the format is not known; readable scans are listed in docs/formats.md")


def _refuse_binary(path: Path, head: bytes) -> None:
    """Refuse what is no text, with what it looks like."""
    if head.startswith(GZIP):
        raise UnreadableFile(f"{path.name}: found a gzip file that is no JoeScan recording; unpack it first")
    if points := points_of(head, path.stat().st_size):
        raise UnreadableFile(
            f"{path.name}: found what looks like a raw dump of a scanCONTROL sensor with {points} points; name "
            f"the sensor's type: truestand import {path.name} --raw-type 29xx-50 --points {points} -o scan.h5"
        )
    refuse_other_kind(head, path.name, "a scan; readable ones are listed in docs/formats.md")
    check_text(head.removeprefix(BYTE_ORDER_MARK), path.name)


def _picked(found: Recordings, pick: str | None, name: str) -> Callable[[], Recording]:
    names = list(found)
    if pick is None and len(found) == 1:
        return found[names[0]]
    if pick in found and pick:
        return found[pick]
    if names == [""]:
        raise BadRecipe(f"{name}: found --pick {pick!r}, but the file holds one recording; leave it out")
    if pick is None:
        raise BadRecipe(
            f"{name}: found {len(found)} recordings: {', '.join(names)}; take one out: "
            f"truestand import {name} --pick {names[0]} -o scan.h5"
        )
    near = difflib.get_close_matches(pick, names, n=1, cutoff=0.6)
    advice = f"did you mean {near[0]!r}?" if near else f"need one of {', '.join(names)}"
    raise BadRecipe(f"{name}: found --pick {pick!r}, which the file doesn't hold; {advice}")


def _unopened(path: Path, wrong: OSError) -> UnreadableFile:
    return UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong}); check the path")


def sha256_of(path: Path | str) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def info(recording: Recording) -> dict[str, Any]:
    """What is in a scan (CONTRACT.md, ``info --json``); turns and angle source are null where they are not known."""
    revolutions, source = None, _angle_column(recording)
    acquisition = recording.acquisition or {}
    if recording.stand is not None:
        try:
            _, source = table_angle(recording, recording.stand)
            revolutions = interpret(recording).revolutions
        except BadRecipe:
            pass  # a stand that leaves the angle open: the scan is readable all the same
    elif recording.angle is not None:
        angle = np.unwrap(recording.angle)
        steps = max(angle.size - 1, 1)
        revolutions = float(abs(angle[-1] - angle[0]) / (2 * np.pi) * angle.size / steps)
    return {
        "format": recording.format,
        "profiles": int(recording.x.shape[0]),
        "points_per_profile": int(recording.x.shape[1]),
        "points_seen": int(np.count_nonzero(np.isfinite(recording.z) & np.isfinite(recording.x))),
        "revolutions": revolutions,
        "angle_source": source,
        "sha256": recording.sha256,
        **{key: acquisition[key] for key in ACQUIRED if key in acquisition},
    }


def info_of_several(found: Recordings) -> dict[str, Any]:
    """What is in a file of several recordings: their sums, and under ``recordings`` each one, its name as ``pick``."""
    each = {name: info(read()) for name, read in found.items()}
    first = next(iter(each.values()))
    sources = {facts["angle_source"] for facts in each.values()}
    return {
        "format": first["format"],
        "profiles": sum(facts["profiles"] for facts in each.values()),
        "points_per_profile": max(facts["points_per_profile"] for facts in each.values()),
        "points_seen": sum(facts["points_seen"] for facts in each.values()),
        "revolutions": None,
        "angle_source": sources.pop() if len(sources) == 1 else None,
        "sha256": first["sha256"],
        "recordings": [{"pick": name, **{key: facts[key] for key in PER_RECORDING}} for name, facts in each.items()],
    }


def _angle_column(recording: Recording) -> str | None:
    """The column that the angle comes from; None where there is none."""
    columns = (("encoder", recording.encoder), ("angle", recording.angle), ("time", recording.time))
    return next((name for name, values in columns if values is not None), None)
