"""``truestand simulate`` and ``stand simulate``: a scan from the virtual stand, or its devices served."""

import time
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Annotated, Literal

import typer

from truestand.cli.options import ForceOption, QuietOption, output_option, radians_or_none
from truestand.cli.terminal import progress
from truestand.core.artefact import Artefact
from truestand.core.errors import BadRecipe
from truestand.core.stand import Stand
from truestand.files.atomic import write_json_atomic
from truestand.files.recipes.parts import read_part, read_part_simulation
from truestand.files.recipes.recipes import read_shaft, read_simulation, read_stand
from truestand.files.scans.write_scan import check_output, write_recording
from truestand.sim import VirtualPart, paper_shaft, simulation_from, truth_record, virtual_part_from
from truestand.sim import simulate as simulate_scan
from truestand.sim.live.faults import FaultKind, fault_at
from truestand.sim.live.positioner import AxisEndpoint
from truestand.sim.live.stand import SensorEndpoint, VirtualStand, virtual_stand
from truestand.station.interrupts import interrupted_by_signals
from truestand.station.recipe import DevicesRecipe, position_of, read_devices, sensor_of

FAULT_POLL_INTERVAL_S = 0.05

ArtefactOption = Annotated[
    Path | None, typer.Option("--artefact", metavar="SHAFT.toml", help="The shaft; default: the paper's.")
]
PartOption = Annotated[
    Path | None, typer.Option("--part", metavar="PART.toml", help="What sits on the shaft: a gear or another part.")
]


def simulate(
    stand: Annotated[Path, typer.Argument(metavar="STAND.toml", help="The stand, with its [simulation] table.")],
    output: Annotated[
        Path,
        output_option("--output", "-o", metavar="SCAN", help="By suffix: .csv (as sensors export) or .h5 (native)."),
    ],
    artefact: ArtefactOption = None,
    part: PartOption = None,
    truth: Annotated[
        Path | None, output_option("--truth", metavar="TRUTH.json", help="Write the truth beside it.")
    ] = None,
    view: Annotated[str | None, typer.Option(help="Of several sensors, the one that scans: its name.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same scan.")] = 0,
    clamped_at_deg: Annotated[
        float | None, typer.Option(help="By how much the shaft sits turned in its clamping, ccw from above.")
    ] = None,
    force: ForceOption = False,
    quiet: QuietOption = False,
) -> None:
    """Scan a shaft, or a part on it, on the virtual stand.

    Example: truestand simulate stand.toml --artefact shaft.toml --part gear.toml -o gear.csv --truth truth.json
    """
    described = read_stand(stand)
    described = described if view is None else described.of_view(view)
    simulation = simulation_from(read_simulation(stand))
    clamped = radians_or_none(clamped_at_deg, "--clamped-at-deg")
    if clamped is not None:
        simulation = replace(simulation, workpiece=replace(simulation.workpiece, clamped=clamped))
    simulation = simulation.seen_from(described.sensor.name)
    shaft, mounted = _shaft(artefact), _virtual_part(part)
    check_output(output, force)
    with progress("Scanning on the virtual stand", quiet) as advance:
        simulated = simulate_scan(described, simulation, shaft, seed, advance, mounted)
    with progress(f"Writing {output.name}", quiet):
        write_recording(simulated.recording, output, described, force=force)
        if truth is not None:
            write_json_atomic(truth, truth_record(simulated.truth))
    if not quiet:
        typer.echo(output if truth is None else f"{output}\n{truth}")


def serve_virtual_stand(
    stand: Annotated[Path, typer.Argument(metavar="STAND.toml", help="The stand, with [devices] and [simulation].")],
    artefact: ArtefactOption = None,
    part: PartOption = None,
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
        Path | None, output_option("--truth", metavar="TRUTH.json", help="Write what is true of it.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the noise.")] = 0,
) -> None:
    """Serve a virtual table, positioner and sensors at the addresses of [devices], until Ctrl-C or SIGTERM.

    Example: truestand stand simulate stand.toml --part gear.toml --pace 5
    """
    faults = sorted((fault_at(text) for text in fault or []), key=lambda one: one[2])
    described, recipes = read_devices(stand)
    endpoints, axes = _endpoints(described, recipes), _axes(recipes)
    on_shaft, shaft = _virtual_part(part), _shaft(artefact)
    simulation = simulation_from(read_simulation(stand))
    virtual = virtual_stand(
        described, simulation, shaft, recipes.table, endpoints, on_shaft, pace, seed, axes, _repeats_within(recipes)
    )  # fmt: skip
    virtual.mount(part is not None if mounted is None else mounted == "part")
    if truth is not None:
        write_json_atomic(truth, truth_record(virtual.truth(part is not None)))
    _serve(virtual, faults)


def _shaft(recipe: Path | None) -> Artefact:
    return paper_shaft() if recipe is None else read_shaft(recipe)


def _virtual_part(recipe: Path | None) -> VirtualPart | None:
    if recipe is None:
        return None
    return virtual_part_from(read_part(recipe), read_part_simulation(recipe), f"{recipe}: [simulation]")


def _endpoints(stand: Stand, devices: DevicesRecipe) -> list[SensorEndpoint]:
    """Where the virtual sensors are, and which view each takes first."""
    found = []
    for recipe in devices.sensor:
        if recipe.driver != "scancontrol":
            raise BadRecipe(
                f'sensor "{recipe.name}": found driver {recipe.driver}, the virtual stand has scancontrol only'
            )
        sensor = sensor_of(stand, recipe.name)
        shape, at = recipe.shape(sensor), position_of(sensor, devices)
        found.append(SensorEndpoint(recipe.name, recipe.address, recipe.model, *shape, sensor.name, at))
    return found


def _axes(devices: DevicesRecipe) -> tuple[AxisEndpoint, ...]:
    """The virtual positioner's axes."""
    return tuple(
        AxisEndpoint(axis.name, axis, axis.linear, tuple(axis.motion.direction.tolist()), axis.through_mm)
        for axis in devices.axes
    )


def _repeats_within(devices: DevicesRecipe) -> tuple[float, float]:
    """mm and rad, standard deviations: as its recipe states."""
    p = devices.positioner
    return (0.0, 0.0) if p is None else (p.position_U_um / 2000.0, radians(p.position_U_deg / 2))


def _serve(virtual: VirtualStand, faults: list[tuple[FaultKind, float | None, float]]) -> None:
    """Serve until the process is asked to end, and begin each fault (kind, strength, s after the start) in time."""
    with interrupted_by_signals():
        try:
            with virtual:
                typer.echo(" · ".join(["ready", *virtual.addresses()]))  # programs wait for this line
                start = time.monotonic()
                while True:
                    while faults and faults[0][2] <= time.monotonic() - start:
                        kind, strength, _ = faults.pop(0)
                        virtual.begin(kind, strength)
                    time.sleep(FAULT_POLL_INTERVAL_S)
        except KeyboardInterrupt:
            return
