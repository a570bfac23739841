"""The state file of a stand: foreign or damaged content is a fault with its reason, never a stand that is free."""

import os

import pytest

from truestand.core.errors import DeviceError, Fault
from truestand.station import stand_lock as lock_module
from truestand.station.stand_lock import StandLock, latched_fault, reset_latched_fault, state_path


@pytest.fixture
def stand(tmp_path):
    return tmp_path / "stand.toml"


@pytest.mark.parametrize("content", [b"\xff\xfe", b"[1, 2]", b"{", b"[" * 60_000, b'{"state": "fault", "sin'])
def test_a_state_file_without_json_is_a_fault_until_reset(stand, content):
    state_path(stand).write_bytes(content)
    with pytest.raises(Fault, match="holds no JSON"):
        StandLock(stand)
    assert "holds no JSON" in reset_latched_fault(stand)
    StandLock(stand).close()


def test_a_write_that_is_broken_off_leaves_a_fault(stand, monkeypatch):
    held = StandLock(stand)
    held.set_in_use("now", stand)

    def killed(file, data):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "write", killed)
    with pytest.raises(KeyboardInterrupt):
        held.latch_fault("now", "x", {})
    monkeypatch.undo()
    os.close(held._file)
    with pytest.raises(Fault):
        StandLock(stand)


@pytest.mark.parametrize("there", [True, False])
def test_recover_is_advised_only_where_the_dead_program_left_a_log(stand, there):
    log = stand.with_suffix(".log")
    if there:
        log.touch()
    held = StandLock(stand)
    held.set_in_use("now", log)
    os.close(held._file)
    with pytest.raises(Fault, match="died") as error:
        StandLock(stand)
    assert ("truestand recover" in str(error.value)) == there


def test_a_program_that_ends_while_the_state_is_read_has_not_died(stand, monkeypatch):
    held, lock = StandLock(stand), lock_module.take_lock
    held.set_in_use("now", stand)
    monkeypatch.setattr(lock_module, "take_lock", lambda file: held.close() or lock(file))
    assert latched_fault(stand) == ""


def test_a_reset_keeps_the_lock_of_a_program_that_started_meanwhile(stand, monkeypatch):
    """Another person's reset, and a scan, just when the first reset has given its lock back."""
    broken, close, came = StandLock(stand), os.close, []
    broken.latch_fault("now", "a reason", {})
    broken.close()

    def close_and_come(file) -> None:
        close(file)
        if not came:
            came.append(None)
            reset_latched_fault(stand)
            came[0] = StandLock(stand)

    monkeypatch.setattr(os, "close", close_and_come)
    assert "a reason" in reset_latched_fault(stand)
    with pytest.raises(DeviceError, match="another program uses this stand"):
        StandLock(stand)
    came[0].close()
