"""``truestand calibrate`` and ``verify``: calibrate by scans of the artefact, see whether it still holds."""

from math import isfinite, radians
from pathlib import Path
from typing import Annotated

import typer

from truestand.apply.verify import Verification
from truestand.cli.evaluation import end_if_untrusted, scan_reader
from truestand.cli.options import (
    VERDICT_CODES,
    ArtefactOption,
    JsonOption,
    OperatorOption,
    QuietOption,
    ReportOption,
    StandOption,
    StartAngleOption,
    StoreOption,
    TruthOption,
    ViewOption,
    output_option,
)
from truestand.cli.store import keep, results_folder
from truestand.cli.terminal import hint, print_json, print_table, step_progress
from truestand.core.calibration import Method
from truestand.core.errors import BadRecipe
from truestand.core.units import mm_from_um, um
from truestand.files.records.record import read_json
from truestand.report.terminal import positions_table, summary_table, views_table
from truestand.station.pipeline import Inputs, Outputs, calibrate_job, verify_job


def calibrate(
    scans: Annotated[list[Path], typer.Argument(metavar="SCAN...", help="A scan of the artefact, or several.")],
    artefact: ArtefactOption,
    stand: StandOption = None,
    method: Annotated[Method, typer.Option(help="The exact model, or the published procedure.")] = "stand",
    output: Annotated[
        Path, output_option("--output", "-o", metavar="CALIBRATION.json", help="The record to write.")
    ] = Path("calibration.json"),
    report: ReportOption = None,
    truth: TruthOption = None,
    clamped_at_deg: Annotated[
        str | None,
        typer.Option(
            metavar="0,180,...",
            help="Several scans: the angle at which the shaft was clamped for each, counter-clockwise from above.",
        ),
    ] = None,
    view: ViewOption = None,
    start_angle_deg: StartAngleOption = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find where the sensor stands and how the shaft runs, from a scan of the reference shaft.

    One scan by each of several sensors finds all of them in one frame. Several scans by one sensor, the shaft clamped
    again at another angle for each, tell the laser plane from the coaxiality of the steps and the table's bearing from
    the shaft's form; the shaft's pose is that of the last.

    Example: truestand calibrate k1.csv --stand stand.toml --artefact shaft.toml -o calibration.json --report r.html
    """
    clamped = _clamping_angles(scans, clamped_at_deg, method)
    results = results_folder(store, stand)
    reader = scan_reader(stand, start_angle_deg, quiet, view)
    known = None if truth is None else read_json(truth)
    outcome = calibrate_job(
        Inputs(tuple(scans), stand, artefact), Outputs(output, report=report), reader.when_asked(*scans),
        step_progress("Calibrating", quiet), method=method, clamped=clamped, truth=known,
    )  # fmt: skip
    calibration, _ = outcome.result
    keep(results, outcome.kind, outcome.record, outcome.evidence, operator, quiet)
    if as_json:
        print_json(outcome.record)
    elif not quiet:
        print_table(summary_table(calibration, truth=known))
        if calibration.positions is not None:
            print_table(positions_table(calibration.positions))
        if calibration.views:
            print_table(views_table(calibration.views))
        typer.echo(output if report is None else f"{output}\n{report}")
    end_if_untrusted(calibration.reasons, quiet)


def _clamping_angles(scans: list[Path], stated: str | None, method: Method) -> tuple[float, ...]:
    """The clamping angles in rad, one a scan; none for a single scan, and for scans of several views."""
    if len(scans) > 1 and method == "paper":
        raise BadRecipe(f"found {len(scans)} scans, the published method knows one; leave out --method paper")
    if stated is None:
        return ()
    if len(scans) == 1:
        raise BadRecipe(
            "found one scan and --clamped-at-deg, need an angle for each of several scans: k1.h5 k2.h5 "
            "--clamped-at-deg 0,180"
        )
    try:
        angles = tuple(radians(float(part)) for part in stated.split(","))
    except ValueError:
        raise BadRecipe(f"found --clamped-at-deg {stated!r}, need numbers like 0,180") from None
    if not all(isfinite(a) for a in angles):
        raise BadRecipe(f"found --clamped-at-deg {stated!r}, need finite numbers like 0,180")
    return angles


def verify(
    scans: Annotated[
        list[Path], typer.Argument(metavar="SCAN...", help="A new scan of the artefact, one by each view.")
    ],
    calibration: Annotated[
        Path, typer.Option("--calibration", metavar="CALIBRATION.json", help="The calibration to hold against it.")
    ],
    artefact: Annotated[
        Path | None,
        typer.Option("--artefact", metavar="SHAFT.toml", help="The shaft; default: the one in the calibration."),
    ] = None,
    stand: StandOption = None,
    output: Annotated[
        Path | None, output_option("--output", "-o", metavar="VERIFICATION.json", help="Write the record.")
    ] = None,
    limit_um: Annotated[float, typer.Option(min=0.0, help="How far a calibrated point may have moved.")] = 10.0,
    view: ViewOption = None,
    start_angle_deg: StartAngleOption = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Hold a calibration against a new scan of the artefact, or one by each view: 0 holds, 1 does not, 3 undecided.

    Example: truestand verify k2.csv --calibration calibration.json
    """
    results = results_folder(store, stand)
    reader = scan_reader(stand, start_angle_deg, quiet, view)
    outcome = verify_job(
        Inputs(tuple(scans), stand, artefact, calibration), Outputs(output), reader.when_asked(*scans),
        step_progress("Verifying", quiet), limit=mm_from_um(limit_um), start_stated=reader.start_stated,
    )  # fmt: skip
    verification = outcome.result
    keep(results, outcome.kind, outcome.record, outcome.evidence, operator, quiet)
    if as_json:
        print_json(outcome.record)
    elif not quiet:
        _print_changes(verification)
    for reason in verification.reasons:
        hint(str(reason), quiet)
    raise typer.Exit(VERDICT_CODES[verification.verdict])


def _print_changes(verification: Verification) -> None:
    width = max(24, *(len(c.name) + 2 for c in verification.changes))
    typer.echo(f"{'the calibration':{width}}{verification.verdict.replace('_', ' ')}")
    for c in verification.changes:
        moved = f"{um(c.value):7.2f} um  U {um(c.U):6.2f}  limit {um(c.limit):6.2f}"
        typer.echo(f"{c.name:{width}}{moved}  {c.verdict.replace('_', ' ')}")
