"""Zaber ASCII protocol, versions 6 and 7: lines of text to and from devices on a chain. Pure: no sockets here.

Source: Zaber's ASCII Protocol Manual. Checked in the tests against Zaber's own library ``zaber-motion``.
"""

import re
from dataclasses import dataclass

from truestand.devices.wire.malformed import Malformed

SPEED_UNIT = 1.6384
"""``maxspeed`` and ``move vel`` count microsteps per second times this (2^14 / 10^4)."""
NOT_HOMED = ("WR", "WH")
"""Warning flags: no reference position; not homed since power on."""
FAULTS = {
    "FF": "critical system error", "FN": "peripheral not supported", "FZ": "peripheral inactive",
    "FO": "driver disabled by over-temperature or over-voltage", "FH": "hardware emergency stop",
    "FV": "motor temperature", "FD": "driver disabled", "FQ": "encoder error", "FS": "stalled and stopped",
    "FT": "excessive twist", "FB": "stream bounds error", "FP": "interpolated path deviation", "FE": "limit error",
}  # fmt: skip
"""Meaning of the fault flags, which begin with F."""
_COMMAND = re.compile(r"/\s*(?:(\d+)(?:\s+(\d+)(?:\s+(\d+))?)?(?=\s|$))?\s*(.*)")
_REPLY = re.compile(r"([@!#])(\d{2}) (\d)(?: (\d{2}))?(?: (.*))?")
_STATE = re.compile(r"(?:(OK|RJ) )?(IDLE|BUSY) ([A-Z]{2}|--)(?: (.*))?")


def checksum(text: str) -> int:
    """The number that makes the sum over all characters of a message, except the first, 0 modulo 256."""
    return -sum(text.encode("ascii")) & 0xFF


@dataclass(frozen=True, slots=True)
class Command:
    """A command as it travels: to a device, or 0 = all; to an axis, or 0 = the device."""

    text: str = ""
    device: int = 0
    axis: int = 0
    id: int | None = None
    """0..99; the reply brings it back."""

    def encode(self) -> bytes:
        """The line, with its checksum."""
        number = "" if self.id is None else f" {self.id:02d}"
        body = f"{self.device} {self.axis}{number} {self.text}".rstrip()
        return f"/{body}:{checksum(body):02X}\n".encode("ascii")


@dataclass(frozen=True, slots=True)
class Reply:
    """A reply (``@``) as it travels."""

    device: int
    axis: int = 0
    id: int | None = None
    accepted: bool = True
    busy: bool = False
    warning: str = "--"
    """The flag of the highest priority; -- = none."""
    data: str = "0"
    """An answer, 0 where there is none, or the reason of a rejection."""

    def encode(self, with_checksum: bool = True) -> bytes:
        """The line."""
        number = "" if self.id is None else f" {self.id:02d}"
        flag = "OK" if self.accepted else "RJ"
        data = f" {self.data}" if self.data else ""
        body = f"{self.device:02d} {self.axis}{number} {flag} {'BUSY' if self.busy else 'IDLE'} {self.warning}{data}"
        end = f":{checksum(body):02X}" if with_checksum else ""
        return f"@{body}{end}\r\n".encode("ascii")


def decode_command(line: bytes) -> Command:
    """A command; its checksum is checked where there is one.

    Raises:
        Malformed: no command, or damaged.
    """
    found = _COMMAND.fullmatch(_checked(line))
    if found is None:
        raise Malformed(f"found {line[:40]!r}, need a command that begins with /")
    device, axis, number, text = found.groups()
    return Command(text.strip(), int(device or 0), int(axis or 0), None if number is None else int(number))


def decode_reply(line: bytes) -> Reply | None:
    """A reply, or None for an alert (``!``) or an info (``#``); its checksum is checked where there is one.

    Raises:
        Malformed: none of them, or damaged.
    """
    text = _checked(line)
    found = _REPLY.fullmatch(text)
    if found is None:
        raise Malformed(f"found {line[:40]!r}, need a reply that begins with @, ! or #")
    kind, device, axis, number, rest = found.groups()
    if kind == "#":
        return None
    state = _STATE.fullmatch(rest or "")
    if state is None or (kind == "@") != (state[1] is not None):
        raise Malformed(f"found {line[:40]!r}, need OK or RJ, IDLE or BUSY, and a warning flag")
    if kind == "!":
        return None
    id_ = None if number is None else int(number)
    return Reply(int(device), int(axis), id_, state[1] == "OK", state[2] == "BUSY", state[3], state[4] or "")


def _checked(line: bytes) -> str:
    """The text without its end and its checksum."""
    try:
        text = line.decode("ascii").strip("\r\n")
    except UnicodeDecodeError as wrong:
        raise Malformed(f"found {line[:40]!r}, need ASCII") from wrong
    body, colon, end = text.rpartition(":")
    if not colon or not re.fullmatch("[0-9A-Fa-f]{2}", end):
        return text
    if checksum(body[1:]) != int(end, 16):
        raise Malformed(f"found checksum {end} at {line[:40]!r}, need {checksum(body[1:]):02X}")
    return body
