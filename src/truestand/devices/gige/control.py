"""GigE Vision control: registers and memory of one device over UDP, the right to control it, and the heartbeat.

A device answers on port 3956 and only to one controller, which has to send a heartbeat. Every call ends within a
second, by an answer or by ``DeviceLost``; only taking control may wait until the control of a crashed program ends.
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

ANSWER_TIMEOUT_S = 0.14
ATTEMPTS = 3
"""Of each request: UDP may lose it, or its answer."""
MAX_PENDING_S = 2.0
"""That a device may ask for with a PENDING acknowledge."""
MAX_TAKE_S = 10.5
"""To wait for a device that another program controls: if that crashed, its control ends with its heartbeat."""
DEFAULT_HEARTBEAT_MS = 1000
ADVICE = "check that it is switched on, its cable, and its address in stand.toml"


class Control:
    """A device's control channel. Its calls may come from any thread."""

    def __init__(self, name: str, address: str) -> None:
        self.name = name
        """As in stand.toml, for messages."""
        self.address = address
        self.lost_reason = ""
        """Why the device counts as lost, in words; empty = it answers."""
        self.on_lost: Callable[[], None] = lambda: None
        """Called once, by the heartbeat, when the device is lost."""
        self._number = 0
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._heartbeat: threading.Thread | None = None
        self._controls = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect((address, gvcp.PORT))
        except OSError as wrong:
            self._socket.close()
            raise DeviceLost(f"{name}: {address} can't be reached ({wrong}); {ADVICE}") from wrong

    @property
    def host(self) -> str:
        """IPv4 address of this computer from which the device is reached."""
        return str(self._socket.getsockname()[0])

    def take(self, heartbeat_ms: int = DEFAULT_HEARTBEAT_MS) -> None:
        """Take control of the device, and hold it by a heartbeat.

        Raises:
            DeviceLost: no answer.
            DeviceError: another program controls it.
        """
        held = self.read(Register.HEARTBEAT) / 1000.0
        end = time.monotonic() + min(held + 0.5, MAX_TAKE_S)
        while not self._taken():
            if time.monotonic() > end:
                raise DeviceError(
                    f"{self.name}: {self.address} is controlled by another program; close that one, then try again"
                )
            self._stop.wait(0.2)
        self._controls = True
        self.write(Register.HEARTBEAT, heartbeat_ms)
        self._heartbeat = threading.Thread(
            target=self._hold, args=(heartbeat_ms / 3000.0,), name=f"heartbeat {self.name}", daemon=True
        )
        self._heartbeat.start()

    def _taken(self) -> bool:
        """Whether the device grants control; one that another program controls refuses, or does not answer."""
        body = gvcp.write_register_body((Register.CONTROL, gvcp.CONTROL))
        try:
            status = self._ask(Command.WRITE_REGISTER, body, attempts=1).status
        except DeviceLost:
            return False
        if status not in (Status.SUCCESS, Status.ACCESS_DENIED):
            raise self._refused("take control", status)
        return status == Status.SUCCESS

    def _hold(self, period: float) -> None:
        while not self.lost_reason and not self._stop.wait(period):
            try:
                if not self.read(Register.CONTROL) & (gvcp.CONTROL | gvcp.EXCLUSIVE):
                    self.lost_reason = (
                        "it gave up our control, as if it had not heard us for too long; check the network"
                    )
            except DeviceLost:
                self.lost_reason = f"{self.address} doesn't answer any more; {ADVICE}"
            except DeviceError as wrong:
                self.lost_reason = f"its heartbeat ended ({wrong})"
        if self.lost_reason:
            self.on_lost()

    def check(self) -> None:
        """Whether the device still answers its heartbeat, without asking it.

        Raises:
            DeviceLost: the heartbeat was not answered.
        """
        if self.lost_reason:
            raise DeviceLost(f"{self.name}: {self.lost_reason}")

    def read(self, address: int) -> int:
        """The 32 bit register at ``address``.

        Raises:
            DeviceLost: no answer.
            DeviceError: refused.
        """
        body = self._command(Command.READ_REGISTER, gvcp.register_body(address), f"read register 0x{address:08x}", 4)
        return gvcp.words(body)[0]

    def write(self, address: int, value: int) -> None:
        """Write the 32 bit register at ``address``. Errors as ``read``."""
        body = gvcp.write_register_body((address, value))
        self._command(Command.WRITE_REGISTER, body, f"write {value} to register 0x{address:08x}")

    def read_memory(self, address: int, count: int) -> bytes:
        """``count`` bytes from ``address`` on, in pieces that fit a datagram. Errors as ``read``."""
        data = bytearray()
        while len(data) < count:
            size, start = min(gvcp.MAX_DATA_BYTES, count - len(data)) + 3 & ~3, address + len(data)
            body = gvcp.read_memory_body(start, size)
            data += self._command(Command.READ_MEMORY, body, f"read {size} bytes at 0x{start:08x}", 4 + size)[4:]
        return bytes(data[:count])

    def write_memory(self, address: int, data: bytes) -> None:
        """Write ``data`` (a multiple of 4 bytes) from ``address`` on. Errors as ``read``."""
        for start in range(0, len(data), gvcp.MAX_DATA_BYTES):
            piece = data[start : start + gvcp.MAX_DATA_BYTES]
            body = gvcp.write_memory_body(address + start, piece)
            self._command(Command.WRITE_MEMORY, body, f"write {len(piece)} bytes at 0x{address + start:08x}")

    def identity(self) -> dict[str, str]:
        """Maker, model, serial, ... Errors as ``read``."""
        identity = gvcp.identity_of(self.read_memory(0, gvcp.DISCOVERY_BYTES))
        return {**identity, "address": self.address}

    def resend(self, request: gvcp.Resend) -> None:
        """Request packets of the stream again; they come over the stream, without an acknowledge."""
        with suppress(OSError):  # a lost device can't be asked; the heartbeat reports it
            self._socket.send(request.request(self._next()).encode())

    def close(self) -> None:
        """Give control back and close; never raises for a device that is gone."""
        self._stop.set()
        if self._heartbeat is not None:
            self._heartbeat.join()
        if self._controls and not self.lost_reason:
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
        raise DeviceLost(f"{self.name}: nobody answers at {self.address}; {ADVICE}")

    def _command(self, command: int, body: bytes, action: str, length: int | None = None) -> bytes:
        """The body of a command's acknowledge, of ``length`` bytes where one is given; errors name the ``action``."""
        answer = self._ask(command, body)
        if answer.status or length not in (None, len(answer.body)):
            raise self._refused(action, answer.status)
        return answer.body

    def _answer(self, request: gvcp.Request) -> gvcp.Acknowledge | None:
        """What came for ``request`` in time; late answers to earlier ones and garbage are passed over."""
        end = time.monotonic() + ANSWER_TIMEOUT_S
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
                end = time.monotonic() + min(wait, MAX_PENDING_S) + ANSWER_TIMEOUT_S
        return None

    def _refused(self, action: str, status: int) -> DeviceError:
        known = Status(status).name.lower().replace("_", " ") if status in list(Status) else f"0x{status:04x}"
        why = known if status else "an answer of the wrong length"
        return DeviceError(
            f"{self.name}: the device did not {action} ({why}); check that it is the sensor of the recipe"
        )
