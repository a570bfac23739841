"""Which table angle belongs to which profile: by the encoder's counts, else by the clocks of sensor and host.

The sensor's clock runs beside the host's. A frame arrives some time after its last exposure, never before: the line
under all arrivals ties the clocks (offset, rate), and what remains is the transport's least delay. Where an encoder is
wired, that delay shows as skew between encoder and table, and is reported.
"""

from dataclasses import dataclass
from math import pi, tau

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.robust import robust_sd

WINDOWS = 12
"""Pieces of a scan, the earliest arrival of each being a point of the line of the clocks."""
STEADY_FACTOR = 3.0
"""A table counts as steady where it keeps a straight line within so many times the half-width of its own samples."""
TABLE_RESOLUTION = 2e-5
"""rad: a table that rounds its own position to this is never called unsteady."""


@dataclass(frozen=True, slots=True)
class TableTrack:
    """The table's own answers, on the host's clock."""

    time: Array
    """(n,) s."""
    position: Array
    """(n,) rad."""
    half_width: Array
    """(n,) s: half of the time between question and answer, within which the position was valid."""
    moving: Mask


@dataclass(frozen=True, slots=True)
class ClockFit:
    """The sensor's clock beside the host's: host = offset + rate device."""

    offset: float
    """s."""
    rate: float
    misfit: float
    """s by which the earliest arrivals leave the line at most: clocks that don't run evenly, or frames held up."""


def fit_clocks(device: Array, host: Array) -> ClockFit:
    """The line under all arrivals: s of the exposures, s of the frames' arrivals."""
    if device.size < 2 or np.ptp(device) == 0:
        return ClockFit(float(host[0] - device[0]), 1.0, 0.0)
    pieces = np.array_split(np.arange(device.size), min(WINDOWS, max(device.size // 4, 1)))
    rough = (host[-1] - host[0]) / (device[-1] - device[0])
    earliest = np.array([p[np.argmin(host[p] - rough * device[p])] for p in pieces])
    slope = rough if earliest.size < 3 else float(np.polyfit(device[earliest] - device[0], host[earliest], 1)[0])
    under = host - slope * device
    return ClockFit(float(under.min()), float(slope), float(np.ptp(under[earliest])))


def angle_by_encoder(counts: NDArray[np.int64], counts_per_turn: int, start: float) -> Array:
    """Table position (n,) rad of profiles from unwrapped counts; the first was taken at rest at ``start`` rad."""
    return np.asarray(start + (counts - counts[0]) * (tau / counts_per_turn), dtype=np.float64)


def angle_by_clock(moment: Array, track: TableTrack, within: tuple[float, float]) -> tuple[Array, bool]:
    """Table position (n,) rad at host times ``moment`` (s), and whether the table kept one speed ``within`` (rad).

    A steady table is read off one straight line, which averages over when it answered; another between its answers.
    """
    scanned = track.moving & (track.position >= within[0]) & (track.position <= within[1])
    if np.count_nonzero(scanned) >= 5:
        time, position = track.time[scanned], track.position[scanned]
        line = np.polynomial.Polynomial.fit(time, position, 1)
        off = float(np.std(position - line(time)))
        speed = abs(float(line.deriv()(time[0])))
        if off <= STEADY_FACTOR * max(float(np.median(track.half_width)) * speed, TABLE_RESOLUTION):
            inside = (moment >= time[0]) & (moment <= time[-1])
            between = np.interp(moment, track.time, track.position)
            return np.where(inside, line(moment), between), True
    return np.interp(moment, track.time, track.position), False


def latch_skew_ms(moment: Array, encoder_angle: Array, track: TableTrack) -> tuple[float | None, float | None]:
    """By how much the table's own position is later than the encoder at the same moment, and its spread, ms.

    Over the steady middle of a motion; None where there is too little of it.
    """
    low, high = np.percentile(encoder_angle, [15, 85])
    middle = track.moving & (track.position > low) & (track.position < high)
    inside = middle & (track.time > moment[0]) & (track.time < moment[-1])
    if np.count_nonzero(inside) < 10 or high - low < pi / 18:
        return None, None
    time, position = track.time[inside], track.position[inside]
    speed = (position[-1] - position[0]) / (time[-1] - time[0])
    late = (np.interp(time, moment, encoder_angle) - position) / speed
    return 1e3 * float(np.median(late)), 1e3 * robust_sd(late - np.median(late))
