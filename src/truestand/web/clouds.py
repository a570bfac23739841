"""A cloud of millions of points made small enough for a browser, without losing the largest deviations.

Most points are taken evenly in the order they were measured; the rest are those that deviate most, so that no defect
is thinned away. The answer is what a browser reads without parsing: a count, then x, y, z (mm) and deviation (um).
"""

import hashlib
import threading
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Ints
from truestand.core.errors import UnreadableFile
from truestand.files.atomic import replacing
from truestand.files.shapes.clouds import open_cloud

EXTREME_SHARE = 0.05
"""Share of the points that is kept for those that deviate most."""
COLUMNS = ("x", "y", "z", "deviation")


def thin_out(source: Path, target: Path, points: int) -> int:
    """Write at most ``points`` points of a PLY to ``target``; how many were written.

    Raises:
        UnreadableFile: no cloud of truestand's, or not the one whose hash is its name.
    """
    digests: list[str] = []
    hashing = threading.Thread(target=lambda: digests.append(_sha256(source)))
    hashing.start()  # on the other core, while this one picks
    cloud = open_cloud(source)
    deviation = cloud["deviation"] if "deviation" in (cloud.dtype.names or ()) else None
    chosen = choose(cloud.size, None if deviation is None else np.asarray(deviation), points)
    picked = cloud[chosen]
    columns = [picked[name] if name in (cloud.dtype.names or ()) else np.full(len(chosen), np.nan) for name in COLUMNS]
    hashing.join()
    if len(source.name) == 64 and digests != [source.name]:
        raise UnreadableFile(f"{source.name}: changed since it was kept; run truestand audit and restore a backup")
    with replacing(target) as temporary:
        arrays = [np.ascontiguousarray(column, dtype="<f4").tobytes() for column in columns]
        temporary.write_bytes(b"".join([np.uint32(len(chosen)).astype("<u4").tobytes(), *arrays]))
    return len(chosen)


def choose(size: int, deviation: NDArray[np.float32] | None, points: int) -> Ints:
    """Indices of the points that are shown, of ``size``, ascending."""
    if size <= points:
        return np.arange(size)
    extreme = int(EXTREME_SHARE * points) if deviation is not None else 0
    even = np.linspace(0, size - 1, points - extreme).astype(np.intp)
    if deviation is None or not extreme:
        return even
    strength = np.abs(deviation, dtype=np.float32)
    strength[np.isnan(strength)] = -1.0
    most = np.argpartition(strength, size - extreme)[size - extreme :]
    return np.union1d(even, most[strength[most] >= 0.0])


def _sha256(path: Path) -> str:
    """As ``sha256_of`` of the scans' readers, which would load every one of them."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
