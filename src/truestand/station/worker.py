"""A job in a process of its own: ``python -m truestand.station.worker``, so that the page's clients cost no profiles.

One JSON object on standard input says what to do: ``kind``, the paths ``stand``, ``folder``, ``store``, ``artefact``,
``part``, ``calibration``, and ``operator``, ``order``, ``serial``. Events go to standard output, one JSON object a
line: ``step``, ``live`` (five a second), and one of ``done``, ``failed``, ``aborted`` at the end. SIGINT or SIGTERM
abort: the stand stops, recorded frames are kept.

A thread writes the events, so that a reader that stalls never delays the polling of table and sensors.
"""

import json
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from math import degrees
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

import numpy as np

from truestand.core.errors import BadRecipe, Fault, TruestandError
from truestand.devices.layout import decode
from truestand.devices.sensor import Layout
from truestand.files.records.record import texts_of
from truestand.station.acquire import Live
from truestand.station.interrupts import interrupted_by_signals, interrupts_not_lost
from truestand.station.jobs import STEPS, Job, Observer, run_job
from truestand.station.pipeline import Outcome

LIVE_INTERVAL_S = 0.2
"""Between two live events."""
LIVE_POINTS = 160
"""Of a profile in a live event, at most."""
PATHS = ("stand", "folder", "artefact", "part", "calibration")
Emit = Callable[[Mapping[str, Any]], None]


def main() -> int:
    """Do the job of standard input: 0 done, 1 failed, 130 aborted."""
    with interrupts_not_lost(), interrupted_by_signals():
        request = json.loads(sys.stdin.readline())
        with closing(EventWriter(sys.stdout)) as events:
            return _work(request, events.emit)


def _work(request: Mapping[str, Any], emit: Emit) -> int:
    """Do a job and emit its events; the exit code."""
    observer = Observer(lambda name, state: emit({"event": "step", "name": name, "state": state}), _LiveEvents(emit))
    try:
        outcome = run_job(_job_from(request), observer)
        number = _keep(outcome, request, observer)
    except KeyboardInterrupt:
        emit({"event": "aborted"})
        return 130
    except (TruestandError, OSError) as error:
        emit({"event": "failed", "message": str(error)})
        return 1
    record = outcome.record
    emit({"event": "done", "number": number, "verdict": record.get("verdict"), "status": record.get("status"),
          "message": "; ".join(texts_of(record))})  # fmt: skip
    return 0


def _job_from(request: Mapping[str, Any]) -> Job:
    """The job that a JSON object describes.

    Raises:
        BadRecipe: an unknown kind.
    """
    if request.get("kind") not in STEPS:
        raise BadRecipe(f"found a job of kind {request.get('kind')!r}, need one of {', '.join(STEPS)}")
    paths = {name: Path(request[name]) for name in PATHS if request.get(name)}
    identity = {key: str(request[key]) for key in ("serial", "order", "operator") if request.get(key)}
    return Job(kind=request["kind"], identity=identity, **paths)


def _keep(outcome: Outcome[Any], request: Mapping[str, Any], observer: Observer) -> int | None:
    """Add the result to the results store, where one is given; the entry's number."""
    if not request.get("store"):
        return None
    from truestand.store import Store

    observer.step("keep", "running")
    store = Store.open(Path(request["store"]), create=True)
    entry = store.add(outcome.kind, outcome.record, outcome.evidence, operator=request.get("operator"))
    observer.step("keep", "done")
    return entry.number


class _LiveEvents:
    """Emits live events, five a second."""

    def __init__(self, emit: Emit) -> None:
        self._emit, self._last = emit, 0.0

    def __call__(self, live: Live) -> None:
        if time.monotonic() - self._last > LIVE_INTERVAL_S:
            self._last = time.monotonic()
            self._emit({"event": "live", **_live_event(live)})


def _live_event(live: Live) -> dict[str, Any]:
    return {
        "state": live.state.value,
        "done": round(live.done, 4),
        "position_deg": round(degrees(live.position), 3),
        "sensors": [
            {"name": sensor.name, "frames_per_s": round(sensor.frames_per_s, 1), "profiles": sensor.profiles,
             "lost": sensor.lost, "profile": _profile(sensor.layout, sensor.latest)}
            for sensor in live.sensors
        ],
    }  # fmt: skip


def _profile(layout: Layout, payload: bytes) -> dict[str, list[float | None]]:
    """The frame's last profile, at most ``LIVE_POINTS`` points, mm; null = not seen."""
    if len(payload) != layout.frame_bytes:
        return {"x": [], "z": []}
    profiles = decode(layout, payload)
    every = slice(None, None, max(1, -(-layout.points // LIVE_POINTS)))
    x, z = profiles.x[-1, every], profiles.z[-1, every]
    seen = np.isfinite(z) & np.isfinite(x)
    return {
        name: [round(float(v), 3) if s else None for v, s in zip(values, seen, strict=True)]
        for name, values in (("x", x), ("z", z))
    }


class EventWriter:
    """Writes events in their order. Where the reader is behind, live ones are left out: emitting never waits."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._lines: SimpleQueue[str | None] = SimpleQueue()  # its put can be interrupted by a signal at any point
        self._reader_gone = False
        self._thread = threading.Thread(target=self._write, name="events", daemon=True)
        self._thread.start()

    def emit(self, event: Mapping[str, Any]) -> None:
        """Queue an event.

        Raises:
            Fault: the reader of an earlier one was gone.
        """
        if self._reader_gone:
            raise Fault("the page's server stopped while the job ran")
        if event["event"] != "live" or self._lines.empty():
            self._lines.put(json.dumps(event, allow_nan=False) + "\n")

    def close(self) -> None:
        """Wait until the reader has taken all, or is gone."""
        self._lines.put(None)
        self._thread.join()

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            try:
                self._out.write(line)
                self._out.flush()
            except OSError:  # a broken pipe, by whatever name the system has for it
                self._reader_gone = True
                return


if __name__ == "__main__":
    sys.exit(main())
