"""``truestand demo``: the main job on the virtual stand, from nothing to the verdict on a gear and its report."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truestand.cli.options import QuietOption

if TYPE_CHECKING:
    from truestand.core.artefact import Artefact
    from truestand.core.calibration import Calibration
    from truestand.core.inspection import Inspection
    from truestand.core.stand import Stand
    from truestand.sim import Simulation

MADE = (
    "k1.h5", "truth.json", "calibration.json", "calibration-paper.json", "cloud.ply", "report.html",
    "gear.h5", "gear-truth.json", "inspection.json", "gear.ply", "gear-report.html",
)  # fmt: skip


def demo(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where to write everything.")] = Path(
        "truestand-demo"
    ),
    open_report: Annotated[bool, typer.Option("--open", help="Open the reports in the browser.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Scan a shaft on the virtual stand, calibrate, scan a gear with a few errors, inspect it, report.

    Example: truestand demo --open
    """
    from truestand.cli.talk import print_table
    from truestand.files.recipes import STARTERS, write_starters
    from truestand.report.terminal import inspection_table, summary_table

    _refuse_real_scans(out)
    write_starters(out, force=True)
    bench = _bench(out)
    calibration, paper, truth = _calibrate(bench, quiet)
    inspection, gear_truth = _inspect(bench, calibration, quiet)
    if not quiet:
        print_table(summary_table(calibration, paper, truth))
        print_table(inspection_table(inspection, gear_truth))
        for name in (*STARTERS, *MADE):
            typer.echo(out / name)
    if open_report:
        for name in ("report.html", "gear-report.html"):
            typer.launch(str(out / name))


@dataclass(frozen=True)
class Bench:
    """The virtual stand of the starter recipes, and the folder that it writes to."""

    out: Path
    stand: "Stand"
    shaft: "Artefact"
    simulation: "Simulation"


def _bench(out: Path) -> Bench:
    from truestand.files.recipes import read_shaft, read_simulation, read_stand
    from truestand.sim import simulation_from

    stand, shaft = read_stand(out / "stand.toml"), read_shaft(out / "shaft.toml")
    return Bench(out, stand, shaft, simulation_from(read_simulation(out / "stand.toml")))


def _calibrate(bench: Bench, quiet: bool) -> tuple["Calibration", "Calibration", dict[str, Any]]:
    """Scan the shaft, calibrate by both methods, write all of it: ours, the paper's, the truth."""
    from truestand.cli.talk import now, working
    from truestand.core.calibrate import calibrate
    from truestand.core.evidence import gather
    from truestand.core.surface import roll
    from truestand.files.atomic import write_json_atomic, write_text_atomic
    from truestand.files.clouds import write_cloud
    from truestand.files.read import read_scan
    from truestand.files.records import write_calibration
    from truestand.files.write_scan import write_recording
    from truestand.report.calibration import calibration_report
    from truestand.sim import simulate, truth_record

    out = bench.out
    with working("Scanning the shaft on the virtual stand", quiet) as advance:
        simulated = simulate(bench.stand, bench.simulation, bench.shaft, 0, advance)
        write_recording(simulated.recording, out / "k1.h5", bench.stand, force=True)
    truth = truth_record(simulated.truth)
    write_json_atomic(out / "truth.json", truth)
    scan = read_scan(out / "k1.h5")
    with working("Calibrating", quiet):
        calibration = replace(calibrate(scan, bench.shaft), created=now())
        paper = calibrate(scan, bench.shaft, "paper")
        write_calibration(out / "calibration.json", calibration)
        write_calibration(out / "calibration-paper.json", paper)
    with working("Rolling up", quiet):
        surface = roll(scan, calibration)
        write_cloud(out / "cloud.ply", surface.x, surface.y, surface.z)
    with working("Writing the report", quiet):
        evidence = gather(scan, bench.shaft, calibration, paper)
        write_text_atomic(out / "report.html", calibration_report(calibration, evidence, paper, truth))
    return calibration, paper, truth


def _inspect(bench: Bench, calibration: "Calibration", quiet: bool) -> tuple["Inspection", dict[str, Any]]:
    """Scan the gear of gear.toml with its errors, inspect it, write all of it."""
    from truestand.cli.inspect import Written, write
    from truestand.cli.talk import now, working
    from truestand.core.calibration import ScanSummary
    from truestand.core.surface import roll
    from truestand.core.transfer import transfer
    from truestand.files.atomic import write_json_atomic
    from truestand.files.inspection_record import inspection_record
    from truestand.files.parts import read_part, read_part_simulation
    from truestand.files.read import read_scan, sha256_of
    from truestand.files.write_scan import write_recording
    from truestand.parts.inspect import inspect
    from truestand.sim import simulate, truth_record, virtual_part_from

    out = bench.out
    part = read_part(out / "gear.toml")
    virtual = virtual_part_from(part, read_part_simulation(out / "gear.toml"), "gear.toml: [simulation]")
    with working("Scanning the gear on the virtual stand", quiet) as advance:
        simulated = simulate(bench.stand, bench.simulation, bench.shaft, 1, advance, virtual)
        write_recording(simulated.recording, out / "gear.h5", bench.stand, force=True)
    truth = truth_record(simulated.truth)
    write_json_atomic(out / "gear-truth.json", truth)
    scan = read_scan(out / "gear.h5")
    with working("Inspecting", quiet):
        tied = transfer(scan, calibration)
        surface = roll(tied.scan, tied.calibration)
        created = now()
        inspection = replace(inspect(surface, part), created=created)
        sha256 = sha256_of(out / "calibration.json")
        record = inspection_record(inspection, tied.calibration, ScanSummary.of(scan), sha256, created)
    with working("Writing the gear's report", quiet):
        write(Written(out / "inspection.json", out / "gear.ply", out / "gear-report.html"), record, inspection, surface,
              truth)  # fmt: skip
    return inspection, truth


def _refuse_real_scans(out: Path) -> None:
    """Raw scans are never overwritten: one without a truth beside it is none of the demo's."""
    from truestand.core.errors import BadRecipe

    if (out / "k1.h5").exists() and not (out / "truth.json").exists():
        raise BadRecipe(f"{out} holds a scan k1.h5 that no demo made; choose another --out")
