"""GRBL 1.1: lines of text and single realtime bytes to a motion controller. Pure: no sockets here.

Source: the Grbl v1.1 wiki (interface, commands, jogging). grblHAL and FluidNC speak the same.
"""

import re
from dataclasses import dataclass

from truestand.devices.wire.malformed import Malformed

ASK = b"?"
HOLD = b"!"
JOG_CANCEL = b"\x85"
"""Slow down and drop the jogs that wait; ignored where nothing jogs."""
RESET = b"\x18"
"""Ctrl-X: stop at once and restart; the position is lost where it was moving."""
HOME = b"$H\n"
UNLOCK = b"$X\n"
ERRORS = {
    1: "a command without a letter", 2: "a number that is none", 3: "an unknown $ command",
    5: "homing is switched off ($22)",
    8: "it isn't idle", 9: "it is locked by an alarm; home it or reset", 10: "soft limits need homing",
    15: "the target is beyond its travel ($130)", 16: "a jog command without a feed", 20: "an unknown command",
    22: "no feed", 24: "two commands in one line", 31: "a letter that this command does not know",
    33: "an invalid target", 34: "an invalid arc",
}  # fmt: skip
ALARMS = {
    1: "hard limit hit", 2: "soft limit", 3: "reset while it moved, position lost", 4: "probe", 5: "probe",
    6: "homing was interrupted", 7: "door opened while homing", 8: "homing: the switch doesn't open",
    9: "homing: no switch found", 10: "homing: second switch not found",
}  # fmt: skip
_NUMBER = r"-?\d{1,9}(?:\.\d{1,6})?"
_REPORT = re.compile(r"<([A-Z][a-z]+)(?::(\d))?((?:\|[^|<>]*)*)>")


@dataclass(frozen=True, slots=True)
class Ok:
    """A line was accepted, or homing ended."""


@dataclass(frozen=True, slots=True)
class Refused:
    """``error:n``."""

    code: int

    def __str__(self) -> str:
        return ERRORS.get(self.code, f"error {self.code}")


@dataclass(frozen=True, slots=True)
class Alarm:
    """``ALARM:n``: the board stopped and stays locked."""

    code: int

    def __str__(self) -> str:
        return f"alarm {self.code}: {ALARMS.get(self.code, 'see the manual of the board')}"


@dataclass(frozen=True, slots=True)
class Report:
    """``<Idle|MPos:0.000,0.000,0.000|FS:0,0>``."""

    state: str
    """Idle, Run, Hold, Jog, Alarm, Door, Check, Home, Sleep."""
    position: tuple[float, ...] | None
    """Machine position by axis, in the board's units; None where it reports work positions ($10)."""
    detail: int | None = None
    """Of Hold and Door: 0 = at rest."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """The board was switched on or reset."""


Message = Ok | Refused | Alarm | Report | Welcome


def jog_to(axis: str, position: float, feed: float) -> bytes:
    """Go to a machine position; board units and units per minute. A jog ends by itself and can be cancelled."""
    return f"$J=G90 G21 G53 {axis}{position:.4f} F{feed:.3f}\n".encode("ascii")


def decode_line(line: bytes) -> Message | None:
    """A message of the board, or None for ``[MSG:...]`` and other lines that need no action.

    Raises:
        Malformed: none of GRBL 1.1.
    """
    try:
        text = line.decode("ascii").strip()
    except UnicodeDecodeError as wrong:
        raise Malformed(f"found {line[:40]!r}, need ASCII") from wrong
    if text == "ok":
        return Ok()
    if re.match(r"(Grbl|GrblHAL) ", text):
        return Welcome()
    if (text.startswith("[") and text.endswith("]")) or not text:
        return None
    if found := re.fullmatch(r"(error|ALARM):(\d{1,3})", text):
        return Refused(int(found[2])) if found[1] == "error" else Alarm(int(found[2]))
    if found := _REPORT.fullmatch(text):
        return Report(found[1], _position(found[3], line), None if found[2] is None else int(found[2]))
    raise Malformed(f"found {line[:40]!r}, need a line of GRBL 1.1")


def _position(fields: str, line: bytes) -> tuple[float, ...] | None:
    for field in fields.split("|"):
        name, _, value = field.partition(":")
        if name == "MPos":
            if not re.fullmatch(rf"{_NUMBER}(,{_NUMBER}){{0,5}}", value):
                raise Malformed(f"found {line[:60]!r}, need numbers after MPos")
            return tuple(float(number) for number in value.split(","))
    return None
