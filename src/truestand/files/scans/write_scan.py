"""Scans to disk, by suffix: .h5 and .nc native, .csv as sensors export."""

from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.files.atomic import replacing

NATIVE = (".h5", ".nc", ".hdf5")


def check_output(path: Path, force: bool) -> None:
    """Refuse an output that can't be written, before the work is done.

    Raises:
        BadRecipe: unknown suffix, or a scan that is already there and ``force`` is not set.
    """
    if path.suffix.lower() not in (*NATIVE, ".csv"):
        raise BadRecipe(f"{path}: found suffix {path.suffix!r}, need .h5 (native) or .csv")
    if path.exists() and not force:
        raise BadRecipe(f"{path} is already there; a raw scan is never overwritten without --force")


def write_recording(recording: Recording, path: Path, stand: Stand | None = None, force: bool = False) -> None:
    """Write a scan: .h5 native with its stand; .csv as XYZ blocks, or long where XYZ blocks can't carry its columns.

    Raises:
        BadRecipe: as ``check_output``.
    """
    check_output(path, force)
    if path.suffix.lower() in NATIVE:
        from truestand.files.scans.native import write_native

        write_native(recording, path, stand)
    elif _has_columns(recording):
        write_long_csv(recording, path)
    else:
        write_xyz_blocks(recording, path)


def write_xyz_blocks(recording: Recording, path: Path) -> None:
    """XYZ blocks with ',' between values and decimal points; Y is the profile number where the scan has none."""
    profiles, points = recording.x.shape
    y = np.arange(profiles, dtype=np.float64) if recording.y is None else recording.y
    with replacing(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        _write_matrix(file, recording.x)
        file.write("\n")
        file.writelines(",".join([f"{value:.9g}"] * points) + "\n" for value in y)
        file.write("\n")
        _write_matrix(file, recording.z)


def write_long_csv(recording: Recording, path: Path) -> None:
    """The long CSV: one row a reading that was seen, with the scan's own columns."""
    seen = np.isfinite(recording.z) & np.isfinite(recording.x)
    seen[~seen.any(axis=1), 0] = True  # a profile that saw nothing still has its columns
    row, point = np.nonzero(seen)
    columns: list[tuple[str, NDArray[Any], str]] = [("profile", row, "%d"), ("point", point, "%d")]
    for name, one_a_profile, scale, form in (
        ("counter", recording.counter, 1, "%d"),
        ("time_s", recording.time, 1.0, "%.12g"),
        ("angle_deg", recording.angle, float(np.degrees(1.0)), "%.12g"),
        ("encoder", recording.encoder, 1.0, "%.12g"),
    ):
        if one_a_profile is not None:
            columns.append((name, one_a_profile[row] * scale, form))
    columns += [("x_mm", recording.x[row, point], "%.9g"), ("z_mm", recording.z[row, point], "%.9g")]
    if recording.intensity is not None:
        columns.append(("intensity", recording.intensity[row, point], "%.9g"))
    with replacing(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.write(",".join(name for name, _, _ in columns) + "\n")
        table = np.column_stack([values for _, values, _ in columns])
        np.savetxt(file, table, fmt=",".join(form for _, _, form in columns))


def _has_columns(recording: Recording) -> bool:
    """Whether the scan has what XYZ blocks can't carry."""
    columns = (recording.time, recording.angle, recording.encoder, recording.counter, recording.intensity)
    return any(values is not None for values in columns)


def _write_matrix(file: TextIO, values: Array) -> None:
    np.savetxt(file, values, fmt=_number_format(values), delimiter=",")


def _number_format(values: Array) -> str:
    """As short as gives numbers back: the fewest decimals (up to 6) that do for the first thousand profiles."""
    sample = values[:1000]
    for decimals in range(7):
        if np.array_equal(np.round(sample, decimals), sample, equal_nan=True):
            return f"%.{decimals}f"
    return "%.9g"
