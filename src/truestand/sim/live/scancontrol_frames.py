"""Frames as a scanCONTROL sends them in container mode: mm to bytes.

One profile is one line of u16: a field of ``points`` after the other (Z, X, ..., an empty one for the stamp), and its
last 16 bytes hold the stamp, bytes most significant first: profile counter, when the shutter opened and closed, twice
the encoder count. Source: the vendor's open SDK (facts only); written apart from the decoder, to check each other.
"""

import re
from dataclasses import dataclass
from math import log2

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import BadRecipe

Array = NDArray[np.float64]
Raw = NDArray[np.uint16]
"""(n, fields, points)."""
Ints = NDArray[np.int64]

MIDDLE = 32768
"""Raw number of 0 mm (x) and of the middle of the range (z)."""
STAMP = 16
"""Bytes."""
COUNTERS, ENCODERS = 1 << 24, 1 << 16
"""Where profile counter and doubled encoder count start again."""
SECONDS, CYCLES, TICKS = 128, 8000, 3072
"""A time is 7 bit of seconds, 13 bit of 1/8000 s, 12 bit of 1/24.576 MHz."""
Z, X, EMPTY_FIELD, STAMPED, LOW_FIRST, STRIPES = 1 << 0, 1 << 1, 1 << 10, 1 << 11, 1 << 17, 0xF << 20
"""Bits of the rearrangement register."""
FIELDS = 0x3FF
POINTS_AT = 12
"""Bit where round(log2(points)) stands, in 4 bit."""

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
    """What a frame consists of: the rearrangement register and the two halves of the size register."""

    rearrangement: int
    width: int
    """u16 in one profile."""
    height: int
    """Profiles in one frame."""

    @property
    def fields(self) -> int:
        """Numbers a point, without the empty field for the stamp."""
        return (self.rearrangement & FIELDS).bit_count() * (self.rearrangement & STRIPES).bit_count()

    @property
    def lines(self) -> int:
        """Fields with the empty one."""
        return self.fields + bool(self.rearrangement & EMPTY_FIELD)

    @property
    def points(self) -> int:
        """Of a profile."""
        return self.width // max(self.lines, 1)

    @property
    def frame_bytes(self) -> int:
        """Of the whole frame."""
        return 2 * self.width * self.height

    @property
    def fits(self) -> bool:
        """Whether rearrangement and size say the same, and something."""
        power = self.rearrangement >> POINTS_AT & 0xF
        return bool(
            self.fields
            and self.height
            and self.points * self.lines == self.width
            and self.points
            and round(log2(self.points)) == power
        )


def default_format(points: int, profiles: int) -> FrameFormat:
    """Z, X and stamp of ``points`` points, ``profiles`` a frame."""
    bits = 1 << 20 | X | Z | EMPTY_FIELD | STAMPED | LOW_FIRST | round(log2(points)) << POINTS_AT
    return FrameFormat(bits, 3 * points, profiles)


def raw_profiles(x: Array, z: Array, scale: tuple[float, float], shape: FrameFormat) -> Raw:
    """Profiles (n, fields, points) of x and z (n, points) mm, not yet stamped; what is not seen is 0."""
    step, middle = scale
    raw = np.zeros((x.shape[0], shape.lines, shape.points), np.uint16)
    unseen = np.isnan(x) | np.isnan(z)
    line = 0
    for bit, values in ((Z, z - middle), (X, x)):
        if shape.rearrangement & bit:
            with np.errstate(invalid="ignore"):
                steps = np.clip(np.rint(values / step) + MIDDLE, 1, 65535)
            raw[:, line] = np.where(unseen, 0.0, steps).astype(np.uint16)
            line += 1
    return raw


def frame_bytes(raw: Raw, shape: FrameFormat, counter: Ints, opened: Array, closed: Array, encoder: Ints) -> bytes:
    """The profiles (n, fields, points) with their stamps, as they travel.

    Args:
        raw: as ``raw_profiles`` makes them.
        shape: what the frame consists of.
        counter: (n,) profile counter, not yet wrapped.
        opened: (n,) s of the sensor's clock when the exposure began, not yet wrapped.
        closed: (n,) when it ended.
        encoder: (n,) encoder counts, not yet doubled and wrapped.
    """
    order = "<u2" if shape.rearrangement & LOW_FIRST else ">u2"
    lines = raw.astype(order).reshape(raw.shape[0], -1).view(np.uint8)
    if shape.rearrangement & STAMPED:
        lines[:, -STAMP:] = stamps(counter, opened, closed, encoder)
    return lines.tobytes()


def stamps(counter: Ints, opened: Array, closed: Array, encoder: Ints) -> NDArray[np.uint8]:
    """The stamps (n, 16)."""
    words = np.zeros((counter.size, 4), ">u4")
    words[:, 0] = counter % COUNTERS
    words[:, 1], words[:, 3] = _times(opened), _times(closed)
    words[:, 2] = 2 * encoder % ENCODERS << 16
    return words.view(np.uint8)


def _times(seconds: Array) -> NDArray[np.uint32]:
    ticks = np.floor(seconds * (CYCLES * TICKS)).astype(np.int64)
    cycles, tick = ticks // TICKS, ticks % TICKS
    return (cycles // CYCLES % SECONDS << 25 | cycles % CYCLES << 12 | tick).astype(np.uint32)
