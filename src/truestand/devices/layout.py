"""Payloads to profiles: one decoder for live frames, for logs after a crash, and for replays.

Counters, times and encoder counts wrap at the sensor's moduli; ``Unwrapper`` continues them from frame to frame.
"""

from dataclasses import replace

import numpy as np

from truestand.core.arrays import Mask
from truestand.core.errors import DeviceError
from truestand.devices.sensor import Layout, Profiles
from truestand.files.scans import scancontrol

PLAIN_COLUMNS = 3
"""Numbers before the points of a plain profile: counter, time, encoder."""


def decode(layout: Layout, payload: bytes | bytearray | memoryview) -> Profiles:
    """The profiles of a frame. An incomplete profile is all zero: nothing seen, and no stamp (counter -1).

    Raises:
        DeviceError: a payload of another size than the layout says.
        BadRecipe: a sensor type without a known scale.
    """
    if len(payload) != layout.frame_bytes:
        raise DeviceError(
            f"found a frame of {len(payload)} bytes, need {layout.frame_bytes} ({layout.profiles} profiles of "
            f"{layout.points} points); the sensor's settings were changed while it streamed"
        )
    return {"scancontrol": _scancontrol, "range-camera": _range_camera, "plain": _plain}[layout.kind](layout, payload)


def _scancontrol(layout: Layout, payload: bytes | bytearray | memoryview) -> Profiles:
    found = scancontrol.decode_container(payload, layout.points, layout.model)
    stamps = np.frombuffer(payload, np.uint8).reshape(layout.profiles, -1)[:, -scancontrol.STAMP :]
    stamped = stamps.any(axis=1)
    stamp = found.stamps
    closed = np.where(stamp.closed < stamp.opened, stamp.closed + scancontrol.TIME_MODULUS, stamp.closed)
    return Profiles(
        found.x,
        found.z,
        np.where(stamped, stamp.counter, -1),
        (stamp.opened + closed) / 2 % scancontrol.TIME_MODULUS,
        stamp.encoder if layout.encoder_modulus else None,
    )


def _range_camera(layout: Layout, payload: bytes | bytearray | memoryview) -> Profiles:
    if layout.scale is None:
        raise DeviceError("found a range camera's layout without its scale; the log's head is damaged")
    first, step, zero, height = layout.scale
    raw = np.frombuffer(payload, "<u2").reshape(layout.profiles, layout.points)
    seen = raw != 0
    x = np.broadcast_to(first + step * np.arange(layout.points), raw.shape)
    return Profiles(np.where(seen, x, np.nan), np.where(seen, zero + height * raw, np.nan))


def _plain(layout: Layout, payload: bytes | bytearray | memoryview) -> Profiles:
    rows = np.frombuffer(payload, "<f8").reshape(layout.profiles, PLAIN_COLUMNS + 2 * layout.points)
    counter, time, encoder = (None if np.isnan(column).all() else column for column in rows[:, :PLAIN_COLUMNS].T.copy())
    return Profiles(
        rows[:, PLAIN_COLUMNS : PLAIN_COLUMNS + layout.points],
        rows[:, PLAIN_COLUMNS + layout.points :],
        None if counter is None else counter.astype(np.int64),
        time,
        None if encoder is None else encoder.astype(np.int64),
    )


def encode_plain(profiles: Profiles) -> bytes:
    """The payload of a plain frame: numbers unchanged, so that a replay gives what the file holds."""
    n, points = profiles.x.shape
    rows = np.full((n, PLAIN_COLUMNS + 2 * points), np.nan)
    for i, column in enumerate((profiles.counter, profiles.time, profiles.encoder)):
        if column is not None:
            rows[:, i] = column
    rows[:, PLAIN_COLUMNS : PLAIN_COLUMNS + points] = profiles.x
    rows[:, PLAIN_COLUMNS + points :] = profiles.z
    return rows.astype("<f8").tobytes()


class Unwrapper:
    """Continues counters, times and encoder counts of one stream over their moduli, frame by frame, in order."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._counter: int | None = None
        self._time: float | None = None
        self._encoder: int | None = None

    def unwrap(self, profiles: Profiles) -> Profiles:
        """The profiles with unwrapped columns. Those without a stamp are left out: the counter's gap stands for them.

        The moduli are those of the scanCONTROL, the one sensor that has any. Time must not pause for a whole modulus,
        the encoder not step by half of its own.
        """
        if profiles.counter is not None and (profiles.counter < 0).any():
            profiles = _rows(profiles, profiles.counter >= 0)
        if not len(profiles.x):
            return profiles
        layout, counter, time, encoder = self._layout, profiles.counter, profiles.time, profiles.encoder
        if counter is not None and layout.counter_modulus:
            counter = scancontrol.unwrap_counter(counter, self._counter)
            self._counter = int(counter[-1])
        if time is not None and layout.time_modulus:
            time = scancontrol.unwrap_time(time, self._time)
            self._time = float(time[-1])
        if encoder is not None and layout.encoder_modulus:
            encoder = scancontrol.unwrap_encoder(encoder, self._encoder)
            self._encoder = int(encoder[-1])
        return replace(profiles, counter=counter, time=time, encoder=encoder)


def _rows(profiles: Profiles, keep: Mask) -> Profiles:
    columns = (profiles.x, profiles.z, profiles.counter, profiles.time, profiles.encoder)
    return Profiles(*(None if column is None else column[keep] for column in columns))  # type: ignore[arg-type]
