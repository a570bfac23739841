"""A log's content, sorted into memory as it is written, or read back after a crash."""

import mmap
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from truestand.core.errors import UnreadableFile
from truestand.core.stand import Stand
from truestand.devices.sensor import Layout
from truestand.files.checking import refuse_other_types
from truestand.files.recipes.recipes import stand_from_recipe
from truestand.files.scans.scan_log import SUSPECT, TABLE, Damage, Kind, Record, read_log
from truestand.station.recipe import ScanSettings, settings_from

MAP_BYTES = 1 << 26
"""Payloads are copied into maps of this size; the system has each back with its last frame, as no heap would do it."""


class Frames:
    """The frames of one sensor that can be decoded, each number once: the last one counts."""

    def __init__(self, frame_bytes: int) -> None:
        self._frame_bytes = frame_bytes
        self._by_number: dict[int, tuple[float, memoryview]] = {}
        self._free = memoryview(b"")
        """The free rest of the newest map."""

    def __len__(self) -> int:
        return len(self._by_number)

    def add(self, record: Record) -> None:
        """Copy a frame, unless it has another size or the watch reported a problem."""
        size = self._frame_bytes
        if record.flags & SUSPECT or len(record.payload) != size:
            return
        if len(self._free) < size:
            self._free = memoryview(mmap.mmap(-1, max(MAP_BYTES, size)))
        payload, self._free = self._free[:size], self._free[size:]
        payload[:] = record.payload
        self._by_number[record.number] = (record.time, payload)

    def taken_out(self) -> Iterator[tuple[int, float, memoryview]]:
        """Number, arrival (s of the host's clock) and payload of each frame in order; it is forgotten after that."""
        self._free = memoryview(b"")
        for number in sorted(self._by_number):
            arrived, payload = self._by_number.pop(number)
            yield number, arrived, payload


@dataclass(frozen=True, slots=True)
class SensorPlan:
    """How one sensor of a log recorded."""

    name: str
    layout: Layout
    encoder: bool
    """Whether its profiles carry the table's encoder count."""


@dataclass(slots=True)
class Log:
    """A log's content, by kind."""

    name: str
    stand: Stand
    settings: ScanSettings
    sensors: tuple[SensorPlan, ...]
    created: str
    software: str
    frames: list[Frames]
    """Of each sensor."""
    track: list[Record] = field(default_factory=list)
    end: Mapping[str, Any] | None = None
    damages: list[Damage] = field(default_factory=list)


def load_log(path: Path) -> Log:
    """The content of the log at ``path``.

    Raises:
        UnreadableFile: no log, without its first record, or with two of them.
    """
    damages: list[Damage] = []
    builder = LogBuilder(path)
    for record in read_log(path, damages):
        builder.add(record)
    if builder.log is None:
        raise _without_begin(path)
    builder.log.damages = damages
    return builder.log


class LogBuilder:
    """Builds the content of the log at ``path`` from its records, as they are written or read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.log: Log | None = None
        """None before the first record."""

    def add(self, record: Record) -> None:
        """Add the next record.

        Raises:
            UnreadableFile: the first one is no BEGIN or of another version, or there are two.
        """
        log = self.log
        if record.kind is Kind.BEGIN:
            if log is not None:
                raise UnreadableFile(
                    f"{self.path.name}: found two recordings, need one; recover each from the log of its own"
                )
            self.log = _log_from(record.json(), self.path.name)
        elif log is None:
            raise _without_begin(self.path)
        elif record.kind is Kind.FRAME and record.source < len(log.frames):
            log.frames[record.source].add(record)
        elif record.kind is Kind.TABLE and len(record.payload) == TABLE.size:
            log.track.append(record)
        elif record.kind is Kind.END:
            log.end = record.json()


def _without_begin(path: Path) -> UnreadableFile:
    return UnreadableFile(f"{path.name}: the log lost its first record, which says how to read it; scan again")


def begin_record(
    stand: Mapping[str, Any], settings: ScanSettings, sensors: tuple[SensorPlan, ...], created: str, software: str
) -> dict[str, Any]:
    """What a log's BEGIN holds; ``stand`` as in stand.toml."""
    plans = [{"name": s.name, "encoder": s.encoder, "layout": asdict(s.layout)} for s in sensors]
    return {"stand": stand, "order": settings.record(), "sensors": plans, "created": created, "software": software}


def _log_from(record: Mapping[str, Any], name: str) -> Log:
    try:
        plans = tuple(SensorPlan(str(s["name"]), _layout(s["layout"]), bool(s["encoder"])) for s in record["sensors"])
        stand = stand_from_recipe(record["stand"])
        settings = settings_from(record["order"])
        created, software = str(record["created"]), str(record["software"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UnreadableFile(
            f"{name}: the log's first record lacks {error}; it was written by another version "
            f"({record.get('software')}): recover it with that one"
        ) from error
    return Log(name, stand, settings, plans, created, software, [Frames(plan.layout.frame_bytes) for plan in plans])


def _layout(record: Mapping[str, Any]) -> Layout:
    scale = record.get("scale")
    layout = Layout(**{**record, "scale": None if scale is None else tuple(scale)})
    refuse_other_types(layout, Layout, "layout")
    if min(layout.points, layout.profiles, layout.rate) <= 0:
        raise ValueError("points, profiles and rate above 0")
    return layout
