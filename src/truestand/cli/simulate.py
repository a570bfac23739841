"""``truestand simulate``: a scan from the virtual stand."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import ForceOption, QuietOption, radians_or_none


def simulate(
    stand: Annotated[Path, typer.Argument(metavar="STAND.toml", help="The stand, with its [simulation] table.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="SCAN", help="By suffix: .csv (as sensors export) or .h5 (native)."),
    ],
    artefact: Annotated[
        Path | None, typer.Option("--artefact", metavar="SHAFT.toml", help="The shaft; default: the paper's.")
    ] = None,
    part: Annotated[
        Path | None, typer.Option("--part", metavar="PART.toml", help="What sits on the shaft: a gear or another part.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Write the truth beside it.")
    ] = None,
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
    from truestand.cli.terminal import working
    from truestand.files.atomic import write_json_atomic
    from truestand.files.recipes.parts import read_part, read_part_simulation
    from truestand.files.recipes.recipes import read_shaft, read_simulation, read_stand
    from truestand.files.scans.write_scan import check_output, write_recording
    from truestand.sim import paper_shaft, simulation_from, truth_record, virtual_part_from
    from truestand.sim import simulate as scan_virtually

    described = read_stand(stand)
    simulation = simulation_from(read_simulation(stand))
    clamped = radians_or_none(clamped_at_deg, "--clamped-at-deg")
    if clamped is not None:
        simulation = replace(simulation, workpiece=replace(simulation.workpiece, clamped=clamped))
    shaft = paper_shaft() if artefact is None else read_shaft(artefact)
    mounted = None
    if part is not None:
        mounted = virtual_part_from(read_part(part), read_part_simulation(part), f"{part}: [simulation]")
    check_output(output, force)
    with working("Scanning on the virtual stand", quiet) as advance:
        simulated = scan_virtually(described, simulation, shaft, seed, advance, mounted)
    with working(f"Writing {output.name}", quiet):
        write_recording(simulated.recording, output, described, force=force)
        if truth is not None:
            write_json_atomic(truth, truth_record(simulated.truth))
    if not quiet:
        typer.echo(output if truth is None else f"{output}\n{truth}")
