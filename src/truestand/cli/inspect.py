"""``truestand inspect``: a part's scan to characteristics, defects and a verdict."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truestand.cli.options import (
    JsonOption,
    OperatorOption,
    QuietOption,
    ReportOption,
    StandOption,
    StartAngleOption,
    StoreOption,
)

if TYPE_CHECKING:
    from truestand.core.inspection import Inspection

EXIT_CODES = {"conforms": 0, "does_not_conform": 1, "undecided": 3}


def inspect(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan of the part on the calibrated stand.")],
    calibration: Annotated[Path, typer.Option("--calibration", metavar="CALIBRATION.json", help="The stand today.")],
    part: Annotated[Path, typer.Option("--part", metavar="PART.toml", help="The part: gear, turned or CAD model.")],
    stand: StandOption = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="INSPECTION.json", help="The record to write.")
    ] = Path("inspection.json"),
    report: ReportOption = None,
    table: Annotated[
        Path | None, typer.Option("--csv", metavar="CHARACTERISTICS.csv", help="Write the characteristics as CSV.")
    ] = None,
    cloud: Annotated[
        Path | None,
        typer.Option("--cloud", metavar="CLOUD", help="Write the cloud with its deviations: .ply, .xyz, .npz."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Simulated scans: compare with the truth.")
    ] = None,
    start_angle_deg: StartAngleOption = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    serial: Annotated[
        str | None, typer.Option("--serial", help="Serial number of the part; default: that of PART.toml.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check a part's geometry against its drawing: 0 conforms, 1 does not, 3 undecided or untrusted.

    Example: truestand inspect gear.csv --calibration calibration.json --part gear.toml --report r.html
    """
    from truestand.cli.keeping import keeping
    from truestand.cli.reading import scan_reader
    from truestand.cli.talk import print_json, print_table, steps
    from truestand.files.records.record import read_json
    from truestand.report.terminal import inspection_table
    from truestand.station.pipeline import Inputs, Outputs, inspect_job

    into = keeping(store, stand, operator, quiet)
    reader = scan_reader(stand, start_angle_deg, quiet)
    known = None if truth is None else read_json(truth)
    inputs = Inputs((scan,), stand, calibration=calibration, part=part)
    outputs = Outputs(output, cloud, report, table)
    own = {key: value for key, value in (("serial", serial), ("operator", operator)) if value is not None}
    done = inspect_job(
        inputs, outputs, reader.taking(scan), steps("Inspecting", quiet), identity=own,
        start_stated=reader.start_stated, truth=known,
    )  # fmt: skip
    into.keep(done)
    if as_json:
        print_json(done.record)
    elif not quiet:
        print_table(inspection_table(done.result, known))
        typer.echo("\n".join(str(path) for path in outputs.paths))
    tell(done.result, quiet)
    raise typer.Exit(EXIT_CODES[done.result.verdict])


def tell(inspection: "Inspection", quiet: bool) -> None:
    """Say why nothing could be decided, and what the reader should know."""
    from truestand.cli.talk import hint

    for remark in inspection.remarks:
        hint(f"truestand: {remark}", quiet)
    for reason in inspection.reasons:
        hint(f"truestand: untrusted: {reason}", quiet)
