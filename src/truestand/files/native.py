"""The native scan: HDF5 in NetCDF-4 layout, small, lossless, quick to read, with its stand and its hashes inside.

x and z are int16 counts with ``scale_factor`` and ``add_offset`` wherever that gives every number back exactly, else
float64. Dimension scales ``profile`` and ``point`` and the ``units`` attributes make it readable by any NetCDF-4 tool.
"""

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from truestand._version import __version__
from truestand.core.errors import TruestandError, UnreadableFile
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.files.atomic import replacing
from truestand.files.recipes import stand_from_recipe, stand_recipe

if TYPE_CHECKING:
    import h5py

Array = NDArray[np.float64]

FORMAT = "native"
LAYOUT = "truestand.scan"
VERSION = 1
STEPS = (0.004, 0.001, 0.002, 0.005, 0.0005, 0.01, 0.00025, 0.0001)
"""mm: range steps that sensors count in, tried in turn."""
FILL = -32768
MOST_READINGS = 2**31
COLUMNS = {"y": "1", "time": "s", "angle": "rad", "encoder": "1", "counter": "1"}
"""Columns with one value a profile, and their units."""


def is_native(head: bytes) -> bool:
    """Whether a file starts like HDF5."""
    return head.startswith(b"\x89HDF\r\n\x1a\n")


def write_native(recording: Recording, path: Path, stand: Stand | None = None) -> None:
    """Write a recording, with the stand that it was taken on, as a whole or not at all."""
    import h5py

    with replacing(path) as temporary, h5py.File(temporary, "w", libver=("v108", "v108")) as file:
        file.attrs["Conventions"] = "CF-1.8"
        file.attrs["format"] = LAYOUT
        file.attrs["version"] = VERSION
        file.attrs["software"] = f"truestand {__version__}"
        file.attrs["source_format"] = recording.format
        file.attrs["source_sha256"] = recording.sha256
        if stand is not None:
            file.attrs["stand"] = json.dumps(stand_recipe(stand))
        _write_scales(file, *recording.x.shape)
        for name in ("x", "z"):
            _write_matrix(file, name, getattr(recording, name), "mm")
        if recording.intensity is not None:
            _write_matrix(file, "intensity", recording.intensity, "1")
        for name, unit in COLUMNS.items():
            values = getattr(recording, name)
            if values is not None:
                _write(file, name, np.asarray(values), unit, ("profile",))


def read_native(path: Path, sha256: str) -> Recording:
    """The recording of a native file.

    Raises:
        UnreadableFile: damaged, truncated, of another kind, newer, or with content that fails its hash.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return _recording(file, path.name, sha256)
    except TruestandError:
        raise
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as wrong:
        raise UnreadableFile(f"{path.name}: the HDF5 file is damaged or cut off ({wrong}); import it again") from wrong


def _recording(file: "h5py.File", name: str, sha256: str) -> Recording:
    if file.attrs.get("format") != LAYOUT:
        raise UnreadableFile(f"{name}: an HDF5 file, but no truestand scan; give a scan written by `truestand import`")
    version = int(file.attrs["version"])
    if version > VERSION:
        raise UnreadableFile(f"{name}: found version {version}, this truestand reads up to {VERSION}; update it")
    shape = file["z"].shape
    if len(shape) != 2 or file["x"].shape != shape or not 0 < shape[0] * shape[1] < MOST_READINGS:
        raise UnreadableFile(f"{name}: found x {file['x'].shape} and z {shape}, need two equal matrices of readings")
    stand = file.attrs.get("stand")
    columns: dict[str, Any] = {key: _read(file[key], name) for key in COLUMNS if key in file}
    return Recording(
        _read_matrix(file["x"], name),
        _read_matrix(file["z"], name),
        FORMAT,
        sha256,
        intensity=_read_matrix(file["intensity"], name) if "intensity" in file else None,
        stand=None if stand is None else stand_from_recipe(json.loads(stand)),
        **columns,
    )


def _write_scales(file: "h5py.File", profiles: int, points: int) -> None:
    for name, size in (("profile", profiles), ("point", points)):
        scale = file.create_dataset(name, data=np.arange(size, dtype=np.int32))
        scale.attrs["units"] = "1"
        scale.make_scale(name)


def _write_matrix(file: "h5py.File", name: str, values: Array, unit: str) -> None:
    counted = _counts(values)
    if counted is None:
        _write(file, name, values, unit, ("profile", "point"))
        return
    counts, step, offset = counted
    dataset = _write(file, name, counts, unit, ("profile", "point"))
    dataset.attrs["scale_factor"] = step
    dataset.attrs["add_offset"] = offset
    dataset.attrs["_FillValue"] = np.int16(FILL)


def _write(file: "h5py.File", name: str, values: NDArray[Any], unit: str, axes: tuple[str, ...]) -> "h5py.Dataset":
    chunks = (min(512, values.shape[0]), values.shape[1]) if values.ndim == 2 else None
    pressed = {"compression": "lzf", "shuffle": True, "chunks": chunks} if values.ndim == 2 and values.size else {}
    dataset = file.create_dataset(name, data=values, **pressed)
    dataset.attrs["units"] = unit
    dataset.attrs["sha256"] = _hash(values)
    for i, axis in enumerate(axes):
        dataset.dims[i].attach_scale(file[axis])
    return dataset


def _counts(values: Array) -> tuple[NDArray[np.int16], float, float] | None:
    """int16 counts, step and offset that give ``values`` back to the last bit; None where there are none."""
    low = float(np.fmin.reduce(values, axis=None, initial=np.inf))
    high = float(np.fmax.reduce(values, axis=None, initial=-np.inf))
    if not np.isfinite([low, high]).all():
        return np.full(values.shape, FILL, dtype=np.int16), 1.0, 0.0
    for step in STEPS:
        offset = float(round((low + high) / 2 / step)) * step
        if (high - low) / step > 65000:
            continue
        if _exact(values[:1], step, offset) is None:
            continue
        counts = _exact(values, step, offset)
        if counts is not None:
            return counts, step, offset
    return None


def _exact(values: Array, step: float, offset: float) -> NDArray[np.int16] | None:
    unseen = np.isnan(values)
    steps = np.rint(np.where(unseen, 0.0, (values - offset) / step))
    if np.abs(steps).max(initial=0.0) > 32767:
        return None
    back = _values(steps, step, offset)
    if not ((back == values) | unseen).all():
        return None
    counts = steps.astype(np.int16)
    counts[unseen] = FILL
    return counts


def _values(counts: NDArray[Any], step: float, offset: float) -> Array:
    """mm from counts: whole steps, so that 0.004 x 23,750 is 95 and not its neighbour."""
    inverse = round(1.0 / step)
    return np.asarray((counts + float(round(offset * inverse))) / float(inverse), dtype=np.float64)


def _read_matrix(dataset: "h5py.Dataset", name: str) -> Array:
    raw = _read(dataset, name)
    if "scale_factor" not in dataset.attrs:
        return np.asarray(raw, dtype=np.float64)
    values = _values(raw, float(dataset.attrs["scale_factor"]), float(dataset.attrs["add_offset"]))
    values[raw == FILL] = np.nan
    return values


def _read(dataset: "h5py.Dataset", name: str) -> NDArray[Any]:
    values: NDArray[Any] = dataset[()]
    if _hash(values) != dataset.attrs["sha256"]:
        raise UnreadableFile(f"{name}: {dataset.name} fails its hash: the file was damaged or edited; import it again")
    return values


def _hash(values: NDArray[Any]) -> str:
    return hashlib.sha256(np.ascontiguousarray(values).data.cast("B")).hexdigest()
