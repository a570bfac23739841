"""A job in a process of its own: ``python -m truestand.station.worker``, so that no client of a page costs a profile.

One JSON object on standard input says what to do: ``kind``, the paths ``stand``, ``folder``, ``store``, ``artefact``,
``part``, ``calibration``, and ``operator``, ``order``, ``serial``. Events go to standard output, one JSON object a
line: ``step``, ``live`` (five a second), and one of ``done``, ``failed``, ``aborted`` at the end. SIGINT or SIGTERM
abort: the stand stops, what came is kept.

A thread writes the events, so that a reader that stalls never holds up a look at table and sensors.
"""

import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from math import degrees
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

import numpy as np

from truestand.core.errors import BadRecipe, Fault, TruestandError
from truestand.devices.layout import decode
from truestand.devices.sensor import Layout
from truestand.station.acquire import Live
from truestand.station.jobs import STEPS, Job, Watching, run
from truestand.station.pipeline import Outcome

LOOK = 0.2
"""s between two live events."""
SHOWN = 160
"""Points of a live profile."""
PATHS = ("stand", "folder", "artefact", "part", "calibration")
Tell = Callable[[Mapping[str, Any]], None]


def main() -> int:
    """Do the job of standard input: 0 done, 1 failed, 130 aborted."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _interrupt)
    told = json.loads(sys.stdin.readline())
    events = EventWriter(sys.stdout)
    try:
        return work(told, events.tell)
    finally:
        events.close()


def work(told: Mapping[str, Any], tell: Tell) -> int:
    """Do a job and tell how it goes."""
    try:
        outcome = run(job_from(told), Watching(lambda name, state: _step(tell, name, state), _Throttled(tell)))
        number = _keep(outcome, told, tell)
    except KeyboardInterrupt:
        tell({"event": "aborted"})
        return 130
    except (TruestandError, OSError) as wrong:
        tell({"event": "failed", "message": str(wrong)})
        return 1
    record = outcome.record
    tell({"event": "done", "number": number, "verdict": record.get("verdict"), "status": record.get("status"),
          "message": "; ".join(record["reasons"])})  # fmt: skip
    return 0


def job_from(told: Mapping[str, Any]) -> Job:
    """The job that a JSON object describes.

    Raises:
        BadRecipe: an unknown kind, or a path missing.
    """
    if told.get("kind") not in STEPS:
        raise BadRecipe(f"found a job of kind {told.get('kind')!r}, need one of {', '.join(STEPS)}")
    if not told.get("stand") or not told.get("folder"):
        raise BadRecipe("found a job without stand or folder; it needs both")
    paths = {name: Path(told[name]) for name in PATHS if told.get(name)}
    known = {key: str(told[key]) for key in ("serial", "order", "operator") if told.get(key)}
    return Job(kind=told["kind"], identity=known, **paths)


def _keep(outcome: Outcome[Any], told: Mapping[str, Any], tell: Tell) -> int | None:
    """Into the results store, where one is given; the entry's number."""
    if not told.get("store"):
        return None
    from truestand.store import Store

    _step(tell, "keep", "running")
    store = Store.open(Path(told["store"]), create=True)
    entry = store.add(outcome.kind, outcome.record, outcome.evidence, operator=told.get("operator"))
    _step(tell, "keep", "done")
    return entry.number


def _step(tell: Tell, name: str, state: str) -> None:
    tell({"event": "step", "name": name, "state": state})


class _Throttled:
    """Live events, five a second."""

    def __init__(self, tell: Tell) -> None:
        self._tell, self._last = tell, 0.0

    def __call__(self, live: Live) -> None:
        if time.monotonic() - self._last > LOOK:
            self._last = time.monotonic()
            self._tell({"event": "live", **live_event(live)})


def live_event(live: Live) -> dict[str, Any]:
    """What people see of a recording."""
    sensors = zip(live.names, live.frames_per_s, live.profiles, live.lost, live.layouts, live.latest, strict=True)
    return {
        "state": live.state.value,
        "done": round(live.done, 4),
        "position_deg": round(degrees(live.position), 3),
        "sensors": [
            {"name": name, "frames_per_s": round(rate, 1), "profiles": profiles, "lost": lost,
             "profile": _profile(layout, latest)}
            for name, rate, profiles, lost, layout, latest in sensors
        ],
    }  # fmt: skip


def _profile(layout: Layout, payload: bytes) -> dict[str, list[float | None]]:
    """The frame's last profile, at most ``SHOWN`` points, mm; null = not seen."""
    if len(payload) != layout.frame_bytes:
        return {"x": [], "z": []}
    found = decode(layout, payload)
    every = slice(None, None, max(1, -(-layout.points // SHOWN)))
    x, z = found.x[-1, every], found.z[-1, every]
    seen = np.isfinite(z) & np.isfinite(x)
    return {
        name: [round(float(v), 3) if s else None for v, s in zip(values, seen, strict=True)]
        for name, values in (("x", x), ("z", z))
    }


class EventWriter:
    """Writes events in their order. Where the reader is behind, live ones are left out and nobody waits."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._lines: SimpleQueue[str | None] = SimpleQueue()  # its put can be interrupted by a signal at any point
        self._gone = False
        self._thread = threading.Thread(target=self._write, name="events", daemon=True)
        self._thread.start()

    def tell(self, event: Mapping[str, Any]) -> None:
        """Hand over an event.

        Raises:
            Fault: the reader of an earlier one was gone.
        """
        if self._gone:
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
                self._gone = True
                return


def _interrupt(number: int, frame: Any) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
