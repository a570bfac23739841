"""kill -9 at random moments: every log is recoverable, nothing partial is complete, and the guard stops the stand."""

import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import pytest

from lab import lab
from truestand.core.errors import Fault
from truestand.station.convert import convert
from truestand.station.latch import Latch, reset_latch

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="kill -9 is of POSIX")

MOST_LOST = 20
"""Profiles between what was sent at the kill and what is recovered."""


@dataclass
class Killed:
    sent: int
    recovered: int
    complete: bool
    stopped_after: float


def kill_once(stand, name, wait) -> Killed:
    """Acquire in a process of its own, kill it ``wait`` s after the first frames, recover."""
    device = stand.sensors[0]
    log = stand.folder / f"{name}.log"
    before = device.frames
    command = [sys.executable, "-m", "truestand", "acquire", "--stand", str(stand.recipe), "--quiet"]
    process = subprocess.Popen([*command, "--output", str(log.with_suffix(".h5"))], stdin=subprocess.DEVNULL)
    while not log.exists() or stand.at_rest:
        assert process.poll() is None
        time.sleep(0.005)
    time.sleep(wait)
    process.send_signal(signal.SIGKILL)
    sent = (device.frames - before) * 4
    killed = time.monotonic()
    process.wait()
    while not stand.safe:
        time.sleep(0.01)
        assert time.monotonic() - killed < 10
    stopped = time.monotonic() - killed
    (scan,) = convert(log)
    while device.controlled:
        time.sleep(0.02)
    return Killed(sent, profiles_in(log), scan.complete, stopped)


def profiles_in(log) -> int:
    from truestand.files.scan_log import Kind, read_log

    return 4 * sum(record.kind is Kind.FRAME for record in read_log(log))


def killed_often(tmp_path, times, seed) -> list[Killed]:
    chance = random.Random(seed)
    results = []
    with lab(tmp_path, turns=1.0, heartbeat_ms=500) as stand:
        for i in range(times):
            results.append(kill_once(stand, f"k{i}", chance.uniform(0.0, 2.5)))
            with pytest.raises(Fault, match=rf"died; see that the table stands still, `truestand recover .*k{i}.log`"):
                Latch(stand.recipe)
            reset_latch(stand.recipe)
    return results


def check(results) -> None:
    assert not any(r.complete for r in results)
    assert max(r.sent - r.recovered for r in results) <= MOST_LOST
    assert max(r.stopped_after for r in results) < 3.0


def test_killed_recordings_are_recovered_and_the_guard_stops_the_stand(tmp_path):
    check(killed_often(tmp_path, 2, 1))


@pytest.mark.slow
def test_a_hundred_kills(tmp_path):
    results = killed_often(tmp_path, 100, 2)
    lost = sorted(r.sent - r.recovered for r in results)
    stopped = sorted(r.stopped_after for r in results)
    print(f"\n100 kills: profiles lost median {lost[50]}, most {lost[-1]}; stopped after {stopped[50]:.2f}, "
          f"at most {stopped[-1]:.2f} s; complete: {sum(r.complete for r in results)}")  # fmt: skip
    check(results)
