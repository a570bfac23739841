"""kill -9 at random moments: every log is recoverable, nothing partial is complete, and the guard stops the stand."""

import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass

import pytest

from lab import lab
from patience import NOT_FOR_EVER
from truestand.core.errors import Fault
from truestand.devices.gige import nodes
from truestand.devices.gige.camera import Camera
from truestand.station.convert import convert
from truestand.station.log import load_log
from truestand.station.stand_lock import StandLock, reset_latched_fault

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="kill -9 is of POSIX")

MOST_LOST, MOST_LOST_WHEN_BUSY = 20, 200
"""Profiles (0.1 s, 1 s) between what was sent at the kill and what is recovered: a process that waits for its turn has
not yet read what was sent."""
SOON = 3.0
"""s after the kill at which the stand is safe."""


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
    command = [sys.executable, "-m", "truestand", "acquire", "--stand", str(stand.recipe), "--quiet"]
    process = subprocess.Popen([*command, "--output", str(log.with_suffix(".h5"))], stdin=subprocess.DEVNULL)
    while not log.exists():
        assert process.poll() is None
        time.sleep(0.002)
    before = device.channel.frames
    while stand.at_rest:
        assert process.poll() is None
        time.sleep(0.005)
    time.sleep(wait)
    process.send_signal(signal.SIGKILL)
    sent = (device.channel.frames - before) * 4
    killed = time.monotonic()
    process.wait()
    while not stand.safe:
        time.sleep(0.01)
        assert time.monotonic() - killed < NOT_FOR_EVER
    stopped = time.monotonic() - killed
    (scan,) = convert(load_log(log))
    while device.controlled:
        time.sleep(0.02)
    return Killed(sent, profiles_in(log), scan.complete, stopped)


def profiles_in(log) -> int:
    from truestand.files.scans.scan_log import Kind, read_log

    return 4 * sum(record.kind is Kind.FRAME for record in read_log(log))


def killed_often(tmp_path, times, seed) -> list[Killed]:
    chance = random.Random(seed)
    results = []
    with lab(tmp_path, turns=1.0, heartbeat_ms=500) as stand:
        for i in range(times):
            results.append(kill_once(stand, f"k{i}", chance.uniform(0.0, 2.5)))
            with pytest.raises(Fault, match=rf"died; .* and the laser is off, `truestand recover .*k{i}.log`"):
                StandLock(stand.recipe)
            reset_latched_fault(stand.recipe)
    return results


def check(results, most_lost, longest) -> None:
    assert not any(r.complete for r in results)
    assert max(r.sent - r.recovered for r in results) <= most_lost
    assert max(r.stopped_after for r in results) < longest


def test_killed_recordings_are_recovered_and_the_guard_stops_the_stand(tmp_path):
    check(killed_often(tmp_path, 2, 1), MOST_LOST_WHEN_BUSY, NOT_FOR_EVER)


def test_stand_watch_when_killed_leaves_no_laser_on(tmp_path):
    with lab(tmp_path, heartbeat_ms=500) as stand:
        command = [sys.executable, "-m", "truestand", "stand", "watch", "--laser", "--stand", str(stand.recipe)]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        while not stand.sensors[0].laser:
            assert process.poll() is None
            time.sleep(0.01)
        process.kill()
        process.wait()
        until = time.monotonic() + NOT_FOR_EVER
        while stand.sensors[0].laser:
            assert time.monotonic() < until
            time.sleep(0.01)


@pytest.mark.parametrize("ended", [signal.SIGTERM, signal.SIGHUP])
def test_stand_test_when_terminated_leaves_the_stand_safe(tmp_path, ended):
    with lab(tmp_path, pace=0.6) as stand:
        command = [sys.executable, "-m", "truestand", "stand", "test", "--laser", "--seconds", "30"]
        process = subprocess.Popen([*command, "--stand", str(stand.recipe)], stdin=subprocess.DEVNULL)
        while not stand.sensors[0].laser:
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(ended)
        assert process.wait(10) == 130
        assert stand.safe


def test_ctrl_c_within_genicam_is_not_lost(tmp_path, monkeypatch):
    """While it is loaded, and at some other places, GenICam swallows what Python raises."""
    real = nodes._genapi

    def swallowing():
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
            time.sleep(0.1)
        return real()

    monkeypatch.setattr(nodes, "_genapi", swallowing)
    with lab(tmp_path) as stand:
        camera = Camera("front", stand.sensors[0].identity.address, 10_000)
        try:
            with pytest.raises(KeyboardInterrupt):
                camera.nodes.has("AcquisitionStart")
        finally:
            camera.close()


@pytest.mark.stand
def test_a_guard_that_dies_costs_no_scan(tmp_path, monkeypatch):
    made, real = [], subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: made.append(real(*a, **k)) or made[-1])
    with lab(tmp_path) as stand:
        taken = stand.take(show=stand.failing(lambda: made[0].kill()))
    assert taken.complete, taken.fault


@pytest.mark.slow
def test_a_hundred_kills(tmp_path):
    results = killed_often(tmp_path, 100, 2)
    lost = sorted(r.sent - r.recovered for r in results)
    stopped = sorted(r.stopped_after for r in results)
    print(f"\n100 kills: profiles lost median {lost[50]}, most {lost[-1]}; stopped after {stopped[50]:.2f}, "
          f"at most {stopped[-1]:.2f} s; complete: {sum(r.complete for r in results)}")  # fmt: skip
    check(results, MOST_LOST, SOON)
