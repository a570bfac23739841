"""Runs one job at a time in a worker process, and knows how far it is.

A thread reads the worker's lines as they come and keeps the newest only, so that slow clients never make the worker
wait.
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
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import IO, Any, Literal

from truestand.core.errors import TruestandError
from truestand.web.hub import Hub

WORKER = (sys.executable, "-m", "truestand.station.worker")
MAX_LINE_BYTES = 1 << 20
PIPE_BYTES = 1 << 20
"""Events that a worker can write ahead of its reader: 20 s of live profiles."""
KILL_DELAY_S = 10.0
"""From a first abort on, until a second one ends the worker by force; the stand's guard then stops the stand."""
SHUTDOWN_TIMEOUT_S = 30.0
"""For a worker to stop when the page ends."""
STDERR_LINES = 20
"""Of a worker, the last ones, that are printed."""
State = Literal["running", "done", "failed", "aborted"]
Steps = Sequence[tuple[str, str]]


class Busy(TruestandError):
    """A job runs already."""


@dataclass(slots=True)
class RunningJob:
    """A job, running or over, as the worker's events describe it."""

    process: subprocess.Popen[bytes]
    kind: str
    part: str | None
    title: str
    steps: dict[str, dict[str, str]]
    """Name, label and state, by name."""
    id: str = field(default_factory=lambda: secrets.token_hex(6))
    state: State = "running"
    step: str | None = None
    step_done: float = 0.0
    """0..1, of the step that runs."""
    message: str = ""
    number: int | None = None
    verdict: str | None = None
    status: str | None = None
    folder: str | None = None
    """Where it works; removed once its result is in the store."""
    aborted_at: float | None = None
    """When the first abort was requested."""

    def payload(self) -> dict[str, Any]:
        """As clients see it: the fields of ``models.Job``."""
        return {
            "id": self.id, "kind": self.kind, "part": self.part, "title": self.title, "state": self.state,
            "step": self.step, "done": self._done(), "message": self.message, "number": self.number,
            "verdict": self.verdict, "status": self.status,
            "steps": [dict(step) for step in self.steps.values()],
        }  # fmt: skip

    def update(self, event: Mapping[str, Any]) -> None:
        """Update from an event of the worker."""
        kind = event.get("event")
        if kind == "step":
            name, state = str(event["name"]), str(event["state"])
            self.steps.setdefault(name, _step(name, name.replace("_", " ").capitalize()))["state"] = state
            if state == "running":
                self.step, self.step_done = name, 0.0
        elif kind == "live":
            self.step_done = float(event.get("done") or 0.0)
        elif kind in ("done", "failed", "aborted"):
            self.state = kind
            self.message = str(event.get("message") or "")
            self.number, self.verdict, self.status = event.get("number"), event.get("verdict"), event.get("status")

    def interrupt(self) -> None:
        """Ask the worker to stop, as Ctrl-C does."""
        self.aborted_at = time.monotonic()
        if sys.platform == "win32":
            self.process.send_signal(signal.CTRL_BREAK_EVENT)
        else:
            self.process.send_signal(signal.SIGINT)

    def end(self, code: int, error: str) -> None:
        """The worker has ended; without an event that says how, the job has failed."""
        if self.state == "running":
            why = f": {error}" if error else ""
            self.state = "aborted" if self.aborted_at is not None else "failed"
            self.message = f"the worker ended with code {code}{why}; see that table and laser are off, then reset"
        for step in self.steps.values():
            if step["state"] == "running":
                step["state"] = "done" if self.state == "done" else "failed"

    def _done(self) -> float:
        if self.state == "done":
            return 1.0
        ended = sum(step["state"] == "done" for step in self.steps.values())
        runs = self.step is not None and self.steps[self.step]["state"] == "running"
        step_done = self.step_done if runs else 0.0
        return round((ended + min(max(step_done, 0.0), 1.0)) / max(len(self.steps), 1), 4)


class JobRunner:
    """Starts the stand's one worker and follows it."""

    def __init__(self, hub: Hub, command: Sequence[str] = WORKER) -> None:
        self._hub, self._command = hub, tuple(command)
        self._lock, self._starting = threading.Lock(), threading.Lock()
        self._job: RunningJob | None = None
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
            return None if self._job is None else self._job.payload()

    def start(self, request: Mapping[str, Any], title: str, part: str | None, steps: Steps) -> dict[str, Any]:
        """Start a job; ``request`` is what the worker reads. It may take a while: not for the event loop.

        Raises:
            Busy: one runs already, or the page is being ended.
        """
        with self._starting:  # current() doesn't wait for a process to start
            if self._closed:
                raise Busy("the page is being ended; start it again first")
            if self._reader is not None and self._reader.is_alive():
                raise Busy("a job runs already; wait for its end, or abort it")
            process = subprocess.Popen(
                self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                start_new_session=True, creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )  # fmt: skip
            waiting = {name: _step(name, label) for name, label in steps}
            job = RunningJob(process, request["kind"], part, title, waiting, folder=request.get("folder"))
            with self._lock:
                self._job = job
            self._hub.publish("live", None)
            _enlarge_pipe(process)
            _send_request(process, request)
            self._reader = threading.Thread(target=self._read, args=(job,), name="worker", daemon=True)
            self._reader.start()
        return self._publish(job)

    def abort(self, identity: str) -> dict[str, Any] | None:
        """Ask the job of that id to stop; a second time, some seconds later, kill it. None: there is no such job."""
        with self._lock:
            job = self._job
            if job is None or job.id != identity:
                return None
            if job.state == "running":
                if job.aborted_at is None:
                    job.interrupt()
                    job.message = "stopping"
                elif time.monotonic() - job.aborted_at > KILL_DELAY_S:
                    job.process.kill()
        return self._publish(job)

    def close(self) -> None:
        """Abort the job that runs, and wait until the stand has stopped."""
        with self._starting, self._lock:
            self._closed = True
            job, reader = self._job, self._reader
            if job is not None and job.process.poll() is None:
                job.interrupt()
        if job is None or reader is None:
            return
        reader.join(SHUTDOWN_TIMEOUT_S)
        if job.process.poll() is None:
            job.process.kill()
            reader.join(SHUTDOWN_TIMEOUT_S)

    def _read(self, job: RunningJob) -> None:
        """In a thread: read each line of a worker until it ends."""
        stderr: deque[str] = deque(maxlen=STDERR_LINES)
        listening = threading.Thread(target=_keep_lines, args=(job.process.stderr, stderr), name="stderr", daemon=True)
        listening.start()
        assert job.process.stdout is not None
        with job.process.stdout as events:
            while line := events.readline(MAX_LINE_BYTES):
                self._take(job, line)
        code = job.process.wait()
        listening.join(1.0)
        with self._lock:
            job.end(code, stderr[-1] if stderr else "")
        for error in stderr:
            print(f"worker: {error}", file=sys.stderr)
        self._hub.publish("live", None)
        if job.number is not None and job.folder is not None:
            shutil.rmtree(job.folder, ignore_errors=True)  # the store has copies of all that counts
        self._publish(job)

    def _take(self, job: RunningJob, line: bytes) -> None:
        try:
            event = json.loads(line)
            with self._lock:
                job.update(event)
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        if event.get("event") == "live":
            live = {key: value for key, value in event.items() if key != "event"}
            self._hub.publish("live", json.dumps({"type": "live", "live": live}))
        elif event.get("event") == "step":
            self._publish(job)

    def _publish(self, job: RunningJob) -> dict[str, Any]:
        with self._lock:  # held while it is published, so that no older state takes a newer one's place
            payload = job.payload()
            self._hub.publish("job", json.dumps({"type": "job", "job": payload}))
        return payload


def _step(name: str, label: str) -> dict[str, str]:
    return {"name": name, "label": label, "state": "waiting"}


def _enlarge_pipe(process: subprocess.Popen[bytes]) -> None:
    """Let a worker write for many seconds before it would have to wait, however busy this process is; Linux only."""
    if sys.platform == "linux" and process.stdout is not None:
        import fcntl

        with suppress(OSError):  # the system allows less
            fcntl.fcntl(process.stdout, fcntl.F_SETPIPE_SZ, PIPE_BYTES)


def _send_request(process: subprocess.Popen[bytes], request: Mapping[str, Any]) -> None:
    """One line; where the worker is gone already, its end is noticed by the reader."""
    assert process.stdin is not None
    with suppress(OSError):
        process.stdin.write(json.dumps(request).encode() + b"\n")
        process.stdin.close()


def _keep_lines(stderr: IO[bytes] | None, lines: deque[str]) -> None:
    assert stderr is not None
    with stderr:
        while line := stderr.readline(MAX_LINE_BYTES):
            lines.append(line.decode("utf-8", "replace").rstrip()[:500])
