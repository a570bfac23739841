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
from dataclasses import dataclass
from typing import IO, Any

from truestand.core.errors import TruestandError
from truestand.web.hub import Hub
from truestand.web.models import Job, JobKind, Step

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
Steps = Sequence[tuple[str, str]]


class Busy(TruestandError):
    """A job runs already."""


@dataclass(slots=True)
class RunningJob:
    """A job and its worker, running or over."""

    process: subprocess.Popen[bytes]
    job: Job
    """As clients see it."""
    folder: str | None
    """Where the worker writes; removed once the job's result is in the store."""
    step_done: float = 0.0
    """0..1, of the step that runs; 0 where none does."""
    aborted_at: float | None = None
    """When the first abort was requested."""

    def update(self, event: Mapping[str, Any]) -> None:
        """Update from an event of the worker."""
        job, kind = self.job, event.get("event")
        if kind == "step":
            self._update_step(str(event["name"]), event["state"])
        elif kind == "live":
            self.step_done = float(event.get("done") or 0.0)
        elif kind in ("done", "failed", "aborted"):
            job.state, job.message = kind, str(event.get("message") or "")
            job.number, job.verdict, job.status = event.get("number"), event.get("verdict"), event.get("status")
        job.done = self._done()

    def interrupt(self) -> None:
        """Ask the worker to stop, as Ctrl-C does."""
        self.aborted_at = time.monotonic()
        self.process.send_signal(getattr(signal, "CTRL_BREAK_EVENT", signal.SIGINT))  # the former on Windows only

    def end(self, code: int, error: str) -> None:
        """The worker has ended; without an event that says how, the job has failed."""
        job = self.job
        if job.state == "running":
            why = f": {error}" if error else ""
            job.state = "aborted" if self.aborted_at is not None else "failed"
            job.message = f"the worker ended with code {code}{why}; see that table and laser are off, then reset"
        for step in job.steps:
            if step.state == "running":
                step.state = "done" if job.state == "done" else "failed"
        self.step_done = 0.0
        job.done = self._done()

    def _update_step(self, name: str, state: Any) -> None:
        steps = {step.name: step for step in self.job.steps}
        steps[name].state = state
        self.step_done = 0.0
        if state == "running":
            self.job.step = name

    def _done(self) -> float:
        if self.job.state == "done":
            return 1.0
        ended = sum(step.state == "done" for step in self.job.steps)
        return round((ended + self.step_done) / len(self.job.steps), 4)


class JobRunner:
    """Starts the stand's one worker and follows it."""

    def __init__(self, hub: Hub, command: Sequence[str] = WORKER) -> None:
        self._hub, self._command = hub, tuple(command)
        self._lock, self._starting = threading.Lock(), threading.Lock()
        self._running: RunningJob | None = None
        self._reader: threading.Thread | None = None
        self._closed = False

    @property
    def busy(self) -> bool:
        """Whether a job runs."""
        with self._lock:
            return self._running is not None and self._running.job.state == "running"

    def current(self) -> dict[str, Any] | None:
        """The job that runs, or the last one; None before the first."""
        with self._lock:
            return None if self._running is None else self._running.job.model_dump()

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
            running = RunningJob(process, _new_job(request["kind"], title, part, steps), request.get("folder"))
            with self._lock:
                self._running = running
            _enlarge_pipe(process)
            _send_request(process, request)
            self._reader = threading.Thread(target=self._read, args=(running,), name="worker", daemon=True)
            self._reader.start()
        return self._publish(running)

    def abort(self, identity: str) -> dict[str, Any] | None:
        """Ask the job of that id to stop; a second time, some seconds later, kill it. None: there is no such job."""
        with self._lock:
            running = self._running
            if running is None or running.job.id != identity:
                return None
            if running.job.state == "running":
                if running.aborted_at is None:
                    running.interrupt()
                    running.job.message = "stopping"
                elif time.monotonic() - running.aborted_at > KILL_DELAY_S:
                    running.process.kill()
        return self._publish(running)

    def close(self) -> None:
        """Abort the job that runs, and wait until the stand has stopped."""
        with self._starting, self._lock:
            self._closed = True
            running, reader = self._running, self._reader
            if running is not None and running.process.poll() is None:
                running.interrupt()
        if running is None or reader is None:
            return
        reader.join(SHUTDOWN_TIMEOUT_S)
        if running.process.poll() is None:
            running.process.kill()
            reader.join(SHUTDOWN_TIMEOUT_S)

    def _read(self, running: RunningJob) -> None:
        """In a thread: read each line of a worker until it ends."""
        stderr: deque[str] = deque(maxlen=STDERR_LINES)
        listening = threading.Thread(
            target=_keep_lines, args=(running.process.stderr, stderr), name="stderr", daemon=True
        )
        listening.start()
        assert running.process.stdout is not None
        with running.process.stdout as events:
            while line := events.readline(MAX_LINE_BYTES):
                self._take(running, line)
        code = running.process.wait()
        listening.join(1.0)
        with self._lock:
            running.end(code, stderr[-1] if stderr else "")
        for error in stderr:
            print(f"worker: {error}", file=sys.stderr)
        self._hub.publish("live", None)
        if running.job.number is not None and running.folder is not None:
            shutil.rmtree(running.folder, ignore_errors=True)  # the store has copies of all that counts
        self._publish(running)

    def _take(self, running: RunningJob, line: bytes) -> None:
        try:
            event = json.loads(line)
            with self._lock:
                running.update(event)
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        if event.get("event") == "live":
            live = {key: value for key, value in event.items() if key != "event"}
            self._hub.publish("live", json.dumps({"type": "live", "live": live}))
        elif event.get("event") == "step":
            self._publish(running)

    def _publish(self, running: RunningJob) -> dict[str, Any]:
        with self._lock:  # held while it is published, so that no older state takes a newer one's place
            payload = running.job.model_dump()
            self._hub.publish("job", json.dumps({"type": "job", "job": payload}))
        return payload


def _new_job(kind: JobKind, title: str, part: str | None, steps: Steps) -> Job:
    return Job(
        id=secrets.token_hex(6), kind=kind, part=part, title=title, state="running", step=None,
        steps=[Step(name=name, label=label, state="waiting") for name, label in steps],
        done=0.0, message="", number=None, verdict=None, status=None,
    )  # fmt: skip


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
