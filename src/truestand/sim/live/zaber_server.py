"""The virtual table as a Zaber stage: the ASCII protocol, over TCP or a pseudo terminal.

One device with one axis; enough of it that Zaber's own software finds its way about.
"""

from math import tau

from truestand.devices.tables.recipe import PORTS, TableRecipe
from truestand.devices.wire.malformed import Malformed
from truestand.devices.wire.zaber import SPEED_UNIT, Command, Reply, decode_command
from truestand.sim.live.servers import LineServer, Send
from truestand.sim.live.table import VirtualTable

DEVICE = {
    "deviceid": "30222", "version": "7.45", "version.build": "17370", "system.serial": "900001",
    "system.access": "1", "system.led.enable": "1", "system.platform": "0", "system.temperature": "31.5",
    "system.voltage": "48.0", "comm.alert": "0", "comm.checksum": "0", "comm.protocol": "2",
    "comm.rs232.baud": "115200", "comm.rs232.protocol": "2", "comm.usb.protocol": "2", "comm.next.owner": "0",
    "device.id": "30222", "peripheral.serial": "0", "peripheralid": "0", "peripheral.id": "0",
}  # fmt: skip
"""Settings that stay as they are. A rotary stage with a controller inside."""
MOST = 80
"""Characters of a command, as a device of version 7."""


class ZaberServer(LineServer):
    """Serves one table."""

    def __init__(self, table: VirtualTable, recipe: TableRecipe) -> None:
        super().__init__(recipe.address, PORTS["zaber"])
        self.stage = _Stage(table, recipe)

    def _talk(self, send: Send) -> "_Talk":
        return _Talk(self.stage, send)


class _Talk:
    def __init__(self, stage: "_Stage", send: Send) -> None:
        self._stage, self._send, self._rest = stage, send, b""

    def hear(self, data: bytes) -> None:
        """Lines end with CR, LF or both."""
        *lines, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        self._rest = self._rest[: 2 * MOST]
        for line in lines:
            start = line.find(b"/")
            if start >= 0:
                reply = self._stage.answer(line[start:])
                if reply is not None:
                    self._send(reply.encode(with_checksum=self._stage.checksums))


class _Stage:
    """The device's side of the protocol."""

    def __init__(self, table: VirtualTable, recipe: TableRecipe) -> None:
        r = recipe.zaber
        self.table = table
        self.device, self.axes = r.device, r.axis
        self.checksums = False
        self._count = r.counts_per_turn / tau
        top = table.motion.top_speed * self._count * SPEED_UNIT
        self._settings = {**DEVICE, "comm.address": str(r.device), "system.axiscount": str(r.axis),
                          "limit.min": "-1000000000", "limit.max": "1000000000", "limit.speed": f"{top:.0f}",
                          "maxspeed": f"{top / 2:.0f}", "accel": "205", "motion.accelonly": "205",
                          "motion.decelonly": "205", "resolution": "64", "limit.cycle.dist": str(r.counts_per_turn),
                          "limit.home.pos": "0", "motion.index.dist": "0", "driver.enabled": "1",
                          "parking.state": "0", "user.data.0": "0"}  # fmt: skip

    def answer(self, line: bytes) -> Reply | None:
        """What the device says; nothing to what it can't read, or isn't told."""
        try:
            command = decode_command(line)
        except Malformed:
            return None
        if command.device not in (0, self.device):
            return None
        self.checksums = b":" in line
        words = command.text.split()
        if len(line) > MOST:
            return self._reply(command, "BADMESSAGE", accepted=False)
        if command.axis > self.axes:
            return self._reply(command, "BADAXIS", accepted=False)
        act = getattr(self, f"_{words[0]}", None) if words and words[0] in WORDS else None
        if words and act is None:
            return self._reply(command, "BADCOMMAND", accepted=False)
        data = "0" if act is None else act(words[1:], command)
        return self._reply(command, data.removeprefix("RJ "), accepted=not data.startswith("RJ "))

    def _reply(self, command: Command, data: str, accepted: bool = True) -> Reply:
        status = self.table.status()
        flag = (*self._flags(), "--")[0]
        return Reply(self.device, command.axis, command.id, accepted, status.moving, flag, data)

    def _flags(self) -> list[str]:
        status = self.table.status()
        return [*(["FS"] if status.fault else []), *([] if status.homed else ["WR"])]

    def _home(self, words: list[str], command: Command) -> str:
        return _done(self.table.home())

    def _stop(self, words: list[str], command: Command) -> str:
        return _done(self.table.halt())

    _estop = _stop

    def _move(self, words: list[str], command: Command) -> str:
        """``move abs|rel|vel value [speed [acceleration]]``; the acceleration is the table's own."""
        try:
            kind, value, *further = words
            number = float(value)
            speed = float(further[0]) if further else float(self._settings["maxspeed"])
        except ValueError:
            return "RJ BADDATA" if words and words[0] in ("abs", "rel", "vel") else "RJ BADCOMMAND"
        if kind == "vel":
            return self._turn(number)
        if kind not in ("abs", "rel"):
            return "RJ BADCOMMAND"
        target = number + (self.table.status().position * self._count if kind == "rel" else 0.0)
        if not float(self._settings["limit.min"]) <= target <= float(self._settings["limit.max"]) or speed <= 0:
            return "RJ BADDATA"
        return _done(self.table.move(target / self._count, speed / SPEED_UNIT / self._count))

    def _turn(self, speed: float) -> str:
        if abs(speed) > float(self._settings["limit.speed"]) + 1:
            return "RJ BADDATA"
        return _done(self.table.turn(speed / SPEED_UNIT / self._count))

    def _get(self, words: list[str], command: Command) -> str:
        status, name = self.table.status(), words[0] if words else ""
        if name in ("pos", "encoder.pos"):
            return f"{status.position * self._count:.0f}"
        if name == "comm.checksum":
            return str(int(self.checksums))
        return self._settings.get(name, "RJ BADCOMMAND")

    def _set(self, words: list[str], command: Command) -> str:
        """Settings that move something are taken where they make sense."""
        if len(words) != 2 or words[0] not in self._settings:
            return "RJ BADCOMMAND"
        name, value = words
        try:
            fits = name != "maxspeed" or 0 < float(value) <= float(self._settings["limit.speed"]) + 1
            float(value)
        except ValueError:
            return "RJ BADDATA"
        if not fits:
            return "RJ BADDATA"
        self._settings[name] = value
        return "0"

    def _warnings(self, words: list[str], command: Command) -> str:
        flags = self._flags()
        if words == ["clear"]:
            self.table.reset()
        return " ".join([f"{len(flags):02d}", *flags])

    def _driver(self, words: list[str], command: Command) -> str:
        return "0" if words and words[0] in ("enable", "disable") else "RJ BADCOMMAND"

    def _tools(self, words: list[str], command: Command) -> str:
        return " ".join(words[1:]) if words[:1] == ["echo"] else "RJ BADCOMMAND"

    def _io(self, words: list[str], command: Command) -> str:
        return "0 0 0 0" if words == ["info"] else "0"

    def _renumber(self, words: list[str], command: Command) -> str:
        """One device: it takes the number that it is given, or the first."""
        self.device = int(words[0]) if words and words[0].isdigit() and 0 < int(words[0]) < 100 else 1
        self._settings["comm.address"] = str(self.device)
        return "0"


WORDS = frozenset(
    ("home", "stop", "estop", "move", "get", "set", "warnings", "driver", "tools", "io", "renumber")
)  # fmt: skip


def _done(taken: bool) -> str:
    return "0" if taken else "RJ DRIVERDISABLED"
