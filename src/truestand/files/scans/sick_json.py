"""SICK height maps as JSON: images of raw counts with the size of a pixel and the origin, base64 inside.

x = Origin.x + column PixelSize.x, Y the same with rows, z = raw PixelSize.z + Origin.z in mm; raw 0 is no data. A row
is a profile. Beside the height map may stand an image of the intensity and a list of encoder counts, one a row.
"""

import base64
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import UnreadableFile
from truestand.core.scan import Recording
from truestand.files.json_text import parse_json
from truestand.files.scans.columns import drop_constant, encoder_counts
from truestand.files.text import BYTE_ORDER_MARK

Json = dict[str, Any]

FORMAT = "sick json"
ADVICE = "export it again"
PIXEL_BYTES = {"uint16": 2, "uint8": 1}
BYTE_ORDERS = {"big": ">", "little": "<", "neutral": "|"}
MISSING = "MissingData"
"""How a map says that raw 0 is no data."""
MOST_MM = 1e6
"""No pixel and no origin is larger."""


@dataclass(frozen=True, slots=True)
class _Image:
    """An image of counts (rows, columns) and its scale."""

    kind: str
    zeros: str
    """What a count of 0 means."""
    counts: NDArray[Any]
    size: tuple[float, float, float]
    """Of a pixel and a count, mm."""
    origin: tuple[float, float, float]
    """mm."""


def is_sick_json(head: bytes) -> bool:
    """Whether a text is JSON of classes, as SICK AppSpace writes its images."""
    text = head.removeprefix(BYTE_ORDER_MARK).lstrip()
    return text[:1] in (b"{", b"[") and b'"class"' in head


def read_sick_json(path: Path) -> Recording:
    """The recording of a height map.

    Raises:
        UnreadableFile: no JSON, none or several height maps, or a map that doesn't fit its size.
    """
    name, data = path.name, path.read_bytes()
    try:
        parts = parse_json(data.decode("utf-8-sig"), name, ADVICE)
        parts = parts if isinstance(parts, list) else [parts]
        images = [_image(part["data"], name) for part in parts if part["class"] == "Image"]
        encoders = list(_encoders([part["data"] for part in parts if part["class"] == "SensorData"]))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as wrong:
        raise UnreadableFile(f"{name}: the height map is incomplete or malformed ({wrong!r}); {ADVICE}") from wrong
    return _recording(images, encoders, name, hashlib.sha256(data).hexdigest())


def _recording(images: list[_Image], encoders: list[NDArray[np.int64]], name: str, sha256: str) -> Recording:
    maps = [image for image in images if image.kind == "uint16" and image.zeros == MISSING]
    if len(maps) != 1:
        found = ", ".join(f"{image.kind} ({image.zeros[:20]!r})" for image in images) or "none"
        raise UnreadableFile(
            f"{name}: found {len(maps)} height maps among the images ({found}), need one: uint16 with {MISSING}"
        )
    height = maps[0]
    rows, columns = height.counts.shape
    encoder = encoders[0] if encoders else np.zeros(rows, dtype=np.int64)
    if encoder.size != rows:
        raise UnreadableFile(f"{name}: found {encoder.size} encoder counts for {rows} rows, need one a row; {ADVICE}")
    bright = [image for image in images if image.kind == "uint8" and image.counts.shape == height.counts.shape]
    z = height.counts * height.size[2] + height.origin[2]
    return Recording(
        np.tile(height.origin[0] + np.arange(columns) * height.size[0], (rows, 1)),
        np.where(height.counts == 0, np.nan, z),
        FORMAT,
        sha256,
        y=height.origin[1] + np.arange(rows, dtype=np.float64) * height.size[1],
        encoder=encoder_counts(drop_constant(encoder), name),
        intensity=bright[0].counts.astype(np.float64) if bright else None,
    )


def _image(data: Json, name: str) -> _Image:
    """An image's counts and scale.

    Raises:
        UnreadableFile: a size that its pixels don't fit, or a kind of number that isn't known.
        KeyError, TypeError, ValueError: a malformed image.
    """
    image = data["Data"]
    kind, columns, rows, pixels = image["ImageType"], image["Width"], image["Height"], image["Pixels"]
    if kind not in PIXEL_BYTES or pixels["endian"] not in BYTE_ORDERS:
        known = f"{' or '.join(PIXEL_BYTES)}, {', '.join(BYTE_ORDERS)}"
        raise UnreadableFile(f"{name}: found an image of {kind!r}, {pixels['endian']!r}, need {known}")
    bytes_needed = _whole(columns) * _whole(rows) * PIXEL_BYTES[kind]
    if bytes_needed > len(pixels["data"]):
        raise UnreadableFile(
            f"{name}: found {len(pixels['data'])} characters for {rows} x {columns} pixels of {PIXEL_BYTES[kind]} "
            f"bytes; the file is cut off: {ADVICE}"
        )
    raw = base64.b64decode(pixels["data"], validate=True)
    if len(raw) != bytes_needed:
        raise UnreadableFile(
            f"{name}: found {len(raw)} bytes of pixels, need {bytes_needed} for {rows} x {columns}; {ADVICE}"
        )
    values = np.frombuffer(raw, dtype=f"{BYTE_ORDERS[pixels['endian']]}u{PIXEL_BYTES[kind]}").reshape(rows, columns)
    size = _lengths(data["PixelSize"])
    if 0.0 in size:
        raise ValueError(f"a pixel of {size} mm")
    return _Image(kind, str(data["HandleZeroPixels"]), values, size, _lengths(data["Origin"]))


def _whole(number: Any) -> int:
    if not isinstance(number, int) or isinstance(number, bool) or number < 1:
        raise ValueError(f"{number!r} pixels")
    return number


def _lengths(place: Json) -> tuple[float, float, float]:
    lengths = (float(place["x"]), float(place["y"]), float(place["z"]))
    if max(abs(length) for length in lengths) > MOST_MM:
        raise ValueError(f"{max(lengths)!r} mm")
    return lengths


def _encoders(sensors: list[Json]) -> Iterator[NDArray[np.int64]]:
    """Every list of encoder counts in the sensors' data."""
    for sensor in sensors:
        for entry in sensor.get("MetaData", {}).get("data", {}).get("Content", []):
            if entry.get("Key") == "EncoderValue" and isinstance(entry.get("Value"), list):
                if not all(type(value) is int for value in entry["Value"]):
                    raise ValueError("an encoder count that is no whole number")
                yield np.array(entry["Value"], dtype=np.int64)
