"""The virtual stand in motion: one clock, a table behind its protocol, sensors that see where the table really is."""

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from ipaddress import ip_address
from types import TracebackType
from typing import Protocol, Self

from truestand.core.artefact import Artefact
from truestand.core.errors import BadRecipe, DeviceError
from truestand.core.stand import Stand
from truestand.devices.tables.recipe import TableRecipe
from truestand.devices.wire.gvcp import PORT
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.gige_device import GigeDevice
from truestand.sim.live.profile_source import SimulatedSource, TableTop
from truestand.sim.live.registers import Identity
from truestand.sim.live.scancontrol_frames import scale_of
from truestand.sim.live.table import Motion, VirtualTable
from truestand.sim.parts import VirtualPart
from truestand.sim.simulation import Simulation
from truestand.sim.truth import Truth


@dataclass(frozen=True, slots=True)
class SensorEndpoint:
    """Where a virtual sensor is, and which type it is. The recipe of a sensor knows the drivers, which sim may not."""

    name: str
    """As the [[sensor]]'s."""
    address: str
    """IPv4, 127.x.x.x."""
    model: str = "29xx-50"
    """scanCONTROL type."""
    points: int = 640
    rate: float = 200.0
    """Profiles per second that the truth is told for; the driver sets the rate."""


class Server(Protocol):
    """A table behind a protocol."""

    address: str
    """Where a driver finds it, known once it started."""

    def start(self) -> None:
        """Bind its sockets and answer."""

    def stop(self) -> None:
        """Close them."""


class VirtualStand:
    """Table and sensors, ready to be started; also as a context.

    Args:
        clock: the stand's time.
        table: what turns.
        sensors: by name; their faults may be those of the table too.
        servers: the table's, by protocol.
    """

    def __init__(
        self, clock: Clock, table: VirtualTable, sensors: dict[str, GigeDevice], servers: dict[str, Server]
    ) -> None:
        self.clock, self.table, self.sensors, self.servers = clock, table, sensors, servers
        self._running = ExitStack()

    def start(self) -> None:
        """Bind all sockets.

        Raises:
            DeviceError: one of them is taken, or not this machine's.
        """
        with ExitStack() as started:
            for name, server in self.servers.items():
                try:
                    server.start()
                except OSError as wrong:
                    raise DeviceError(
                        f"virtual table: can't serve {name} ({wrong}); take another port in [devices.table], or end "
                        "the program that holds this one"
                    ) from wrong
                started.callback(server.stop)
            for sensor in self.sensors.values():
                started.enter_context(sensor)
            self._running = started.pop_all()

    def close(self) -> None:
        """End everything, leave all sockets."""
        self._running.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def addresses(self) -> list[str]:
        """Where everything is: "table modbus 127.0.0.1:5020", "sensor front 127.0.0.11:3956"."""
        tables = [f"table {protocol} {server.address}" for protocol, server in self.servers.items()]
        return tables + [f"sensor {name} {device.identity.address}:{PORT}" for name, device in self.sensors.items()]

    def begin(self, kind: FaultKind, strength: float | None = None) -> None:
        """A fault of all sensors, or of the table; ``NONE`` ends all.

        Raises:
            BadRecipe: a strength that can't be.
        """
        for device in self.sensors.values():
            device.faults.begin(kind, strength)

    def mount(self, part: bool) -> None:
        """Put the shaft alone, or with the part, on the table.

        Raises:
            BadRecipe: there is no part.
        """
        for device in self.sensors.values():
            device.source.mount(part)

    def truth(self, part: bool = False) -> Truth:
        """What is true of the stand as its first sensor sees it, of the shaft alone or with the part."""
        source = next(iter(self.sensors.values())).source
        if not isinstance(source, SimulatedSource):
            raise BadRecipe("a recorded source has no truth")
        return source.truth(part)


def virtual_stand(
    stand: Stand,
    simulation: Simulation,
    artefact: Artefact,
    table: TableRecipe,
    sensors: Sequence[SensorEndpoint],
    part: VirtualPart | None = None,
    pace: float = 1.0,
    seed: int = 0,
) -> VirtualStand:
    """The virtual stand that a stand.toml describes: [simulation] behind [devices].

    Of ``simulation.acquisition`` the table takes its ripple; everything else of it is up to whoever scans.

    Raises:
        BadRecipe: no scanCONTROL type, an address that is not this machine's own, a part that can't be.
    """
    _own("[devices.table]", table.address.removeprefix("opc.tcp://").rpartition(":")[0] or table.address)
    clock = Clock(pace)
    ripple = simulation.acquisition
    turning = VirtualTable(clock, Motion(ripple=ripple.ripple, ripple_per_turn=ripple.ripple_per_turn))
    top = TableTop()
    devices = {
        place.name: _sensor(place, stand, simulation, artefact, turning, part, clock, top, seed + number)
        for number, place in enumerate(sensors)
    }
    return VirtualStand(clock, turning, devices, {table.protocol: table_server(turning, table)})


def table_server(table: VirtualTable, recipe: TableRecipe) -> Server:
    """The table behind the protocol of its recipe. Only what is needed is loaded."""
    if recipe.protocol == "modbus":
        from truestand.sim.live.modbus_server import ModbusServer

        return ModbusServer(table, recipe)
    if recipe.protocol == "zaber":
        from truestand.sim.live.zaber_server import ZaberServer

        return ZaberServer(table, recipe)
    if recipe.protocol == "grbl":
        from truestand.sim.live.grbl_server import GrblServer

        return GrblServer(table, recipe)
    from truestand.sim.live.opcua_server import OpcUaServer

    return OpcUaServer(table, recipe)


def _sensor(
    place: SensorEndpoint,
    stand: Stand,
    simulation: Simulation,
    artefact: Artefact,
    table: VirtualTable,
    part: VirtualPart | None,
    clock: Clock,
    top: TableTop,
    seed: int,
) -> GigeDevice:
    _own(f'sensor "{place.name}"', place.address)
    of = next(s for s in stand.sensors if s.name == place.name)
    alone = replace(stand, sensors=(replace(of, points=place.points, profile_rate=place.rate),))
    source = SimulatedSource(alone, simulation, artefact, table, scale_of(place.model), part, seed, top=top)
    identity = Identity(place.address, _plate(place.model), of.serial or f"V{seed + 1:07d}", place.name[:15])
    return GigeDevice(identity, source, clock, Faults(table), place.points, seed=seed)


def _plate(model: str) -> str:
    """The type as the device says it."""
    return f"scanCONTROL {model}" if model[:1].isdigit() else model


def _own(whose: str, host: str) -> None:
    """Refuse an address that others could reach: the virtual stand has no password."""
    try:
        own = host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        own = host.startswith("/") or "." not in host  # a serial port
    if not own:
        raise BadRecipe(f"{whose}: found address {host}, the virtual stand needs one of this machine (127.0.0.x)")


def names_of(addresses: Iterable[str]) -> str:
    """One line for people and programs that wait for it."""
    return " · ".join(["ready", *addresses])
