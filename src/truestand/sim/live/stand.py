"""The virtual stand as devices: one clock, table and positioner behind their protocols, sensors where they stand."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from ipaddress import ip_address

from truestand.core.artefact import Artefact
from truestand.core.errors import BadRecipe, DeviceError
from truestand.core.stand import Stand
from truestand.devices.tables.recipe import ControllerRecipe, TableRecipe
from truestand.devices.wire.gvcp import PORT
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.gige_device import GigeDevice
from truestand.sim.live.positioner import AxisEndpoint, VirtualPositioner
from truestand.sim.live.profile_source import SimulatedSource
from truestand.sim.live.registers import Identity
from truestand.sim.live.scancontrol_frames import scale_of
from truestand.sim.live.servers import ServerThread, Service
from truestand.sim.live.table import Motion, VirtualTable
from truestand.sim.parts import VirtualPart
from truestand.sim.simulation import Simulation
from truestand.sim.truth import Truth


@dataclass(frozen=True, slots=True)
class SensorEndpoint:
    """Address and type of a virtual sensor. ``SensorRecipe`` would bring in the decoder, which sim must not share."""

    name: str
    """Of the device."""
    address: str
    """IPv4, 127.x.x.x."""
    model: str = "29xx-50"
    """scanCONTROL type."""
    points: int = 640
    rate: float = 200.0
    """Profiles per second, for the truth; the driver sets the rate."""
    view: str = ""
    """The [[sensor]] that it is, or the first one; empty: it has its name."""
    at: tuple[float, ...] | None = None
    """mm or rad: where the positioner's axes are when it takes that view; None: it stands there."""


class VirtualStand(Service):
    """Table, positioner and sensors, ready to be started.

    Args:
        clock: the stand's time.
        table: the rotary table.
        sensors: by name; their faults may be those of the table too.
        servers: of all that moves, by its name and protocol, the table first.
    """

    def __init__(
        self, clock: Clock, table: VirtualTable, sensors: dict[str, GigeDevice], servers: dict[str, ServerThread]
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
                        f"virtual {name}: can't serve ({wrong}); take another port under [devices], or end the "
                        "program that holds this one"
                    ) from wrong
                started.callback(server.stop)
            for sensor in self.sensors.values():
                started.enter_context(sensor)
            self._running = started.pop_all()

    def close(self) -> None:
        """End everything, close all sockets."""
        self._running.close()

    def addresses(self) -> list[str]:
        """Device, name and address of each: "table modbus 127.0.0.1:5020", "sensor front 127.0.0.11:3956"."""
        sensors = [f"sensor {name} {device.identity.address}:{PORT}" for name, device in self.sensors.items()]
        return [*(f"{name} {server.address}" for name, server in self.servers.items()), *sensors]

    def begin(self, kind: FaultKind, strength: float | None = None) -> None:
        """Begin a fault of all sensors, or of the table; ``NONE`` ends all.

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
        return next(iter(self.sensors.values())).source.truth(part)


def virtual_stand(
    stand: Stand,
    simulation: Simulation,
    artefact: Artefact,
    table: TableRecipe,
    sensors: Sequence[SensorEndpoint],
    part: VirtualPart | None = None,
    pace: float = 1.0,
    seed: int = 0,
    axes: Sequence[AxisEndpoint] = (),
    repeats_within: tuple[float, float] = (0.0, 0.0),
) -> VirtualStand:
    """The virtual stand that a stand.toml describes: [simulation] behind [devices].

    ``axes``: of the positioner; ``repeats_within``: mm and rad, standard deviations of where it brings its sensor.

    Of ``simulation.acquisition`` only the ripple is used, by the table; the program that scans decides the rest.

    Raises:
        BadRecipe: no scanCONTROL type, an address that is not this machine's own, a part that can't be.
    """
    for recipe in (table, *(axis.recipe for axis in axes)):
        host = recipe.address.removeprefix("opc.tcp://").rpartition(":")[0] or recipe.address
        _demand_loopback("[devices.table]" if recipe is table else "[[devices.positioner.axis]]", host)
    clock = Clock(pace)
    acquisition = simulation.acquisition
    turning = VirtualTable(clock, Motion(ripple=acquisition.ripple, ripple_per_turn=acquisition.ripple_per_turn))
    positioner = VirtualPositioner(clock, axes, repeats_within, seed)
    faults = Faults(turning, positioner.axes)
    devices = {
        endpoint.name: _sensor(endpoint, stand, simulation, artefact, turning, part, seed + number, positioner, faults)
        for number, endpoint in enumerate(sensors)
    }
    servers = {f"table {table.protocol}": axis_server(turning, table)} | {
        f"axis {axis.name} {axis.recipe.protocol}": axis_server(moving, axis.recipe)
        for axis, moving in zip(axes, positioner.axes, strict=True)
    }
    return VirtualStand(clock, turning, devices, servers)


def axis_server(table: VirtualTable, recipe: ControllerRecipe) -> ServerThread:
    """A table or an axis behind the protocol of its recipe. Only the library of this protocol is loaded."""
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
    endpoint: SensorEndpoint,
    stand: Stand,
    simulation: Simulation,
    artefact: Artefact,
    table: VirtualTable,
    part: VirtualPart | None,
    seed: int,
    positioner: VirtualPositioner,
    faults: Faults,
) -> GigeDevice:
    _demand_loopback(f'sensor "{endpoint.name}"', endpoint.address)
    view = endpoint.view or endpoint.name
    sensor = next(s for s in stand.sensors if s.name == view)
    alone = replace(stand, sensors=(replace(sensor, points=endpoint.points, profile_rate=endpoint.rate),))
    seen, at = simulation.seen_from(view), endpoint.at
    source = SimulatedSource(
        alone, seen, artefact, table, scale_of(endpoint.model), part, seed,
        (lambda: None) if at is None else (lambda: positioner.carried(seen.mounting, at, artefact)),
    )  # fmt: skip
    model = f"scanCONTROL {endpoint.model}" if endpoint.model[:1].isdigit() else endpoint.model
    identity = Identity(endpoint.address, model, sensor.serial or f"V{seed + 1:07d}", endpoint.name[:15])
    return GigeDevice(identity, source, table.clock, faults, endpoint.points, seed=seed)


def _demand_loopback(whose: str, host: str) -> None:
    """Refuse an address that other machines could reach: the virtual stand has no password."""
    try:
        local = host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        local = host.startswith("/") or "." not in host  # a serial port
    if not local:
        raise BadRecipe(f"{whose}: found address {host}, the virtual stand needs one of this machine (127.0.0.x)")
