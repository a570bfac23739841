"""Frames as a scanCONTROL sends them in container mode: mm to bytes.

One profile is one row of u16: a field of ``points`` after the other (Z, X, ..., an empty one for the stamp), and its
last 16 bytes hold the stamp, bytes most significant first: profile counter, when the shutter opened and closed, twice
the encoder count. Source: the vendor's open SDK (facts only); written apart from the decoder, to check each other.
"""

import re
from dataclasses import dataclass
from math import log2

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe

Raw = NDArray[np.uint16]
"""(n, fields, points)."""
Counts = NDArray[np.int64]

MIDDLE = 32768
"""Raw number of 0 mm (x) and of the middle of the range (z)."""
STAMP_BYTES = 16
COUNTER_MODULUS, ENCODER_MODULUS = 1 << 24, 1 << 16
"""Of the profile counter, and of twice the encoder count."""
SECONDS, CYCLES, TICKS = 128, 8000, 3072
"""A time is 7 bit of seconds, 13 bit of 1/8000 s, 12 bit of 1/24.576 MHz."""
Z, X, EMPTY_FIELD, STAMPED, LOW_FIRST, STRIPES = 1 << 0, 1 << 1, 1 << 10, 1 << 11, 1 << 17, 0xF << 20
"""Bits of the rearrangement register."""
FIELDS = 0x3FF
POINTS_SHIFT = 12
"""Lowest of the 4 bit of round(log2(points))."""

_SCALES = {
    "25xx-25": (0.001, 65.0), "25xx-50": (0.002, 95.0), "25xx-100": (0.005, 250.0),
    "26xx-25": (0.001, 65.0), "26xx-50": (0.002, 95.0), "26xx-100": (0.005, 250.0),
    "27xx-25": (0.001, 100.0), "27xx-50": (0.002, 210.0), "27xx-100": (0.005, 450.0),
    "29xx-10": (0.0005, 55.0), "29xx-25": (0.001, 65.0), "29xx-50": (0.002, 95.0), "29xx-100": (0.005, 250.0),
    "30xx-25": (0.001, 85.0), "30xx-50": (0.002, 125.0),
}  # fmt: skip


def scale_of(model: str) -> tuple[float, float]:
    """Step (mm) and middle of the range (mm) of a sensor type such as "29xx-50", "2950-50" or "LLT2950-50/BL".

    Raises:
        BadRecipe: another one.
    """
    found = re.search(r"(\d\d)..-(\d+)", model)
    scale = _SCALES.get(f"{found[1]}xx-{found[2]}") if found else None
    if scale is None:
        raise BadRecipe(f'found a sensor model "{model}", the virtual sensor can be one of {", ".join(_SCALES)}')
    return scale


@dataclass(frozen=True, slots=True)
class FrameFormat:
    """Format of a frame: the rearrangement register and the two halves of the size register."""

    rearrangement: int
    width: int
    """u16 in one profile."""
    height: int
    """Profiles in one frame."""

    @property
    def fields(self) -> int:
        """Values of a point: fields without the empty one for the stamp."""
        return (self.rearrangement & FIELDS).bit_count() * (self.rearrangement & STRIPES).bit_count()

    @property
    def lines(self) -> int:
        """Fields of a profile with the empty one."""
        return self.fields + bool(self.rearrangement & EMPTY_FIELD)

    @property
    def points(self) -> int:
        """Points of a profile."""
        return self.width // max(self.lines, 1)

    @property
    def frame_bytes(self) -> int:
        """Size of the frame."""
        return 2 * self.width * self.height

    @property
    def valid(self) -> bool:
        """Whether rearrangement and size are consistent and not empty."""
        power = self.rearrangement >> POINTS_SHIFT & 0xF
        return bool(
            self.fields
            and self.height
            and self.points * self.lines == self.width
            and self.points
            and round(log2(self.points)) == power
        )


def default_format(points: int, profiles: int) -> FrameFormat:
    """Z, X and stamp of ``points`` points, ``profiles`` a frame."""
    bits = 1 << 20 | X | Z | EMPTY_FIELD | STAMPED | LOW_FIRST | round(log2(points)) << POINTS_SHIFT
    return FrameFormat(bits, 3 * points, profiles)


def raw_profiles(x: Array, z: Array, scale: tuple[float, float], frame: FrameFormat) -> Raw:
    """Profiles (n, fields, points) of x and z (n, points) mm, not yet stamped; what is not seen is 0."""
    step, middle = scale
    raw = np.zeros((x.shape[0], frame.lines, frame.points), np.uint16)
    unseen = np.isnan(x) | np.isnan(z)
    line = 0
    for bit, values in ((Z, z - middle), (X, x)):
        if frame.rearrangement & bit:
            with np.errstate(invalid="ignore"):
                steps = np.clip(np.rint(values / step) + MIDDLE, 1, 65535)
            raw[:, line] = np.where(unseen, 0.0, steps).astype(np.uint16)
            line += 1
    return raw


def frame_bytes(raw: Raw, frame: FrameFormat, counter: Counts, opened: Array, closed: Array, encoder: Counts) -> bytes:
    """The profiles (n, fields, points) with their stamps, as they travel.

    Args:
        raw: as ``raw_profiles`` makes them.
        frame: format of the frame.
        counter: (n,) profile counter, not yet wrapped.
        opened: (n,) s of the sensor's clock when the exposure began, not yet wrapped.
        closed: (n,) when it ended.
        encoder: (n,) encoder counts, not yet doubled and wrapped.
    """
    order = "<u2" if frame.rearrangement & LOW_FIRST else ">u2"
    lines = raw.astype(order).reshape(raw.shape[0], -1).view(np.uint8)
    if frame.rearrangement & STAMPED:
        lines[:, -STAMP_BYTES:] = stamps(counter, opened, closed, encoder)
    return lines.tobytes()


def stamps(counter: Counts, opened: Array, closed: Array, encoder: Counts) -> NDArray[np.uint8]:
    """The stamps (n, 16) of ``frame_bytes``."""
    words = np.zeros((counter.size, 4), ">u4")
    words[:, 0] = counter % COUNTER_MODULUS
    words[:, 1], words[:, 3] = _times(opened), _times(closed)
    words[:, 2] = 2 * encoder % ENCODER_MODULUS << 16
    return words.view(np.uint8)


def _times(seconds: Array) -> NDArray[np.uint32]:
    ticks = np.floor(seconds * (CYCLES * TICKS)).astype(np.int64)
    cycles, tick = ticks // TICKS, ticks % TICKS
    return (cycles // CYCLES % SECONDS << 25 | cycles % CYCLES << 12 | tick).astype(np.uint32)
