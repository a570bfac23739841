"""``truestand stand``: the stand's devices, and the virtual stand that stands in for them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from truestand.cli import devices

if TYPE_CHECKING:
    from truestand.core.stand import Sensor
    from truestand.devices.sensors.recipe import SensorRecipe
    from truestand.sim.live.faults import FaultKind
    from truestand.sim.live.stand import SensorEndpoint, VirtualStand

app = typer.Typer(
    no_args_is_help=True,
    help="The stand's devices: list, test, identify and watch them, reset a fault, or simulate a stand.",
)
app.command("list")(devices.list_devices)
app.command("test")(devices.test_devices)
app.command("identify")(devices.identify_device)
app.command("watch")(devices.watch_devices)
app.command("reset")(devices.reset_fault)

LOOK = 0.05
"""s between two looks at the time."""


@app.command("simulate")
def simulate(
    stand: Annotated[Path, typer.Argument(metavar="STAND.toml", help="The stand, with [devices] and [simulation].")],
    artefact: Annotated[
        Path | None, typer.Option("--artefact", metavar="SHAFT.toml", help="The shaft; default: the paper's.")
    ] = None,
    part: Annotated[
        Path | None, typer.Option("--part", metavar="PART.toml", help="What sits on the shaft: a gear or another part.")
    ] = None,
    mounted: Annotated[
        Literal["shaft", "part"] | None,
        typer.Option(help="What is on the table at first; default: the part, where there is one."),
    ] = None,
    pace: Annotated[float, typer.Option(min=0.01, max=100.0, help="Times real time.")] = 1.0,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="KIND@SECONDS",
            help="Something goes wrong so many seconds after the start, e.g. lose-packets:0.02@5; none@9 ends all.",
        ),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Write what is true of it.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise.")] = 0,
) -> None:
    """Serve a virtual table and virtual sensors at the addresses of [devices], until Ctrl-C or SIGTERM.

    Example: truestand stand simulate stand.toml --part gear.toml --pace 5
    """
    from truestand.files.atomic import write_json_atomic
    from truestand.sim import truth_record
    from truestand.sim.live.faults import fault_at

    faults = sorted((fault_at(text) for text in fault or []), key=lambda one: one[2])
    virtual = _described(stand, artefact, part, pace, seed)
    virtual.mount(part is not None if mounted is None else mounted == "part")
    if truth is not None:
        write_json_atomic(truth, truth_record(virtual.truth(part is not None)))
    _serve(virtual, faults)


def _described(stand: Path, artefact: Path | None, part: Path | None, pace: float, seed: int) -> "VirtualStand":
    from truestand.files.recipes.parts import read_part, read_part_simulation
    from truestand.files.recipes.recipes import read_shaft, read_simulation
    from truestand.sim import paper_shaft, simulation_from, virtual_part_from
    from truestand.sim.live.stand import virtual_stand
    from truestand.station.recipe import read_devices, sensor_of

    described, recipes = read_devices(stand)
    places = [_place(recipe, sensor_of(described, recipe.name)) for recipe in recipes.sensor]
    on = None
    if part is not None:
        on = virtual_part_from(read_part(part), read_part_simulation(part), f"{part}: [simulation]")
    shaft = paper_shaft() if artefact is None else read_shaft(artefact)
    simulation = simulation_from(read_simulation(stand))
    return virtual_stand(described, simulation, shaft, recipes.table, places, on, pace, seed)


def _place(recipe: "SensorRecipe", sensor: "Sensor") -> "SensorEndpoint":
    """Where the virtual sensor is."""
    from truestand.core.errors import BadRecipe
    from truestand.sim.live.stand import SensorEndpoint

    if recipe.driver != "scancontrol":
        raise BadRecipe(f'sensor "{recipe.name}": found driver {recipe.driver}, the virtual stand has scancontrol only')
    return SensorEndpoint(recipe.name, recipe.address, recipe.model, *recipe.shape(sensor))


def _serve(virtual: "VirtualStand", faults: "list[tuple[FaultKind, float | None, float]]") -> None:
    """Until somebody ends it, with what goes wrong meanwhile."""
    import time

    from truestand.cli.live import ended_by_signals

    with ended_by_signals():
        try:
            with virtual:
                typer.echo(" · ".join(["ready", *virtual.addresses()]))  # programs wait for this line
                start = time.monotonic()
                while True:
                    while faults and faults[0][2] <= time.monotonic() - start:
                        kind, strength, _ = faults.pop(0)
                        virtual.begin(kind, strength)
                    time.sleep(LOOK)
        except KeyboardInterrupt:
            return
