"""One writer at a time: a lock on a file beside the database, which ends with its process."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from truestand.core.errors import BadStore

NAME = "lock"
RETRY_INTERVAL_S = 0.01


def is_read_only(folder: Path) -> bool:
    """Whether a store can only be read: an archive, a disc, someone else's folder."""
    return not os.access(folder, os.W_OK)


@contextmanager
def locked(folder: Path, timeout: float) -> Iterator[None]:
    """Hold the lock of a store's folder; the lock's file is made if missing and stays.

    Raises:
        BadStore: another program held it for ``timeout`` seconds.
    """
    file = os.open(folder / NAME, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        deadline = time.monotonic() + timeout
        while not _take(file):
            if time.monotonic() > deadline:
                raise BadStore(f"{folder}: another program has been writing for {timeout:g} s; try again later")
            time.sleep(RETRY_INTERVAL_S)
        yield
    finally:
        os.close(file)  # gives the lock back


def _take(file: int) -> bool:
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, 0, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
