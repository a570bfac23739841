"""The camera's own list of features (GenICam), read from the camera: get, set and execute by name.

EMVA's reference implementation (the ``genicam`` wheel) does the work; we lend it the camera's memory.
"""

import difflib
import io
import re
import zipfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from truestand.core.errors import DeviceError, MissingExtra
from truestand.devices.gige.control import Control
from truestand.devices.wire.gvcp import Register

MOST_XML = 16 << 20
"""Bytes of a description; real ones have 0.02 to 2 MB."""
Value = int | float | str | bool
T = TypeVar("T")


class Nodes:
    """The features of the camera behind ``control``."""

    def __init__(self, control: Control) -> None:
        """Reads and understands the camera's description.

        Raises:
            MissingExtra: no ``genicam`` wheel.
            DeviceLost: no answer.
            DeviceError: no description, or none that can be understood.
        """
        self._worker = ThreadPoolExecutor(1, f"features {control.name}")
        genapi = self._apart(_genapi)
        self._name = control.name
        self._wrong: type[Exception] = genapi.GenericException
        self._map = genapi.NodeMap()
        xml = description(control)
        try:
            self._apart(lambda: self._map.load_xml_from_string(xml))
            self._port = _port(genapi, control)
            self._apart(lambda: self._map.connect(self._port, "Device"))
        except self._wrong as wrong:
            raise DeviceError(f"{self._name}: its GenICam description can't be understood ({_plain(wrong)})") from wrong

    def names(self) -> list[str]:
        """All features and what they are made of."""
        return sorted(str(node.node.name) for node in self._map.nodes)

    def has(self, name: str) -> bool:
        """Whether there is such a feature."""
        return bool(self._map.has_node([name]))

    def get(self, name: str) -> Value:
        """The value of feature ``name``; an enumeration gives the name of its entry.

        Raises:
            DeviceLost: no answer.
            DeviceError: no such feature, or it can't be read now.
        """
        node = self._node(name)
        try:
            value: Value = self._apart(lambda: node.value)
        except (self._wrong, AttributeError) as wrong:
            raise DeviceError(f"{self._name}: feature {name} can't be read ({_plain(wrong)})") from wrong
        return value

    def set(self, name: str, value: Value) -> None:
        """Set feature ``name``.

        Raises:
            DeviceLost: no answer.
            DeviceError: no such feature, a value out of its range, or it can't be written now.
        """
        node = self._node(name)
        try:
            self._apart(lambda: setattr(node, "value", value))
        except (self._wrong, AttributeError, TypeError) as wrong:
            entries = [str(entry.symbolic) for entry in getattr(node, "entries", [])]
            known = f"; it knows {', '.join(entries)}" if entries else ""
            raise DeviceError(f"{self._name}: feature {name} refused {value!r} ({_plain(wrong)}){known}") from wrong

    def execute(self, name: str) -> None:
        """Execute command ``name``. Errors as ``set``."""
        node = self._node(name)
        try:
            self._apart(node.execute)
        except (self._wrong, AttributeError) as wrong:
            raise DeviceError(f"{self._name}: command {name} was refused ({_plain(wrong)})") from wrong

    def _apart(self, job: Callable[[], T]) -> T:
        """Do it in a thread of its own: GenICam, and loading it, swallow a Ctrl-C that comes meanwhile."""
        return self._worker.submit(job).result()

    def _node(self, name: str) -> Any:
        try:
            return self._apart(lambda: self._map.get_node(name))
        except self._wrong:
            near = difflib.get_close_matches(name, self.names(), n=3, cutoff=0.5)
            advice = f"; did you mean {', '.join(near)}?" if near else ""
            raise DeviceError(f"{self._name}: the device has no feature {name}{advice}") from None


def description(control: Control) -> str:
    """The camera's GenICam description (XML), out of its own memory.

    Raises:
        DeviceLost: no answer.
        DeviceError: not in its memory, too large, or a broken archive.
    """
    url = control.read_memory(Register.FIRST_URL, 512).split(b"\0", 1)[0].decode("latin-1")
    kind, _, rest = url.partition(":")
    parts = rest.split("?", 1)[0].split(";")
    try:
        if kind.lower() != "local":
            raise ValueError(kind)
        name, address, size = parts[0], int(parts[1], 16), int(parts[2], 16)
    except (ValueError, IndexError):
        raise DeviceError(f"{control.name}: found description {url!r}, need Local:name;address;size") from None
    if not 0 < size <= MOST_XML:
        raise DeviceError(f"{control.name}: found a description of {size} bytes, need 1 to {MOST_XML}")
    data = control.read_memory(address, size)
    try:
        return (_unzipped(data) if name.lower().endswith(".zip") else data).rstrip(b"\0").decode("utf-8")
    except (zipfile.BadZipFile, UnicodeDecodeError, ValueError, IndexError) as wrong:
        raise DeviceError(f"{control.name}: its description {name} can't be read ({wrong})") from wrong


def _unzipped(data: bytes) -> bytes:
    """The first file of an archive, not larger than a description can be."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive, archive.open(archive.infolist()[0]) as file:
        xml = file.read(MOST_XML + 1)
    if len(xml) > MOST_XML:
        raise ValueError(f"more than {MOST_XML} bytes")
    return xml


def _genapi() -> Any:
    try:
        from genicam import genapi
    except ImportError as wrong:
        raise MissingExtra(
            "GenICam cameras need the package genicam, which is not installed or not made for this platform; "
            "`pip install genicam`, or use a platform that it supports (Windows, Linux, macOS)"
        ) from wrong
    return genapi


def _port(genapi: Any, control: Control) -> Any:
    """The camera's memory in the form that GenICam wants; errors of ours go through it as they are."""

    class Port(genapi.AbstractPort):  # type: ignore[misc]
        def read(self, address: int, length: int) -> bytes:
            if length == 4 and not address % 4:
                return control.read(address).to_bytes(4, "big")
            return control.read_memory(address, length)

        def write(self, address: int, data: bytes) -> None:
            if len(data) == 4 and not address % 4:
                control.write(address, int.from_bytes(data, "big"))
            else:
                control.write_memory(address, bytes(data) + bytes(-len(data) % 4))

        def get_access_mode(self) -> Any:
            return genapi.EAccessMode.RW

        def is_open(self) -> bool:
            return True

    return Port()


def _plain(wrong: Exception) -> str:
    """The first sentence of GenICam's message, without its file and line."""
    return re.split(r" : \w+Exception thrown| \(file ", str(wrong))[0].strip()
