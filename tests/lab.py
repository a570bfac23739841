"""A virtual lab in this process: table and sensors behind their real protocols on loopback, and their stand.toml."""

import itertools
import os
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from patience import NOT_FOR_EVER
from truestand.devices.tables.recipe import TableRecipe
from truestand.files.recipes.parts import read_part, read_part_simulation
from truestand.files.recipes.recipes import read_shaft, read_simulation, read_stand, write_starters
from truestand.sim import simulation_from, virtual_part_from
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import FaultKind, Faults
from truestand.sim.live.gige_device import GigeDevice
from truestand.sim.live.modbus_server import ModbusServer
from truestand.sim.live.profile_source import SimulatedSource
from truestand.sim.live.registers import Identity
from truestand.sim.live.table import VirtualTable
from truestand.station.recipe import read_devices, scan_settings
from truestand.station.scan import ScanOutcome, take_scan

_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
_hosts = itertools.count(10)


@dataclass
class Lab:
    folder: Path
    clock: Clock
    table: VirtualTable
    server: ModbusServer
    sensors: list[GigeDevice]
    faults: Faults
    since_fault: float | None = None
    """Real s from the fault's begin to table at rest and lasers off; None: that did not come."""
    _watching: list[threading.Thread] = field(default_factory=list)

    @property
    def recipe(self) -> Path:
        return self.folder / "stand.toml"

    @property
    def at_rest(self) -> bool:
        now = self.clock.now()
        before, after = self.table.angle_at([now - 0.02, now])
        return before == after

    @property
    def safe(self) -> bool:
        return self.at_rest and not any(sensor.laser for sensor in self.sensors)

    def take(self, name="k1.h5", show=lambda live: None, **options) -> ScanOutcome:
        stand, devices = read_devices(self.recipe)
        settings = scan_settings(stand, devices.acquire, options.pop("turns", None))
        outcome = take_scan(self.recipe, stand, devices, settings, self.folder / name, show, **options)
        for thread in self._watching:
            thread.join()
        return outcome

    def failing(self, begin, at=0.4):
        """A ``show`` that begins something at a share of the scan, and measures how long the stand then goes on."""
        begun = []

        def show(live) -> None:
            if live.done > at and not begun:
                begun.append(time.monotonic())
                thread = threading.Thread(target=self._until_safe, args=(begun[0],))
                self._watching.append(thread)
                thread.start()
                begin()

        return show

    def _until_safe(self, since: float) -> None:
        while time.monotonic() - since < NOT_FOR_EVER:
            if self.safe and time.monotonic() - since > 0.05:
                self.since_fault = time.monotonic() - since
                return
            time.sleep(0.01)

    def put(self, part: str | None) -> None:
        """What an operator's hands do: the shaft alone, or the part of a recipe in the folder, on the table."""
        for sensor in self.sensors:
            if part is not None:
                recipe = self.folder / part
                virtual = virtual_part_from(read_part(recipe), read_part_simulation(recipe), part)
                sensor.source.replace_part(virtual)
            sensor.source.mount(part is not None)

    def fault(self, kind: FaultKind, strength: float | None = None):
        return lambda: self.faults.begin(kind, strength)


@contextmanager
def lab(folder, pace=5.0, points=64, turns=0.25, sensors=("front",), encoder=True, rate=200.0, acquire="",
        part=None, views="", **device):  # fmt: skip
    """The starter stand with few points, on ports and loopback addresses of its own; ``views``: [[simulation.view]]s.

    Sensors wait for their heartbeat as long as they can, for a busy machine may hold up this process for a second.
    """
    write_starters(folder, force=True)
    clock = Clock(pace)
    table = VirtualTable(clock)
    server = ModbusServer(table, TableRecipe(protocol="modbus", address="127.0.0.1:0"))
    faults = Faults(table)
    addresses = [own_address() for _ in sensors]
    server.start()
    recipe = folder / "stand.toml"
    recipe.write_text(_recipe(recipe.read_text(), server.address, sensors, addresses, points, turns, encoder, rate,
                              acquire, {"heartbeat_ms": 10_000, **device}) + views)  # fmt: skip
    described = read_stand(recipe)
    simulation = simulation_from(read_simulation(recipe))
    shaft = read_shaft(folder / "shaft.toml")
    devices, virtual = [], None
    if part is not None:
        virtual = virtual_part_from(read_part(folder / part), read_part_simulation(folder / part), part)
    try:
        for i, address in enumerate(addresses):
            one = type(described)(described.table, described.sensors[i : i + 1], described.y, described.counts_per_turn)
            seen = simulation.seen_from(sensors[i])
            source = SimulatedSource(one, seen, shaft, table, (0.002, 95.0), virtual, seed=i)
            source.mount(False)
            devices.append(GigeDevice(Identity(address, serial=f"V{i}"), source, clock, faults, points=points))
            devices[-1].start()
        yield Lab(folder, clock, table, server, devices, faults)
    finally:
        for device_ in devices:
            device_.close()
        server.stop()


def own_address() -> str:
    """A loopback address that no other test has."""
    return f"127.{20 + _worker}.{os.getpid() % 250}.{next(_hosts)}"


def _recipe(text, table, names, addresses, points, turns, encoder, rate, acquire, device):
    before, _, rest = text.partition("# Only `truestand acquire`")
    text = before + "# Only `truestand simulate`" + rest.partition("# Only `truestand simulate`")[2]
    head, sensor, rest = text.partition("[[sensor]]")
    block, scan, rest = rest.partition("[scan]")
    block = block.replace("points = 640", f"points = {points}").replace("= 200.0", f"= {rate}")
    blocks = "".join(sensor + block.replace('"front"', f'"{name}"') for name in names)
    keys = "".join(
        f"{key} = {value!r}\n".replace("True", "true").replace("False", "false") for key, value in device.items()
    )
    found = f'[devices.table]\nprotocol = "modbus"\naddress = "{table}"\n'
    for name, address in zip(names, addresses, strict=True):
        found += f'[[devices.sensor]]\nname = "{name}"\ndriver = "scancontrol"\naddress = "{address}"\n'
        found += f'model = "29xx-50"\nencoder = {str(encoder).lower()}\n{keys}'
    return f"{head}{blocks}{scan}{rest}\n{found}[devices.acquire]\nturns = {turns}\n{acquire}\n"
