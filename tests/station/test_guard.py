"""The guard's start: nothing moves before it is ready, and one that hangs is killed."""

import io
import subprocess
import threading

import pytest

from truestand.core.errors import DeviceLost
from truestand.station import guard as guard_module
from truestand.station.guard import guard


class HangingGuard:
    """A process that says nothing until it is killed."""

    def __init__(self) -> None:
        self.killed = threading.Event()
        self.stdin, self.stdout = io.BytesIO(), self

    def readline(self) -> bytes:
        self.killed.wait(30.0)  # more than the test needs, less than for ever
        return b""

    def kill(self) -> None:
        self.killed.set()

    def wait(self, timeout: float | None = None) -> int:
        return 0

    def close(self) -> None:
        pass


def test_a_guard_that_hangs_at_its_start_is_killed_and_reported(tmp_path, monkeypatch):
    started = []
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: started.append(HangingGuard()) or started[-1])
    monkeypatch.setattr(guard_module, "START_TIMEOUT_S", 0.01)
    with pytest.raises(DeviceLost, match="found no guard within"), guard("stand.toml"):
        pass
    assert started[0].killed.is_set()
