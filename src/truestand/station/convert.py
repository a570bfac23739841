"""From a log's content to scans, the same as they are recorded and after a crash.

A scan is incomplete until proven complete.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import degrees, radians, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.errors import NotEnoughData
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.devices.layout import Unwrapper, decode
from truestand.devices.sensor import Layout
from truestand.files.scans.scan_log import TABLE
from truestand.station.log import Frames, Log, SensorPlan
from truestand.station.sync import (
    ClockFit,
    TableTrack,
    angle_by_clock,
    angle_by_encoder,
    fit_clocks,
    latch_skew_ms,
)

Column = NDArray[Any] | None

COVERAGE_TOLERANCE = radians(0.2)
"""rad that may be missing at the end of a scan that is called complete, or two profiles' worth, if that is more."""
AT_REST_S = 0.05
"""With one count at most, where the encoder is at rest."""
LATEST_REST_S = 1.0
"""After the first profile, within which the table is at rest; it may have come there while a frame was on its way."""
TRAVEL_TOLERANCE, TRAVEL_TOLERANCE_SHARE = radians(0.3), 0.001
"""rad, and share of the travel, by which encoder and table may differ at the end of a scan that is called complete."""


@dataclass(frozen=True, slots=True)
class SensorScan:
    """One sensor's scan out of a log."""

    sensor: str
    stand: Stand
    recording: Recording
    reasons: tuple[str, ...]
    """Why the scan isn't complete; empty where it is proven to be."""
    sensors: int
    """How many took part, whether or not profiles came of each."""

    @property
    def complete(self) -> bool:
        """Whether the scan is proven complete."""
        return not self.reasons


def convert(log: Log) -> tuple[SensorScan, ...]:
    """The scans of a log, one a sensor. The log gives up its frames for them, so that a scan is in memory once.

    Raises:
        NotEnoughData: a log without a whole profile.
    """
    scans = []
    for plan, frames in zip(log.sensors, log.frames, strict=True):
        stream = _decoded(plan.layout, frames).from_rest() if frames else None
        if stream is not None and stream.counter.size:
            scans.append(_scan(log, plan, stream))
    if not scans:
        raise NotEnoughData(f"{log.name}: found no whole profile in the log, need at least one; scan again")
    return tuple(scans)


@dataclass(frozen=True, slots=True)
class Stream:
    """The profiles of a whole stream, in order."""

    x: Array
    """(N, points) mm; NaN = not seen."""
    z: Array
    counter: NDArray[np.int64]
    """(N,): a step of more than 1 = profiles lost."""
    time: Array
    """(N,) s of the sensor's clock, the middle of the exposure; from counter and rate where it sends none."""
    encoder: NDArray[np.int64] | None
    """(N,) counts."""
    arrived: Array
    """(N,) s of the host's clock."""

    def from_rest(self) -> "Stream":
        """Without the profiles from when the table was still coming to its start, as the encoder shows it."""
        if self.encoder is None or not self.time.size:
            return self
        soon = self.time[self.time <= self.time[0] + LATEST_REST_S]
        until = np.searchsorted(self.time, soon + AT_REST_S, side="right") - 1
        first = int(np.argmax(np.abs(self.encoder[until] - self.encoder[: soon.size]) <= 1))
        return Stream(
            self.x[first:], self.z[first:], self.counter[first:], self.time[first:], self.encoder[first:],
            self.arrived[first:],
        )  # fmt: skip


def _decoded(layout: Layout, frames: Frames) -> Stream:
    """All frames as one stream; x and z are filled in place as the frames are given up."""
    unwrapper, capacity = Unwrapper(layout), len(frames) * layout.profiles
    x, z = np.empty((capacity, layout.points)), np.empty((capacity, layout.points))
    columns: list[tuple[Column, ...]] = []
    n, begin = 0, None
    for number, arrived, payload in frames.taken_out():
        begin = number if begin is None else begin
        profiles = unwrapper.unwrap(decode(layout, payload))
        rows = slice(n, n := n + len(profiles.x))
        x[rows], z[rows] = profiles.x, profiles.z
        first = (number - begin) * layout.profiles
        counter = np.arange(len(profiles.x)) + first if profiles.counter is None else profiles.counter
        columns.append((counter, profiles.time, profiles.encoder, np.full(len(profiles.x), arrived)))
    numbers, time, encoder, arrivals = (_joined(column) for column in zip(*columns, strict=True))
    assert numbers is not None and arrivals is not None
    counts = numbers.astype(np.int64)
    return Stream(
        x[:n], z[:n], counts, counts / layout.rate if time is None else time,
        None if encoder is None else encoder.astype(np.int64), arrivals,
    )  # fmt: skip


def _joined(column: tuple[Column, ...]) -> NDArray[Any] | None:
    """One column of the whole stream; None where a frame lacks it."""
    pieces = [piece for piece in column if piece is not None]
    return np.concatenate(pieces) if len(pieces) == len(column) else None


@dataclass(frozen=True, slots=True)
class TableAngles:
    """The table's angle at each profile of a stream."""

    position: Array
    """(n,) rad of the table; NaN where it is not known."""
    source: str
    """encoder, clock or none."""
    synchronisation: dict[str, Any]
    """As recorded with the scan."""
    contradiction: str = ""
    """Why the angles can't be right; empty = no contradiction."""


def _scan(log: Log, plan: SensorPlan, stream: Stream) -> SensorScan:
    settings = log.settings
    angles = _table_angles(log, plan, stream)
    begin = angles.position[0] + settings.run_up
    end = begin + settings.turns * tau
    kept = (angles.position >= begin) & (angles.position < end)
    if not kept.any():  # broken off during the run-up: keep the profiles there are
        kept = np.ones(angles.position.shape, dtype=np.bool_)
    lost = _lost(stream.counter, kept)
    tolerance = max(COVERAGE_TOLERANCE, 2 * settings.speed / plan.layout.rate)
    reasons = _reasons(log, lost, angles, kept, end, tolerance)
    acquisition = {
        "complete": not reasons,
        "reasons": reasons,
        "recorded": log.created,
        "software": log.software,
        "order": settings.record(),
        "profiles": int(kept.sum()),
        "lost_profiles": lost,
        "synchronisation": angles.synchronisation,
    }
    stand = _sensor_stand(log.stand, plan, angles)
    recording = _recording(stream, angles, _rows(kept), acquisition, stand)
    return SensorScan(plan.name, stand, recording, tuple(reasons), len(log.sensors))


def _rows(kept: Mask) -> "slice | Ints":
    """What is kept, as a slice where it is one piece: a slice costs no copy of millions of points."""
    rows = np.flatnonzero(kept)
    whole = rows[-1] - rows[0] + 1 == rows.size
    return slice(int(rows[0]), int(rows[-1]) + 1) if whole else rows


def _table_angles(log: Log, plan: SensorPlan, stream: Stream) -> TableAngles:
    track = _track(log)
    start = float(track.position[0]) if track.position.size else 0.0
    turning = _turning(stream.arrived, track)
    clocks = fit_clocks(stream.time[turning], stream.arrived[turning])
    moment = clocks.offset + clocks.rate * stream.time
    synchronisation: dict[str, Any] = {"clock_rate": clocks.rate, "table_samples": int(track.time.size)}
    if plan.encoder and stream.encoder is not None and log.stand.counts_per_turn:
        position = angle_by_encoder(stream.encoder, log.stand.counts_per_turn, start)
        skew_ms, spread_ms = latch_skew_ms(moment, position, track)
        synchronisation |= {"source": "encoder", "latch_skew_ms": skew_ms, "latch_skew_spread_ms": spread_ms}
        return TableAngles(position, "encoder", synchronisation, _contradiction(stream, position, track))
    if track.time.size < 2:
        return TableAngles(np.full(moment.shape, np.nan), "none", {**synchronisation, "source": "none"})
    begin = start + log.settings.run_up
    position, steady = angle_by_clock(moment, track, (begin, begin + log.settings.turns * tau))
    synchronisation |= {"source": "clock", "steady": steady, "doubt_ms": 1e3 * float(np.median(track.half_width)),
                        "clock_misfit_ms": 1e3 * clocks.misfit}  # fmt: skip
    return TableAngles(position, "clock", synchronisation, _uneven(clocks, log.settings.speed))


def _turning(arrived: Array, track: TableTrack) -> Mask:
    """Profiles (n,) that came while the table turned: at rest their moment doesn't matter. All, where it never did."""
    times = track.time[track.moving]
    if times.size < 2:
        return np.ones(arrived.shape, dtype=np.bool_)
    turning = (arrived >= times[0]) & (arrived <= times[-1])
    return turning if np.count_nonzero(turning) > 1 else np.ones(arrived.shape, dtype=np.bool_)


def _track(log: Log) -> TableTrack:
    values = np.array([TABLE.unpack(r.payload) for r in log.track], dtype=np.float64).reshape(-1, 3)
    time = np.array([r.time for r in log.track], dtype=np.float64)
    return TableTrack(time, values[:, 0], values[:, 1], values[:, 2] > 0)


def _uneven(clocks: ClockFit, speed: float) -> str:
    """The problem of angles by the clocks where the table turned at ``speed`` (rad/s)."""
    error = clocks.misfit * speed
    if error <= TRAVEL_TOLERANCE:
        return ""
    return (
        f"the clocks of sensor and host left their line by {1e3 * clocks.misfit:.0f} ms, {degrees(error):.1f} deg of "
        "the table: end other programs, or wire the encoder"
    )


def _contradiction(stream: Stream, position: Array, track: TableTrack) -> str:
    """The problem of the encoder's ``position`` where the table reports another travel from rest to rest."""
    last = stream.time > stream.time[-1] - AT_REST_S
    if track.time.size < 2 or track.moving[-1] or stream.encoder is None or np.ptp(stream.encoder[last]) > 1:
        return ""
    counted, turned = position[-1] - position[0], track.position[-1] - track.position[0]
    if abs(counted - turned) <= TRAVEL_TOLERANCE + TRAVEL_TOLERANCE_SHARE * abs(turned):
        return ""
    return (
        f"the encoder counted {degrees(counted):.1f} deg where the table turned {degrees(turned):.1f}: counts were "
        "lost, or counts_per_turn in stand.toml is wrong"
    )


def _lost(counter: NDArray[np.int64], kept: Mask) -> int:
    """Profiles that the counter skips, from the last one before those that are kept to the first one after them."""
    first, last = np.flatnonzero(kept)[[0, -1]]
    around = counter[max(first - 1, 0) : last + 2]
    return int(around[-1] - around[0]) + 1 - around.size


def _reasons(log: Log, lost: int, angles: TableAngles, kept: Mask, end: float, tolerance: float) -> list[str]:
    """Why the scan isn't complete; empty where it is proven. ``end``: up to where it must have been seen (rad)."""
    reasons = []
    if log.end is None:
        reasons.append("the recording was cut off before its end")
    elif not log.end.get("complete"):
        reasons += [str(reason) for reason in log.end.get("reasons", [])] or ["it was stopped before its end"]
    if log.damages:
        reasons.append(f"the log is damaged: {sum(d.bytes for d in log.damages)} bytes at byte {log.damages[0].start}")
    if angles.contradiction and not reasons:
        reasons.append(angles.contradiction)
    if lost > log.settings.most_lost * np.count_nonzero(kept):
        reasons.append(f"{lost} profiles were lost, at most {100 * log.settings.most_lost:g} % may be")
    missing = end - float(angles.position[kept].max())
    if angles.source == "none":
        reasons.append("nothing tells the table's angle: no encoder, and no position of the table was recorded")
    elif missing > tolerance and not reasons:
        reasons.append(f"the last {degrees(missing):.1f} deg of {360 * log.settings.turns:g} were not seen")
    return reasons


def _sensor_stand(stand: Stand, plan: SensorPlan, angles: TableAngles) -> Stand:
    """The stand with this sensor only."""
    sensors = tuple(s for s in stand.sensors if s.name == plan.name) or stand.sensors[:1]
    counts = stand.counts_per_turn if angles.source == "encoder" else 0
    return replace(stand, sensors=sensors, counts_per_turn=counts)


def _recording(
    stream: Stream, angles: TableAngles, rows: slice | Ints, acquisition: Mapping[str, Any], stand: Stand
) -> Recording:
    counts = angles.position / tau * stand.counts_per_turn if angles.source == "encoder" else None
    return Recording(
        stream.x[rows],
        stream.z[rows],
        "recorded",
        "",
        time=stream.time[rows],
        angle=angles.position[rows] if angles.source == "clock" else None,
        encoder=None if counts is None else np.rint(counts[rows]),
        counter=stream.counter[rows],
        acquisition=acquisition,
    )
