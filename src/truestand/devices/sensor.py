"""The sensor interface: a line-profile sensor that streams frames of raw profiles.

A frame holds the bytes that the sensor sent: the log stores them unchanged, and one decoder (``Layout``) converts them
to millimetres, live and after a crash alike.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array

Laser = Literal["off", "reduced", "full"]


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame as received: some profiles in the sensor's own layout."""

    number: int
    """Counts from the first frame of the stream, unwrapped; a step of 2 = one frame lost."""
    received: float
    """s of the host's monotonic clock, when its last byte had arrived."""
    payload: bytes
    missing: int = 0
    """Bytes that never arrived, even when requested again. Each profile that lacks some is all zero in ``payload``."""


@dataclass(frozen=True, slots=True)
class Profiles:
    """Profiles of a frame, decoded."""

    x: Array
    """(n, points) mm; NaN = not seen."""
    z: Array
    counter: NDArray[np.int64] | None = None
    """(n,) as the sensor counts, before unwrapping; -1 = incomplete, without a stamp."""
    time: Array | None = None
    """(n,) s of the sensor's clock, middle of the exposure, before unwrapping."""
    encoder: NDArray[np.int64] | None = None
    """(n,) counts, before unwrapping."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How to read a payload; it stands in the header of every log, so that a log can be read by itself."""

    kind: Literal["scancontrol", "range-camera", "plain"]
    """``plain``: numbers in mm, from a recorded scan."""
    model: str
    """Sensor type, which gives the scale."""
    points: int
    profiles: int
    """Per frame."""
    rate: float
    """Profiles per second."""
    counter_modulus: int = 0
    """The counter wraps there; 0 = never. Likewise below."""
    time_modulus: float = 0.0
    encoder_modulus: int = 0
    scale: tuple[float, float, float, float] | None = None
    """Range camera: x of the first column, x step, z of raw 0, z step; mm."""

    @property
    def frame_bytes(self) -> int:
        """Size of a whole payload."""
        of_profile = {"scancontrol": 6 * self.points, "range-camera": 2 * self.points, "plain": 24 + 16 * self.points}
        return self.profiles * of_profile[self.kind]


@dataclass(frozen=True, slots=True)
class StreamStatistics:
    """Counts of a stream so far."""

    frames: int = 0
    lost: int = 0
    """Frames of which nothing arrived, or that the program did not take in time."""
    incomplete: int = 0
    """Frames handed on with bytes missing."""
    resent: int = 0
    """Packets that arrived after they had been requested again."""
    packets: int = 0
    duplicates: int = 0
    """Packets that arrived twice, or too late for their frame."""
    foreign: int = 0
    """Packets from another address than the sensor's: ignored."""
    malformed: int = 0
    """Packets that don't fit the stream: not used."""
    overrun: int = 0
    """Those of ``lost`` that arrived, but the program was too slow to take."""


class LineSensor(Protocol):
    """Interface of a sensor driver. Calls raise ``DeviceLost`` within the connection's timeout, or ``DeviceError``."""

    @property
    def name(self) -> str:
        """As in stand.toml."""

    def identity(self) -> dict[str, str]:
        """Maker, model, serial, firmware, as the device reports them."""

    def start(self) -> Layout:
        """Configure (rate, points, exposure, trigger) and begin to stream; returns how to read the payloads."""

    def next_frame(self, timeout: float) -> Frame | None:
        """The next frame in order, or None where none came within ``timeout`` s.

        Raises:
            DeviceLost: the sensor is gone (no heartbeat answer).
        """

    def set_laser(self, power: Laser) -> None:
        """Switch the laser.

        Raises:
            DeviceError: it can't be switched. ``off`` never returns while the laser may still be on.
        """

    def stop(self) -> None:
        """End the stream; the connection stays."""

    def statistics(self) -> StreamStatistics:
        """Counts of the stream so far."""

    def close(self) -> None:
        """Laser off, stream ended, control given back; never raises for a device that is gone."""
