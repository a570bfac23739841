"""What a result is worth today: corrected, withdrawn, or in doubt for what became of the calibration it rests on.

Nothing that is stored changes when a calibration is withdrawn or turns out not to hold. What follows from that for the
results made with it is worked out here, whenever they are shown.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Any, Literal

from truestand.core.errors import BadStore
from truestand.core.message import RECIPE_CHANGED, Message
from truestand.files.records.record import is_past, read_messages
from truestand.store.entry import RESULTS, Entry

Standing = Literal["stands", "in_doubt", "corrected", "withdrawn"]
ReadRecord = Callable[[str], Mapping[str, Any]]
"""The record with a SHA-256; BadStore where it is missing or changed."""


class Results:
    """The results among a store's entries, with their corrections."""

    def __init__(self, entries: Iterable[Entry], read: ReadRecord) -> None:
        self.entries = {e.number: e for e in entries if e.kind in (*RESULTS, "correction")}
        self.corrected_by = {e.about: e.number for e in self.entries.values() if e.about is not None}
        self._read = read
        self._stated: dict[str, _Statement] = {}
        self._withdrawals = self._withdrawals_by_record()
        self._calibrations: dict[str, list[int]] = {}
        for number, entry in self.entries.items():
            if entry.record is not None and self.kind(number) == "calibration":
                self._calibrations.setdefault(entry.record, []).append(number)

    def with_origins(self, number: int) -> list[Entry]:
        """A result and what it corrects, the original last."""
        found = [self.entries[number]]
        while found[-1].kind == "correction" and found[-1].about in self.entries:
            found.append(self.entries[found[-1].about])
        return found

    def kind(self, number: int) -> str:
        """A correction is of the kind that it corrects."""
        return self.with_origins(number)[-1].kind

    def last(self, number: int) -> Entry:
        """The last correction of a result, or the result itself; of a record that was withdrawn, its withdrawal.

        A withdrawal stands for the same bytes wherever they are kept, and kept again.
        """
        while number in self.corrected_by:
            number = self.corrected_by[number]
        entry = self.entries[number]
        return self._withdrawals.get(entry.record or "", entry)

    def replaced_by(self, number: int) -> int | None:
        """The entry that corrects or withdraws a result; None: it counts."""
        last = self.last(number).number
        return self.corrected_by.get(number) or (None if last == number else last)

    def standing(self, number: int, now: datetime) -> Standing:
        """What a result is worth at a time."""
        last = self.last(number)
        if last.record is None:
            return "withdrawn"
        if last.number != number:
            return "corrected"
        return "in_doubt" if self.doubts(number, now) else "stands"

    def not_withdrawn(self, kind: str) -> Iterator[Entry]:
        """Results of a kind as last corrected, without those that were withdrawn; the newest original first."""
        for number in sorted((n for n, e in self.entries.items() if e.kind == kind), reverse=True):
            last = self.last(number)
            if last.record is not None:
                yield last

    def verification(self, calibration: int, before: int | None = None) -> Entry | None:
        """The verification that counts for a calibration, of all or of those ``before`` an entry; None: none was made.

        The newest, but one that is undecided takes back no *does not hold*.
        """
        found = [v for n, v in self._verifications(calibration) if before is None or n < before]
        decided = [v for v in found if v.status != "undecided"][:1]
        counting = [v for v in decided if v.status == "does_not_hold"] or found
        return counting[0] if counting else None

    def doubts(self, number: int, now: datetime) -> tuple[Message, ...]:
        """What speaks against a result that was neither corrected nor withdrawn; nothing where it stands."""
        if self.replaced_by(number) is not None or self.entries[number].record is None:
            return ()
        kind = self.kind(number)
        try:
            if kind == "calibration":
                return tuple(self._calibration_doubts(number, now))
            return tuple(self._dependent_doubts(number, kind))
        except BadStore as wrong:
            return (Message("evidence_missing", f"what it rests on can't be read: {wrong}"),)

    def _calibration_doubts(self, number: int, now: datetime) -> Iterator[Message]:
        until = self._valid_until(self.entries[number].record or "")
        if is_past(until, now):
            yield Message("calibration_expired", f"expired: it was valid until {until}; calibrate again")
        verification = self.verification(number)
        if verification is not None and verification.status == "does_not_hold":
            yield Message("calibration_does_not_hold", f"does not hold: {_of(verification)}; calibrate again")
        if verification is not None and verification.status == "undecided":
            yield Message("calibration_undecided", f"may not hold: {_of(verification)} is undecided; verify again")

    def _dependent_doubts(self, number: int, kind: str) -> Iterator[Message]:
        """Of an inspection or a verification, whose calibration the store may know or not."""
        if kind == "inspection":
            yield from self._statement(self.entries[number].record or "").changes
        sha256 = self._calibration_sha256(number)
        if sha256 is None:
            return
        known = self._calibrations.get(sha256, [])
        # one record may have been kept twice, for instance in the place of its own withdrawal
        counting = [n for n in known if self.replaced_by(n) is None]
        calibration = next(reversed(counting or known), None)
        name = f"calibration {sha256[:12]}" if calibration is None else f"calibration #{calibration}"
        if calibration is not None and not counting:
            yield self._taken_back(calibration, name)
        if kind != "inspection":
            return
        made, until = self.with_origins(number)[-1], self._valid_until(sha256)
        if is_past(until, _moment(made.time)):
            text = f"rests on {name}, which had expired: it was valid until {until}; calibrate and inspect again"
            yield Message("calibration_expired", text)
        if calibration is not None:
            yield from self._verified(made.number, calibration, name)

    def _taken_back(self, calibration: int, name: str) -> Message:
        last = self.last(calibration)
        code, word = ("withdrawn", "is withdrawn") if last.record is None else ("corrected", "was corrected")
        text = f"rests on {name}, which {word} by #{last.number} ({last.text}); inspect again"
        return Message(f"calibration_{code}", text)

    def _verified(self, number: int, calibration: int, name: str) -> Iterator[Message]:
        """What the verifications before an inspection and the next decided one after it say."""
        before = self.verification(calibration, number)
        if before is not None and before.status == "does_not_hold":
            text = f"rests on {name}, which did not hold before: {_of(before)}; calibrate and inspect again"
            yield Message("calibration_did_not_hold", text)
        if before is not None and before.status == "undecided":
            text = f"rests on {name}, which may not have held: {_of(before)} is undecided; verify again"
            yield Message("calibration_undecided", text)
        decided = [v for n, v in self._verifications(calibration) if n > number and v.status != "undecided"]
        if decided and decided[-1].status == "does_not_hold":  # one that holds vouches for all that was measured before
            text = f"since then {name} did not hold: {_of(decided[-1])}; calibrate and inspect again"
            yield Message("calibration_does_not_hold", text)

    def _withdrawals_by_record(self) -> dict[str, Entry]:
        """By the hash of a record the entry that withdrew it, but of one that somebody kept again for a reason."""
        found: dict[str, Entry] = {}
        for number, entry in sorted(self.entries.items()):
            if entry.kind != "correction":
                continue
            if entry.record is None:
                found |= {e.record: entry for e in self.with_origins(number) if e.record is not None}
            else:
                found.pop(entry.record, None)
        return found

    def _verifications(self, calibration: int) -> list[tuple[int, Entry]]:
        """Those of a calibration, with the number of the original, the newest first."""
        records = {e.record for e in self.with_origins(calibration)}
        found = [v for record in records for v in self._verifications_of.get(record, ())]
        return sorted(found, key=lambda one: one[0], reverse=True)

    @cached_property
    def _verifications_of(self) -> dict[str | None, list[tuple[int, Entry]]]:
        """By the hash of the calibration's record."""
        found: dict[str | None, list[tuple[int, Entry]]] = {}
        for verification in self.not_withdrawn("verification"):
            original = self.with_origins(verification.number)[-1].number
            found.setdefault(self._calibration_sha256(original), []).append((original, verification))
        return found

    def _calibration_sha256(self, number: int) -> str | None:
        """Of the record of the calibration that a result rests on."""
        entry = self.entries[number]
        return entry.evidence.get("calibration") or self._statement(entry.record or "").calibration

    def _valid_until(self, sha256: str) -> str | None:
        return self._statement(sha256).valid_until

    def _statement(self, sha256: str) -> "_Statement":
        """What a record states. A record never changes."""
        if sha256 not in self._stated:
            self._stated[sha256] = _Statement.of(self._read(sha256))
        return self._stated[sha256]


@dataclass(frozen=True, slots=True)
class _Statement:
    """What a record says of what it rests on."""

    calibration: str | None
    """Its hash."""
    valid_until: str | None
    changes: tuple[Message, ...]
    """In what recipes differed at the inspection from the calibration: told then, not by the recipes of today."""

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> "_Statement":
        remarks = read_messages(record.get("remarks") or ())
        return cls(
            (record.get("calibration") or {}).get("sha256"), record.get("valid_until"),
            tuple(remark for remark in remarks if remark.code == RECIPE_CHANGED),
        )  # fmt: skip


def _moment(time: str) -> datetime:
    """An ISO time; one without a zone is UTC."""
    found = datetime.fromisoformat(time)
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _of(verification: Entry) -> str:
    return f"verification #{verification.number} of {verification.time[:10]}"
