"""Small files as other sensors write them, for the tests of the readers and the fuzzer."""

import base64
import gzip
import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np


def joescan_profile(
    points: Sequence[tuple[int, int, int]] = (),
    *,
    head: int = 0,
    camera: int = 0,
    laser: int = 0,
    encoders: Sequence[int] = (-700,),
    sequence: int = 0,
    nanoseconds: int = 1_571_754_885_552,
) -> bytes:
    """One record of a JoeScan recording."""
    return (
        struct.pack(f"<iiIHi{len(encoders)}q", 0x010203, 0, laser, 200, len(encoders), *encoders)
        + struct.pack("<IQIIii", sequence, nanoseconds, head, camera, 0, len(points))
        + b"".join(struct.pack("<hhB", *point) for point in points)
    )


def joescan(cameras: int = 2) -> bytes:
    """Three profiles of each camera of a head, unpacked."""
    return b"".join(
        joescan_profile([(i, 10 * i - camera, 9)] * i, camera=camera, encoders=(5 * i,), sequence=7 + i)
        for i in range(1, 4)
        for camera in range(cameras)
    )


def sick(raw: Any = ((0, 1, 2), (9000, 9001, 65535)), *, order: str = "big", **changes: Any) -> bytes:
    """A SICK height map; ``changes`` replace what stands in the image's data."""
    counts = np.array(raw, dtype=">u2" if order == "big" else "<u2")
    rows, columns = counts.shape

    def image(kind: str, zeros: str, values: Any, z: float) -> dict[str, Any]:
        pixels = {
            "numOfElems": rows * columns, "elemSz": values.itemsize, "endian": order if kind == "uint16" else "neutral",
            "elemTypes": [kind], "data": base64.b64encode(values.tobytes()).decode(),
        }  # fmt: skip
        return {"class": "Image", "data": {
            "PixelSize": {"x": 0.5, "y": 0.25, "z": z}, "Origin": {"x": -1.5, "y": 2, "z": 10},
            "HandleZeroPixels": zeros,
            "Data": {"ImageType": kind, "Width": columns, "Height": rows, "Pixels": pixels},
        }}  # fmt: skip

    height = image("uint16", "MissingData", counts, 0.125)
    height["data"] |= {key: value for key, value in changes.items() if key in height["data"]}
    height["data"]["Data"] |= {key: value for key, value in changes.items() if key in height["data"]["Data"]}
    bright = image("uint8", "Default", np.full((rows, columns), 7, dtype="u1"), 1)
    content = [{"Key": "EncoderValue", "Type": "int", "IsVector": True, "Value": [100 + 5 * i for i in range(rows)]}]
    sensor = {"class": "SensorData", "data": {"MetaData": {"class": "Container", "data": {"Content": content}}}}
    return json.dumps([height, bright, sensor]).encode()


GOCATOR = """Info
CSV Version,Sensor Count,Trigger Mode
2,1,0
End

DeviceInfo
ID,Model
40959,313109A
End

RecordingFilter
Condition Combination Type
Any

Type,Enabled,Result
Any Measurement,No,Pass
End

"""
STAMP = "Frame,Source,Time,Encoder,Z Encoder,Inputs"


def gocator_surface(frame: int = 1, source: int = 0) -> str:
    """A frame of a surface of two profiles of three points, two of them not seen."""
    return (
        f"{STAMP},Row Count,Column Count,X Offset,Y Offset,Z Offset\n"
        f"{frame},{source},544820424776,0,0,0,2,3,-1.50000,-2.00000,1.69400\n"
        "Y\\X,-1.50000,-1.20000,-0.90000\n"
        "-2.00000,,27.22400,\n"
        "-1.70000,27.11000,26.97500,26.84900\n"
    )


def gocator(*surfaces: str) -> bytes:
    """A Gocator export of surfaces."""
    return (GOCATOR + "Part\n" + "".join(surfaces or (gocator_surface(),)) + "End\n\n").encode()


def gocator_profiles(raw: bool = False) -> bytes:
    """A Gocator export of two frames of profiles, of two sources; not resampled where ``raw``."""
    lines = [
        GOCATOR + ("RawProfile" if raw else "Profile"),
        "Frame Count,Column Count,X Offset,Y Offset,Z Offset",
        "2,3,-1.5,0,0",
        f"{STAMP},Exposure,Y,Axis," + ("0,1,2" if raw else "-1.5,-1.2,-0.9"),
    ]
    for frame in (4, 6):
        for source in (0, 1):
            stamp = f"{frame},{source},5448{frame},{100 * frame},0,0,1000.0,0.25"
            lines += [f"{stamp},X,-1.5,,-0.9"] * raw
            lines += [f"{stamp},Z,27.5,,2{frame}.25", f"{stamp},I,200,,10{source}"]
    return ("\n".join(lines) + "\nEnd\n").encode()


def scancontrol_profile(
    i: int, points: int, *, z: Sequence[int] | None = None, start: float = 0.0, encoder: int | None = None
) -> bytes:
    """Profile i of a raw dump at 200 profiles a second, 2 ms of exposure."""
    at = start + i / 200

    def stamp(seconds: float) -> int:
        ticks = round(seconds * 24.576e6) % (128 * 24_576_000)
        cycles, offset = divmod(ticks, 3072)
        return cycles // 8000 << 25 | cycles % 8000 << 12 | offset

    z = [32768 + i % 1000] * points if z is None else z
    x = [32768 + 10 * (k - points // 2) for k in range(points)]
    count = 2 * (40 * i if encoder is None else encoder) % 65536
    return (
        struct.pack(f"<{2 * points}H", *z, *x)
        + bytes(2 * points - 16)
        + struct.pack(">IIHHI", 0xC0000000 | i % 2**24, stamp(at), count, 0, stamp(at + 0.002))
    )


def scancontrol(profiles: int = 4, points: int = 16, first: int = 0, **given: Any) -> bytes:
    """A raw dump."""
    return b"".join(scancontrol_profile(first + i, points, **given) for i in range(profiles))


def packed(data: bytes) -> bytes:
    """As JoeScan's software stores it."""
    return gzip.compress(data, mtime=0)
