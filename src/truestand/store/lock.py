"""One writer at a time: a lock on a file beside the database, which ends with its process."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from truestand.core.errors import BadStore
from truestand.files.file_lock import take_lock

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
        while not take_lock(file):
            if time.monotonic() > deadline:
                raise BadStore(f"{folder}: another program has been writing for {timeout:g} s; try again later")
            time.sleep(RETRY_INTERVAL_S)
        yield
    finally:
        os.close(file)  # gives the lock back
