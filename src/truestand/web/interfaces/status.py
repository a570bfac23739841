"""The stand's status for all interfaces, from the functions that answer the page's routes: so all say the same.

One task follows the page's hub: jobs, live values, and a word from the watch where store, recipes or the file of a
latched fault have changed, by whatever program. Every interface takes the newest snapshot, never a backlog.
"""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any, Self

from truestand.core.errors import TruestandError
from truestand.files.records.record import texts_of
from truestand.station.stand_lock import latched_fault
from truestand.web.app_state import AppState
from truestand.web.hub import Listener
from truestand.web.interfaces.lines import Line, lines_of
from truestand.web.models import CalibrationState, Entry
from truestand.web.routes.stand import calibration_state
from truestand.web.watch import watching

EVALUATIONS = {"conforms": 1, "does_not_conform": 2, "undecided": 3}
"""ResultEvaluationEnum of OPC 40001-101: in tolerance, out of it, not decidable for its uncertainty; 0: undefined."""
Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The stand's status at one moment, as JSON objects."""

    state: Json = field(default_factory=dict)
    calibration: Json = field(default_factory=dict)
    job: Json | None = None
    live: Json | None = None
    """Only while a job scans, without its profile."""
    result: Json | None = None
    """The newest."""
    lines: tuple[Line, ...] = ()
    """Of the newest result."""
    count: int = 0
    """Results in the store."""

    @property
    def number(self) -> int:
        """The newest result's; 0 before the first."""
        return 0 if self.result is None else int(self.result["number"])


class StatusPublisher:
    """Follows the stand's status and publishes snapshots of it."""

    def __init__(self, state: AppState) -> None:
        self.state = state
        self.newest, self._version = Snapshot(), 0
        self._changed = asyncio.Condition()

    @asynccontextmanager
    async def running(self) -> AsyncIterator[Self]:
        """While this is open, it follows; the first snapshot is there from the beginning."""
        listener = self.state.hub.listen()
        await self._update([], stored=True)
        async with watching(self.state):
            following = asyncio.create_task(self._follow(listener))
            try:
                yield self
                await self._update([], stored=True)  # how the last job ended
            finally:
                following.cancel()
                await asyncio.gather(following, return_exceptions=True)
                self.state.hub.leave(listener)

    async def changes(self) -> AsyncIterator[Snapshot]:
        """The newest snapshot, and again whenever it has changed."""
        seen = 0
        while True:
            async with self._changed:
                while self._version == seen:
                    await self._changed.wait()
                seen, snapshot = self._version, self.newest
            yield snapshot

    async def _follow(self, listener: Listener) -> None:
        while True:
            events = [json.loads(message) for message in await listener.next()]
            await self._update(events, stored=any(event["type"] in ("job", "home") for event in events))

    async def _update(self, events: list[Json], stored: bool) -> None:
        """Publish a snapshot of what is true now; ``stored``: the disk is read again too."""
        old = self.newest
        job, busy = self.state.runner.current(), self.state.runner.busy
        lives = [_without_profiles(event["live"]) for event in events if event["type"] == "live"]
        snapshot = replace(old, job=job, live=None if not busy else lives[-1] if lives else old.live)
        fault = old.state.get("fault")
        if stored:
            snapshot, fault = await asyncio.to_thread(_with_stored, snapshot, self.state)
        snapshot = replace(snapshot, state=_state(snapshot, busy, fault))
        async with self._changed:
            if snapshot != self.newest:
                self.newest, self._version = snapshot, self._version + 1
                self._changed.notify_all()


def _state(snapshot: Snapshot, busy: bool, fault: str | None) -> Json:
    job, calibration = snapshot.job or {}, snapshot.calibration
    return {
        "state": "running" if busy else "fault" if fault else "idle",
        "step": job.get("step") if busy else None,
        "done": job.get("done", 0.0),
        "message": job.get("message", ""),
        "fault": fault,
        "calibrated": calibration.get("state") == "valid",
        "calibration_status": calibration.get("state", "none"),
        "calibrated_until": calibration.get("valid_until"),
    }


def _with_stored(old: Snapshot, state: AppState) -> tuple[Snapshot, str | None]:
    """The snapshot with what the store holds, and the latched fault; what can't be read becomes the reason."""
    fault = latched_fault(state.settings.stand) or None
    try:
        calibration = calibration_state(state, datetime.now(UTC))
        results = state.results.entries(limit=1)
        snapshot = replace(old, calibration=calibration.model_dump(mode="json"))
        if not results:
            return replace(snapshot, result=None, lines=(), count=0), fault
        newest = results[0]
        if newest.number != old.number:
            count = len(state.results.entries(limit=None))
            lines = lines_of(newest.kind, state.results.record(newest.number))
            snapshot = replace(snapshot, lines=lines, count=count)
        return replace(snapshot, result=_result(state, newest)), fault
    except (TruestandError, OSError) as wrong:
        unknown = CalibrationState(state="none", reasons=[f"the store can't be read: {wrong}"])
        return replace(old, calibration=unknown.model_dump(mode="json")), fault


def _result(state: AppState, entry: Entry) -> Json:
    record = state.results.record(entry.number)
    path = state.results.file(entry.number, "record")
    return entry.model_dump(mode="json", exclude={"has"}) | {
        "reasons": [*entry.doubts, *texts_of(record)],
        "evaluation": _evaluation(entry),
        "record_sha256": None if path is None else path.name,  # its hash, as of all evidence
    }


def _evaluation(entry: Entry) -> int:
    """A part that conforms by a calibration that is in doubt is not known to be in tolerance."""
    if entry.standing in ("corrected", "withdrawn"):
        return 0
    verdict = "undecided" if entry.standing == "in_doubt" and entry.verdict == "conforms" else entry.verdict
    return EVALUATIONS.get(verdict or "", 0)


def _without_profiles(live: Json) -> Json:
    sensors = [{key: value for key, value in s.items() if key != "profile"} for s in live.get("sensors") or ()]
    return live | {"sensors": sensors}
