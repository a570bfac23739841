"""From a log's records to scans, the same way as they are written and after a crash.

A scan is incomplete until proven complete.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from math import degrees, radians, tau
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import NotEnoughData, UnreadableFile
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.devices.layout import Unwrapper, decode
from truestand.devices.sensor import Layout
from truestand.files.checking import refuse_other_types
from truestand.files.recipes.recipes import stand_from_recipe
from truestand.files.scans.scan_log import TABLE, Damage, Kind, Record, read_log
from truestand.station.frames import Frames
from truestand.station.recipe import Order, order_from
from truestand.station.sync import (
    ClockLine,
    TableTrack,
    angle_by_clock,
    angle_by_encoder,
    clock_line,
    latch_skew,
)

Array = NDArray[np.float64]
Column = NDArray[Any] | None

CUT_OFF = "the recording was cut off before its end"
COVERAGE_SLACK = radians(0.2)
"""rad that may be missing at the end of a scan that is called complete, or two profiles' worth, if that is more."""
AT_REST = 0.05
"""s with one count at most at the end, where the encoder has come to rest."""
MOST_APART, APART_SHARE = radians(0.3), 0.001
"""rad, and share of the travel, by which encoder and table may differ at the end of a scan that is called complete."""


@dataclass(frozen=True, slots=True)
class SensorPlan:
    """One sensor of a log."""

    name: str
    layout: Layout
    encoder: bool


@dataclass(slots=True)
class Log:
    """A log's content, sorted."""

    name: str
    stand: Stand
    order: Order
    sensors: tuple[SensorPlan, ...]
    created: str
    software: str
    frames: list[Frames]
    """Of each sensor."""
    track: list[Record] = field(default_factory=list)
    end: Mapping[str, Any] | None = None
    damages: list[Damage] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Converted:
    """One sensor's scan out of a log."""

    sensor: str
    stand: Stand
    recording: Recording
    sensors: int = 1
    """How many took part, whether or not anything came of each."""

    @property
    def complete(self) -> bool:
        """Whether it is proven complete."""
        return self.recording.acquisition is not None and bool(self.recording.acquisition["complete"])

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is not."""
        return () if self.recording.acquisition is None else tuple(self.recording.acquisition["reasons"])


def convert(log: Log) -> tuple[Converted, ...]:
    """The scans of a log, one a sensor. The log gives up its frames for them, so that a scan is in memory once.

    Raises:
        NotEnoughData: a log without a whole profile.
    """
    found = tuple(_scan(log, i, stream) for i, stream in _streams(log))
    if not found:
        raise NotEnoughData(f"{log.name}: found no whole profile in the log, need at least one; scan again")
    return found


def sort_log(path: Path) -> Log:
    """A log's records, by kind.

    Raises:
        UnreadableFile: no log, without its first record, or with two of them.
    """
    damages: list[Damage] = []
    sorter = LogSorter(path)
    for record in read_log(path, damages):
        sorter.add(record)
    if sorter.log is None:
        raise _headless(path)
    sorter.log.damages = damages
    return sorter.log


class LogSorter:
    """Sorts the records of the log at ``path`` as they are written, or read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.log: Log | None = None
        """None before the first record."""

    def add(self, record: Record) -> None:
        """Sort in the next record.

        Raises:
            UnreadableFile: the first one is no BEGIN or of another version, or there are two.
        """
        log = self.log
        if record.kind is Kind.BEGIN:
            if log is not None:
                raise UnreadableFile(
                    f"{self.path.name}: found two recordings, need one; recover each from the log of its own"
                )
            self.log = _begun(record.json(), self.path.name)
        elif log is None:
            raise _headless(self.path)
        elif record.kind is Kind.FRAME and record.source < len(log.frames):
            log.frames[record.source].add(record)
        elif record.kind is Kind.TABLE and len(record.payload) == TABLE.size:
            log.track.append(record)
        elif record.kind is Kind.END:
            log.end = record.json()


def _headless(path: Path) -> UnreadableFile:
    return UnreadableFile(f"{path.name}: the log lost its first record, which says how to read it; scan again")


def begin_record(
    stand: Mapping[str, Any], order: Order, sensors: tuple[SensorPlan, ...], created: str, software: str
) -> dict[str, Any]:
    """What a log's BEGIN holds; ``stand`` as in stand.toml."""
    plans = [{"name": s.name, "encoder": s.encoder, "layout": asdict(s.layout)} for s in sensors]
    return {"stand": stand, "order": order.record(), "sensors": plans, "created": created, "software": software}


def _begun(told: Mapping[str, Any], name: str) -> Log:
    try:
        plans = tuple(SensorPlan(str(s["name"]), _layout(s["layout"]), bool(s["encoder"])) for s in told["sensors"])
        stand = stand_from_recipe(told["stand"])
        order = order_from(told["order"])
        created, software = str(told["created"]), str(told["software"])
    except (KeyError, TypeError, ValueError, AttributeError) as wrong:
        raise UnreadableFile(
            f"{name}: the log's first record lacks {wrong}; it was written by another version "
            f"({told.get('software')}): recover it with that one"
        ) from wrong
    return Log(name, stand, order, plans, created, software, [Frames(plan.layout.frame_bytes) for plan in plans])


def _layout(told: Mapping[str, Any]) -> Layout:
    scale = told.get("scale")
    layout = Layout(**{**told, "scale": None if scale is None else tuple(scale)})
    refuse_other_types(layout, Layout, "layout")
    if min(layout.points, layout.profiles, layout.rate) <= 0:
        raise ValueError("points, profiles and rate above 0")
    return layout


def _streams(log: Log) -> Iterator[tuple[int, "Stream"]]:
    """Each sensor of which a whole profile came, by its place, one after the other."""
    for i, plan in enumerate(log.sensors):
        frames = log.frames[i]
        if frames and (stream := _decoded(plan.layout, frames)).counter.size:
            yield i, stream


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


def _decoded(layout: Layout, frames: Frames) -> Stream:
    """All frames in one go on; x and z are filled in place as the frames are given up."""
    unwrapper, most = Unwrapper(layout), len(frames) * layout.profiles
    x, z = np.empty((most, layout.points)), np.empty((most, layout.points))
    columns: list[tuple[Column, ...]] = []
    n, begin = 0, None
    for number, arrived, payload in frames.taken_out():
        begin = number if begin is None else begin
        found = unwrapper.unwrap(decode(layout, payload))
        rows = slice(n, n := n + len(found.x))
        x[rows], z[rows] = found.x, found.z
        first = (number - begin) * layout.profiles
        counter = np.arange(len(found.x)) + first if found.counter is None else found.counter
        columns.append((counter, found.time, found.encoder, np.full(len(found.x), arrived)))
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
class Placed:
    """Profiles with the table angle that belongs to each."""

    position: Array
    """(n,) rad of the table; NaN where nothing tells it."""
    source: str
    """encoder, clock or none."""
    told: dict[str, Any]
    """What the record says of the synchronisation."""
    contradiction: str = ""
    """Why the angles can't be right; empty where nothing says so."""


def _scan(log: Log, i: int, decoded: Stream) -> Converted:
    plan = log.sensors[i]
    placed = _placed(log, plan, decoded)
    begin = placed.position[0] + log.order.run_up
    end = begin + log.order.turns * tau
    kept = (placed.position >= begin) & (placed.position < end)
    if not kept.any():  # broken off before the scan proper: better what there is than nothing
        kept = np.ones(placed.position.shape, dtype=np.bool_)
    lost = _lost(decoded.counter, kept)
    slack = max(COVERAGE_SLACK, 2 * log.order.speed / plan.layout.rate)
    reasons = _reasons(log, lost, placed, kept, end, slack)
    acquisition = {
        "complete": not reasons,
        "reasons": reasons,
        "recorded": log.created,
        "software": log.software,
        "order": log.order.record(),
        "profiles": int(kept.sum()),
        "lost_profiles": lost,
        "synchronisation": placed.told,
    }
    stand = _stand_of(log.stand, plan, placed)
    return Converted(plan.name, stand, _recording(decoded, placed, _rows(kept), acquisition, stand), len(log.sensors))


def _rows(kept: NDArray[np.bool_]) -> "slice | NDArray[np.intp]":
    """What is kept, as a slice where it is one piece: a slice costs no copy of millions of points."""
    rows = np.flatnonzero(kept)
    whole = rows[-1] - rows[0] + 1 == rows.size
    return slice(int(rows[0]), int(rows[-1]) + 1) if whole else rows


def _placed(log: Log, plan: SensorPlan, decoded: Stream) -> Placed:
    track = _track(log)
    start = float(track.position[0]) if track.position.size else 0.0
    turning = _turning(decoded.arrived, track)
    clocks = clock_line(decoded.time[turning], decoded.arrived[turning])
    moment = clocks.offset + clocks.rate * decoded.time
    told: dict[str, Any] = {"clock_rate": clocks.rate, "table_samples": int(track.time.size)}
    if plan.encoder and decoded.encoder is not None and log.stand.counts_per_turn:
        position = angle_by_encoder(decoded.encoder, log.stand.counts_per_turn, start)
        skew = latch_skew(moment, position, track)
        told |= {"source": "encoder", "latch_skew_ms": None if skew is None else 1e3 * skew.seconds,
                 "latch_skew_spread_ms": None if skew is None else 1e3 * skew.spread}  # fmt: skip
        return Placed(position, "encoder", told, _contradiction(decoded, position, track))
    if track.time.size < 2:
        return Placed(np.full(moment.shape, np.nan), "none", {**told, "source": "none"})
    within = (start + log.order.run_up, start + log.order.run_up + log.order.turns * tau)
    position, steady = angle_by_clock(moment, track, within)
    told |= {"source": "clock", "steady": steady, "doubt_ms": 1e3 * float(np.median(track.doubt)),
             "clock_misfit_ms": 1e3 * clocks.misfit}  # fmt: skip
    return Placed(position, "clock", told, _uneven(clocks, log.order.speed))


def _turning(arrived: Array, track: TableTrack) -> NDArray[np.bool_]:
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


def _uneven(clocks: ClockLine, speed: float) -> str:
    """What is wrong with angles by the clocks where the table turned at ``speed`` (rad/s)."""
    off = clocks.misfit * speed
    if off <= MOST_APART:
        return ""
    return (
        f"the clocks of sensor and host left their line by {1e3 * clocks.misfit:.0f} ms, {degrees(off):.1f} deg of the "
        "table: end other programs, or wire the encoder"
    )


def _contradiction(decoded: Stream, position: Array, track: TableTrack) -> str:
    """What is wrong with the encoder's ``position`` where the table tells another travel from rest to rest."""
    last = decoded.time > decoded.time[-1] - AT_REST
    if track.time.size < 2 or track.moving[-1] or decoded.encoder is None or np.ptp(decoded.encoder[last]) > 1:
        return ""
    counted, turned = position[-1] - position[0], track.position[-1] - track.position[0]
    if abs(counted - turned) <= MOST_APART + APART_SHARE * abs(turned):
        return ""
    return (
        f"the encoder counted {degrees(counted):.1f} deg where the table turned {degrees(turned):.1f}: counts were "
        "lost, or counts_per_turn in stand.toml is wrong"
    )


def _lost(counter: NDArray[np.int64], kept: NDArray[np.bool_]) -> int:
    """Profiles that the counter skips, from the last one before those that are kept to the first one after them."""
    first, last = np.flatnonzero(kept)[[0, -1]]
    around = counter[max(first - 1, 0) : last + 2]
    return int(around[-1] - around[0]) + 1 - around.size


def _reasons(log: Log, lost: int, placed: Placed, kept: NDArray[np.bool_], end: float, slack: float) -> list[str]:
    """Why the scan isn't complete; empty where it is proven. It must have been seen up to ``end``, less ``slack``."""
    reasons = []
    if log.end is None:
        reasons.append(CUT_OFF)
    elif not log.end.get("complete"):
        reasons += [str(reason) for reason in log.end.get("reasons", [])] or ["it was stopped before its end"]
    if log.damages:
        reasons.append(f"the log is damaged: {sum(d.bytes for d in log.damages)} bytes at byte {log.damages[0].start}")
    if placed.contradiction and not reasons:
        reasons.append(placed.contradiction)
    if lost > log.order.most_lost * np.count_nonzero(kept):
        reasons.append(f"{lost} profiles were lost, at most {100 * log.order.most_lost:g} % may be")
    missing = end - float(placed.position[kept].max())
    if placed.source == "none":
        reasons.append("nothing tells the table's angle: no encoder, and no position of the table was recorded")
    elif missing > slack and not reasons:
        reasons.append(f"the last {degrees(missing):.1f} deg of {360 * log.order.turns:g} were not seen")
    return reasons


def _stand_of(stand: Stand, plan: SensorPlan, placed: Placed) -> Stand:
    """The stand as this sensor saw it."""
    own = tuple(s for s in stand.sensors if s.name == plan.name) or stand.sensors[:1]
    counts = stand.counts_per_turn if placed.source == "encoder" else 0
    return replace(stand, sensors=own, counts_per_turn=counts)


def _recording(
    decoded: Stream, placed: Placed, rows: slice | NDArray[np.intp], acquisition: Mapping[str, Any], stand: Stand
) -> Recording:
    counts = placed.position / tau * stand.counts_per_turn if placed.source == "encoder" else None
    return Recording(
        decoded.x[rows],
        decoded.z[rows],
        "recorded",
        "",
        time=decoded.time[rows],
        angle=placed.position[rows] if placed.source == "clock" else None,
        encoder=None if counts is None else np.rint(counts[rows]),
        counter=decoded.counter[rows],
        acquisition=acquisition,
    )
