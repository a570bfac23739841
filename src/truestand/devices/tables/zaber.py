"""A Zaber stage over TCP or a serial port: the ASCII protocol. Angles travel as microsteps."""

import re
import time
from math import tau

from truestand.devices.axis import DriveState, malformed, refused, timed
from truestand.devices.tables.line import Line, Lines
from truestand.devices.tables.recipe import PORTS, ZaberRecipe
from truestand.devices.wire.malformed import Malformed
from truestand.devices.wire.zaber import FAULTS, NOT_HOMED, SPEED_UNIT, Command, Reply, decode_reply

ADVICE = {
    "BADDATA": "check counts_per_turn in its zaber table and the stage's limit.min, limit.max and limit.speed",
    "BADAXIS": "check axis in its zaber table",
    "PARKED": "unpark the stage with Zaber Launcher",
    "DRIVERDISABLED": "mend the cause, then reset",
}
"""By the reason of a rejection."""


class ZaberTable:
    """A ``Drive``; safe to use from two threads."""

    def __init__(
        self, address: str, recipe: ZaberRecipe, timeout: float, what: str = "table", lines: Lines | None = None
    ) -> None:
        self.name = f"{what} at {address} (Zaber ASCII)"
        self._recipe = recipe
        own = Line(self.name, address, timeout, PORTS["zaber"], recipe.baud)
        self._line = own if lines is None else lines.setdefault(address, own)
        self._lock = self._line.lock
        self._id = 0

    def start_home(self) -> None:
        """Begin to search for the home position."""
        self._ask("home")

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move to ``position`` (rad) at ``speed`` (rad/s) and stop there."""
        with self._lock:
            self._ask(f"set maxspeed {max(1, self._speed(speed))}")
            self._ask(f"move abs {self._counts(position)}")

    def halt(self) -> None:
        """Begin to slow down to rest."""
        self._ask("stop")

    def reset(self) -> None:
        """Clear the warnings, and enable the driver where a fault disabled it."""
        with self._lock:
            self._ask("warnings clear")
            if any(flag in ("FO", "FD") for flag in self._flags()):
                self._ask("driver enable")

    def state(self) -> DriveState:
        """Ask for the warnings, then for the position; the reply to that says whether it moves."""
        with self._lock:
            flags = self._flags()
            reply, asked, half_width = timed(self._ask, "get pos")
        faults = [f"{FAULTS.get(flag, 'fault')} ({flag})" for flag in flags if flag.startswith("F")]
        return DriveState(
            self._number(reply.data) * tau / self._recipe.counts_per_turn,
            reply.busy,
            not any(flag in NOT_HOMED for flag in flags),
            asked,
            half_width,
            ", ".join(faults),
        )

    def close(self) -> None:
        """Close the connection."""
        with self._lock:
            self._line.close()

    def _counts(self, angle: float) -> int:
        return round(angle * self._recipe.counts_per_turn / tau)

    def _speed(self, speed: float) -> int:
        return round(speed * self._recipe.counts_per_turn / tau * SPEED_UNIT)

    def _number(self, data: str) -> float:
        """A position, in counts."""
        if not re.fullmatch(r"-?\d{1,15}(\.\d+)?", data):
            raise malformed(self.name, f"position {data[:20]!r}", "a number")
        return float(data)

    def _flags(self) -> list[str]:
        """All warning flags: a count, then the flags."""
        return self._ask("warnings").data.split()[1:]

    def _ask(self, text: str) -> Reply:
        """A command and its reply.

        Raises:
            DeviceLost: silence, or a broken connection.
            DeviceError: rejected, or an answer that is none.
        """
        with self._lock:
            self._id = self._id % 99 + 1
            end = time.monotonic() + self._line.timeout
            self._line.send(Command(text, self._recipe.device, self._recipe.axis, self._id).encode())
            reply = self._reply(end)
        if not reply.accepted:
            advice = ADVICE.get(reply.data, "see Zaber's protocol manual for the reason")
            raise refused(self.name, f"{text!r} is {reply.data}", advice)
        return reply

    def _reply(self, end: float) -> Reply:
        """The reply to the last command; alerts, infos and late replies to others are skipped."""
        while (line := self._line.receive(end)) is not None and time.monotonic() < end:
            try:
                message = decode_reply(line)
            except Malformed as wrong:
                raise self._line.malformed(repr(line[:40]), "a reply of the Zaber ASCII protocol") from wrong
            if message is not None and message.id == self._id:
                return message
        raise self._line.silent()
