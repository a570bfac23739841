"""The results store as the page sees it: read only, and read again only where something came to it."""

import threading
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

from truestand.files.records.inspection_record import Limits, limits_of
from truestand.report.quantities import QUANTITIES
from truestand.statistics.control import ControlChart, control_chart
from truestand.store import Entry as Stored
from truestand.store import Results, Store
from truestand.store.history import inspections, series, whole_part_lines
from truestand.web.models import AvailableFiles, Entry, Point, Quantity, TrendFinding
from truestand.web.usable import unusable_reason

KINDS = ("calibration", "verification", "inspection")
WITHDRAWN = "withdrawn"
"""Verdict or status of the entry that takes a result back."""
MAX_INSPECTIONS = 300
"""The newest: a record each is read."""


class ResultIndex:
    """The results of a folder's store, be it there yet or not, each with its record and files."""

    def __init__(self, folder: Path, stand: Path) -> None:
        self._folder, self._stand, self._lock = folder, stand, threading.Lock()
        self._made_with: dict[str | None, Mapping[str, Any]] = {}
        self._results = Results((), lambda sha256: {})
        self._head = (0, "")
        self._trends: dict[tuple[tuple[int, str], str, tuple[str, ...]], list[Quantity]] = {}

    def entries(
        self,
        kinds: Collection[str] = KINDS,
        parts: Collection[str] = (),
        limit: int | None = 50,
        before: int | None = None,
    ) -> list[Entry]:
        """Results and what corrected them, newest first: at most ``limit`` before entry ``before``.

        Raises:
            TruestandError: the store can't be read; so do all methods here.
        """
        known = self._updated()
        numbers = (
            number
            for number, result in sorted(known.entries.items(), reverse=True)
            if (before is None or number < before)
            and known.kind(number) in kinds
            and (not parts or result.part in parts)
        )
        return [self._entry(known, number) for number in islice(numbers, limit)]

    def entry(self, number: int) -> Entry | None:
        """One result."""
        known = self._updated()
        return self._entry(known, number) if number in known.entries else None

    def head(self) -> tuple[int, str]:
        """Number and hash of the store's last entry; (0, "") where there is none."""
        self._updated()
        return self._head

    def calibration(self) -> Entry | None:
        """The calibration in force: the newest valid one that was not withdrawn and is usable here, as last corrected.

        An untrusted one is in force only where none is valid.
        """
        known = self._updated()
        found = self._in_force(known)
        return None if found is None else self._entry(known, found.number)

    def not_in_force(self) -> tuple[int, str] | None:
        """The newest calibration and why it is not used, where another one is in force, or none."""
        known = self._updated()
        newest, found = next(known.not_withdrawn("calibration"), None), self._in_force(known)
        if newest is None or newest is found:
            return None
        return newest.number, self._unusable_reason(newest) or "it is not trusted"

    def verification(self) -> Entry | None:
        """The verification that counts for that calibration; None: it was not verified."""
        known = self._updated()
        calibration = self._in_force(known)
        found = None if calibration is None else known.verification(calibration.number)
        return None if found is None else self._entry(known, found.number)

    def record(self, number: int) -> Mapping[str, Any]:
        """Its calibration.json, inspection.json or verification.json, checked against its hash; empty: withdrawn."""
        stored = self._updated().entries[number]
        if stored.record is None:
            return {}
        return Store(self._folder).record(stored)

    def file(self, number: int, role: str) -> Path | None:
        """Where a file of a result lies, by its role (record, report, cloud); None: it has none."""
        stored = self._updated().entries.get(number)
        path = None if stored is None else Store(self._folder).evidence(stored).get(role)
        return path if path is not None and path.exists() else None

    def trends(self, kind: str, parts: Collection[str]) -> list[Quantity]:
        """Of calibrations, or of the inspections of a part; computed again only where something came to the store."""
        if not self._updated().entries:
            return []
        key = (self._head, kind, tuple(sorted(parts)))
        found = self._trends.get(key)
        if found is None:
            store = Store(self._folder)
            found = calibration_trends(store) if kind == "calibration" else inspection_trends(store, parts)
            self._trends = {k: v for k, v in self._trends.items() if k[0] == self._head} | {key: found}
        return found

    def _updated(self) -> Results:
        """All results, brought up to date."""
        with self._lock:
            if (self._folder / "store.db").exists():
                store = Store.open(self._folder)
                head = store.head()
                if head != self._head:
                    self._results, self._head = store.standing(), head
            return self._results

    def _entry(self, known: Results, number: int) -> Entry:
        """As clients see it."""
        entry, kind, now = known.entries[number], known.kind(number), datetime.now(UTC)
        word = entry.status if entry.record is not None else WITHDRAWN
        standing, doubts = known.standing(number, now), [str(doubt) for doubt in known.doubts(number, now)]
        if kind == "calibration" and standing == "stands" and (reason := self._unusable_reason(entry)):
            doubts = [f"not used on this stand: {reason}"]
        certified = kind == "calibration" and entry.status == "valid" and standing in ("stands", "in_doubt")
        return Entry(
            number=number,
            kind=kind,
            time=entry.time,
            operator=entry.operator,
            order=entry.order,
            serial=entry.serial,
            part=entry.part,
            title=entry.part or entry.text or "",
            verdict=None if kind == "calibration" else word,
            status=word if kind == "calibration" else None,
            corrects=entry.about,
            corrected_by=known.replaced_by(number),
            standing="in_doubt" if standing == "stands" and doubts else standing,
            doubts=doubts,
            has=AvailableFiles(
                report="report" in entry.evidence, cloud="cloud" in entry.evidence, certificate=certified
            ),
        )

    def _in_force(self, known: Results) -> Stored | None:
        """The newest valid calibration that is usable here; the newest usable one where none is valid."""
        newest = None
        for calibration in known.not_withdrawn("calibration"):
            if self._unusable_reason(calibration) is None:
                if calibration.status == "valid":
                    return calibration
                newest = newest or calibration
        return newest

    def _unusable_reason(self, calibration: Stored) -> str | None:
        """Why nothing can be inspected with it on this stand; of its record, which never changes, little is kept."""
        if calibration.record not in self._made_with:
            record = Store(self._folder).record(calibration)
            self._made_with[calibration.record] = {key: record.get(key) for key in ("method", "sensor", "stand")}
        return unusable_reason(self._made_with[calibration.record], self._stand)


def calibration_trends(store: Store) -> list[Quantity]:
    """The quantities of all calibrations that were not withdrawn; of several sensors, each for itself."""
    names = {key: name for key, name, *_ in QUANTITIES} | {"rms_um": "Residual, rms"}
    all_series = series(store)
    several = len({s.sensor for s in all_series}) > 1
    return [
        _quantity(
            f"{s.sensor} {s.quantity}" if several else s.quantity,
            f"{s.sensor}: {names[s.quantity]}" if several else names[s.quantity],
            s.unit, s.entries, s.chart,
        )
        for s in all_series
    ]  # fmt: skip


def inspection_trends(store: Store, parts: Collection[str]) -> list[Quantity]:
    """The whole part's characteristics over the newest inspections of a part, all serial numbers together."""
    matching = [r for r in inspections(store) if {r.entry.part, r.last.part} & set(parts)]
    standing = sorted((s for s in matching if not s.withdrawn), key=lambda s: s.entry.number)[-MAX_INSPECTIONS:]
    readings: dict[str, list[tuple[Stored, str, float, float | None, Limits | None]]] = {}
    for inspection in standing:
        record = store.record(inspection.last)
        for name, unit, c in whole_part_lines(record):
            reading = (inspection.entry, unit, float(c[f"value_{unit}"]), c.get(f"U_{unit}"), limits_of(c, record))
            readings.setdefault(name, []).append(reading)
    quantities = []
    for name, found in readings.items():
        entries, units, values, U, limits = zip(*found, strict=True)
        unit = "µm" if units[0] == "um" else units[0]
        quantities.append(_quantity(name, name, unit, entries, control_chart(values, U), limits[-1]))
    return quantities


def _quantity(
    name: str, label: str, unit: str, entries: Collection[Stored], chart: ControlChart, limits: Limits | None = None
) -> Quantity:
    pairs = list(zip(entries, chart.points, strict=True))
    return Quantity(
        name=name,
        label=label,
        unit=unit,
        points=[Point(number=e.number, time=e.time, value=p.value, U=p.U) for e, p in pairs],
        centre=chart.mean,
        lower=chart.lower,
        upper=chart.upper,
        limit=None if limits is None or unit == "mm" else limits[0] if limits[1] is None else limits[1],
        limits=limits,
        findings=[TrendFinding(number=e.number, text="; ".join(p.flags)) for e, p in pairs if p.flags],
    )
