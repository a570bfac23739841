"""``truestand compare``: the paper's method, ours and the installed peers on one scan."""

from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from truestand.calibration.peers import peers
from truestand.cli.evaluation import scan_reader
from truestand.cli.options import ArtefactOption, JsonOption, QuietOption, StandOption, StartAngleOption, output_option
from truestand.cli.terminal import print_json, print_table, progress
from truestand.files.atomic import write_json_atomic
from truestand.files.recipes.recipes import read_shaft
from truestand.files.records.comparison_record import axis_of, comparison_record, comparison_row
from truestand.files.records.record import now, read_json
from truestand.report.notation import number


def compare(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan of the artefact.")],
    artefact: ArtefactOption,
    stand: StandOption = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Simulated scans: errors against the truth.")
    ] = None,
    output: Annotated[
        Path | None, output_option("--output", "-o", metavar="COMPARISON.json", help="Write the record.")
    ] = None,
    start_angle_deg: StartAngleOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Hold the exact model against the published method and against what general libraries make of the same scan.

    Example: truestand compare k1.csv --stand stand.toml --artefact shaft.toml --truth truth.json
    """
    shaft, reader = read_shaft(artefact), scan_reader(stand, start_angle_deg, quiet)
    known = None if truth is None else axis_of(read_json(truth), truth)
    measured = reader.read(scan)
    rows = []
    with progress("Comparing", quiet) as advance:
        methods = peers(measured, shaft)
        for done, method in enumerate(methods, 1):
            start = perf_counter()
            result = method.tried()
            rows.append(comparison_row(method, result, perf_counter() - start, known))
            advance(done, len(methods))
    record = comparison_record(measured, rows, now())
    if output is not None:
        write_json_atomic(output, record)
    if as_json:
        print_json(record)
    elif not quiet:
        print_table(_table(rows, known is not None))
        for row in rows:
            if row["reason"]:
                typer.echo(f"{row['method']} ({row['library']}): {row['reason']}")


def _table(rows: list[dict[str, Any]], against_truth: bool) -> Table:
    table = Table(title="Where the shaft's axis stands, by whom", title_justify="left", box=SIMPLE_HEAD)
    table.add_column("\nmethod (library)", no_wrap=True)
    columns = [("eccentricity\num", "eccentricity_um", 3), ("direction\ndeg", "eccentricity_direction_deg", 4),
               ("at height\nmm", "height_mm", 1), ("tilt\nmrad", "tilt_mrad", 3), ("phi\ndeg", "phi_deg", 4),
               ("leaves\num rms", "rms_um", 2), ("time\ns", "seconds", 2)]  # fmt: skip
    if against_truth:
        columns.append(("axis off\num", "axis_error_um", 3))
    for heading, _, _ in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        cells = ["" if row[key] is None else number(row[key], places) for _, key, places in columns]
        table.add_row(f"{row['method']} ({row['library']})", *cells)
    return table
