"""Raw 16-bit profiles of scanCONTROL sensors: bytes to mm, and counts that start again to counts that go on.

A container is N profiles without a header. A profile is three fields of ``points`` little-endian u16 each: Z, X, and a
field whose last 16 bytes are the time stamp, high byte first; the rest of it is empty. A sensor sends this where its
profile rearrangement is 0x00120c03 (Z, X, empty field, time stamp, first reflection, low byte first):

    byte   0      flags
           1..3   profile counter, starts again after 2^24
           4..7   shutter opened: 7 bit seconds, 13 bit of 1/8000 s, 12 bit of 1/24.576 MHz; starts again after 128 s
           8..9   twice the encoder's count, so that the count starts again after 2^15
          12..15  shutter closed, like opened

mm = (raw - 32768) step, z + offset; raw z = 0 is no data. Step and offset depend on the sensor type (``RANGES``).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.errors import BadRecipe, UnreadableFile

Counts = NDArray[np.int64]

RAW_ZERO = 32768
"""The raw value of 0 mm before the offset."""
FIELDS = 3
STAMP = 16
"""Bytes of the time stamp."""
FEWEST_POINTS, MOST_POINTS = STAMP // 2, 4096
"""The time stamp has to fit into its field; the widest sensors give 2048 points."""
COUNTER_MODULUS = 1 << 24
TIME_MODULUS = 128.0
"""s."""
ENCODER_MODULUS = 1 << 15


@dataclass(frozen=True, slots=True)
class ScanControlScale:
    """What one raw count is on a type of sensor, and the distance of the middle of its range (mm)."""

    step: float
    offset: float


RANGES: Mapping[str, ScanControlScale] = MappingProxyType(
    {
        **{f"{series}-25": ScanControlScale(0.001, 65.0) for series in ("25xx", "26xx", "29xx")},
        **{f"{series}-50": ScanControlScale(0.002, 95.0) for series in ("25xx", "26xx", "29xx")},
        **{f"{series}-100": ScanControlScale(0.005, 250.0) for series in ("25xx", "26xx", "29xx")},
        "29xx-10": ScanControlScale(0.0005, 55.0),
        "27xx-25": ScanControlScale(0.001, 100.0),
        "27xx-50": ScanControlScale(0.002, 210.0),
        "27xx-100": ScanControlScale(0.005, 450.0),
        "30xx-25": ScanControlScale(0.001, 85.0),
        "30xx-50": ScanControlScale(0.002, 125.0),
    }
)
"""By series and measuring range (mm); the series as ``xx`` stands for its types."""


@dataclass(frozen=True, slots=True)
class Stamps:
    """The time stamps of profiles; all start again at their modulus as the sensor sends them."""

    counter: Counts
    """(N,) modulo 2^24."""
    opened: Array
    """(N,) s modulo 128: the shutter opened."""
    closed: Array
    """(N,) s modulo 128: the shutter closed."""
    encoder: Counts
    """(N,) counts modulo 2^15."""


@dataclass(frozen=True, slots=True)
class ContainerProfiles:
    """Decoded profiles."""

    x: Array
    """(N, M) mm along the line; NaN where z was not seen."""
    z: Array
    """(N, M) mm; NaN = not seen."""
    stamps: Stamps


def scale_of(model: str) -> ScanControlScale:
    """The scale of a sensor type: a key of ``RANGES``, or as the type plate has it (``LLT2950-50/BL``).

    Raises:
        BadRecipe: a type that is not in ``RANGES``; the message lists them.
    """
    found = re.fullmatch(r"(?:LLT|scanCONTROL)?\s*(\d\d)(?:\d\d|xx)-(\d+)(?:/.*)?", model.strip(), re.IGNORECASE)
    scale = RANGES.get(f"{found[1]}xx-{found[2]}") if found else None
    if scale is None:
        raise BadRecipe(
            f"found scanCONTROL type {model!r}, need one of {', '.join(sorted(RANGES))}; see the type plate"
        )
    return scale


def profile_bytes(points: int) -> int:
    """Bytes of one profile of ``points`` readings.

    Raises:
        BadRecipe: a number of points that no sensor gives.
    """
    if not FEWEST_POINTS <= points <= MOST_POINTS:
        raise BadRecipe(
            f"found {points} points a profile, need {FEWEST_POINTS} to {MOST_POINTS}; see the sensor's settings"
        )
    return FIELDS * 2 * points


def decode_container(buffer: bytes | bytearray | memoryview, points: int, model: str) -> ContainerProfiles:
    """The profiles of a container (``buffer``), ``points`` readings each, of a sensor of type ``model``.

    x, z (N, M) are the decimal numbers that the counts stand for, to the last bit. No bytes: no profiles.

    Raises:
        UnreadableFile: no whole number of profiles.
        BadRecipe: an unknown type, or a number of points that no sensor gives.
    """
    scale = scale_of(model)
    rows = _rows(buffer, points)
    raw = rows.view("<u2")
    seen = raw[:, :points] != 0
    return ContainerProfiles(
        x=_millimetres(raw[:, points : 2 * points], seen, scale.step, 0.0),
        z=_millimetres(raw[:, :points], seen, scale.step, scale.offset),
        stamps=_stamps(rows),
    )


def decode_stamps(buffer: bytes | bytearray | memoryview, points: int) -> Stamps:
    """The time stamps alone: quick enough to look at every frame while it is recorded.

    Raises:
        UnreadableFile, BadRecipe: as ``decode_container``.
    """
    return _stamps(_rows(buffer, points))


def _rows(buffer: bytes | bytearray | memoryview, points: int) -> NDArray[np.uint8]:
    """One row of bytes a profile."""
    size = profile_bytes(points)
    bytes_ = np.frombuffer(buffer, dtype=np.uint8)
    if bytes_.size % size:
        whole = bytes_.size // size
        raise UnreadableFile(
            f"found {bytes_.size} bytes: {whole} profiles of {points} points ({size} bytes each) and "
            f"{bytes_.size % size} bytes from byte {whole * size} on, need whole profiles; it is cut off, or the "
            "number of points is another"
        )
    return bytes_.reshape(-1, size)


def _stamps(rows: NDArray[np.uint8]) -> Stamps:
    words = np.ascontiguousarray(rows[:, -STAMP:]).view(">u4").astype(np.int64)
    return Stamps(
        counter=words[:, 0] & 0xFFFFFF,
        opened=_seconds(words[:, 1]),
        closed=_seconds(words[:, 3]),
        encoder=words[:, 2] >> 17,
    )


def unwrap_counter(counter: Counts, last: int | None = None) -> Counts:
    """Profile numbers (N,) int64 that go on where the counter starts again; lost profiles stay gaps.

    ``last``: the number before, as this function gave it, where a stream is decoded piece by piece.
    """
    return _unwrapped(np.asarray(counter, dtype=np.int64), COUNTER_MODULUS, 0, last)


def unwrap_time(seconds: Array, last: float | None = None) -> Array:
    """Times (N,) s that go on where the sensor's clock starts again; a pause of 128 s and more can't be told.

    ``last``: the time before, as this function gave it.
    """
    seconds = np.asarray(seconds, dtype=np.float64)
    if not seconds.size:
        return seconds
    first = 0.0 if last is None else np.ceil((last - seconds[0]) / TIME_MODULUS)
    turns = first + np.concatenate([[0.0], np.cumsum(np.diff(seconds) < 0)])
    return np.asarray(seconds + TIME_MODULUS * turns, dtype=np.float64)


def unwrap_encoder(encoder: Counts, last: int | None = None) -> Counts:
    """Encoder counts (N,) int64 that go on, in either direction: a step is less than 2^14 counts.

    ``last``: the count before, as this function gave it.
    """
    return _unwrapped(np.asarray(encoder, dtype=np.int64), ENCODER_MODULUS, ENCODER_MODULUS // 2, last)


def _unwrapped(counts: Counts, modulus: int, back: int, last: int | None) -> Counts:
    """``counts`` with steps from -``back`` up to ``modulus`` - ``back``, on from ``last``, else from the first."""
    before = (last if last is not None else counts[0]) if counts.size else 0
    steps = np.diff(counts, prepend=np.int64(before))
    return np.asarray(before + np.cumsum((steps + back) % modulus - back), dtype=np.int64)


def _millimetres(raw: NDArray[np.uint16], seen: Mask, step: float, offset: float) -> Array:
    """Whole counts over counts a mm, so that 0.002 x 47,500 is 95 and not its neighbour."""
    a_mm = round(1.0 / step)
    return np.where(seen, (raw + (offset * a_mm - RAW_ZERO)) / a_mm, np.nan)


def _seconds(stamp: Counts) -> Array:
    return np.asarray((stamp >> 25) + (stamp >> 12 & 0x1FFF) / 8000.0 + (stamp & 0xFFF) / 24.576e6)
