"""Tables of points in PCD, NPY and STL: names and columns, whatever they hold."""

import re
import warnings
from io import BytesIO
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import UnreadableFile
from truestand.files.number_text import read_table, refuse_cut_table
from truestand.files.shapes.meshes import is_stl, stl_vertices
from truestand.files.shapes.point_columns import MOST_COLUMNS, numbered
from truestand.files.text import Dialect

PointTable = dict[str, NDArray[Any]]
"""Columns (n,) by name; named by their numbers from 1 where the file has no names."""

NPY = b"\x93NUMPY"
NPY_ERRORS = (ValueError, OSError, EOFError, SyntaxError, TypeError, MemoryError, OverflowError, TokenError)
"""What numpy raises on a file that isn't what it seems."""
MOST_HEADER_BYTES = 65_536
_PCD = re.compile(rb"(#[^\n]*\n|\s)*VERSION ")
_PCD_DATA = re.compile(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE)
_PCD_TYPES = {"I": "i", "U": "u", "F": "f"}


def point_table(data: bytes, name: str) -> PointTable | None:
    """The table of a PCD, NPY or STL; None: the file is none of these.

    Raises:
        UnreadableFile: cut off, compressed, or no table.
    """
    if data.startswith(NPY):
        return _npy(data, name)
    if _PCD.match(data):
        return _pcd(data, name)
    if is_stl(data):
        return dict(zip("xyz", np.unique(stl_vertices(data, name), axis=0).T, strict=True))
    return None


def _npy(data: bytes, name: str) -> PointTable:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of how old the file is
            table = np.load(BytesIO(data), allow_pickle=False)
    except NPY_ERRORS as wrong:
        raise UnreadableFile(f"{name}: the numpy array can't be read ({wrong}); save it again") from wrong
    if table.dtype.names:
        numbers = [f for f in table.dtype.names if table.dtype[f].kind in "fiu"]  # one a point
        return {field: table[field].reshape(-1) for field in numbers}
    if table.ndim != 2 or table.dtype.kind not in "fiu":
        raise UnreadableFile(
            f"{name}: found an array of {table.dtype} with shape {table.shape}, need numbers (points, 3)"
        )
    points, columns = table.shape
    if points in (2, 3) and columns > MOST_COLUMNS:  # x, y and z are its rows
        table = table.T
    elif 3 <= points <= columns or points < 3 < columns:
        raise UnreadableFile(
            f"{name}: found an array of shape {table.shape}, whose points may be its rows or its columns, need fewer "
            "columns than rows; save it as (points, 3)"
        )
    return dict(zip(numbered(table.shape[1]), table.T, strict=True))


def _pcd(data: bytes, name: str) -> PointTable:
    """Point Cloud Library, file format 0.7."""
    end = _PCD_DATA.search(data, 0, MOST_HEADER_BYTES)
    if end is None:
        raise UnreadableFile(f"{name}: the PCD's header is cut off; copy the file again")
    lines = data[: end.start()].decode("ascii", "replace").splitlines()
    header = {words[0]: words[1:] for line in lines if (words := line.split()) and not line.startswith("#")}
    try:
        fields, points = [f.lower() for f in header["FIELDS"]], int(header["POINTS"][0])
        counts = [int(c) for c in header.get("COUNT", ["1"] * len(fields))]
        kinds = [f"{_PCD_TYPES[t]}{int(s)}" for t, s in zip(header["TYPE"], header["SIZE"], strict=True)]
        record = np.dtype([(f, k, (c,)) for f, k, c in zip(fields, kinds, counts, strict=True)])
        if points < 0 or min(counts) < 1:
            raise ValueError(f"{points} points, counts {counts}")
    except (KeyError, ValueError, IndexError, TypeError) as wrong:
        raise UnreadableFile(f"{name}: the PCD's header can't be read ({wrong}); export it again") from wrong
    kind, body = end[1], data[end.end() :]
    if kind == b"binary":
        if len(body) < points * record.itemsize:
            raise UnreadableFile(f"{name}: the PCD promises {points} points and is cut off before; copy it again")
        table = np.frombuffer(body, record, points)
        return {field: table[field][:, 0] for field in fields}
    if kind != b"ascii":
        raise UnreadableFile(
            f"{name}: found DATA {kind.decode()}, need ascii or binary; convert it (pcl_convert_pcd_ascii_binary)"
        )
    rows = [row for row in body.split(b"\n") if row.strip()]
    first_line = data[: end.end()].count(b"\n") + 1
    if len(rows) != points:
        raise UnreadableFile(f"{name}: the PCD promises {points} points and holds {len(rows)}; copy it again")
    values = read_table(rows, Dialect(b" ", b"."), name, first_line)
    if values.shape[1] != sum(counts):
        raise UnreadableFile(f"{name}: found {values.shape[1]} numbers a line, need {sum(counts)} for the fields")
    if not data.endswith(b"\n"):
        refuse_cut_table(rows, b" ", name, first_line + len(rows) - 1)
    starts = np.cumsum([0, *counts[:-1]])
    return {field: values[:, at] for field, at in zip(fields, starts, strict=True)}
