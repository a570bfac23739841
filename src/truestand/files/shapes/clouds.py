"""Point clouds to disk, by suffix: PLY, XYZ, npz, E57. Only points that were seen are written."""

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import BadRecipe, MissingExtra, UnreadableFile
from truestand.files.atomic import replacing

Array = NDArray[np.float64]

SUFFIXES = (".ply", ".xyz", ".npz", ".e57")
_HEADER = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(comment .*\n)*element vertex (?P<count>\d{1,12})\n"
    rb"(?P<properties>(property (float|int) \w+\n){3,9})end_header\n"
)
BLOCK = 512
"""Profiles written at once."""


def check_suffix(path: Path) -> None:
    """Refuse a cloud that can't be written, before the work is done.

    Raises:
        BadRecipe: unknown suffix.
        MissingExtra: E57 without its extra.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise BadRecipe(f"{path}: found suffix {path.suffix!r}, need one of {', '.join(SUFFIXES)}")
    if path.suffix.lower() == ".e57" and find_spec("pye57") is None:
        raise MissingExtra("E57 needs an extra package; install it with: pip install 'truestand[e57]'")


def write_cloud(path: Path | str, x: Array, y: Array, z: Array, deviation: Array | None = None) -> int:
    """Write a rolled-up scan (N, M) mm in the format that the suffix names; returns the number of points.

    Raises:
        BadRecipe: unknown suffix.
        MissingExtra: E57 without its extra.
    """
    path = Path(path)
    check_suffix(path)
    writers = {".ply": _write_ply, ".xyz": _write_xyz, ".npz": _write_npz, ".e57": _write_e57}
    with replacing(path) as temporary:
        return writers[path.suffix.lower()](temporary, x, y, z, deviation)


def _seen(x: Array, y: Array, z: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(x) & np.isfinite(y) & np.isfinite(z))


def _write_ply(path: Path, x: Array, y: Array, z: Array, deviation: Array | None) -> int:
    names = ["x", "y", "z", "profile", "point"] + ([] if deviation is None else ["deviation"])
    types = {"profile": "int", "point": "int"}
    kind = np.dtype([(n, "<i4" if n in types else "<f4") for n in names])
    count = int(np.count_nonzero(_seen(x, y, z)))
    properties = "".join(f"property {types.get(n, 'float')} {n}\n" for n in names)
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment truestand: mm, frame C (the shaft)\n"
        f"element vertex {count}\n{properties}end_header\n"
    )
    point = np.arange(x.shape[1], dtype=np.int32)
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        for first in range(0, x.shape[0], BLOCK):
            rows = slice(first, min(first + BLOCK, x.shape[0]))
            on = _seen(x[rows], y[rows], z[rows])
            block = np.empty(int(np.count_nonzero(on)), dtype=kind)
            block["x"], block["y"], block["z"] = x[rows][on], y[rows][on], z[rows][on]
            block["profile"] = np.broadcast_to(np.arange(rows.start, rows.stop, dtype=np.int32)[:, None], on.shape)[on]
            block["point"] = np.broadcast_to(point, on.shape)[on]
            if deviation is not None:
                block["deviation"] = deviation[rows][on]
            file.write(block.tobytes())
    return count


def _write_xyz(path: Path, x: Array, y: Array, z: Array, deviation: Array | None) -> int:
    on = _seen(x, y, z)
    columns = [x[on], y[on], z[on]] + ([] if deviation is None else [deviation[on]])
    np.savetxt(path, np.column_stack(columns), fmt="%.5f")
    return int(np.count_nonzero(on))


def _write_npz(path: Path, x: Array, y: Array, z: Array, deviation: Array | None) -> int:
    on = _seen(x, y, z)
    profile, point = (i.astype(np.int32) for i in np.nonzero(on))
    columns: dict[str, Any] = {"x": x[on], "y": y[on], "z": z[on], "profile": profile, "point": point}
    if deviation is not None:
        columns["deviation"] = deviation[on]
    with path.open("wb") as file:
        np.savez(file, **columns)
    return int(profile.size)


def _write_e57(path: Path, x: Array, y: Array, z: Array, deviation: Array | None) -> int:
    import pye57

    on = _seen(x, y, z)
    profile, point = np.nonzero(on)
    data = {
        "cartesianX": x[on] / 1000.0,  # E57 counts in metres
        "cartesianY": y[on] / 1000.0,
        "cartesianZ": z[on] / 1000.0,
        "rowIndex": profile.astype(np.int32),
        "columnIndex": point.astype(np.int32),
    }
    path.unlink()  # the library writes new files only
    file = pye57.E57(str(path), mode="w")
    try:
        file.write_scan_raw(data, name="truestand")
    finally:
        file.close()
    return int(profile.size)


def open_cloud(path: Path | str) -> "np.memmap[Any, np.dtype[np.void]]":
    """The points of a PLY that ``write_cloud`` wrote, by column, without reading them yet.

    Raises:
        UnreadableFile: it is another file, or cut off.
    """
    path = Path(path)
    with path.open("rb") as file:
        found = _HEADER.match(file.read(2048))
    if found is None:
        raise UnreadableFile(f"{path.name}: no cloud of truestand's; `truestand roll` and `inspect` write them")
    properties = re.findall(rb"property (float|int) (\w+)\n", found["properties"])
    kind = np.dtype([(name.decode(), "<f4" if of == b"float" else "<i4") for of, name in properties])
    count = int(found["count"])
    needed = found.end() + count * kind.itemsize
    if path.stat().st_size != needed or count == 0:
        raise UnreadableFile(
            f"{path.name}: found {count} points in {path.stat().st_size} bytes, need {needed}, and a point"
        )
    return np.memmap(path, dtype=kind, mode="r", offset=found.end(), shape=(count,))
