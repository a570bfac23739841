"""GigE Vision control: registers and memory of one device over UDP, the right to control it, and the heartbeat.

A device answers on port 3956 and only to one controller, which has to say every so often that it is still there. Every
call ends within a second, by an answer or by ``DeviceLost``; only taking control may wait until the device has given up
a controller that died.
"""

import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from truestand.core.errors import DeviceError, DeviceLost
from truestand.devices.wire import gvcp
from truestand.devices.wire.gvcp import Command, Register, Status
from truestand.devices.wire.malformed import Malformed

PATIENCE = 0.14
"""s for one answer."""
ATTEMPTS = 3
"""Of each request: UDP may lose it, or its answer."""
LONGEST_PENDING = 2.0
"""s that a device may ask for with a PENDING acknowledge."""
LONGEST_TAKE = 10.5
"""s, at most, to wait for a device that somebody else controls: one that died lets go when its heartbeat runs out."""
DEFAULT_HEARTBEAT = 1000
"""ms."""
GONE = "check that it is switched on, its cable, and its address in stand.toml"


class Control:
    """A device's control channel. Its calls may come from any thread."""

    def __init__(self, name: str, address: str) -> None:
        self.name = name
        """As in stand.toml, for messages."""
        self.address = address
        self.gone = ""
        """Why the device is taken as lost, in plain words; empty = it answers."""
        self.on_gone: Callable[[], None] = lambda: None
        """Called once, by the heartbeat, when the device is lost."""
        self._number = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._heart: threading.Thread | None = None
        self._controls = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect((address, gvcp.PORT))
        except OSError as wrong:
            self._socket.close()
            raise DeviceLost(f"{name}: {address} can't be reached ({wrong}); {GONE}") from wrong

    @property
    def host(self) -> str:
        """The own IPv4 address that the device is reached from."""
        return str(self._socket.getsockname()[0])

    def take(self, heartbeat_ms: int = DEFAULT_HEARTBEAT) -> None:
        """Become the one who controls the device, and keep saying so.

        Raises:
            DeviceLost: no answer.
            DeviceError: another program controls it and goes on.
        """
        held = self.read(Register.HEARTBEAT) / 1000.0
        end = time.monotonic() + min(held + 0.5, LONGEST_TAKE)
        while not self._taken():
            if time.monotonic() > end:
                raise DeviceError(
                    f"{self.name}: {self.address} is controlled by another program; close that one, then try again"
                )
            self._stop.wait(0.2)
        self._controls = True
        self.write(Register.HEARTBEAT, heartbeat_ms)
        self._heart = threading.Thread(
            target=self._beat, args=(heartbeat_ms / 3000.0,), name=f"heartbeat {self.name}", daemon=True
        )
        self._heart.start()

    def _taken(self) -> bool:
        """Whether the device lets us control it; one that is taken refuses, or says nothing at all."""
        body = gvcp.write_register_body((Register.CONTROL, gvcp.CONTROL))
        try:
            status = self._ask(Command.WRITE_REGISTER, body, attempts=1).status
        except DeviceLost:
            return False
        if status not in (Status.SUCCESS, Status.ACCESS_DENIED):
            raise self._refused("take control", status)
        return status == Status.SUCCESS

    def _beat(self, period: float) -> None:
        while not self._stop.wait(period):
            try:
                if not self.read(Register.CONTROL) & (gvcp.CONTROL | gvcp.EXCLUSIVE):
                    self._lose("it gave up our control, as if it had not heard us for too long; check the network")
            except DeviceLost:
                self._lose(f"{self.address} doesn't answer any more; {GONE}")
            except DeviceError as wrong:
                self._lose(f"its heartbeat ended ({wrong})")
            if self.gone:
                return

    def _lose(self, why: str) -> None:
        self.gone = why
        self.on_gone()

    def check(self) -> None:
        """Whether the device is still there, without asking it.

        Raises:
            DeviceLost: the heartbeat was not answered.
        """
        if self.gone:
            raise DeviceLost(f"{self.name}: {self.gone}")

    def read(self, address: int) -> int:
        """The 32 bit register at ``address``.

        Raises:
            DeviceLost: no answer.
            DeviceError: refused.
        """
        answer = self._ask(Command.READ_REGISTER, gvcp.register_body(address))
        if answer.status or len(answer.body) != 4:
            raise self._refused(f"read register 0x{address:08x}", answer.status)
        return gvcp.words(answer.body)[0]

    def write(self, address: int, value: int) -> None:
        """Write the 32 bit register at ``address``. Errors as ``read``."""
        answer = self._ask(Command.WRITE_REGISTER, gvcp.write_register_body((address, value)))
        if answer.status:
            raise self._refused(f"write {value} to register 0x{address:08x}", answer.status)

    def read_memory(self, address: int, count: int) -> bytes:
        """``count`` bytes from ``address`` on, in pieces that fit a datagram. Errors as ``read``."""
        data = bytearray()
        while len(data) < count:
            size = min(gvcp.MOST_DATA, count - len(data)) + 3 & ~3
            answer = self._ask(Command.READ_MEMORY, gvcp.read_memory_body(address + len(data), size))
            if answer.status or len(answer.body) != 4 + size:
                raise self._refused(f"read {size} bytes at 0x{address + len(data):08x}", answer.status)
            data += answer.body[4:]
        return bytes(data[:count])

    def write_memory(self, address: int, data: bytes) -> None:
        """Write ``data`` (a multiple of 4 bytes) from ``address`` on. Errors as ``read``."""
        for start in range(0, len(data), gvcp.MOST_DATA):
            piece = data[start : start + gvcp.MOST_DATA]
            answer = self._ask(Command.WRITE_MEMORY, gvcp.write_memory_body(address + start, piece))
            if answer.status:
                raise self._refused(f"write {len(piece)} bytes at 0x{address + start:08x}", answer.status)

    def identity(self) -> dict[str, str]:
        """Maker, model, serial, ... Errors as ``read``."""
        identity = gvcp.identity_of(self.read_memory(0, gvcp.DISCOVERY_BYTES))
        return {**identity, "address": self.address}

    def resend(self, request: gvcp.Resend) -> None:
        """Ask for packets of the stream again; they come over the stream, and nothing tells whether they will."""
        with suppress(OSError):  # a device that is gone can't be asked; the heartbeat tells
            self._socket.send(request.request(self._next()).encode())

    def close(self) -> None:
        """Give control back and leave; never raises for a device that is gone."""
        self._stop.set()
        if self._heart is not None:
            self._heart.join()
        if self._controls and not self.gone:
            with suppress(DeviceError):
                self.write(Register.CONTROL, 0)
        self._controls = False
        self._socket.close()

    def _next(self) -> int:
        """A request id; 0 is not allowed."""
        self._number = self._number % 0xFFFF + 1
        return self._number

    def _ask(self, command: int, body: bytes, attempts: int = ATTEMPTS) -> gvcp.Acknowledge:
        """The acknowledge of a command, sent again with the same id where none comes in time."""
        with self._lock:
            request = gvcp.Request(command, self._next(), body)
            for _ in range(attempts):
                with suppress(OSError):  # e.g. refused by a machine that has no device now: it may come back
                    self._socket.send(request.encode())
                answer = self._answer(request)
                if answer is not None:
                    return answer
        raise DeviceLost(f"{self.name}: nobody answers at {self.address}; {GONE}")

    def _answer(self, request: gvcp.Request) -> gvcp.Acknowledge | None:
        """What came for ``request`` in time; late answers to earlier ones and garbage are passed over."""
        end = time.monotonic() + PATIENCE
        while (rest := end - time.monotonic()) > 0:
            try:
                self._socket.settimeout(rest)
                answer = gvcp.decode_acknowledge(self._socket.recv(2048))
            except TimeoutError:
                return None
            except Malformed:
                continue
            except OSError:  # the other machine says that nobody listens: no answer, at once
                self._stop.wait(min(0.02, rest))
                continue
            if answer.id == request.id and answer.command == request.command:
                return answer
            if answer.id == request.id and answer.command == Command.PENDING and len(answer.body) >= 4:
                wait = int.from_bytes(answer.body[2:4], "big") / 1000.0
                end = time.monotonic() + min(wait, LONGEST_PENDING) + PATIENCE
        return None

    def _refused(self, what: str, status: int) -> DeviceError:
        known = Status(status).name.lower().replace("_", " ") if status in list(Status) else f"0x{status:04x}"
        why = known if status else "an answer of the wrong length"
        return DeviceError(f"{self.name}: the device did not {what} ({why}); check that it is the sensor of the recipe")
