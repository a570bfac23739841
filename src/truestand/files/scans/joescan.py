"""JoeScan raw recordings: profiles of several heads and cameras one after the other, compressed with gzip.

A record, little endian: magic, flags, laser, laser-on time (us), encoders, then the encoders' counts, sequence number,
time (ns), head, camera, inputs, points, then each point's x and y in 1/100 inch and its brightness. A profile has the
points that its camera saw, so lengths differ; the sensor's y is our z. Each head's camera is a recording of its own.
"""

import gzip
import hashlib
import io
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.scans.columns import drop_constant, encoder_counts, stack_profiles

FORMAT = "joescan raw"
MAGIC = struct.pack("<i", 0x010203)
GZIP = b"\x1f\x8b"
RECORD_START = struct.Struct("<iiIHi")
"""Magic, flags, laser, laser-on time, number of encoders."""
RECORD_MIDDLE = struct.Struct("<IQIIii")
"""Sequence number, time, head, camera, inputs, number of points."""
POINT = np.dtype([("x", "<i2"), ("z", "<i2"), ("brightness", "u1")])
MOST_COMPRESSION = 50
"""Unpacked bytes for each compressed one: a real recording has 1.5, what unpacks to much more holds nothing."""
ALWAYS_UNPACKED_BYTES = 1 << 22
"""Whatever the compression."""
ADVICE = "the file is cut off or damaged: export it again"


@dataclass(frozen=True, slots=True)
class _Profile:
    laser: int
    encoders: tuple[int, ...]
    sequence: int
    nanoseconds: int
    head: int
    camera: int
    points: NDArray[Any]


def is_joescan(head: bytes) -> bool:
    """Whether a file starts like a JoeScan record, packed or not."""
    if head.startswith(GZIP):
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, len(MAGIC))
        except zlib.error:
            return False
    return head.startswith(MAGIC)


def joescan_recordings(path: Path) -> Mapping[str, Callable[[], Recording]]:
    """What a file holds by name (``head1-camera0``), each to be built when called for.

    Raises:
        UnreadableFile: cut off or damaged, with the profile and the byte; unpacking to more than a recording does.
    """
    packed = path.read_bytes()
    sha256 = hashlib.sha256(packed).hexdigest()
    data = _unpacked(packed, path.name)
    groups: dict[tuple[int, int, int], list[_Profile]] = {}
    at = count = 0
    while at < len(data):
        profile, at = _profile(data, at, f"{path.name}: profile {count}")
        groups.setdefault((profile.head, profile.camera, profile.laser), []).append(profile)
        count += 1
    several = len(groups) > len({key[:2] for key in groups})
    return {
        f"head{head}-camera{camera}" + f"-laser{laser}" * several: partial(
            _recording, groups[head, camera, laser], path.name, sha256
        )
        for head, camera, laser in sorted(groups)
    }


def _unpacked(data: bytes, name: str) -> bytes:
    if not data.startswith(GZIP):
        return data
    limit = max(ALWAYS_UNPACKED_BYTES, MOST_COMPRESSION * len(data))
    unpacked = bytearray()
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            while chunk := file.read1(1 << 16):
                unpacked += chunk
                if len(unpacked) > limit:
                    raise UnreadableFile(
                        f"{name}: {len(data)} bytes unpack to more than {limit}, need a recording; it is no scan"
                    )
    except (EOFError, OSError, zlib.error) as wrong:
        raise UnreadableFile(
            f"{name}: the packed data ends at byte {len(unpacked)} of the unpacked ({wrong}); {ADVICE}"
        ) from wrong
    return bytes(unpacked)


def _profile(data: bytes, at: int, where: str) -> tuple[_Profile, int]:
    """The record at byte ``at``, and where the next one starts.

    Raises:
        UnreadableFile: another magic number, or more encoders or points than there are bytes left.
    """
    _refuse_short(data, at, RECORD_START.size, where)
    _, _, laser, _, encoders = RECORD_START.unpack_from(data, at)
    if data[at : at + len(MAGIC)] != MAGIC:
        raise UnreadableFile(f"{where} (byte {at} of the unpacked data) starts with another magic number; {ADVICE}")
    at += RECORD_START.size
    _refuse_short(data, at, 8 * encoders + RECORD_MIDDLE.size * (encoders >= 0), where)
    values = struct.unpack_from(f"<{encoders}q", data, at)
    at += 8 * encoders
    sequence, nanoseconds, head, camera, _, points = RECORD_MIDDLE.unpack_from(data, at)
    at += RECORD_MIDDLE.size
    _refuse_short(data, at, POINT.itemsize * points, where)
    seen = np.frombuffer(data, dtype=POINT, count=points, offset=at)
    return _Profile(laser, values, sequence, nanoseconds, head, camera, seen), at + POINT.itemsize * points


def _refuse_short(data: bytes, at: int, size: int, where: str) -> None:
    if not 0 <= size <= len(data) - at:
        raise UnreadableFile(
            f"{where} claims {size} bytes from byte {at} of the unpacked data, {len(data) - at} are left; {ADVICE}"
        )


def _recording(profiles: list[_Profile], name: str, sha256: str) -> Recording:
    """The profiles of one camera in the order of the file."""
    if len({len(p.encoders) > 0 for p in profiles}) > 1:
        raise UnreadableFile(f"{name}: found profiles with and without an encoder, need one kind; {ADVICE}")
    encoder = np.array([p.encoders[0] for p in profiles], dtype=np.int64) if profiles[0].encoders else None
    return Recording(
        stack_profiles([_mm(p.points["x"]) for p in profiles], name),
        stack_profiles([_mm(p.points["z"]) for p in profiles], name),
        FORMAT,
        sha256,
        time=np.array([p.nanoseconds for p in profiles], dtype=np.float64) / 1e9,
        encoder=encoder_counts(encoder, name),
        counter=drop_constant(np.array([p.sequence for p in profiles], dtype=np.int64)),
        intensity=stack_profiles([p.points["brightness"].astype(np.float64) for p in profiles], name),
    )


def _mm(hundredths: NDArray[np.int16]) -> Array:
    """1/100 inch is 254/1000 mm, to the last bit."""
    return hundredths.astype(np.float64) * 254.0 / 1000.0
