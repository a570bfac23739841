"""The mark beside a stand.toml that the stand is in use, or in a fault that nobody has reset yet.

The process that uses the stand holds a lock on it, which ends with the process, however that ends: a mark that says
*in use* and isn't locked is that of a process that died.
"""

import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from truestand.core.errors import DeviceError, Fault

WORDS = "mend the cause, then `truestand stand reset`"


def latch_path(stand: Path) -> Path:
    """Where a stand's mark stands: beside its stand.toml."""
    return stand.with_name(f".{stand.name}.state")


class Latch:
    """The mark, taken for as long as the stand is used.

    Raises:
        DeviceError: another process uses the stand.
        Fault: a fault that nobody has reset.
    """

    def __init__(self, stand: Path) -> None:
        self.path = latch_path(stand)
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
        self._fault = False
        try:
            if not _lock(self._file):
                raise _in_use(stand)
            reason = _reason(self._read())
            if reason:
                raise Fault(reason)
        except BaseException:
            os.close(self._file)
            raise

    def use(self, since: str, log: Path) -> None:
        """Say that the stand is in use now, recording to ``log``."""
        self._write({"state": "in use", "since": since, "log": str(log)})

    def fault(self, since: str, reason: str, left: Mapping[str, str] | None = None) -> None:
        """Keep a fault until ``reset``, with what could not be stopped and why."""
        self._fault = True
        self._write({"state": "fault", "since": since, "reason": reason, "not_stopped": left or {}})

    def close(self) -> None:
        """Give the stand free; a fault stays."""
        if not self._fault:
            self._write({})
        os.close(self._file)

    def _read(self) -> dict[str, Any]:
        os.lseek(self._file, 0, os.SEEK_SET)
        return _parsed(os.read(self._file, 65536), self.path.name)

    def _write(self, content: dict[str, Any]) -> None:
        """Broken off in between, it leaves no JSON rather than nothing: a fault, not a stand that is free."""
        text = json.dumps(content).encode() if content else b""
        os.lseek(self._file, 0, os.SEEK_SET)
        os.write(self._file, text)
        os.ftruncate(self._file, len(text))
        os.fsync(self._file)


def demand_free(stand: Path) -> None:
    """See that nobody uses the stand; a fault doesn't matter.

    Raises:
        DeviceError: the stand is in use.
    """
    if latch_path(stand).exists():
        with suppress(Fault):
            Latch(stand).close()


def reset_latch(stand: Path) -> str:
    """Forget a latched fault; its reason, or nothing where there was none.

    Raises:
        DeviceError: the stand is in use.
    """
    path = latch_path(stand)
    if not path.exists():
        return ""
    file = os.open(path, os.O_RDWR)
    try:
        if not _lock(file):
            raise _in_use(stand)
        reason = _reason(_mark(path))
        os.ftruncate(file, 0)  # not unlinked: others may have this file open, and lock it
        return reason
    finally:
        os.close(file)


def latched_fault(stand: Path) -> str:
    """Why the stand may not be used, or nothing; looks only, and says nothing of a stand that is in use."""
    path = latch_path(stand)
    told = _mark(path)
    if told.get("state") != "in use":
        return _reason(told)
    file = os.open(path, os.O_RDWR)
    try:
        return _reason(_mark(path)) if _lock(file) else ""  # read again: its program may just have ended well
    finally:
        os.close(file)


def not_stopped(stand: Path) -> list[str]:
    """What could not be stopped when the stand's fault was latched, in plain words."""
    return list(_left(_mark(latch_path(stand))))


def in_words(left: Mapping[str, str]) -> list[str]:
    """What could not be stopped, each with its reason."""
    return [f"{what}: {why}" for what, why in left.items()]


def _left(told: dict[str, Any]) -> dict[str, str]:
    left = told.get("not_stopped")
    return {what: str(why) for what, why in left.items()} if isinstance(left, dict) else {}


def _mark(path: Path) -> dict[str, Any]:
    try:
        return _parsed(path.read_bytes(), path.name)
    except FileNotFoundError:
        return {}


def _parsed(content: bytes, name: str) -> dict[str, Any]:
    if not content.strip():
        return {}
    try:
        told = json.loads(content)
    except (ValueError, RecursionError):
        told = None
    return told if isinstance(told, dict) else {"state": "fault", "reason": f"{name} holds no JSON"}


def _in_use(stand: Path) -> DeviceError:
    return DeviceError(f"{stand}: another program uses this stand; end it first, or wait")


def _reason(told: dict[str, Any]) -> str:
    """Why a stand with this mark may not be used."""
    if told.get("state") == "fault":
        why = dict.fromkeys(["; ".join(in_words(_left(told))), str(told.get("reason"))])
        return f"the stand is in fault since {told.get('since')}: {'; '.join(filter(None, why))}; {WORDS}"
    if told.get("state") == "in use":
        log = Path(str(told.get("log")))
        recover = f"`truestand recover {log}`, " if log.exists() else ""
        return (
            f"the program that used the stand since {told.get('since')} died; see that the table stands still and "
            f"the laser is off, {recover}then `truestand stand reset`"
        )
    return ""


def _lock(file: int) -> bool:
    """Take the file's lock, which ends with this process; whether it was free."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, 1 << 20, os.SEEK_SET)  # beyond the content, which others may read
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
