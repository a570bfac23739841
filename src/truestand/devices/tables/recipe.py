"""``[devices.table]`` of stand.toml: which protocol, where, which limits; register map, node names, axis.

The defaults of each protocol's own table are what the virtual table serves.
"""

import re
from math import inf, radians
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, model_validator

from truestand.devices.axis import Limits
from truestand.files.checking import Recipe

Protocol = Literal["modbus", "opcua", "zaber", "grbl"]
Register = Annotated[int, Field(ge=0, le=65534)]


def _ordered(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise ValueError("need [lowest, highest]")
    return pair


Reach = Annotated[tuple[float, float], AfterValidator(_ordered)]
"""Lowest and highest position of an axis."""
PORTS = {"modbus": 502, "zaber": 55550, "grbl": 23}
"""Default network ports: Modbus TCP, Zaber's X-MCC and virtual devices, GRBL boards with a network (telnet)."""


class ModbusRecipe(Recipe):
    """``[devices.table.modbus]``: registers count from 0; numbers of 32 bit take two registers, signed.

    | register | what | who writes |
    |---|---|---|
    | ``command`` | bits: 0 home, 1 move, 3 halt, 4 reset; high byte: the command's number, 1..255 | truestand |
    | ``target`` | int32, counts from home | truestand, before ``command`` |
    | ``speed`` | int32, counts per second | truestand, before ``command`` |
    | ``heartbeat`` | counts up ten times a second; the PLC stops the table where it no longer changes | truestand |
    | ``status`` | bits: 0 homed, 1 moving, 2 fault; high byte: number of the last command accepted | PLC |
    | ``position`` | int32, counts from home | PLC |
    | ``fault_code`` | the fault, by the maker's number | PLC |

    The number goes up with every command, so that two equal commands differ, and the PLC repeats it only when its
    ``moving`` bit is up to date: a table that has not begun to move can't be taken for one that has arrived.
    """

    unit: Annotated[int, Field(ge=0, le=255)] = 1
    counts_per_turn: PositiveInt = 360000
    words: Literal["high-first", "low-first"] = "high-first"
    """Order of the two registers of a number."""
    status_in: Literal["holding", "input"] = "holding"
    """Registers that the PLC writes: holding (function 3) or input registers (function 4)."""
    command: Register = 0
    target: Register = 1
    speed: Register = 3
    heartbeat: Register | None = None
    status: Register = 16
    position: Register = 17
    fault_code: Register = 19

    @model_validator(mode="after")
    def _apart(self) -> "ModbusRecipe":
        """Each register has one meaning, and the registers of one request lie together."""
        writes = [self.command, self.target, self.target + 1, self.speed, self.speed + 1]
        writes += [] if self.heartbeat is None else [self.heartbeat]
        reads = [self.status, self.position, self.position + 1, self.fault_code]
        groups = [writes + reads] if self.status_in == "holding" else [writes, reads]
        for used in groups:
            if len(set(used)) < len(used):
                twice = next(r for r in used if used.count(r) > 1)
                raise ValueError(f"register {twice} is used twice; a number of 32 bit takes two registers")
        if max(reads) - min(reads) >= 100:
            raise ValueError("status, position and fault_code are read at once; they must lie within 100 registers")
        return self


class OpcUaRecipe(Recipe):
    """``[devices.table.opcua]``: an object with methods and variables, found by their names under Objects.

    Methods: ``home()``, ``move(target, speed)``, ``halt()``, ``reset()``, doubles in ``unit``.
    Variables: ``position`` (double), ``moving``, ``homed`` (boolean), ``fault`` (string, empty = none).
    """

    namespace: str = "urn:truestand:table"
    object: str = "RotaryTable"
    """Browse name under Objects; a path with slashes where it lies deeper."""
    unit: Literal["deg", "rad"] = "deg"
    home: str = "Home"
    move: str = "MoveTo"
    turn: str = "Turn"
    """Not called any more; recipes that state it stay valid."""
    halt: str = "Stop"
    reset: str = "Reset"
    position: str = "Position"
    moving: str = "Moving"
    homed: str = "Homed"
    fault: str = "Fault"


class ZaberRecipe(Recipe):
    """``[devices.table.zaber]``: device and axis on the chain; microsteps as the stage's data sheet says."""

    device: Annotated[int, Field(ge=1, le=99)] = 1
    axis: Annotated[int, Field(ge=1, le=9)] = 1
    counts_per_turn: PositiveInt = 576000
    """360 deg over the microstep size in the stage's data sheet; 0.000625 deg gives 576,000."""
    baud: PositiveInt = 115200


class GrblRecipe(Recipe):
    """``[devices.table.grbl]``: a board with GRBL 1.1 (or grblHAL, FluidNC) whose axis turns the table."""

    axis: Literal["X", "Y", "Z", "A", "B", "C"] = "X"
    axes: Annotated[str, Field(pattern="^[XYZABC]{1,6}$")] = "XYZ"
    """In the order in which the board reports them."""
    degrees_per_unit: PositiveFloat = 1.0
    """A board that counts its axis in degrees: 1; in turns: 360."""
    baud: PositiveInt = 115200

    @model_validator(mode="after")
    def _known(self) -> "GrblRecipe":
        if self.axis not in self.axes:
            raise ValueError(f"axis {self.axis!r} is not among axes {self.axes!r}")
        return self


class ControllerRecipe(Recipe):
    """What a table and an axis of a positioner share: which controller turns it, and how long it may take."""

    protocol: Protocol
    address: Annotated[str, Field(min_length=1)]
    """``host:port``, ``opc.tcp://host:port/path``, or a serial port: ``/dev/ttyUSB0``, ``COM3``."""
    home_timeout_s: PositiveFloat = 60.0
    stop_timeout_s: PositiveFloat = 5.0
    timeout_s: PositiveFloat = 0.5
    """Of the connection: a controller that does not answer for longer is lost."""
    modbus: ModbusRecipe = ModbusRecipe()
    opcua: OpcUaRecipe = OpcUaRecipe()
    zaber: ZaberRecipe = ZaberRecipe()
    grbl: GrblRecipe = GrblRecipe()

    @model_validator(mode="after")
    def _matching(self) -> "ControllerRecipe":
        """The address is one of the protocol."""
        if (self.protocol == "opcua") != self.address.startswith("opc.tcp://"):
            wanted = "opc.tcp://host:port" if self.protocol == "opcua" else "host:port or a serial port"
            raise ValueError(f"address {self.address!r} is none for {self.protocol}; need {wanted}")
        if self.protocol == "modbus":
            host_and_port(self.address, PORTS["modbus"])
        return self

    def within(self, speed: float, reach: Reach | None, tolerance: float) -> Limits:
        """Limits and timeouts, of a speed, a range and a tolerance in deg (or mm, of a linear axis)."""
        lowest, highest = reach or (-inf, inf)
        return Limits(
            radians(speed), radians(lowest), radians(highest), radians(tolerance), self.home_timeout_s,
            self.stop_timeout_s,
        )  # fmt: skip


class TableRecipe(ControllerRecipe):
    """``[devices.table]``."""

    max_speed_deg_per_s: PositiveFloat = 90.0
    range_deg: Reach | None = None
    """For a table with stops; without it the table turns endlessly."""
    tolerance_deg: PositiveFloat = 0.05

    @property
    def unit(self) -> str:
        """Of its positions, in messages."""
        return "deg"

    @property
    def limits(self) -> Limits:
        """Limits and timeouts of the table."""
        return self.within(self.max_speed_deg_per_s, self.range_deg, self.tolerance_deg)


def host_and_port(address: str, port: int) -> tuple[str, int]:
    """``host`` or ``host:port``, with or without ``socket://``, as both.

    Raises:
        ValueError: neither.
    """
    found = re.fullmatch(r"(?:socket://)?\[?([\w.\-]+|(?<=\[)[\w.:]+)\]?(?::(\d{1,5}))?", address)
    if found is None or int(found[2] or port) > 65535:
        raise ValueError(f"address {address!r} is none for a network; need host:port")
    return found[1], int(found[2] or port)


def is_network(address: str) -> bool:
    """Whether ``address`` is ``host:port`` rather than a serial port."""
    return re.fullmatch(r"(socket://.*|[^/\\]+:\d{1,5})", address) is not None
