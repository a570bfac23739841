"""A virtual lab whose one sensor is carried by a positioner: lift and swivel, behind two protocols."""

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import radians

from lab import Lab, own_address
from truestand.devices.positioner import AxisRecipe
from truestand.devices.tables.recipe import TableRecipe
from truestand.files.recipes.recipes import read_shaft, read_simulation, read_stand, write_starters
from truestand.sim import simulation_from
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import Faults
from truestand.sim.live.gige_device import GigeDevice
from truestand.sim.live.positioner import AxisEndpoint, VirtualPositioner
from truestand.sim.live.profile_source import SimulatedSource
from truestand.sim.live.registers import Identity
from truestand.sim.live.stand import axis_server
from truestand.sim.live.table import VirtualTable

LIFT = {"name": "lift", "direction": (0.0, 0.0, 1.0), "range_mm": (0.0, 200.0), "protocol": "zaber"}
SWIVEL = {
    "name": "swivel", "kind": "rotary", "direction": (0.0, 1.0, 0.0), "through_mm": (12.5, 0.0, -15.0),
    "range_deg": (-45.0, 45.0), "protocol": "modbus",
}  # fmt: skip
AT = {"front": (20.0, 20.0), "rear": (20.0, -20.0)}
"""mm and degrees."""
SWEPT = "swept = [{ radius_mm = 12.5, from_mm = -60.0, to_mm = 35.0 }]"


@dataclass
class PositionedLab(Lab):
    positioner: VirtualPositioner = None
    axis_servers: tuple = ()

    @property
    def at_rest(self) -> bool:
        return Lab.at_rest.fget(self) and not any(axis.status().moving for axis in self.positioner.axes)


@contextmanager
def positioned_lab(folder, pace=8.0, points=64, turns=0.1, at=None, swept=SWEPT, plan="", axis="", repeats=(0.0, 0.0)):
    """``at``: mm and degrees of each view; ``plan``, ``axis``: further lines of [plan] and of each axis."""
    write_starters(folder, force=True)
    clock, address = Clock(pace), own_address()
    table = VirtualTable(clock)
    endpoints = [
        AxisEndpoint("lift", _recipe(LIFT), True, LIFT["direction"], (0.0, 0.0, 0.0)),
        AxisEndpoint("swivel", _recipe(SWIVEL), False, SWIVEL["direction"], SWIVEL["through_mm"]),
    ]
    positioner = VirtualPositioner(clock, endpoints, repeats, seed=1)
    with ExitStack() as running:
        servers = [axis_server(table, TableRecipe(protocol="modbus", address="127.0.0.1:0"))]
        servers += [axis_server(a, e.recipe) for a, e in zip(positioner.axes, endpoints, strict=True)]
        for server in servers:
            server.start()
            running.callback(server.stop)
        recipe = folder / "stand.toml"
        recipe.write_text(_text([s.address for s in servers], address, points, turns, at or AT, swept, plan, axis))
        stand = read_stand(recipe)
        simulation = simulation_from(read_simulation(recipe)).seen_from("front")
        alone = stand.of_view("front")
        first = tuple(v if k == 0 else radians(v) for k, v in enumerate(AT["front"]))
        shaft = read_shaft(folder / "shaft.toml")
        source = SimulatedSource(
            alone, simulation, shaft, table, (0.002, 95.0), None, 1,
            lambda: positioner.carried(simulation.mounting, first, shaft),
        )  # fmt: skip
        source.mount(False)
        faults = Faults(table, positioner.axes)
        device = GigeDevice(Identity(address, serial="V1"), source, clock, faults, points=points)
        device.start()
        running.callback(device.close)
        yield PositionedLab(
            folder, clock, table, servers[0], [device], faults, None, [], positioner, tuple(servers[1:])
        )


def _recipe(axis):
    return AxisRecipe(address="127.0.0.1:0", **axis)


def _text(servers, sensor, points, turns, at, swept, plan, more):
    views = "".join(
        f'[[sensor]]\nname = "{name}"\ndevice = "scanner"\nprofile_rate_hz = 200.0\npoints = {points}\n'
        f"range_mm = [70.0, 120.0]\nhousing_mm = [90.0, 40.0, 60.0]\n"
        f"position = {{ lift_mm = {lift}, swivel_deg = {swivel} }}\n"
        for name, (lift, swivel) in at.items()
    )
    axes = "".join(_axis_text(axis, address, more) for axis, address in zip((LIFT, SWIVEL), servers[1:], strict=True))
    return (
        f'[table]\nspeed_rad_per_s = 0.3141592653589793\nstart = "home"\n[scan]\ncounts_per_turn = 360000\n{views}'
        f'[devices.table]\nprotocol = "modbus"\naddress = "{servers[0]}"\n'
        f'[[devices.sensor]]\nname = "scanner"\ndriver = "scancontrol"\naddress = "{sensor}"\nmodel = "29xx-50"\n'
        f"heartbeat_ms = 10000\n[devices.positioner]\nposition_U_um = 4.0\nposition_U_deg = 0.002\n{swept}\n"
        f"at_zero = {{ phi_deg = -90.0, radial_mm = 120.5, height_mm = -15.0 }}\n{axes}"
        f"[devices.acquire]\nturns = {turns}\n[plan]\ntable_disc_mm = 140.0\n{plan}\n"
        "[simulation]\nfan_deg = 30.0\ntilt_mrad = 0.4\nprofiles = 11000\n"
        '[[simulation.view]]\nname = "front"\nphi_deg = -70.0\nstandoff_mm = 108.0\nheight_mm = 5.0\n'
        '[[simulation.view]]\nname = "rear"\nphi_deg = -110.0\nstandoff_mm = 108.0\nheight_mm = 5.0\n'
    )


def _axis_text(axis, address, more):
    values = {key: f'"{v}"' if isinstance(v, str) else list(v) for key, v in axis.items()}
    lines = "".join(f"{key} = {value}\n" for key, value in values.items())
    return f'[[devices.positioner.axis]]\n{lines}address = "{address}"\n{more}\n'
