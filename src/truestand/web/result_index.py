"""The results store as the page sees it: read only, and read again only where something came to it."""

import threading
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from truestand.store import Entry as Stored
from truestand.store import Store
from truestand.web.models import Entry, Has, Quantity
from truestand.web.trends import calibration_trends, inspection_trends

SHOWN = ("calibration", "verification", "inspection")
ROLES = ("record", "report", "cloud")


class Kept:
    """The store of a folder, be it there yet or not."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._lock = folder, threading.Lock()
        self._entries: list[Stored] = []
        self._head = (0, "")
        self._records: dict[str, Mapping[str, Any]] = {}
        self._trends: dict[tuple[tuple[int, str], str, tuple[str, ...]], list[Quantity]] = {}

    def entries(
        self, kinds: Collection[str] = (), parts: Collection[str] = (), limit: int = 50, before: int | None = None
    ) -> list[Entry]:
        """Results and what corrected them, newest first."""
        known = self._known()
        found: list[Entry] = []
        for number in sorted(known.results, reverse=True):
            if len(found) == limit:
                break
            if before is not None and number >= before:
                continue
            kind = known.kind(number)
            if kind in (kinds or SHOWN) and (not parts or known.results[number].part in parts):
                found.append(known.told(number))
        return found

    def entry(self, number: int) -> Entry | None:
        """One result."""
        known = self._known()
        return known.told(number) if number in known.results else None

    def calibration(self) -> Entry | None:
        """The newest that was not withdrawn, as last corrected."""
        known = self._known()
        newest = next(known.standing("calibration"), None)
        return None if newest is None else known.told(newest.number)

    def verification(self) -> Entry | None:
        """The newest of that calibration, but one that is undecided takes back no *does not hold*."""
        known = self._known()
        calibration = next(known.standing("calibration"), None)
        if calibration is None:
            return None
        records = {e.record for e in known.origins(calibration.number)}
        found = [
            v for v in known.standing("verification")
            if known.origins(v.number)[-1].evidence.get("calibration") in records
        ]  # fmt: skip
        decided = [v for v in found if v.status != "undecided"][:1]
        counts = [v for v in decided if v.status == "does_not_hold"] or found
        return known.told(counts[0].number) if counts else None

    def record(self, number: int) -> Mapping[str, Any]:
        """The record, checked against its hash; of a withdrawal there is none."""
        stored = self._known().results[number]
        if stored.record is None:
            return {}
        record = self._records.get(stored.record)
        if record is None:
            record = Store(self._folder).record(stored)
            # those of the newest calibration and its verification are asked for again and again
            self._records = dict([*self._records.items(), (stored.record, record)][-2:])
        return record

    def file(self, number: int, role: str) -> Path | None:
        """Where a file of a result lies."""
        stored = self._known().results.get(number)
        path = None if stored is None else Store(self._folder).evidence(stored).get(role)
        return path if role in ROLES and path is not None and path.exists() else None

    def history(self, kind: str, parts: Collection[str]) -> list[Quantity]:
        """Trends, made anew only where something came to the store."""
        known = self._known()
        if not known.results:
            return []
        key = (self._head, kind, tuple(sorted(parts)))
        found = self._trends.get(key)
        if found is None:
            store = Store(self._folder)
            found = calibration_trends(store) if kind == "calibration" else inspection_trends(store, parts)
            self._trends = {k: v for k, v in self._trends.items() if k[0] == self._head} | {key: found}
        return found

    def _known(self) -> "_Known":
        """All entries, brought up to date."""
        with self._lock:
            if (self._folder / "store.db").exists():
                store = Store.open(self._folder)
                head = store.head()
                if head != self._head:
                    self._add(store)
                    self._head = head
            return _Known(self._entries)

    def _add(self, store: Store) -> None:
        """What came since, by number, for a clock may be set back; everything where it isn't the store that was known.

        The last known entry's hash is chained to all before it.
        """
        last = self._entries[-1] if self._entries else None
        came = store.entries(first=None if last is None else last.number)
        if last is not None and came and came[0].hash == last.hash:
            self._entries = [*self._entries, *came[1:]]
        else:
            self._entries = store.entries()


class _Known:
    """Results with what became of them."""

    def __init__(self, entries: list[Stored]) -> None:
        self.results = {e.number: e for e in entries if e.kind in SHOWN or e.kind == "correction"}
        self.corrected = {e.about: e.number for e in entries if e.kind == "correction" and e.about is not None}

    def origins(self, number: int) -> list[Stored]:
        """A result and what it corrects, the original last."""
        found = [self.results[number]]
        while found[-1].kind == "correction" and found[-1].about in self.results:
            found.append(self.results[found[-1].about])
        return found

    def kind(self, number: int) -> str:
        """A correction is of the kind that it corrects."""
        return self.origins(number)[-1].kind

    def standing(self, kind: str) -> Iterator[Stored]:
        """Results of a kind that were not withdrawn, as last corrected; the newest original first."""
        for number in sorted((n for n, e in self.results.items() if e.kind == kind), reverse=True):
            last = self.results[self.last(number)]
            if last.record is not None:
                yield last

    def last(self, number: int) -> int:
        """The last correction's number, or its own."""
        while number in self.corrected:
            number = self.corrected[number]
        return number

    def told(self, number: int) -> Entry:
        """As clients see it."""
        entry, kind = self.results[number], self.kind(number)
        certified = kind == "calibration" and entry.status == "valid" and entry.record is not None
        return Entry(
            number=number,
            kind=kind,
            time=entry.time,
            operator=entry.operator,
            order=entry.order,
            serial=entry.serial,
            part=entry.part,
            title=entry.part or entry.text or kind,
            verdict=None if kind == "calibration" else entry.status,
            status=entry.status if kind == "calibration" else None,
            corrected_by=self.corrected.get(number),
            has=Has(report="report" in entry.evidence, cloud="cloud" in entry.evidence, certificate=certified),
        )
