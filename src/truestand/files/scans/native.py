"""The native scan: HDF5 in NetCDF-4 layout, small, lossless, quick to read, with its stand and its hashes inside.

x and z are int16 counts with ``scale_factor`` and ``add_offset`` wherever that gives every number back exactly, else
float64. Dimension scales ``profile`` and ``point`` and the ``units`` attributes make it readable by any NetCDF-4 tool.
"""

import hashlib
import json
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from truestand._version import __version__
from truestand.core.arrays import Array
from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.files.atomic import replacing
from truestand.files.recipes.recipes import stand_from_recipe, stand_recipe

if TYPE_CHECKING:
    import h5py


FORMAT = "native"
LAYOUT = "truestand.scan"
VERSION = 1
STEPS_MM = (0.004, 0.001, 0.002, 0.005, 0.0005, 0.01, 0.00025, 0.0001)
"""Range steps that sensors count in, tried in turn."""
FILL = -32768
MOST_OFFSET_MM = 2.0**53
"""Any offset of counts is less, as float64 skips whole numbers beyond."""
MOST_READINGS = 2**31
MOST_COMPRESSION = 1032
"""Ratio of deflate at best (lzf: 88): what promises more holds nothing."""
COLUMNS = {"y": "1", "time": "s", "angle": "rad", "encoder": "1", "counter": "1"}
"""Columns with one value a profile, and their units."""


def is_native(head: bytes) -> bool:
    """Whether a file starts like HDF5."""
    return head.startswith(b"\x89HDF\r\n\x1a\n")


def write_native(recording: Recording, path: Path, stand: Stand | None = None) -> None:
    """Write a recording, with the stand that it was taken on, as a whole or not at all."""
    import h5py

    with replacing(path) as temporary, h5py.File(temporary, "w", libver=("v108", "v108")) as file:
        file.attrs.update(
            Conventions="CF-1.8",
            format=LAYOUT,
            version=VERSION,
            software=f"truestand {__version__}",
            source_format=recording.format,
            source_sha256=recording.sha256,
        )
        if stand is not None:
            file.attrs["stand"] = json.dumps(stand_recipe(stand))
        if recording.acquisition is not None:
            file.attrs["acquisition"] = json.dumps(dict(recording.acquisition), allow_nan=False)
        _write_scales(file, *recording.x.shape)
        for name in ("x", "z"):
            _write_matrix(file, name, getattr(recording, name), "mm")
        if recording.intensity is not None:
            _write_matrix(file, "intensity", recording.intensity, "1")
        for name, unit in COLUMNS.items():
            values = getattr(recording, name)
            if values is not None:
                _write(file, name, np.asarray(values), unit)


def read_native(path: Path, sha256: str) -> Recording:
    """The recording of a native file.

    Raises:
        UnreadableFile: damaged, truncated, of another kind, newer, or with content that fails its hash.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return _recording(file, path.name, sha256)
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError) as wrong:
        raise UnreadableFile(f"{path.name}: the HDF5 file is damaged or cut off ({wrong}); import it again") from wrong


def _recording(file: "h5py.File", name: str, sha256: str) -> Recording:
    if file.attrs.get("format") != LAYOUT:
        raise UnreadableFile(f"{name}: an HDF5 file, but no truestand scan; give a scan written by `truestand import`")
    version = file.attrs["version"]
    if not isinstance(version, np.integer) or version > VERSION:
        raise UnreadableFile(f"{name}: found version {version!r}, this truestand reads up to {VERSION}; update it")
    x, z = _dataset(file, "x", name), _dataset(file, "z", name)
    if len(z.shape) != 2 or x.shape != z.shape or not 0 < z.shape[0] * z.shape[1] < MOST_READINGS:
        raise UnreadableFile(f"{name}: found x {x.shape} and z {z.shape}, need two equal matrices of readings")
    stand, acquisition = file.attrs.get("stand"), file.attrs.get("acquisition")
    columns: dict[str, Any] = {key: _read_column(file, key, z.shape[:1], name) for key in COLUMNS if key in file}
    return Recording(
        _read_matrix(x, name),
        _read_matrix(z, name),
        FORMAT,
        sha256,
        intensity=_read_matrix(_dataset(file, "intensity", name, z.shape), name) if "intensity" in file else None,
        stand=None if stand is None else stand_from_recipe(json.loads(stand)),
        acquisition=None if acquisition is None else dict(json.loads(acquisition)),
        **columns,
    )


def _dataset(file: "h5py.File", key: str, name: str, shape: tuple[int, ...] | None = None) -> "h5py.Dataset":
    """A dataset of numbers, of that shape where one is given; nothing is read yet."""
    dataset = file[key]
    if getattr(dataset, "shape", None) is None or dataset.dtype.kind not in "iuf":  # groups and types have no shape
        raise UnreadableFile(f"{name}: {key} holds no numbers; the file was edited: import it again")
    if shape not in (None, dataset.shape):
        raise UnreadableFile(f"{name}: {dataset.name} has shape {dataset.shape}, need {shape}; import it again")
    return dataset


def _write_scales(file: "h5py.File", profiles: int, points: int) -> None:
    for name, size in (("profile", profiles), ("point", points)):
        scale = file.create_dataset(name, data=np.arange(size, dtype=np.int32))
        scale.attrs["units"] = "1"
        scale.make_scale(name)


def _write_matrix(file: "h5py.File", name: str, values: Array, unit: str) -> None:
    counted = _counts(values)
    dataset = _write(file, name, values if counted is None else counted[0], unit)
    if counted is not None:
        dataset.attrs.update(scale_factor=counted[1], add_offset=counted[2], _FillValue=np.int16(FILL))


def _write(file: "h5py.File", name: str, values: NDArray[Any], unit: str) -> "h5py.Dataset":
    """Write one value a profile, or a reading (N, M)."""
    options: dict[str, Any] = {}
    if values.ndim == 2 and values.size:  # deflate: lzf is quicker, but its bytes depend on what its memory held before
        chunks = (min(512, values.shape[0]), values.shape[1])
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True, "chunks": chunks}
    dataset = file.create_dataset(name, data=values, **options)
    dataset.attrs.update(units=unit, sha256=_hash(values))
    for i, axis in enumerate(("profile", "point")[: values.ndim]):
        dataset.dims[i].attach_scale(file[axis])
    return dataset


def _counts(values: Array) -> tuple[NDArray[np.int16], float, float] | None:
    """int16 counts, step and offset that give ``values`` back to the last bit; None where there are none."""
    low = float(np.fmin.reduce(values, axis=None, initial=np.inf))
    high = float(np.fmax.reduce(values, axis=None, initial=-np.inf))
    if not np.isfinite([low, high]).all():
        return np.full(values.shape, FILL, dtype=np.int16), 1.0, 0.0
    for step in STEPS_MM:
        offset = float(round((low + high) / 2 / step)) * step
        if (high - low) / step > 65000 or _exact(values[:1], step, offset) is None:
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
    return np.where(unseen, FILL, steps).astype(np.int16)


def _values(counts: NDArray[Any], step: float, offset: float) -> Array:
    """mm from counts: whole steps, so that 0.004 x 23,750 is 95 and not its neighbour."""
    inverse = round(1.0 / step)
    return np.asarray((counts + float(round(offset * inverse))) / float(inverse), dtype=np.float64)


def _read_matrix(dataset: "h5py.Dataset", name: str) -> Array:
    raw = _read(dataset, name)
    if "scale_factor" not in dataset.attrs:
        return _finite(np.asarray(raw, dtype=np.float64), dataset, name)
    step, offset = dataset.attrs["scale_factor"], dataset.attrs["add_offset"]
    known = all(isinstance(number, np.floating) for number in (step, offset))
    if not known or step not in (*STEPS_MM, 1.0) or not abs(offset) < MOST_OFFSET_MM:
        raise UnreadableFile(
            f"{name}: {dataset.name} has scale_factor {step!r} and add_offset {offset!r}, which truestand never "
            "writes; the file was edited: import it again"
        )
    values = _values(raw, float(step), float(offset))
    values[raw == FILL] = np.nan
    return values


def _read_column(file: "h5py.File", key: str, shape: tuple[int, ...], name: str) -> NDArray[Any]:
    dataset = _dataset(file, key, name, shape)
    if key == "counter" and not np.can_cast(dataset.dtype, np.int64):
        raise UnreadableFile(f"{name}: {dataset.name} holds {dataset.dtype}, need whole numbers; import it again")
    values = _read(dataset, name)
    if np.isnan(values).any():
        raise UnreadableFile(f"{name}: {dataset.name} lacks a number, need one a profile; import it again")
    return values.astype(np.int64) if key == "counter" else _finite(values.astype(np.float64), dataset, name)


def _finite(values: Array, dataset: "h5py.Dataset", name: str) -> Array:
    if np.isinf(values).any():
        raise UnreadableFile(f"{name}: {dataset.name} holds an infinite number, need finite ones; import it again")
    return values


def _read(dataset: "h5py.Dataset", name: str) -> NDArray[Any]:
    promised = max(dataset.size, prod(dataset.chunks or ())) * dataset.dtype.itemsize
    if promised > MOST_COMPRESSION * dataset.id.get_storage_size():
        raise UnreadableFile(f"{name}: {dataset.name} promises {dataset.shape} numbers and is cut off; import it again")
    values: NDArray[Any] = dataset[()]
    if _hash(values) != dataset.attrs["sha256"]:
        raise UnreadableFile(f"{name}: {dataset.name} fails its hash: the file was damaged or edited; import it again")
    return values


def _hash(values: NDArray[Any]) -> str:
    return hashlib.sha256(np.ascontiguousarray(values).data.cast("B")).hexdigest()
