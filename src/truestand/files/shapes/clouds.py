"""Point clouds to disk, by suffix: PLY, XYZ, npz, E57. Only points that were seen are written."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
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


@dataclass(frozen=True, slots=True)
class Cloud:
    """A rolled-up scan: ``x``, ``y``, ``z`` (N, M) mm, NaN = not seen, and what it is written with."""

    x: Array
    y: Array
    z: Array
    deviation: Array | None = None
    """(N, M), in the unit in which it is to stand in the file."""
    view: str | None = None
    """Name of the sensor, where several are written together."""

    @property
    def seen(self) -> Mask:
        """(N, M): readings that are points."""
        return np.asarray(np.isfinite(self.x) & np.isfinite(self.y) & np.isfinite(self.z))

    def rows(self, rows: slice) -> "Cloud":
        """Some of its profiles."""
        deviation = None if self.deviation is None else self.deviation[rows]
        return replace(self, x=self.x[rows], y=self.y[rows], z=self.z[rows], deviation=deviation)


def write_cloud(path: Path | str, x: Array, y: Array, z: Array, deviation: Array | None = None) -> int:
    """Write a rolled-up scan (N, M) mm in the format that the suffix names; returns the number of points.

    Raises:
        BadRecipe: unknown suffix.
        MissingExtra: E57 without its extra.
    """
    return write_clouds(path, [Cloud(x, y, z, deviation)])


def write_clouds(path: Path | str, clouds: Sequence[Cloud]) -> int:
    """Write the rolled-up scans of one or several views as one cloud, points of several with the number of their view.

    The format is the one that the suffix names; returns the number of points.

    Raises:
        BadRecipe: unknown suffix.
        MissingExtra: E57 without its extra.
    """
    path = Path(path)
    check_suffix(path)
    with replacing(path) as temporary:
        if path.suffix.lower() == ".ply":
            return _write_ply(temporary, clouds)
        columns = _joined([_columns(cloud, number, len(clouds)) for number, cloud in enumerate(clouds)])
        writers = {".xyz": _write_xyz, ".npz": _write_npz, ".e57": _write_e57}
        writers[path.suffix.lower()](temporary, columns)
        return int(columns["x"].size)


def _columns(cloud: Cloud, number: int, clouds: int, first: int = 0) -> dict[str, NDArray[Any]]:
    """The points that were seen, by column, of the cloud of that ``number`` among ``clouds``; ``first``: number of its
    first profile.
    """
    seen = cloud.seen
    profile, point = (i.astype(np.int32) for i in np.nonzero(seen))
    columns: dict[str, NDArray[Any]] = {
        "x": cloud.x[seen], "y": cloud.y[seen], "z": cloud.z[seen], "profile": profile + np.int32(first),
        "point": point,
    }  # fmt: skip
    if cloud.deviation is not None:
        columns["deviation"] = cloud.deviation[seen]
    if clouds > 1:
        columns["view"] = np.full(point.size, number, dtype=np.uint8)
    return columns


def _joined(parts: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


PLY_TYPES = {"profile": ("int", "<i4"), "point": ("int", "<i4"), "view": ("uchar", "u1")}
"""Of columns that are no lengths, in the header and in the file."""


def _write_ply(path: Path, clouds: Sequence[Cloud]) -> int:
    names = list(_columns(clouds[0].rows(slice(0, 0)), 0, len(clouds)))
    record = np.dtype([(n, PLY_TYPES.get(n, ("float", "<f4"))[1]) for n in names])
    count = sum(int(np.count_nonzero(cloud.seen)) for cloud in clouds)
    properties = "".join(f"property {PLY_TYPES.get(n, ('float', ''))[0]} {n}\n" for n in names)
    views = "".join(f"comment view {k} {cloud.view}\n" for k, cloud in enumerate(clouds) if len(clouds) > 1)
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment truestand: mm, frame C (the shaft)\n{views}"
        f"element vertex {count}\n{properties}end_header\n"
    )
    with path.open("wb") as file:
        file.write(header.encode("ascii", "replace"))
        for number, cloud in enumerate(clouds):
            for first in range(0, cloud.x.shape[0], BLOCK_PROFILES):
                part = _columns(cloud.rows(slice(first, first + BLOCK_PROFILES)), number, len(clouds), first)
                file.write(np.rec.fromarrays(list(part.values()), dtype=record).tobytes())
    return count


def _write_xyz(path: Path, columns: dict[str, NDArray[Any]]) -> None:
    lengths = [values for name, values in columns.items() if name not in ("profile", "point", "view")]
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
