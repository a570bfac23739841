"""A lock on an open file, which ends with its process, however that ends."""

import os
import sys

LOCKED_BYTE = 1 << 20
"""On Windows; beyond the content, which others may read."""


def take_lock(file: int) -> bool:
    """Take the lock of an open file descriptor until that is closed; whether it was free."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, LOCKED_BYTE, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
