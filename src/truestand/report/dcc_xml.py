"""Elements of a Digital Calibration Certificate (DCC 3.3) and of the SI's digital notation (D-SI 2.2).

Numbers keep all the digits of the record; ``significantDigit`` says up to where they mean something.
"""

import base64
import re
from collections.abc import Sequence
from math import floor, isfinite, log10
from typing import Any

from lxml import etree

from truestand.core.errors import UnreadableFile

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
XSI = "http://www.w3.org/2001/XMLSchema-instance"
SPACES = {"dcc": DCC, "si": SI, "xsi": XSI}
ROOT = "dcc:digitalCalibrationCertificate"
VERSION = "3.3.0"
SCHEMA = f"{DCC} https://ptb.de/dcc/v{VERSION}/dcc.xsd"
LANGUAGE = "en"
NOT_STATED = "not stated"
PROBABILITY = "0.9545"
"""What lies within k = 2 of a normal distribution, and what the Monte Carlo's half-width holds."""
UNITS = {
    "deg": r"\degree", "um": r"\micro\metre", "mm": r"\milli\metre", "mrad": r"\milli\radian", "C": r"\degreecelsius",
    "1": r"\one",
}  # fmt: skip
"""D-SI's name by the unit at the end of a record's key."""
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

Node = Any
"""lxml's elements carry no types."""


def node(tag: str, *inside: Node | str | None, **attributes: str) -> Node:
    """An element ``dcc:…`` or ``si:…`` with what is inside it; None is left out."""
    space, name = tag.split(":")
    made = etree.Element(etree.QName(SPACES[space], name), attributes, nsmap=SPACES if tag == ROOT else None)
    for part in inside:
        if isinstance(part, str):
            made.text = _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", part)
        elif part is not None:
            made.append(part)
    return made


def plain(tag: str, text: str | None) -> Node | None:
    """An element with a text that may not be empty; None where nothing is stated."""
    words = " ".join((text or "").split())
    return node(tag, words) if words else None


def text(tag: str, *paragraphs: str, **attributes: str) -> Node:
    """An element with text in the certificate's language."""
    return node(tag, *[node("dcc:content", p, lang=LANGUAGE) for p in paragraphs], **attributes)


def name(words: str) -> Node:
    """``dcc:name``."""
    return text("dcc:name", words)


def identification(issuer: str, value: str | None, what: str, kind: str | None = None) -> Node:
    """A number by which somebody knows a thing; ``not stated`` where it is not known."""
    attributes = {} if kind is None else {"refType": kind}
    stated = plain("dcc:value", value)
    return node(
        "dcc:identification", node("dcc:issuer", issuer),
        node("dcc:value", NOT_STATED) if stated is None else stated, name(what), **attributes,
    )  # fmt: skip


def real(value: float, unit: str, U: float | None = None, k: float = 2.0, normal: bool = True) -> Node:
    """``si:real``: value, unit, and U with its factor and probability where there is one."""
    inside = [node("si:value", digits(value)), node("si:unit", UNITS[unit])]
    if U is not None:
        expanded = node(
            "si:expandedMU", node("si:valueExpandedMU", digits(U)), node("si:coverageFactor", digits(k)),
            node("si:coverageProbability", PROBABILITY), node("si:distribution", "normal") if normal else None,
        )  # fmt: skip
        inside += [node("si:significantDigit", str(floor(log10(U)) - 1))] if U > 0 else []
        inside.append(node("si:measurementUncertaintyUnivariate", expanded))
    return node("si:real", *inside)


def real_list(values: Sequence[float], unit: str) -> Node:
    """``si:realListXMLList`` of values in one unit."""
    return node(
        "si:realListXMLList", node("si:valueXMLList", " ".join(map(digits, values))),
        node("si:unitXMLList", UNITS[unit]),
    )  # fmt: skip


def quantity(what: str, value: Node, meaning: str | None = None, **attributes: str) -> Node:
    """``dcc:quantity``."""
    described = None if meaning is None else text("dcc:description", meaning)
    return node("dcc:quantity", name(what), described, value, **attributes)


def embedded(file_name: str, mime: str, content: bytes, meaning: str) -> Node:
    """``dcc:byteData``: a file inside the certificate."""
    return node(
        "dcc:byteData", name(file_name), text("dcc:description", meaning), plain("dcc:fileName", file_name),
        node("dcc:mimeType", mime), node("dcc:dataBase64", base64.b64encode(content).decode("ascii")),
    )  # fmt: skip


def digits(value: Any) -> str:
    """A number with all the digits of the record.

    Raises:
        UnreadableFile: no finite number.
    """
    if not isinstance(value, int | float) or isinstance(value, bool) or not isfinite(value):
        raise UnreadableFile(f"found {str(value)[:40]!r} for a number of the calibration; give a record by truestand")
    return repr(value)


def printed(root: Node) -> bytes:
    """The document as a file's content, indented."""
    etree.indent(root)
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"
