"""``truestand demo``: the main job on the virtual stand, from nothing to the report."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import QuietOption

MADE = ("k1.h5", "truth.json", "calibration.json", "calibration-paper.json", "cloud.ply", "report.html")


def demo(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where to write everything.")] = Path(
        "truestand-demo"
    ),
    open_report: Annotated[bool, typer.Option("--open", help="Open the report in the browser.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Scan a shaft on the virtual stand with the paper's numbers, calibrate, roll up, report.

    Example: truestand demo --open
    """
    from truestand.cli.talk import now, print_table, working
    from truestand.core.calibrate import calibrate
    from truestand.core.evidence import gather
    from truestand.core.surface import roll
    from truestand.files.atomic import write_json_atomic, write_text_atomic
    from truestand.files.clouds import write_cloud
    from truestand.files.read import read_scan
    from truestand.files.recipes import STARTERS, read_shaft, read_simulation, read_stand, write_starters
    from truestand.files.records import write_calibration
    from truestand.files.write_scan import write_recording
    from truestand.report.calibration import calibration_report
    from truestand.report.terminal import summary_table
    from truestand.sim import simulate, simulation_from, truth_record

    _refuse_real_scans(out)
    write_starters(out, force=True)
    stand, shaft = read_stand(out / "stand.toml"), read_shaft(out / "shaft.toml")
    with working("Scanning the shaft on the virtual stand", quiet) as advance:
        simulated = simulate(stand, simulation_from(read_simulation(out / "stand.toml")), shaft, 0, advance)
        write_recording(simulated.recording, out / "k1.h5", stand, force=True)
    truth = truth_record(simulated.truth)
    write_json_atomic(out / "truth.json", truth)

    scan = read_scan(out / "k1.h5")
    with working("Calibrating", quiet):
        calibration = replace(calibrate(scan, shaft), created=now())
        paper = calibrate(scan, shaft, "paper")
        write_calibration(out / "calibration.json", calibration)
        write_calibration(out / "calibration-paper.json", paper)
    with working("Rolling up", quiet):
        surface = roll(scan, calibration)
        write_cloud(out / "cloud.ply", surface.x, surface.y, surface.z)
    with working("Writing the report", quiet):
        evidence = gather(scan, shaft, calibration, paper)
        write_text_atomic(out / "report.html", calibration_report(calibration, evidence, paper, truth))

    if not quiet:
        print_table(summary_table(calibration, paper, truth))
        for name in (*STARTERS, *MADE):
            typer.echo(out / name)
    if open_report:
        typer.launch(str(out / "report.html"))


def _refuse_real_scans(out: Path) -> None:
    """Raw scans are never overwritten: one without a truth beside it is none of the demo's."""
    from truestand.core.errors import BadRecipe

    if (out / "k1.h5").exists() and not (out / "truth.json").exists():
        raise BadRecipe(f"{out} holds a scan k1.h5 that no demo made; choose another --out")
