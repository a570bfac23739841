"""What all machines are told, from the functions that answer the page's routes: so all say the same.

One task looks: at the page's hub for jobs and live values, and every few seconds whether the store or the fault's mark
on the disk has changed, for what other programs do. Every interface takes the newest from it, never a backlog.
"""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from truestand.core.errors import TruestandError
from truestand.files.scans.read import sha256_of
from truestand.station.latch import latch_path, latched_fault
from truestand.web.app_state import Page
from truestand.web.hub import Listener
from truestand.web.interfaces.lines import Line, lines_of
from truestand.web.models import CalibrationState, Entry
from truestand.web.problem import Problem
from truestand.web.routes.home import calibration_state

LOOK = 2.0
"""s between two looks at the disk."""
AGAIN = 60.0
"""s after which all is read again though nothing seems changed: a calibration expires by itself."""
RESULTS = ("calibration", "inspection", "verification")
EVALUATIONS = {"conforms": 1, "does_not_conform": 2, "undecided": 3}
"""ResultEvaluationEnum of OPC 40001-101: in tolerance, out of it, not decidable for its uncertainty; 0: undefined."""
Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Told:
    """All that there is to tell, as JSON objects."""

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


class Teller:
    """Looks, and tells everyone who wants to know."""

    def __init__(self, page: Page, look: float = LOOK) -> None:
        self.page, self._look = page, look
        self._told, self._version = Told(), 0
        self._changed = asyncio.Condition()
        self._seen: object = None
        self._again = 0.0

    @property
    def newest(self) -> Told:
        """As it is known now."""
        return self._told

    @asynccontextmanager
    async def telling(self) -> AsyncIterator[None]:
        """While this is open, it looks; all is known from the beginning."""
        listener = self.page.hub.listen()
        await self._take([], stored=True)
        looking = asyncio.create_task(self._run(listener))
        try:
            yield
            await self._take([], stored=True)  # how the last job ended
        finally:
            looking.cancel()
            await asyncio.gather(looking, return_exceptions=True)
            self.page.hub.leave(listener)

    async def changes(self) -> AsyncIterator[Told]:
        """The newest, and again whenever it has changed."""
        seen = 0
        while True:
            async with self._changed:
                while self._version == seen:
                    await self._changed.wait()
                seen, told = self._version, self._told
            yield told

    async def _run(self, listener: Listener) -> None:
        while True:
            messages: list[str] = []
            with suppress(TimeoutError):
                async with asyncio.timeout(self._look):
                    messages = await listener.next()
            news = [json.loads(message) for message in messages]
            await self._take(news, stored=any(one["type"] == "job" for one in news) or await self._is_new())

    async def _take(self, news: list[Json], stored: bool) -> None:
        """Put together what is true now and tell it where it is new."""
        page, old = self.page, self._told
        job, busy = page.runner.current(), page.runner.busy
        lives = [_without_profiles(one["live"]) for one in news if one["type"] == "live"]
        told = replace(old, job=job, live=None if not busy else lives[-1] if lives else old.live)
        fault = old.state.get("fault")
        if stored:
            told, fault = await asyncio.to_thread(_stored, page, told, busy)
        await self._tell(replace(told, state=_state(told, busy, fault)))

    async def _tell(self, told: Told) -> None:
        async with self._changed:
            if told != self._told:
                self._told, self._version = told, self._version + 1
                self._changed.notify_all()

    async def _is_new(self) -> bool:
        """Whether the disk has changed, or may have."""
        now = asyncio.get_running_loop().time()
        settings = self.page.settings
        seen = await asyncio.to_thread(_signature, settings.store, latch_path(settings.stand))
        new = seen != self._seen or now > self._again
        if new:
            self._seen, self._again = seen, now + AGAIN
        return new


def _state(told: Told, busy: bool, fault: str | None) -> Json:
    job, calibration = told.job or {}, told.calibration
    return {
        "state": "running" if busy else "fault" if fault else "idle",
        "step": job.get("step") if busy else None,
        "done": job.get("done", 0.0),
        "message": job.get("message", ""),
        "fault": None if busy else fault,
        "calibrated": calibration.get("state") == "valid",
        "calibration_status": calibration.get("state", "none"),
        "calibrated_until": calibration.get("valid_until"),
    }


def _stored(page: Page, old: Told, busy: bool) -> tuple[Told, str | None]:
    """What the store tells, and the fault that is latched; what can't be read is told as the reason."""
    fault = None if busy else latched_fault(page.settings.stand) or None
    try:
        calibration = calibration_state(page, datetime.now(UTC))
        newest = page.results.entries(kinds=RESULTS, limit=1)
        told = replace(old, calibration=calibration.model_dump(mode="json"))
        if not newest:
            return replace(told, result=None, lines=(), count=0), fault
        if newest[0].number != old.number:
            count = len(page.results.entries(kinds=RESULTS, limit=1 << 31))
            record = page.results.record(newest[0].number)
            told = replace(told, lines=lines_of(newest[0].kind, record), count=count)
        return replace(told, result=_result(page, newest[0])), fault
    except (TruestandError, Problem, OSError) as wrong:
        unknown = CalibrationState(state="none", reasons=[f"the store can't be read: {wrong}"])
        return replace(old, calibration=unknown.model_dump(mode="json")), fault


def _result(page: Page, entry: Entry) -> Json:
    record = page.results.record(entry.number)
    path = page.results.file(entry.number, "record")
    told = entry.model_dump(mode="json", exclude={"has"})
    reasons = [str(reason) for reason in record.get("reasons") or []]
    return told | {
        "reasons": reasons,
        "evaluation": EVALUATIONS.get(entry.verdict or "", 0),
        "record_sha256": None if path is None else sha256_of(path),
    }


def _without_profiles(live: Json) -> Json:
    sensors = [{key: value for key, value in s.items() if key != "profile"} for s in live.get("sensors") or ()]
    return live | {"sensors": sensors}


def _signature(store: Path, mark: Path) -> object:
    """What changes with every write to the store or to the fault's mark."""
    files = [mark, *(sorted(store.iterdir()) if store.is_dir() else ())]
    found = []
    for path in files:
        with suppress(OSError):
            stat = path.stat()
            found.append((path.name, stat.st_mtime_ns, stat.st_size))
    return tuple(found)


def as_json(lines: tuple[Line, ...]) -> list[Json]:
    """Lines as JSON objects."""
    return [asdict(line) for line in lines]
