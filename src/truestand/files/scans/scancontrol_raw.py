"""Raw dumps of scanCONTROL sensors: profiles as they are sent (``files/scans/scancontrol.py``), no header.

The bytes don't say the sensor's type, and the number of points only by where time stamps make sense. Both are given by
the user and checked against the time stamp of every profile.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.scans.columns import drop_constant, encoder_counts
from truestand.files.scans.scancontrol import (
    COUNTER_MODULUS,
    FEWEST_POINTS,
    TIME_MODULUS,
    Stamps,
    decode_container,
    decode_stamps,
    profile_bytes,
    unwrap_counter,
    unwrap_encoder,
    unwrap_time,
)

FORMAT = "scancontrol raw"
USUAL_POINTS = (640, 1280, 320, 160, 2048, 1024, 512, 256)
"""Readings in a profile that sensors can be set to."""
PARTS = (2, 3, 4, 5, 8)
"""Into which a profile is divided to look for further time stamps."""
MOST_EXPOSURE_S = 0.1
"""The sensors' longest is 0.04."""
MOST_LOST_PROFILES = 1 << 16
"""In a row, beyond which the counter is taken for something else."""


@dataclass(frozen=True, slots=True)
class RawLayout:
    """What a raw dump doesn't say of itself: the type of the sensor (``29xx-50``) and the readings in a profile."""

    model: str
    points: int


def read_scancontrol_raw(path: Path, layout: RawLayout) -> Recording:
    """The recording of a raw dump; time is the middle of the exposure, columns go on where the sensor's start again.

    Raises:
        UnreadableFile: no whole number of profiles, or one without a time stamp, with its byte.
        BadRecipe: an unknown type, or a number of points that no sensor gives.
    """
    data = path.read_bytes()
    if not data:
        raise UnreadableFile(f"{path.name}: the file is empty; need a scan")
    try:
        profiles = decode_container(data, layout.points, layout.model)
    except UnreadableFile as wrong:
        raise UnreadableFile(f"{path.name}: {wrong}") from wrong
    stamps = profiles.stamps
    _refuse_other_points(data, stamps, layout.points, path.name)
    return Recording(
        profiles.x,
        profiles.z,
        FORMAT,
        hashlib.sha256(data).hexdigest(),
        time=unwrap_time(stamps.opened) + _exposure(stamps) / 2,
        encoder=encoder_counts(drop_constant(unwrap_encoder(stamps.encoder)), path.name),
        counter=unwrap_counter(stamps.counter),
    )


def points_of(head: bytes, size: int) -> int | None:
    """Readings in a profile, where the beginning of a file of ``size`` bytes looks like a raw dump; None otherwise."""
    for points in USUAL_POINTS:
        length = profile_bytes(points)
        whole = len(head) // length * length
        if whole >= 2 * length and size % length == 0 and _stamped(decode_stamps(head[:whole], points)).all():
            return points
    return None


def _refuse_other_points(data: bytes, stamps: Stamps, points: int, name: str) -> None:
    """Refuse profiles without a time stamp at their end, or with another one on the way there.

    Raises:
        UnreadableFile: with the first such profile and its byte, or the number of points that it should be.
    """
    odd = np.flatnonzero(~_stamped(stamps))
    if odd.size:
        raise UnreadableFile(
            f"{name}: profile {odd[0]} (byte {odd[0] * profile_bytes(points)}) has no time stamp that follows the one "
            f"before, need profiles of {points} points with Z, X and a time stamp; check --points, or record it again"
        )
    for parts in PARTS:
        fewer, rest = divmod(points, parts)
        if rest == 0 and fewer >= FEWEST_POINTS and _stamped(decode_stamps(data, fewer)).all():
            raise UnreadableFile(
                f"{name}: found time stamps as of profiles of {fewer} points, given were {points}; pass "
                f"--points {fewer}"
            )


def _stamped(stamps: Stamps) -> Mask:
    """Which profiles (N,) have a time stamp that can be one, and a counter that follows the profile before."""
    exposure = _exposure(stamps)
    steps = np.diff(stamps.counter, prepend=stamps.counter[:1] - 1) % COUNTER_MODULUS
    return (exposure > 0) & (exposure <= MOST_EXPOSURE_S) & (steps > 0) & (steps <= MOST_LOST_PROFILES)


def _exposure(stamps: Stamps) -> Array:
    return (stamps.closed - stamps.opened) % TIME_MODULUS
