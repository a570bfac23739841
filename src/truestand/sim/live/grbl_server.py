"""The virtual table as a motion controller with GRBL 1.1, over TCP or a pseudo terminal.

It is locked until it is homed, executes jogs one after the other, and answers nothing during the home search, as a
real one. It shares nothing with the driver's codec.
"""

import re
from collections import deque
from math import degrees, radians

from truestand.devices.tables.recipe import PORTS, ControllerRecipe
from truestand.sim.live.servers import LineServer, Receive, Send
from truestand.sim.live.table import VirtualTable

WELCOME = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LOCKED = b"[MSG:'$H'|'$X' to unlock]\r\n"
MAX_LINE = 80
"""Characters."""
REALTIME = (b"?", b"!", b"~", b"\x18", b"\x85")
"""Characters that count at once, wherever they stand: report, hold, resume, reset, cancel the jog."""
WORD = re.compile(r"(.)([0-9.+-]*)")
"""A letter and its number."""
ANSWERS = {
    "": b"ok\r\n",
    "$": b"[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]\r\nok\r\n",
    "$I": b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n",
    "$G": b"[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]\r\nok\r\n",
    "$$": b"$10=1\r\n$13=0\r\n$20=0\r\n$21=0\r\n$22=1\r\n$23=0\r\nok\r\n",
}


class GrblServer(LineServer):
    """Serves one table; ``home_position`` is the machine position that homing sets, in the board's units."""

    def __init__(self, table: VirtualTable, recipe: ControllerRecipe, home_position: float = 0.0) -> None:
        super().__init__(recipe.address, PORTS["grbl"])
        self.table, self.map, self.home_position = table, recipe.grbl, home_position
        self._locked, self._held = not table.status().homed, False
        self._homing: Send | None = None
        """The client that gets the answer at the end of the home search."""
        self._report_requests: set[Send] = set()
        self._lines: deque[tuple[Send, str]] = deque()
        self._jogs: deque[tuple[float, bool, float]] = deque()

    def _connected(self, send: Send) -> Receive:
        line = b""

        def receive(data: bytes) -> None:
            """Take realtime characters out of the lines."""
            nonlocal line
            for byte in (bytes([number]) for number in data):
                if byte in REALTIME:
                    line = b"" if byte == b"\x18" else line
                    self.realtime(byte, send)
                elif byte in (b"\n", b"\r"):
                    text, line = line.decode("ascii", "replace").strip().upper(), b""
                    if text or byte == b"\n":
                        self._lines.append((send, text))
                        self._poll()
                elif len(line) < MAX_LINE:
                    line += byte

        return receive

    def realtime(self, byte: bytes, send: Send) -> None:
        """Execute a realtime character at once."""
        if byte == b"?":
            self._report_requests.add(send)
        elif byte == b"\x18":
            self._restart()
        elif byte in (b"!", b"\x85"):
            jogging = self._jogging()
            self._held = byte == b"!" and not jogging
            if jogging and self._homing is None:
                self._jogs.clear()
                self.table.halt()
        elif byte == b"~":
            self._held = False
        self._poll()

    def _poll(self) -> None:
        status = self.table.status()
        if self._homing is not None and not status.moving:
            self._end_homing(self._homing, status.homed)
        if status.fault and not self._locked:
            self._alarm(1)
        if self._jogs and not status.moving:
            self._start(*self._jogs.popleft())
        while self._lines and self._homing is None:
            send, text = self._lines.popleft()
            send(self._answer(text, send))
        while self._report_requests and self._homing is None:
            self._report_requests.pop()(self._report())

    def _answer(self, text: str, send: Send) -> bytes:
        """The answer to a line; empty for a home search that began: its answer comes at its end."""
        if text in ANSWERS:
            return ANSWERS[text]
        if text == "$H":
            self._homing = send if self.table.home() else None
            return b"" if self._homing else b"error:9\r\n"
        if text == "$X":
            locked, self._locked = self._locked, False
            return (b"[MSG:Caution: Unlocked]\r\n" if locked else b"") + b"ok\r\n"
        if self._locked:
            return b"error:9\r\n"
        if text.startswith("$J="):
            return self._jog(text[3:].replace(" ", ""))
        return b"error:3\r\n" if text.startswith("$") else b"error:20\r\n"

    def _jog(self, text: str) -> bytes:
        """``G90 G21 G53 X10 F100``: accepted, and executed after the others."""
        relative, target, feed, words = False, None, None, _words(text)
        if words is None:
            return b"error:2\r\n"
        for letter, number in words:
            if letter == "G" and number in (20, 21, 53, 90, 91):
                relative = relative or number == 91
            elif letter == "F":
                feed = number
            elif letter == self.map.axis:
                target = number
            else:
                return b"error:16\r\n"
        if feed is None or feed <= 0 or target is None:
            return b"error:22\r\n" if target is not None else b"error:16\r\n"
        self._jogs.append((target, relative, feed / 60))
        if not self.table.status().moving:
            self._start(*self._jogs.popleft())
        return b"ok\r\n"

    def _start(self, target: float, relative: bool, speed: float) -> None:
        scale = self.map.degrees_per_unit
        distance = target if relative else target - self._units()
        self.table.move(self.table.status().position + radians(distance * scale), radians(speed * scale))

    def _units(self) -> float:
        """Machine position."""
        status = self.table.status()
        return degrees(status.position) / self.map.degrees_per_unit + (self.home_position if status.homed else 0.0)

    def _jogging(self) -> bool:
        return bool(self._jogs) or self.table.status().moving

    def _report(self) -> bytes:
        state = "Alarm" if self._locked else "Jog" if self._jogging() else "Hold:0" if self._held else "Idle"
        position = ",".join(f"{self._units() if axis == self.map.axis else 0.0:.3f}" for axis in self.map.axes)
        return f"<{state}|MPos:{position}|FS:0,0|WCO:0.000,0.000,0.000>\r\n".encode()

    def _end_homing(self, send: Send, homed: bool) -> None:
        """Answer the home command at the end of its search."""
        self._homing = None
        if homed:
            self._locked = False
            send(b"ok\r\n")
        else:
            self._alarm(9)

    def _alarm(self, code: int) -> None:
        self._locked = True
        self._jogs.clear()
        self._broadcast(f"ALARM:{code}\r\n".encode())

    def _restart(self) -> None:
        homing, self._homing = self._homing, None
        if homing or self._jogging():
            self.table.halt()
            self._alarm(6 if homing else 3)
        self._lines.clear()
        self._held = False
        self.table.reset()
        self._broadcast(WELCOME + (LOCKED if self._locked else b""))

    def _broadcast(self, data: bytes) -> None:
        for send in tuple(self._clients):
            send(data)


def _words(text: str) -> list[tuple[str, float]] | None:
    """Letters and their numbers; None where one of these is no number."""
    try:
        return [(letter, float(digits)) for letter, digits in WORD.findall(text)]
    except ValueError:
        return None
