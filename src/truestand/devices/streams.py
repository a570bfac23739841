"""A whole stream of payloads as profiles: counters, times and encoder counts go on where the sensor's start again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.core.scancontrol import decode_container, unwrap_counter, unwrap_encoder, unwrap_time
from truestand.devices.sensor import Layout

Array = NDArray[np.float64]
Counts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Stream:
    """The profiles of a stream, in order."""

    x: Array
    """(N, points) mm; NaN = not seen."""
    z: Array
    counter: Counts
    """(N,): a step of more than 1 = profiles lost."""
    time: Array
    """(N,) s of the sensor's clock, the middle of the exposure; from the counter and the rate where it sends none."""
    encoder: Counts | None
    """(N,) counts."""


def decode_stream(layout: Layout, payloads: Sequence[bytes], numbers: Sequence[int]) -> Stream:
    """The profiles of whole payloads, whose frames have ``numbers``, in order."""
    if layout.kind == "scancontrol":
        profiles = decode_container(b"".join(payloads), layout.points, layout.model)
        stamps = profiles.stamps
        opened = unwrap_time(stamps.opened)
        exposure = (stamps.closed - stamps.opened) % layout.time_modulus
        return Stream(
            profiles.x,
            profiles.z,
            unwrap_counter(stamps.counter),
            opened + exposure / 2,
            unwrap_encoder(stamps.encoder),
        )
    first, step_x, offset, step_z = layout.scale or (0.0, 1.0, 0.0, 1.0)
    raw = np.frombuffer(b"".join(payloads), dtype="<u2").reshape(-1, layout.points)
    z = np.where(raw == 0, np.nan, offset + step_z * raw)
    x = np.where(raw == 0, np.nan, first + step_x * np.arange(layout.points))
    frames = np.asarray(numbers, dtype=np.int64) - (numbers[0] if numbers else 0)
    counter = (frames[:, None] * layout.profiles + np.arange(layout.profiles)).reshape(-1)
    return Stream(x, z, counter, counter / layout.rate, None)
