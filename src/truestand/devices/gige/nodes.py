"""The features of a camera (GenICam), by the description in its memory: get, set and execute by name.

EMVA's reference implementation (the ``genicam`` wheel) does the work; a port gives it the camera's memory.
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

MAX_XML_BYTES = 16 << 20
"""Of a description; real ones have 0.02 to 2 MB."""
Value = int | float | str | bool
T = TypeVar("T")


class Nodes:
    """The features of the camera behind ``control``."""

    def __init__(self, control: Control) -> None:
        """Reads the camera's description.

        Raises:
            MissingExtra: no ``genicam`` wheel.
            DeviceLost: no answer.
            DeviceError: no description, or one that can't be understood.
        """
        self._worker = ThreadPoolExecutor(1, f"features {control.name}")
        genapi = self._in_worker(_genapi)
        self._name = control.name
        self._genapi_error: type[Exception] = genapi.GenericException
        self._map = genapi.NodeMap()
        xml = description(control)
        try:
            self._in_worker(lambda: self._map.load_xml_from_string(xml))
            self._port = _port(genapi, control)
            self._in_worker(lambda: self._map.connect(self._port, "Device"))
        except self._genapi_error as wrong:
            raise DeviceError(
                f"{self._name}: its GenICam description can't be understood ({_first_sentence(wrong)})"
            ) from wrong

    def names(self) -> list[str]:
        """Names of all features and of the nodes behind them."""
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
            value: Value = self._in_worker(lambda: node.value)
        except (self._genapi_error, AttributeError) as wrong:
            raise DeviceError(f"{self._name}: feature {name} can't be read ({_first_sentence(wrong)})") from wrong
        return value

    def set(self, name: str, value: Value) -> None:
        """Set feature ``name``.

        Raises:
            DeviceLost: no answer.
            DeviceError: no such feature, a value out of its range, or it can't be written now.
        """
        node = self._node(name)
        try:
            self._in_worker(lambda: setattr(node, "value", value))
        except (self._genapi_error, AttributeError, TypeError) as wrong:
            entries = [str(entry.symbolic) for entry in getattr(node, "entries", [])]
            known = f"; it knows {', '.join(entries)}" if entries else ""
            raise DeviceError(
                f"{self._name}: feature {name} refused {value!r} ({_first_sentence(wrong)}){known}"
            ) from wrong

    def execute(self, name: str) -> None:
        """Execute command ``name``. Errors as ``set``."""
        node = self._node(name)
        try:
            self._in_worker(node.execute)
        except (self._genapi_error, AttributeError) as wrong:
            raise DeviceError(f"{self._name}: command {name} was refused ({_first_sentence(wrong)})") from wrong

    def _in_worker(self, job: Callable[[], T]) -> T:
        """Run ``job`` in a thread of its own: GenICam, and loading it, swallow a Ctrl-C that comes meanwhile."""
        return self._worker.submit(job).result()

    def _node(self, name: str) -> Any:
        try:
            return self._in_worker(lambda: self._map.get_node(name))
        except self._genapi_error:
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
    if not 0 < size <= MAX_XML_BYTES:
        raise DeviceError(f"{control.name}: found a description of {size} bytes, need 1 to {MAX_XML_BYTES}")
    data = control.read_memory(address, size)
    try:
        return (_unzipped(data) if name.lower().endswith(".zip") else data).rstrip(b"\0").decode("utf-8")
    except (zipfile.BadZipFile, UnicodeDecodeError, ValueError, IndexError) as wrong:
        raise DeviceError(f"{control.name}: its description {name} can't be read ({wrong})") from wrong


def _unzipped(data: bytes) -> bytes:
    """The first file of an archive, not larger than a description can be."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive, archive.open(archive.infolist()[0]) as file:
        xml = file.read(MAX_XML_BYTES + 1)
    if len(xml) > MAX_XML_BYTES:
        raise ValueError(f"more than {MAX_XML_BYTES} bytes")
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
    """The camera's memory as a port of GenICam; errors of ours pass through it unchanged."""

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


def _first_sentence(wrong: Exception) -> str:
    """The first sentence of GenICam's message, without its file and line."""
    return re.split(r" : \w+Exception thrown| \(file ", str(wrong))[0].strip()
