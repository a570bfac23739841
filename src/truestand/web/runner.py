"""Runs one job at a time in a process of its own, and knows how far it is.

A thread takes the worker's lines as they come and keeps the newest only, so that a page full of slow clients never
makes the worker wait.
"""

import json
import secrets
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import IO, Any, Literal

from truestand.core.errors import TruestandError
from truestand.web.hub import Hub

WORKER = (sys.executable, "-m", "truestand.station.worker")
LONGEST_LINE = 1 << 20
"""Bytes of an event."""
ROOM = 1 << 20
"""Bytes of events that a worker can tell ahead of its reader: 20 s of live profiles."""
PATIENCE = 10.0
"""s after an abort that a second one ends the worker by force; the stand's guard then stops the stand."""
LAST = 30.0
"""s that a worker has to stop when the page ends."""
SAID = 20
"""Lines of a worker's standard error that are kept."""
State = Literal["running", "done", "failed", "aborted"]
Steps = Sequence[tuple[str, str]]


class Busy(TruestandError):
    """A job runs already."""


@dataclass(slots=True)
class Running:
    """A job as far as it is known."""

    kind: str
    part: str | None
    title: str
    steps: dict[str, str]
    """Labels by name."""
    states: dict[str, str]
    id: str = field(default_factory=lambda: secrets.token_hex(6))
    state: State = "running"
    step: str | None = None
    share: float = 0.0
    """Of the step that runs, 0..1."""
    message: str = ""
    number: int | None = None
    verdict: str | None = None
    status: str | None = None
    folder: str | None = None
    """Where it works; kept unless its result is in the store."""
    aborted: float | None = None
    """When an abort was asked for first."""

    def told(self) -> dict[str, Any]:
        """As clients see it."""
        return {
            "id": self.id, "kind": self.kind, "part": self.part, "title": self.title, "state": self.state,
            "step": self.step, "done": self._done(), "message": self.message, "number": self.number,
            "verdict": self.verdict, "status": self.status,
            "steps": [{"name": n, "label": label, "state": self.states[n]} for n, label in self.steps.items()],
        }  # fmt: skip

    def take(self, event: Mapping[str, Any]) -> None:
        """What the worker says."""
        kind = event.get("event")
        if kind == "step":
            name, state = str(event["name"]), str(event["state"])
            self.steps.setdefault(name, name.replace("_", " ").capitalize())
            self.states[name] = state
            if state == "running":
                self.step, self.share = name, 0.0
        elif kind == "live":
            self.share = float(event.get("done") or 0.0)
        elif kind in ("done", "failed", "aborted"):
            self.state = kind
            self.message = str(event.get("message") or "")
            self.number, self.verdict, self.status = event.get("number"), event.get("verdict"), event.get("status")

    def over(self, code: int, said: str) -> None:
        """The worker has ended; one that said nothing has failed."""
        if self.state == "running":
            why = f": {said}" if said else ""
            self.state = "aborted" if self.aborted is not None else "failed"
            self.message = f"the worker ended with code {code}{why}; see that table and laser are off, then reset"
        for name, state in self.states.items():
            if state == "running":
                self.states[name] = "done" if self.state == "done" else "failed"

    def _done(self) -> float:
        if self.state == "done":
            return 1.0
        ended = sum(state == "done" for state in self.states.values())
        share = self.share if self.states.get(self.step or "") == "running" else 0.0
        return round((ended + min(max(share, 0.0), 1.0)) / max(len(self.steps), 1), 4)


class Runner:
    """The one worker of the stand."""

    def __init__(
        self,
        hub: Hub,
        command: Sequence[str] = WORKER,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._hub, self._command, self._clock = hub, tuple(command), clock
        self._lock, self._starting = threading.Lock(), threading.Lock()
        self._job: Running | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._reader: threading.Thread | None = None
        self._closed = False

    @property
    def busy(self) -> bool:
        """Whether a job runs."""
        with self._lock:
            return self._job is not None and self._job.state == "running"

    def current(self) -> dict[str, Any] | None:
        """The job that runs, or the last one; None before the first."""
        with self._lock:
            return None if self._job is None else self._job.told()

    def start(self, order: Mapping[str, Any], title: str, part: str | None, steps: Steps) -> dict[str, Any]:
        """Start a job; ``order`` is what the worker reads. It may take a while: not for the event loop.

        Raises:
            Busy: one runs already, or the page is being ended.
        """
        with self._starting:  # who only asks how far a job is doesn't wait for a process to start
            if self._closed:
                raise Busy("the page is being ended; start it again first")
            if self._reader is not None and self._reader.is_alive():
                raise Busy("a job runs already; wait for its end, or abort it")
            waiting = {name: "waiting" for name, _ in steps}
            job = Running(order["kind"], part, title, dict(steps), waiting, folder=order.get("folder"))
            process = subprocess.Popen(
                self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                start_new_session=True, creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )  # fmt: skip
            with self._lock:
                self._job, self._process = job, process
            self._hub.publish("live", None)
            _make_room(process)
            _send_order(process, order)
            self._reader = threading.Thread(target=self._read, args=(process, job), name="worker", daemon=True)
            self._reader.start()
        return self._publish(job)

    def abort(self, identity: str) -> dict[str, Any] | None:
        """Ask the job of that id to stop; the second time, some seconds later, end it. None: there is no such job."""
        with self._lock:
            job, process = self._job, self._process
            if job is None or job.id != identity:
                return None
            if job.state == "running" and process is not None:
                if job.aborted is None:
                    job.aborted = self._clock()
                    _interrupt(process)
                    job.message = "stopping"
                elif self._clock() - job.aborted > PATIENCE:
                    process.kill()
        return self._publish(job)

    def close(self) -> None:
        """Abort what runs, and wait until the stand has stopped."""
        with self._starting, self._lock:
            self._closed = True
            job, process, reader = self._job, self._process, self._reader
            if process is not None and process.poll() is None:
                if job is not None:
                    job.aborted = self._clock()
                _interrupt(process)
        if process is None or reader is None:
            return
        reader.join(LAST)
        if process.poll() is None:
            process.kill()
            reader.join(LAST)

    def _read(self, process: subprocess.Popen[bytes], job: Running) -> None:
        """A thread's job: each line of a worker, until it ends."""
        said: deque[str] = deque(maxlen=SAID)
        listening = threading.Thread(target=_keep_said, args=(process.stderr, said), name="worker says", daemon=True)
        listening.start()
        assert process.stdout is not None
        with process.stdout as told:
            while line := told.readline(LONGEST_LINE):
                self._take(job, line)
        code = process.wait()
        listening.join(1.0)
        with self._lock:
            job.over(code, said[-1] if said else "")
        for line_said in said:
            print(f"worker: {line_said}", file=sys.stderr)
        self._hub.publish("live", None)
        if job.number is not None and job.folder is not None:
            shutil.rmtree(job.folder, ignore_errors=True)  # the store has copies of all that counts
        self._publish(job)

    def _take(self, job: Running, line: bytes) -> None:
        try:
            event = json.loads(line)
            with self._lock:
                job.take(event)
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        if event.get("event") == "live":
            live = {key: value for key, value in event.items() if key != "event"}
            self._hub.publish("live", json.dumps({"type": "live", "live": live}))
        elif event.get("event") == "step":
            self._publish(job)

    def _publish(self, job: Running) -> dict[str, Any]:
        with self._lock:  # held while it is published, so that no older state takes a newer one's place
            told = job.told()
            self._hub.publish("job", json.dumps({"type": "job", "job": told}))
        return told


def _make_room(process: subprocess.Popen[bytes]) -> None:
    """Let a worker tell for many seconds before it would have to wait, however busy this process is; Linux only."""
    if sys.platform == "linux" and process.stdout is not None:
        import fcntl

        with suppress(OSError):  # the system allows less
            fcntl.fcntl(process.stdout, fcntl.F_SETPIPE_SZ, ROOM)


def _send_order(process: subprocess.Popen[bytes], order: Mapping[str, Any]) -> None:
    """One line; a worker that is gone already tells so by its end."""
    assert process.stdin is not None
    try:
        process.stdin.write(json.dumps(order).encode() + b"\n")
        process.stdin.close()
    except OSError:
        return


def _interrupt(process: subprocess.Popen[bytes]) -> None:
    """As Ctrl-C does."""
    if sys.platform == "win32":
        process.send_signal(signal.CTRL_BREAK_EVENT)
    else:
        process.send_signal(signal.SIGINT)


def _keep_said(stderr: IO[bytes] | None, said: deque[str]) -> None:
    assert stderr is not None
    with stderr:
        while line := stderr.readline(LONGEST_LINE):
            said.append(line.decode("utf-8", "replace").rstrip()[:500])
