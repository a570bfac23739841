"""Where a store lies: names that its parts share, and whether the place can be written at all."""

import os
from pathlib import Path

LOCK = "lock"


def is_frozen(folder: Path) -> bool:
    """Whether a store can only be read: an archive, a disc, someone else's folder."""
    return not os.access(folder, os.W_OK)
