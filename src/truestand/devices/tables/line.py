"""A connection for lines of text: a serial port or TCP. The first call after it broke opens it again.

Every call ends within the timeout: silence and a broken cable are ``DeviceLost``.
"""

import socket
import threading
import time

from truestand.core.errors import DeviceError
from truestand.devices.axis import lost, malformed
from truestand.devices.tables.recipe import host_and_port, is_network

MAX_LINE = 512
"""Bytes; a device that sends more without an end speaks another protocol."""


class Line:
    """Lines to and from ``address``. Its users hold ``lock`` around a question and its answer."""

    def __init__(self, name: str, address: str, timeout: float, port: int, baud: int) -> None:
        self.name = name
        self.timeout = timeout
        self.lock = threading.RLock()
        self.opened = 0
        """How often it was opened: each time the device may have been restarted."""
        self._where = (address, port, baud)
        self._port: _Tcp | _Serial | None = None
        self._rest = b""

    def send(self, data: bytes) -> None:
        """Send.

        Raises:
            DeviceLost: no connection.
        """
        try:
            (self._port or self._open()).send(data)
        except OSError as wrong:
            raise self._broken(wrong) from wrong

    def receive(self, end: float) -> bytes | None:
        """The next line without its end, or None where none came until ``end`` (s of the monotonic clock).

        Raises:
            DeviceLost: a broken connection.
            DeviceError: bytes that are no lines.
        """
        try:
            while b"\n" not in self._rest:
                data = self._port.receive(max(end - time.monotonic(), 0.0)) if self._port is not None else b""
                if not data:
                    return None
                self._rest += data
                if len(self._rest) > MAX_LINE and b"\n" not in self._rest:
                    raise self.malformed(f"{len(self._rest)} bytes without a line end", "lines of text")
        except OSError as wrong:
            raise self._broken(wrong) from wrong
        line, _, self._rest = self._rest.partition(b"\n")
        return line.strip(b"\r")

    def silent(self) -> DeviceError:
        """The error to raise where nothing came in time, or bytes that are no line."""
        if self._rest:
            return self.malformed(f"{len(self._rest)} bytes without a line end", "lines of text")
        self.close()
        return lost(self.name, f"no answer within {self.timeout:g} s")

    def malformed(self, found: str, needed: str) -> DeviceError:
        """The error to raise where an answer is none of the protocol; the next call opens a new connection."""
        self.close()
        return malformed(self.name, found, needed)

    def close(self) -> None:
        """Close; a later ``send`` opens it again."""
        if self._port is not None:
            self._port.close()
        self._port, self._rest = None, b""

    def _open(self) -> "_Tcp | _Serial":
        address, port, baud = self._where
        self._port = (
            _Tcp(*host_and_port(address, port), self.timeout)
            if is_network(address)
            else _Serial(address, baud, self.timeout)
        )
        self.opened += 1
        return self._port

    def _broken(self, wrong: OSError) -> DeviceError:
        self.close()
        return lost(self.name, wrong.strerror or str(wrong) or "the connection broke")


Lines = dict[str, Line]
"""Connections by address: the axes of one controller share theirs, for a serial port has one end only."""


class _Tcp:
    def __init__(self, host: str, port: int, timeout: float) -> None:
        self._timeout = timeout
        self._socket = socket.create_connection((host, port), timeout)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, data: bytes) -> None:
        self._socket.settimeout(self._timeout)
        self._socket.sendall(data)

    def receive(self, seconds: float) -> bytes:
        """What came; empty = nothing within ``seconds``. As that of ``_Serial``."""
        self._socket.settimeout(seconds)
        try:
            data = self._socket.recv(4096)
        except (TimeoutError, BlockingIOError):
            return b""
        if not data:
            raise ConnectionError("the controller closed the connection")
        return data

    def close(self) -> None:
        self._socket.close()


class _Serial:
    def __init__(self, port: str, baud: int, timeout: float) -> None:
        import serial

        self._port = serial.serial_for_url(port, baud, timeout=0, write_timeout=timeout)

    def send(self, data: bytes) -> None:
        self._port.write(data)

    def receive(self, seconds: float) -> bytes:
        self._port.timeout = seconds
        first: bytes = self._port.read(1)
        return first + bytes(self._port.read(self._port.in_waiting)) if first else b""

    def close(self) -> None:
        self._port.close()
