"""A table turned by a motion controller with GRBL 1.1, on a serial port or TCP. It moves by jogs only.

The driver stores what GRBL doesn't know: whether it was homed since it was started, and the position of home. During
the home search GRBL answers nothing; it isn't lost then.
"""

import time
from contextlib import suppress
from math import degrees, radians
from typing import Literal

from truestand.core.errors import DeviceError
from truestand.devices.axis import DriveState, refused, timed
from truestand.devices.tables.line import Line, Lines
from truestand.devices.tables.recipe import PORTS, GrblRecipe, is_network
from truestand.devices.wire import grbl
from truestand.devices.wire.grbl import Alarm, Message, Ok, Refused, Report, Welcome
from truestand.devices.wire.malformed import Malformed

BOOT_TIMEOUT_S = 3.0
"""For a board that a serial port resets when it is opened."""
REST_TIMEOUT_S = 2.0
"""To come to rest before another motion."""
POLL_INTERVAL_S = 0.01
"""Between two questions meanwhile."""
HOMING_TIMEOUT_S = 0.05
"""For a report during the home search; a halt waits no longer."""


class GrblTable:
    """A ``Drive``; safe to use from two threads."""

    def __init__(
        self, address: str, recipe: GrblRecipe, timeout: float, what: str = "table", lines: Lines | None = None
    ) -> None:
        self.name = f"{what} at {address} (GRBL)"
        self._recipe = recipe
        own = Line(self.name, address, timeout, PORTS["grbl"], recipe.baud)
        self._line = own if lines is None else lines.setdefault(address, own)
        self._boot = timeout if is_network(address) else max(timeout, BOOT_TIMEOUT_S)
        self._index = recipe.axes.index(recipe.axis)
        self._lock = self._line.lock
        self._opened = 0
        self._home: Literal["unknown", "searching", "found", "known"] = "unknown"
        self._zero = 0.0
        self._last = 0.0
        self._alarm = ""

    def start_home(self) -> None:
        """Begin to search for the home position; the answer comes at its end."""
        with self._lock:
            self._come_to_rest()
            self._home, self._alarm = "searching", ""
            self._line.send(grbl.HOME)

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move to ``position`` (rad) at ``speed`` (rad/s) and stop there."""
        with self._lock:
            self._come_to_rest()
            target = self._zero + self._units(position)
            self._line.send(grbl.jog_to(self._recipe.axis, target, 60 * self._units(speed)))
            answer = self._until(self._line.timeout, Ok)
            if isinstance(answer, Refused):
                raise refused(self.name, str(answer), "reset, or check the board's settings ($$)")

    def halt(self) -> None:
        """Begin to slow down to rest; a home search ends at once, and home is unknown then."""
        with self._lock:
            if self._home == "searching":
                self._home = "unknown"
                self._line.send(grbl.RESET)
                return
            self._line.send(grbl.JOG_CANCEL)
            if self._report().state == "Run":  # a program of another client
                self._line.send(grbl.HOLD)

    def reset(self) -> None:
        """Reset and unlock the board; it has to be homed again."""
        with self._lock:
            self._home, self._alarm = "unknown", ""
            self._line.send(grbl.RESET)
            self._until(self._boot, Welcome)
            self._alarm = ""
            self._line.send(grbl.UNLOCK)
            self._until(self._line.timeout, Ok)

    def state(self) -> DriveState:
        """Ask the board."""
        with self._lock:
            report, asked, half_width = timed(self._report)
            moving = report.state in ("Run", "Jog", "Home") or (report.state in ("Hold", "Door") and report.detail != 0)
            if report.position is not None or report.state != "Home":  # during a silent home search there is none
                self._last = self._units_of(report)
            if self._home == "found" and not moving:
                self._home, self._zero = "known", self._last
            return DriveState(
                radians((self._last - self._zero) * self._recipe.degrees_per_unit),
                moving,
                self._home == "known",
                asked,
                half_width,
                self._fault(report),
            )

    def close(self) -> None:
        """Close the connection."""
        with self._lock:
            self._line.close()

    def _units(self, angle: float) -> float:
        """Board units of an angle (rad) or speed (rad/s)."""
        return degrees(angle) / self._recipe.degrees_per_unit

    def _units_of(self, report: Report) -> float:
        position = report.position or ()
        if len(position) <= self._index:
            raise refused(
                self.name,
                f"found {len(position)} axes in its report, need axis {self._recipe.axis}",
                "check axis and axes in its grbl table, and that the board reports machine positions ($10=1)",
            )
        return position[self._index]

    def _fault(self, report: Report) -> str:
        """The fault in words. An alarm from power-on is none: it only asks for homing."""
        if self._alarm or (report.state == "Alarm" and self._home == "known"):
            return self._alarm or "locked by an alarm"
        words = {"Hold": "held", "Door": "the safety door is open", "Sleep": "asleep", "Check": "in check mode"}
        return words.get(report.state, "") if report.detail in (None, 0) else ""

    def _come_to_rest(self) -> None:
        """Before a motion: a jog that is sent while another runs would only follow it."""
        end = time.monotonic() + REST_TIMEOUT_S
        if self._report().state == "Jog":
            self._line.send(grbl.JOG_CANCEL)
        while self._report().state in ("Jog", "Hold", "Home"):
            if time.monotonic() > end:
                raise refused(self.name, f"it doesn't come to rest within {REST_TIMEOUT_S:g} s", "stop it, or reset")
            time.sleep(POLL_INTERVAL_S)

    def _report(self) -> Report:
        """The board's state now; during the home search it may say nothing."""
        self._read_pending()
        self._line.send(grbl.ASK)
        if self._line.opened != self._opened:
            self._opened, self._home = self._line.opened, "unknown"
            answer = self._until(self._boot, Report, booting=True)
        else:
            searching = self._home == "searching"
            answer = self._until(HOMING_TIMEOUT_S if searching else self._line.timeout, Report)
        if isinstance(answer, Refused):
            raise self._refused(answer)
        return answer if isinstance(answer, Report) else Report("Home", None)

    def _refused(self, answer: Refused) -> DeviceError:
        """The error to raise where the board refused to home, or to report."""
        self._home = "unknown"
        return refused(self.name, str(answer), "check the board's settings ($$)")

    def _read_pending(self) -> None:
        """Read what came before: an old report would be taken for the answer, the refusal of a home search lost."""
        while (line := self._line.receive(0.0)) is not None:
            with suppress(Malformed):  # the answer to the next question shows what is wrong
                message = self._decoded(line)
                if isinstance(message, Refused) and self._home == "searching":
                    raise self._refused(message)

    def _until(self, seconds: float, wanted: type[Ok | Report | Welcome], booting: bool = False) -> Message | None:
        """The first ``wanted`` message or refusal; None where the board is silent during the home search.

        A board that boots sends bytes that are no GRBL, and ignores the first questions.

        Raises:
            DeviceLost: silence, or a broken connection.
            DeviceError: bytes that are no GRBL.
        """
        end, malformed, searching = time.monotonic() + seconds, b"", self._home == "searching"
        while time.monotonic() < end:
            line = self._line.receive(min(end, time.monotonic() + self._line.timeout))
            try:
                message = None if line is None else self._decoded(line)
            except Malformed:
                malformed = line or b""
                if not booting:
                    break
                continue
            if isinstance(message, wanted | Refused):
                return message
            if line is None and booting:
                self._line.send(grbl.ASK)
        if malformed:
            raise self._line.malformed(repr(malformed[:40]), "a line of GRBL 1.1")
        if searching:
            return None
        raise self._line.silent()

    def _decoded(self, line: bytes) -> Message | None:
        """A message; the state of homing and alarms follows it."""
        message = grbl.decode_line(line)
        if isinstance(message, Ok) and self._home == "searching":
            self._home = "found"
            self._line.send(grbl.ASK)
        elif isinstance(message, Alarm):
            self._home, self._alarm = "unknown", str(message)
        elif isinstance(message, Welcome):
            self._home = "unknown"
        return message
