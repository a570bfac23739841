"""What a file is that can't be read here: its right name helps more than a list of what can."""

import re

from truestand.core.errors import UnreadableFile

_KINDS = (
    (re.compile(rb"\s*ISO-10303-21", re.IGNORECASE), "a STEP model"),
    (re.compile(rb"\s*solid\b(?s:.*?)\bfacet\b", re.IGNORECASE), "an STL model"),
    (re.compile(rb"\s*ply\s"), "a PLY file"),
    (re.compile(rb"(#.*\n)*VERSION .*\nFIELDS "), "a PCD cloud"),
    (re.compile(rb"(ST)?C?N?4?n?OFF(\s|$)"), "an OFF mesh"),
    (re.compile(rb"([ \t\r]*((#|mtllib |o |g |s ).*)?\n)*[ \t]*v[nt]?[ \t]+[-+0-9.]"), "an OBJ model"),
    (re.compile(rb"# vtk DataFile"), "a VTK file"),
    (re.compile(rb"([ \t]*999\r?\n.*\n)*[ \t]*0\r?\n[ \t]*SECTION"), "a DXF drawing"),
    (re.compile(rb".{72}S      1"), "an IGES model"),
    (re.compile(rb"glTF"), "a glTF model"),
    (re.compile(rb"\x93NUMPY"), "a numpy array"),
    (re.compile(rb"MATLAB 5\.0 MAT-file"), "a MATLAB file"),
    (re.compile(rb"PK\x03\x04(?s:.*?)\.npy"), "an archive of numpy arrays"),
    (re.compile(rb"PK\x03\x04(?s:.*?)3D/3dmodel"), "a 3MF model"),
    (re.compile(rb"PK\x03\x04(?s:.*?)xl/workbook"), "an Excel workbook"),
    (re.compile(rb"PK\x03\x04(?s:.*?)\[Content_Types\]"), "an Office document"),
    (re.compile(rb"\xd0\xcf\x11\xe0"), "an old Office file"),
    (re.compile(rb"PK\x03\x04"), "a zip archive"),
    (re.compile(rb"\x1f\x8b"), "a gzip file"),
    (re.compile(rb"7z\xbc\xaf"), "a 7z archive"),
    (re.compile(rb"BZh[1-9]1AY|\xfd7zXZ\0|\x28\xb5\x2f\xfd"), "a compressed file"),
    (re.compile(rb"\xff\xfe|\xfe\xff"), "text in UTF-16"),
    (re.compile(rb"%PDF"), "a PDF"),
    (re.compile(rb"\x89PNG|\xff\xd8\xff|II\*\0|MM\0\*"), "a picture"),
    (re.compile(rb"ASTM-E57"), "an E57 cloud"),
    (re.compile(rb"LASF"), "a LAS cloud"),
    (re.compile(rb"\x89HDF"), "an HDF5 file"),
    (re.compile(rb"PAR1"), "a Parquet file"),
    (re.compile(rb"CDF[\x01\x02\x05]"), "a NetCDF file"),
    (re.compile(rb"SQLite format 3\0"), "an SQLite database"),
    (re.compile(rb"\s*<(!doctype )?html", re.IGNORECASE), "a web page"),
    (re.compile(rb"\s*<(\?xml|svg)"), "XML"),
    (re.compile(rb"\s*\{(?s:.{0,200}?)\"format\"\s*:\s*\"truestand\."), "a record of truestand"),
    (re.compile(rb"\s*(\{\s*\"|\[\s*[\[{])"), "JSON"),
    (re.compile(rb"\{\\rtf"), "an RTF document"),
)
"""By how they begin."""


def refuse_other_kind(head: bytes, name: str, need: str) -> None:
    """Refuse a file whose beginning shows that it is of another kind; ``need`` says what would do.

    Raises:
        UnreadableFile: with the kind's name.
    """
    for pattern, kind in _KINDS:
        if pattern.match(head):
            raise UnreadableFile(f"{name}: this is {kind}, need {need}")
