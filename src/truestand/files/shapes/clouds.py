"""Point clouds to disk, by suffix: PLY, XYZ, npz, E57. Only points that were seen are written."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe, MissingExtra, UnreadableFile
from truestand.files.atomic import replacing
from truestand.files.shapes.ply import MOST_HEADER_BYTES, is_ply, ply_header

SUFFIXES = (".ply", ".xyz", ".npz", ".e57")
BLOCK_PROFILES = 512
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
    with replacing(path) as temporary:
        if path.suffix.lower() == ".ply":
            return _write_ply(temporary, x, y, z, deviation)
        columns = _columns(x, y, z, deviation)
        writers = {".xyz": _write_xyz, ".npz": _write_npz, ".e57": _write_e57}
        writers[path.suffix.lower()](temporary, columns)
        return columns["x"].size


def _columns(x: Array, y: Array, z: Array, deviation: Array | None, first: int = 0) -> dict[str, NDArray[Any]]:
    """The points that were seen, by column; ``first`` is the number of the first profile."""
    seen = np.isfinite(x) & np.isfinite(y) & np.isfinite(z)
    profile, point = (i.astype(np.int32) for i in np.nonzero(seen))
    columns = {"x": x[seen], "y": y[seen], "z": z[seen], "profile": profile + np.int32(first), "point": point}
    return columns if deviation is None else {**columns, "deviation": deviation[seen]}


def _write_ply(path: Path, x: Array, y: Array, z: Array, deviation: Array | None) -> int:
    names = ["x", "y", "z", "profile", "point"] + ([] if deviation is None else ["deviation"])
    types = {"profile": "int", "point": "int"}
    record = np.dtype([(n, "<i4" if n in types else "<f4") for n in names])
    count = int(np.count_nonzero(np.isfinite(x) & np.isfinite(y) & np.isfinite(z)))
    properties = "".join(f"property {types.get(n, 'float')} {n}\n" for n in names)
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment truestand: mm, frame C (the shaft)\n"
        f"element vertex {count}\n{properties}end_header\n"
    )
    with path.open("wb") as file:
        file.write(header.encode("ascii"))
        for first in range(0, x.shape[0], BLOCK_PROFILES):
            rows = slice(first, first + BLOCK_PROFILES)
            columns = _columns(x[rows], y[rows], z[rows], None if deviation is None else deviation[rows], first)
            file.write(np.rec.fromarrays(list(columns.values()), dtype=record).tobytes())
    return count


def _write_xyz(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    lengths = [values for name, values in columns.items() if name not in ("profile", "point")]
    np.savetxt(path, np.column_stack(lengths), fmt="%.5f")


def _write_npz(path: Path, columns: dict[str, Any]) -> None:
    with path.open("wb") as file:
        np.savez(file, **columns)


def _write_e57(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    import pye57

    data = {f"cartesian{axis.upper()}": columns[axis] / 1000.0 for axis in "xyz"}  # E57 counts in metres
    data |= {"rowIndex": columns["profile"], "columnIndex": columns["point"]}
    path.unlink()  # the library writes new files only
    file = pye57.E57(str(path), mode="w")
    try:
        file.write_scan_raw(data, name="truestand")
    finally:
        file.close()


def open_cloud(path: Path | str) -> "np.memmap[Any, np.dtype[np.void]]":
    """The points (n,) of a PLY that ``write_cloud`` wrote, by column, without reading them yet.

    Raises:
        UnreadableFile: it is another file, or cut off.
    """
    path = Path(path)
    with path.open("rb") as file:
        head = file.read(MOST_HEADER_BYTES)
    header = ply_header(head, path.name) if is_ply(head) else None
    if header is None or header.byte_order != "<" or (header.record.names or ())[:3] != ("x", "y", "z"):
        raise UnreadableFile(f"{path.name}: no cloud of truestand's; `truestand roll` and `inspect` write them")
    needed = header.size + header.count * header.record.itemsize
    if path.stat().st_size != needed or header.count == 0:
        raise UnreadableFile(
            f"{path.name}: found {header.count} points in {path.stat().st_size} bytes, need {needed}, and a point"
        )
    return np.memmap(path, dtype=header.record, mode="r", offset=header.size, shape=(header.count,))
