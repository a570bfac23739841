"""One writer at a time: a lock that ends with its process, on a file beside the database."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from truestand.core.errors import BadStore

PAUSE = 0.01
"""s between two tries."""


@contextmanager
def locked(path: Path, timeout: float) -> Iterator[None]:
    """Hold the lock of ``path``; the file is made if missing and stays.

    Raises:
        BadStore: another program held it for ``timeout`` seconds.
    """
    file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        until = time.monotonic() + timeout
        while not _take(file):
            if time.monotonic() > until:
                raise BadStore(f"{path.parent}: another program has been writing for {timeout:g} s; try again later")
            time.sleep(PAUSE)
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
