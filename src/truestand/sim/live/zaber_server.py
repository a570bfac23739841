"""The virtual table as a Zaber stage: the ASCII protocol, over TCP or a pseudo terminal.

One device with one axis, and enough of the protocol that Zaber's own software can use it.
"""

from math import tau

from truestand.devices.tables.recipe import PORTS, ControllerRecipe
from truestand.devices.wire.malformed import Malformed
from truestand.devices.wire.zaber import SPEED_UNIT, Reply, decode_command
from truestand.sim.live.servers import LineServer, Receive, Send
from truestand.sim.live.table import VirtualTable

DEVICE = {
    "deviceid": "30222", "version": "7.45", "version.build": "17370", "system.serial": "900001",
    "system.access": "1", "system.led.enable": "1", "system.platform": "0", "system.temperature": "31.5",
    "system.voltage": "48.0", "comm.alert": "0", "comm.checksum": "0", "comm.protocol": "2",
    "comm.rs232.baud": "115200", "comm.rs232.protocol": "2", "comm.usb.protocol": "2", "comm.next.owner": "0",
    "device.id": "30222", "peripheral.serial": "0", "peripheralid": "0", "peripheral.id": "0",
}  # fmt: skip
"""Settings that stay as they are. A rotary stage with an integrated controller."""
MAX_LINE = 80
"""Characters of a command, as a device of version 7."""
REJECTED = "RJ "
"""What stands before the reason of a rejection."""


class ZaberServer(LineServer):
    """Serves one table."""

    def __init__(self, table: VirtualTable, recipe: ControllerRecipe) -> None:
        super().__init__(recipe.address, PORTS["zaber"])
        r = recipe.zaber
        self.table = table
        self.device, self.axes = r.device, r.axis
        self.checksums = False
        self._counts_per_rad = r.counts_per_turn / tau
        top = table.motion.top_speed * self._counts_per_rad * SPEED_UNIT
        self._settings = {**DEVICE, "comm.address": str(r.device), "system.axiscount": str(r.axis),
                          "limit.min": "-1000000000", "limit.max": "1000000000", "limit.speed": f"{top:.0f}",
                          "maxspeed": f"{top / 2:.0f}", "accel": "205", "motion.accelonly": "205",
                          "motion.decelonly": "205", "resolution": "64", "limit.cycle.dist": str(r.counts_per_turn),
                          "limit.home.pos": "0", "motion.index.dist": "0", "driver.enabled": "1",
                          "parking.state": "0", "user.data.0": "0"}  # fmt: skip

    def _connected(self, send: Send) -> Receive:
        rest = b""

        def receive(data: bytes) -> None:
            """Lines end with CR, LF or both."""
            nonlocal rest
            *lines, rest = (rest + data).replace(b"\r", b"\n").split(b"\n")
            rest = rest[: 2 * MAX_LINE]
            for line in lines:
                reply = self.reply(line[line.find(b"/") :]) if b"/" in line else None
                if reply is not None:
                    send(reply.encode(with_checksum=self.checksums))

        return receive

    def reply(self, line: bytes) -> Reply | None:
        """The reply to a command; None to a line that can't be read, or is meant for another device."""
        try:
            command = decode_command(line)
        except Malformed:
            return None
        if command.device not in (0, self.device):
            return None
        self.checksums = b":" in line
        if len(line) > MAX_LINE:
            data = "RJ BADMESSAGE"
        elif command.axis > self.axes:
            data = "RJ BADAXIS"
        else:
            data = self._execute(command.text.split())
        status, flags = self.table.status(), self._flags()
        accepted, data = not data.startswith(REJECTED), data.removeprefix(REJECTED)
        return Reply(self.device, command.axis, command.id, accepted, status.moving, (*flags, "--")[0], data)

    def _flags(self) -> list[str]:
        status = self.table.status()
        return [*(["FS"] if status.fault else []), *([] if status.homed else ["WR"])]

    def _execute(self, words: list[str]) -> str:
        """The data of the reply to a command."""
        match words:
            case ["home", *_]:
                return _taken(self.table.home())
            case ["stop" | "estop", *_]:
                return _taken(self.table.halt())
            case ["move", "vel" | "abs" | "rel" as kind, *numbers]:
                return self._move(kind, numbers)
            case ["get", name, *_]:
                return self._get(name)
            case ["set", name, value] if name in self._settings:
                return self._set(name, value)
            case ["warnings", *rest]:
                return self._warnings(clear=rest == ["clear"])
            case ["renumber", *rest]:
                return self._renumber(rest)
        return _without_effect(words)

    def _move(self, kind: str, numbers: list[str]) -> str:
        """``move abs|rel|vel value [speed [acceleration]]``; the acceleration is the table's own."""
        try:
            value = float(numbers[0])
            speed = float(numbers[1] if len(numbers) > 1 else self._settings["maxspeed"])
        except (ValueError, IndexError):
            return "RJ BADDATA"
        if kind == "vel":
            return self._turn(value)
        target = value + (self.table.status().position * self._counts_per_rad if kind == "rel" else 0.0)
        if not float(self._settings["limit.min"]) <= target <= float(self._settings["limit.max"]) or speed <= 0:
            return "RJ BADDATA"
        return _taken(self.table.move(target / self._counts_per_rad, speed / SPEED_UNIT / self._counts_per_rad))

    def _turn(self, speed: float) -> str:
        if abs(speed) > self._speed_limit():
            return "RJ BADDATA"
        return _taken(self.table.turn(speed / SPEED_UNIT / self._counts_per_rad))

    def _speed_limit(self) -> float:
        """The setting, which is rounded, and one more."""
        return float(self._settings["limit.speed"]) + 1

    def _get(self, name: str) -> str:
        if name in ("pos", "encoder.pos"):
            return f"{self.table.status().position * self._counts_per_rad:.0f}"
        if name == "comm.checksum":
            return str(int(self.checksums))
        return self._settings.get(name, "RJ BADCOMMAND")

    def _set(self, name: str, value: str) -> str:
        """Change a setting to a number; the speed only within its limits."""
        try:
            number = float(value)
        except ValueError:
            return "RJ BADDATA"
        if name == "maxspeed" and not 0 < number <= self._speed_limit():
            return "RJ BADDATA"
        self._settings[name] = value
        return "0"

    def _warnings(self, clear: bool) -> str:
        flags = self._flags()
        if clear:
            self.table.reset()
        return " ".join([f"{len(flags):02d}", *flags])

    def _renumber(self, words: list[str]) -> str:
        """One device: it takes the number that it is given, or the first."""
        self.device = int(words[0]) if words and words[0].isdigit() and 0 < int(words[0]) < 100 else 1
        self._settings["comm.address"] = str(self.device)
        return "0"


def _without_effect(words: list[str]) -> str:
    """The data of the reply to a command that changes nothing here."""
    match words:
        case ["tools", "echo", *rest]:
            return " ".join(rest)
        case ["io", "info"]:
            return "0 0 0 0"
        case [] | ["io", *_] | ["driver", "enable" | "disable", *_]:
            return "0"
    return "RJ BADCOMMAND"


def _taken(taken: bool) -> str:
    return "0" if taken else "RJ DRIVERDISABLED"
