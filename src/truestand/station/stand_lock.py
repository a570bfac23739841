"""The state file beside a stand.toml: the stand is in use, or in a latched fault that nobody has reset yet.

The process that uses the stand holds a lock on the file, which ends with the process, however that ends: a file that
says *in use* and isn't locked is that of a process that died.
"""

import json
import os
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from truestand.core.errors import DeviceError, Fault
from truestand.files.file_lock import take_lock

REMEDY = "mend the cause, then `truestand stand reset`"


def state_path(stand: Path) -> Path:
    """The state file of a stand.toml, in the same folder."""
    return stand.with_name(f".{stand.name}.state")


class StandLock:
    """Exclusive use of a stand, for as long as this is open.

    Raises:
        DeviceError: another process uses the stand.
        Fault: a fault that nobody has reset.
    """

    def __init__(self, stand: Path) -> None:
        self.path = state_path(stand)
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
        self._fault = False
        with ExitStack() as on_failure:
            on_failure.callback(os.close, self._file)
            if not take_lock(self._file):
                raise _in_use(stand)
            reason = _reason(_read_state(self.path))
            if reason:
                raise Fault(reason)
            on_failure.pop_all()

    def set_in_use(self, since: str, log: Path) -> None:
        """Write that the stand records to ``log``."""
        self._write({"state": "in use", "since": since, "log": str(log)})

    def latch_fault(self, since: str, reason: str, not_stopped: Mapping[str, str]) -> None:
        """Keep a fault until it is reset; ``not_stopped``: devices that did not obey, with the reason."""
        self._fault = True
        self._write({"state": "fault", "since": since, "reason": reason, "not_stopped": dict(not_stopped)})

    def close(self) -> None:
        """Release the stand; a latched fault stays."""
        if not self._fault:
            self._write({})
        os.close(self._file)

    def _write(self, content: dict[str, Any]) -> None:
        """Broken off in between, it leaves no JSON rather than nothing: a fault, not a stand that is free."""
        text = json.dumps(content).encode() if content else b""
        os.lseek(self._file, 0, os.SEEK_SET)
        os.write(self._file, text)
        os.ftruncate(self._file, len(text))
        os.fsync(self._file)


def require_unused(stand: Path) -> None:
    """Refuse a stand that is in use; a fault doesn't matter.

    Raises:
        DeviceError: the stand is in use.
    """
    if state_path(stand).exists():
        with suppress(Fault):
            StandLock(stand).close()


def reset_latched_fault(stand: Path) -> str:
    """Forget a latched fault; its reason, empty where there was none.

    Raises:
        DeviceError: the stand is in use.
    """
    path = state_path(stand)
    if not path.exists():
        return ""
    file = os.open(path, os.O_RDWR)
    try:
        if not take_lock(file):
            raise _in_use(stand)
        reason = _reason(_read_state(path))
        os.ftruncate(file, 0)  # not unlinked: others may have this file open, and lock it
        return reason
    finally:
        os.close(file)


def latched_fault(stand: Path) -> str:
    """Why the stand may not be used; empty where it may, or is in use. Changes nothing."""
    path = state_path(stand)
    state = _read_state(path)
    if state.get("state") != "in use":
        return _reason(state)
    file = os.open(path, os.O_RDWR)
    try:
        return _reason(_read_state(path)) if take_lock(file) else ""  # read again: its program may just have ended well
    finally:
        os.close(file)


def not_stopped(stand: Path) -> list[str]:
    """The devices that could not be stopped when the stand's fault was latched, as warnings for people."""
    return list(_not_stopped(_read_state(state_path(stand))))


def failure_texts(not_stopped: Mapping[str, str]) -> list[str]:
    """What could not be stopped, each with its reason."""
    return [f"{hazard}: {reason}" for hazard, reason in not_stopped.items()]


def _not_stopped(state: dict[str, Any]) -> dict[str, str]:
    hazards = state.get("not_stopped")
    return {hazard: str(reason) for hazard, reason in hazards.items()} if isinstance(hazards, dict) else {}


def _read_state(path: Path) -> dict[str, Any]:
    try:
        content = path.read_bytes()
        state = json.loads(content) if content.strip() else {}
    except FileNotFoundError:
        return {}
    except (ValueError, RecursionError):
        state = None
    return state if isinstance(state, dict) else {"state": "fault", "reason": f"{path.name} holds no JSON"}


def _in_use(stand: Path) -> DeviceError:
    return DeviceError(f"{stand}: another program uses this stand; end it first, or wait")


def _reason(state: dict[str, Any]) -> str:
    """Why a stand in this state may not be used; empty where it may."""
    if state.get("state") == "fault":
        reasons = dict.fromkeys(["; ".join(failure_texts(_not_stopped(state))), str(state.get("reason"))])
        return f"the stand is in fault since {state.get('since')}: {'; '.join(filter(None, reasons))}; {REMEDY}"
    if state.get("state") == "in use":
        log = Path(str(state.get("log")))
        recover = f"`truestand recover {log}`, " if log.exists() else ""
        return (
            f"the program that used the stand since {state.get('since')} died; see that the table stands still and "
            f"the laser is off, {recover}then `truestand stand reset`"
        )
    return ""
