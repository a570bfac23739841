"""CAD models as triangles in mm: STL (binary and text), PLY, and STEP with an extra, told apart by their content."""

import re
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import MissingExtra, UnreadableFile
from truestand.parts.drawings import Mesh

Unit = Literal["mm", "inch"]

MM_PER_UNIT: dict[Unit, float] = {"mm": 1.0, "inch": 25.4}
STL_HEADER, STL_RECORD = 84, 50
STEP_START = b"ISO-10303-21"
CHORD_MM, TURN_RAD = 0.0005, 0.05
"""By which the triangles of a STEP model may depart from its surfaces."""
MM_PER_M = 1000.0
"""The converter counts in metres."""
MOST_MM = 1e5
"""Coordinates beyond are no part of this stand's."""
LEAST_FACE_BYTES, LEAST_VERTEX_BYTES = 2, 3
"""Of an entry of a PLY."""
_NUMBER = rb"\s+([^\s]+)"
_VERTEX = re.compile(rb"\bvertex" + _NUMBER * 3)
_PLY_COUNT = re.compile(rb"^element\s+(vertex|face)\s+(\S+)\s*$", re.MULTILINE)
_TRIMESH_ERRORS = (ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, EOFError, MemoryError)
"""What trimesh raises on a file that isn't what it seems."""


def read_mesh(path: Path | str, unit: Unit = "mm") -> Mesh:
    """The triangles of a model, vertices in mm; a closed model that was turned inside out is turned back.

    A STEP model says its own unit; its surfaces become triangles within CHORD_MM of them.

    Raises:
        UnreadableFile: missing, empty, another format, cut off, numbers that are none, no triangles, or triangles of a
            closed model that face both ways.
        MissingExtra: STEP without its extra.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as wrong:
        raise UnreadableFile(f"{path}: can't be read ({wrong.strerror or wrong}); check the path") from wrong
    if not data.strip():
        raise UnreadableFile(f"{path}: the file is empty; need a model as STL, PLY or STEP")
    vertices, faces = _triangles(data, path.name)
    if not data.lstrip()[:12].upper().startswith(STEP_START):
        vertices = vertices * MM_PER_UNIT[unit]
    _refuse_invalid(vertices, faces, path.name)
    return _merged(vertices, faces, path.name)


def _triangles(data: bytes, name: str) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (V, 3) in the file's unit (STEP: mm) and faces (F, 3)."""
    start = data.lstrip()[:64]
    if start.upper().startswith(STEP_START):
        return _step(data, name)
    if re.match(rb"ply\s", start):
        return _ply(data, name)
    if is_stl(data):
        corners = stl_vertices(data, name)
        return corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    count = _stl_count(data)
    if name.lower().endswith(".stl") and count >= 0:
        held = (len(data) - STL_HEADER) / STL_RECORD
        raise UnreadableFile(
            f"{name}: the STL promises {count} triangles and holds {held:.6g}; copy or export it again"
        )
    raise UnreadableFile(f"{name}: found neither STL, PLY nor STEP; export the model as one of these")


def is_stl(data: bytes) -> bool:
    """Whether a file is an STL, binary and whole, or text."""
    return _is_binary_stl(data) or (data.lstrip()[:5].lower() == b"solid" and b"facet" in data)


def stl_vertices(data: bytes, name: str) -> Array:
    """The corners (3 triangles, 3) of an STL, in its unit.

    Raises:
        UnreadableFile: cut off, no triangles, or no numbers.
    """
    if not _is_binary_stl(data):
        return _text_stl(data, name)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN, and no warning
        return np.frombuffer(data, record, -1, STL_HEADER)["corners"].astype(np.float64).reshape(-1, 3)


def _is_binary_stl(data: bytes) -> bool:
    count = _stl_count(data)
    return count >= 0 and len(data) == STL_HEADER + STL_RECORD * count


def _stl_count(data: bytes) -> int:
    """Triangles that a binary STL promises; -1 where the file is too short for one."""
    return int.from_bytes(data[80:STL_HEADER], "little") if len(data) >= STL_HEADER else -1


def _text_stl(data: bytes, name: str) -> Array:
    found = _VERTEX.findall(data)
    ends = len(re.findall(rb"\bendfacet\b", data))
    if b"endsolid" not in data or len(found) != 3 * ends or len(re.findall(rb"\bfacet\b", data)) != ends:
        raise UnreadableFile(f"{name}: the STL is cut off or holds facets that are no triangles; export it again")
    try:
        numbers = [float(word) for row in found for word in row]
    except ValueError as wrong:
        raise UnreadableFile(f"{name}: found {str(wrong).rsplit(':', 1)[-1].strip()} for a coordinate") from wrong
    return np.array(numbers).reshape(-1, 3)


def _ply(data: bytes, name: str) -> tuple[Array, NDArray[np.int64]]:
    import trimesh

    head, end, body = data.partition(b"end_header")
    counts = {str(kind, "ascii"): count for kind, count in _PLY_COUNT.findall(head)}
    if not end or set(counts) != {"vertex", "face"} or not all(c.isdigit() for c in counts.values()):
        raise UnreadableFile(f"{name}: the PLY's header is cut off or names no vertices and faces; export a mesh")
    least = {"vertex": LEAST_VERTEX_BYTES, "face": LEAST_FACE_BYTES}
    for kind, count in counts.items():
        if int(count) * least[kind] > len(body):
            raise UnreadableFile(f"{name}: the PLY promises {int(count):.6g} {kind} entries and is cut off before")
    try:
        loaded: Any = trimesh.load(BytesIO(data), file_type="ply", process=False)
        vertices, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces, np.int64)
    except _TRIMESH_ERRORS as wrong:
        raise UnreadableFile(f"{name}: the PLY can't be read ({wrong}); export it again") from wrong
    if len(vertices) != int(counts["vertex"]) or len(faces) < int(counts["face"]):
        raise UnreadableFile(
            f"{name}: the PLY promises {int(counts['face'])} faces and holds {len(faces)}; copy it again"
        )
    return vertices, faces


def _step(data: bytes, name: str) -> tuple[Array, NDArray[np.int64]]:
    if find_spec("cascadio") is None:
        raise MissingExtra("STEP needs an extra package; install it with: pip install 'truestand[step]'")
    import trimesh

    try:
        loaded: Any = trimesh.load(
            BytesIO(data),
            file_type="step",
            tol_linear=CHORD_MM,
            tol_angular=TURN_RAD,
            tol_relative=False,
            process=False,
        )
        whole = loaded.to_mesh() if hasattr(loaded, "to_mesh") else loaded
        return np.asarray(whole.vertices, np.float64) * MM_PER_M, np.asarray(whole.faces, np.int64)
    except (*_TRIMESH_ERRORS, OSError, RuntimeError) as wrong:
        raise UnreadableFile(f"{name}: the STEP model can't be read ({wrong}); export it again") from wrong


def _refuse_invalid(vertices: Array, faces: NDArray[np.int64], name: str) -> None:
    if not len(faces):
        raise UnreadableFile(f"{name}: holds no triangles; export the model as a mesh")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise UnreadableFile(f"{name}: a triangle names a vertex that isn't there; export it again")
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if wrong.size:
        raise UnreadableFile(f"{name}: found no number in vertex {wrong[0] + 1}; export it again")
    if np.abs(vertices).max() > MOST_MM:
        raise UnreadableFile(
            f"{name}: found a vertex {np.abs(vertices).max():.3g} mm from the origin, need at most {MOST_MM:g}; "
            'check unit = "mm" or "inch"'
        )


def _merged(vertices: Array, faces: NDArray[np.int64], name: str) -> Mesh:
    """The model with each vertex once, facing outwards where it is closed."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    if not len(mesh.faces):
        raise UnreadableFile(f"{name}: holds no triangle with an area; export it again")
    found = np.asarray(mesh.faces, np.int64)
    if mesh.is_watertight:
        if not mesh.is_winding_consistent:
            raise UnreadableFile(f"{name}: the triangles face both ways; let your CAD repair the model's normals")
        if mesh.volume < 0:
            found = found[:, ::-1].copy()
    return Mesh(np.asarray(mesh.vertices, np.float64), found)
