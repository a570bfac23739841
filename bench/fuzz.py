"""Every reader against damaged files: what comes back is a valid object or a TruestandError, whatever the bytes say.

The table of readers serves the test suite (tests/files/test_fuzz.py, hypothesis) and the coverage-guided fuzzer here.
That one needs atheris (pip install atheris; no dependency of the project):

    python bench/fuzz.py FORMAT [-max_total_time=60] [any other option of libFuzzer]

The files that it grew, and the one that broke a reader, stay in .benchmarks/fuzz/FORMAT.
"""

import json
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from exports import gocator, gocator_profiles, joescan, joescan_profile, packed, scancontrol, sick

TOKENS = (
    b"1e309", b"-1e309", b"nan", b"inf", b"-", b"", b"1,5", b"1.5", b"\0", b"\xef\xbb\xbf", b"2147483648", b"-1",
    b"9" * 400, b"9" * 5000, b"1_0", b"0x10", b"1e-400", b"1e308", b"true", b"null", b'"', b"{}", b"\r", b"\n", b"\r\n",
    b";", b"\t", b" ", b",", b"\xff", b"\x85", "²".encode(), b"[" * 3000,
)  # fmt: skip
"""What a damaged or foreign file holds in place of a number."""


@dataclass(frozen=True)
class Format:
    """A kind of file: its readers in one call that returns only what is valid, and whole files to start from."""

    read: Callable[[Path], None]
    whole: Callable[[], list[bytes]]


def read_or_refused(kind: str, path: Path) -> str | None:
    """The message of the typed refusal, None where the file was read; anything else is raised, warnings too."""
    from truestand.core.errors import TruestandError

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            FORMATS[kind].read(path)
        except TruestandError as refused:
            assert "\n" not in str(refused), str(refused)
            return str(refused)
    return None


def _scan(path: Path) -> None:
    from truestand.files.scans.read import recordings

    for read in recordings(path).values():
        _valid(read())


def _raw(path: Path) -> None:
    from truestand.files.scans.read import read_recording
    from truestand.files.scans.scancontrol_raw import RawLayout

    _valid(read_recording(path, layout=RawLayout("29xx-50", 16)))


def _valid(recording: Any) -> None:
    from truestand.files.scans.read import info

    shape = recording.x.shape
    matrices = [m for m in (recording.x, recording.z, recording.intensity) if m is not None]
    assert all(m.shape == shape and m.dtype == np.float64 and m.size and not np.isinf(m).any() for m in matrices)
    for name in ("y", "time", "angle", "encoder", "counter"):
        values = getattr(recording, name)
        assert values is None or (values.shape == shape[:1] and np.isfinite(values).all()), name
    assert recording.counter is None or recording.counter.dtype == np.int64
    json.dumps(info(recording), allow_nan=False)


def _points(path: Path) -> None:
    from truestand.files.shapes.points import read_points

    points = read_points(path).points
    assert points.shape[1:] == (3,)
    assert points.dtype == np.float64
    assert not np.isinf(points).any()


def _npy(array: NDArray[Any]) -> bytes:
    file = BytesIO()
    np.save(file, array)
    return file.getvalue()


def _ply(path: Path) -> None:
    from truestand.files.shapes.ply import ply_vertices
    from truestand.files.text import BYTE_ORDER_MARK

    vertices = ply_vertices(path.read_bytes().removeprefix(BYTE_ORDER_MARK), path.name)
    assert len({v.shape for v in vertices.values()}) == 1
    _points(path)


def _stand(path: Path) -> None:
    from truestand.files.recipes.recipes import read_simulation, read_stand, stand_from_recipe, stand_recipe

    stand = read_stand(path)
    back = stand_from_recipe(stand_recipe(stand))
    assert (back.table, back.counts_per_turn) == (stand.table, stand.counts_per_turn)
    assert isinstance(read_simulation(path), dict)


def _shaft(path: Path) -> None:
    from truestand.files.recipes.recipes import read_shaft, shaft_from_recipe, shaft_recipe

    artefact = read_shaft(path)
    assert shaft_from_recipe(shaft_recipe(artefact)) == artefact


def _calibration(path: Path) -> None:
    from truestand.files.records.calibration_record import calibration_record, read_calibration

    calibration = read_calibration(path)
    assert np.isfinite(calibration.table_from_sensor.matrix).all()
    for part in (calibration.residuals, calibration.scan, calibration.paper, *calibration.checks):
        for field in fields(part) if part is not None else ():
            if field.type in (int, float):
                assert isinstance(getattr(part, field.name), int | float | None), field.name
    json.dumps(calibration_record(calibration, "2026-11-21T12:00:00Z"), allow_nan=False)


def _native(path: Path) -> None:
    """A file that starts unlike HDF5 is a list of edits to a whole one: checksums let few damaged bytes through."""
    data = path.read_bytes()
    if not data.startswith(b"\x89HDF"):
        path.write_bytes(native())
        edit_native(path, list(data[:8]))
    _scan(path)


@cache
def native() -> bytes:
    """A small native scan with every column."""
    from truestand.core.scan import Recording
    from truestand.core.stand import Sensor, Stand, Table
    from truestand.files.scans.native import write_native

    x, z = np.array([[-1.5, 0.25], [-1.5, 0.5], [-1.25, 0.5]]), np.array([[95.5, 96.25], [95.25, np.nan], [95.0, 96.5]])
    n = np.arange(3.0)
    columns: dict[str, Any] = {"time": n / 10, "angle": n / 5, "encoder": n, "y": n * 2, "intensity": x / 3}
    stand = Stand(Table(0.3, "cw"), (Sensor("front", 200.0),), counts_per_turn=36000)
    recording = Recording(x, z, "xyz blocks", "0" * 64, counter=np.arange(3), stand=stand, **columns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scan.h5"
        write_native(recording, path, stand)
        return path.read_bytes()


ATTRIBUTES = (
    ("", "format"),
    ("", "version"),
    ("", "stand"),
    ("z", "scale_factor"),
    ("z", "add_offset"),
    ("x", "sha256"),
)
DATASETS = ("x", "z", "time", "counter", "intensity", "encoder")
VALUES: tuple[Any, ...] = (
    0, 1, -1, 2.5, float("nan"), float("inf"), 1e-320, 1e308, 2**63 - 1, "", "x", "[]", "{", b"\xff", [1], [1, 2],
    [[1.0]], "9" * 5000, '{"sensor": [{}]}', '{"sensor": [{}], "table": {"speed_rad_per_s": 1e309}}', "[" * 9000, True,
    np.complex128(1), np.void(b"ab"),
)  # fmt: skip
CONTENTS: tuple[Any, ...] = (
    *VALUES, np.zeros((3, 2)), np.full((3, 2), np.inf), np.full((3, 2), 1e308), np.full(3, np.nan), np.full(3, 1e308),
    np.array([1e308, -1e308, 1e308]), np.arange(3, dtype="<u8") + 2**63, np.arange(3, dtype=">f4"), np.zeros((3, 0)),
    np.zeros(3, dtype="c16"), np.zeros((3, 2), dtype="c16"), np.zeros((3, 2), dtype=[("a", "f4")]),
    np.zeros((3, 2, 1)), np.array([b"ab", b"c", b"d"]), np.zeros(3, dtype=bool), np.zeros((3, 2), dtype="i8"),
)  # fmt: skip


def edit_native(path: Path, edits: list[int]) -> None:
    """Change a native file as pairs of numbers say: which attribute or dataset, and what stands there instead."""
    import h5py

    with h5py.File(path, "r+") as file:
        for where, what in zip(edits[::2], edits[1::2], strict=False):
            if where % 2:
                _edit_attribute(file, *ATTRIBUTES[where // 2 % len(ATTRIBUTES)], what)
            else:
                _edit_dataset(file, DATASETS[where // 2 % len(DATASETS)], what)


def _edit_attribute(file: Any, place: str, name: str, what: int) -> None:
    if place not in file and place:
        return
    attrs = file[place or "/"].attrs
    attrs.pop(name, None)
    if what:
        attrs[name] = VALUES[what % len(VALUES)]


def _edit_dataset(file: Any, name: str, what: int) -> None:
    """Leave a dataset out, make it a group or one of a huge shape, or give it another content with a right hash."""
    import hashlib

    if name not in file:
        return
    del file[name]
    if what == 1:
        file.create_group(name)
    elif what == 2:
        file.create_dataset(name, shape=(2**31 - 1, 1), dtype="i2", chunks=(2**20, 1)).attrs["sha256"] = ""
    elif what == 3:
        file.create_dataset(name, data=h5py_empty()).attrs["sha256"] = ""
    elif what:
        dataset = file.create_dataset(name, data=CONTENTS[what % len(CONTENTS)])
        dataset.attrs["sha256"] = hashlib.sha256(np.asarray(dataset[()]).tobytes()).hexdigest()


def h5py_empty() -> Any:
    import h5py

    return h5py.Empty("f8")


def _native_files() -> list[bytes]:
    return [native(), b"\x00\x00", *(bytes([where, what]) for where in range(12) for what in range(0, 40, 3))]


def _starters(name: str) -> list[bytes]:
    from importlib.resources import files

    return [files("truestand.files").joinpath("starters", name).read_bytes()]


def calibration() -> bytes:
    """A calibration record with every key that the reader looks at."""
    matrix = [[1.0, 0.0, 0.0, 70.0], [0.0, 1.0, 0.0, 0.25], [0.0, 0.0, 1.0, 5.0], [0.0, 0.0, 0.0, 1.0]]
    record = {
        "format": "truestand.calibration", "version": 1, "status": "untrusted", "reasons": ["too few turns"],
        "method": "stand", "created": "2026-11-21T12:00:00Z", "valid_until": None, "software": "truestand",
        "scan": {"sha256": "0" * 64, "profiles": 9, "points": 4, "revolutions": 1.5, "seen": 0.5},
        "stand": {"table": {"speed_rad_per_s": 0.3}, "sensor": [{"name": "front", "profile_rate_hz": 200.0}]},
        "artefact": {"cylinder": [{"name": "base", "diameter_mm": 25.0, "from_mm": -60.0, "to_mm": 0.0}]},
        "table": {"direction": "ccw", "angle_source": "index", "angle_zero": "home", "rad_per_profile": 0.0015},
        "sensor": {"name": "front", "table_from_sensor": matrix},
        "shaft": {"shaft_from_rotor": matrix},
        "residuals": {"rms_um": 5.0, "p90_um": 9.0, "points": 100, "rejected": 3},
        "harmonics": [{"surface": "base", "upr": 2, "amplitude_um": 1.5, "phase_deg": 20.0}],
        "static_profiles": [{"surface": "base", "height_mm": [1.0, 2.0], "deviation_um": [0.5, None]}],
        "uncertainty": {"eccentricity_um": {"U": 1.0, "k": 2.0, "U_monte_carlo": None, "contributions": [
            {"name": "noise", "U": 0.5, "value": 0.1, "distribution": "normal", "sensitivity": 2.0, "dof": None}]}},
        "covariance": {"names": ["ex"], "matrix": [[1e-6]], "repeatability": [[1e-7]]},
        "not_identifiable": ["tilt_mrad"],
        "checks": [{"name": "turns", "value": 1.5, "limit": 1.0, "ok": True, "advice": ""}],
        "paper": {"bin": 3, "bin_amplitude_um": 1.0, "fit_amplitude_um": 1.0, "phase_error_pi": 0.1,
                  "arcsine_shift_pi": 0.1},
    }  # fmt: skip
    return json.dumps(record, indent=2).encode()


PLY = b"ply\nformat %s 1.0\nelement vertex 2\nproperty float x\nproperty double y\nproperty short z\nend_header\n"
PCD = b"VERSION 0.7\nFIELDS x y z n\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nPOINTS 2\nDATA %s\n"
FORMATS = {
    "xyz": Format(_scan, lambda: [
        b"1.5,2.5\n1.5,2.25\n\n0,0\n1,1\n\n90.5,91.5\nnan,93.5\n",
        b"\xef\xbb\xbf1,5;2,5;\r\n1,5;;\r\n\r\n0;0;\r\n1;1;\r\n\r\n90,5;91,5;\r\n90,5;;\r\n",
        b"1.5 2.5\r1.5 2.5\r\r0 0\r1 1\r\r90.5 91.5\r90.5 93.5",
    ]),
    "long": Format(_scan, lambda: [
        b"profile,point,counter,time_ms,angle_deg,encoder,x_mm,z_mm,intensity\n"
        b"0,0,17,0,350,100,1.5,90,200\n0,1,17,0,350,100,2.5,91,\n2,0,19,5,10,200,1.5,92,150\n",
        b"profile;x_um;z_m\r\n0;1500,5;0,09\r\n1;1500,5;0,09\r\n",
        b"profile\tpoint\tx_mm\tz_mm\r0\t1\t1.5\t90\r",
    ]),
    "native": Format(_native, _native_files),
    "gocator": Format(_scan, lambda: [gocator(), gocator_profiles(), gocator_profiles(raw=True)]),
    "joescan": Format(_scan, lambda: [joescan(), packed(joescan(1)), joescan_profile([(1, 2, 3)], encoders=())]),
    "sick": Format(_scan, lambda: [sick(), sick(order="little")]),
    "raw": Format(_raw, lambda: [scancontrol()]),
    "points": Format(_points, lambda: [
        b"# c\nx;y;z\n1,5;-2;3\n4;5;0,006\n", b"1.5 -2 3 9\r\n4 5 6e-3 9\r\n", b"1.5,-2.0,3.0\r4.0,5.0,nan\r",
    ]),
    "ds": Format(_points, lambda: [b"2\n1.5 -2 3\n4 5 6e-3\n"]),
    "ply": Format(_ply, lambda: [
        PLY % b"ascii" + b"1.5 -2 3\n4 5 6\n",
        PLY % b"binary_little_endian" + b"\x00\x00\xc0\x3f" * 7,
        PLY % b"binary_big_endian" + b"\x3f\xc0\x00\x00" * 7,
    ]),
    "pcd": Format(_points, lambda: [
        PCD % b"ascii" + b"1.5 -2 3 7\n4 5 6e-3 8\n", PCD % b"binary" + b"\x00\x00\xc0\x3f" * 8,
    ]),
    "npy": Format(_points, lambda: [
        _npy(np.arange(12.0).reshape(4, 3)), _npy(np.zeros(2, [("z", "<f4"), ("x", ">i2"), ("y", "<f8")])),
    ]),
    "stl": Format(_points, lambda: [
        b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 1.5 -2 3\nvertex 4 5 6e-3\nvertex 4 5 7\nendloop\n"
        b"endfacet\nendsolid a\n",
        b"\0" * 80 + b"\1\0\0\0" + b"\x3f" * 50,
    ]),
    "stand": Format(_stand, lambda: _starters("stand.toml")),
    "shaft": Format(_shaft, lambda: _starters("shaft.toml") + _starters("gear.toml")),
    "calibration": Format(_calibration, lambda: [calibration()]),
}  # fmt: skip


def main() -> None:
    kinds = ", ".join(FORMATS)
    if len(sys.argv) < 2 or sys.argv[1] not in FORMATS:
        sys.exit(f"give a format, one of {kinds}: python bench/fuzz.py FORMAT [-max_total_time=60]")
    try:
        import atheris
    except ImportError:
        sys.exit("the fuzzer needs atheris, which is not installed; install it with: pip install atheris")
    with atheris.instrument_imports(include=["truestand", "tomllib", "json"]):
        import truestand.files.records.calibration_record
        import truestand.files.scans.read
        import truestand.files.shapes.points  # noqa: F401
    kind = sys.argv.pop(1)
    folder = Path(".benchmarks") / "fuzz" / kind
    corpus, path, words = folder / "corpus", folder / "file", folder / "words"
    corpus.mkdir(parents=True, exist_ok=True)
    for i, data in enumerate(FORMATS[kind].whole()):
        (corpus / f"whole{i}").write_bytes(data)
    words.write_text("".join('"' + "".join(f"\\x{b:02x}" for b in t) + '"\n' for t in TOKENS if 0 < len(t) < 50))

    def one(data: bytes) -> None:
        path.write_bytes(data)
        read_or_refused(kind, path)

    atheris.Setup([*sys.argv, f"-dict={words}", f"-artifact_prefix={folder}/", str(corpus)], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
