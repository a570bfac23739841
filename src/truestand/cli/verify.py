"""``truestand verify``: does an old calibration still hold?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truestand.cli.options import (
    JsonOption,
    OperatorOption,
    QuietOption,
    StandOption,
    StartAngleOption,
    StoreOption,
)

if TYPE_CHECKING:
    from truestand.apply.verify import Verification

EXIT_CODES = {"holds": 0, "does_not_hold": 1, "undecided": 3}


def verify(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A new scan of the artefact.")],
    calibration: Annotated[
        Path, typer.Option("--calibration", metavar="CALIBRATION.json", help="The calibration to hold against it.")
    ],
    artefact: Annotated[
        Path | None,
        typer.Option("--artefact", metavar="SHAFT.toml", help="The shaft; default: the one in the calibration."),
    ] = None,
    stand: StandOption = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="VERIFICATION.json", help="Write the record.")
    ] = None,
    limit_um: Annotated[float, typer.Option(min=0.0, help="How far a calibrated point may have moved.")] = 10.0,
    start_angle_deg: StartAngleOption = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Hold an old calibration against a new scan of the artefact: 0 holds, 1 does not, 3 undecided.

    Example: truestand verify k2.csv --calibration calibration.json
    """
    from truestand.cli.evaluation import scan_reader
    from truestand.cli.keeping import keeping
    from truestand.cli.terminal import hint, print_json, steps
    from truestand.core.units import mm_from_um
    from truestand.station.pipeline import Inputs, Outputs, verify_job

    into = keeping(store, stand, operator, quiet)
    reader = scan_reader(stand, start_angle_deg, quiet)
    done = verify_job(
        Inputs((scan,), stand, artefact, calibration), Outputs(output), reader.taking(scan), steps("Verifying", quiet),
        limit=mm_from_um(limit_um), start_stated=reader.start_stated,
    )  # fmt: skip
    into.keep(done)
    verification = done.result
    if as_json:
        print_json(done.record)
    elif not quiet:
        _print(verification)
    for reason in verification.reasons:
        hint(f"truestand: {reason}", quiet)
    raise typer.Exit(EXIT_CODES[verification.verdict])


def _print(verification: "Verification") -> None:
    from truestand.core.units import um

    typer.echo(f"{'the calibration':24}{verification.verdict.replace('_', ' ')}")
    for c in verification.changes:
        moved = f"{um(c.value):7.2f} um  U {um(c.U):6.2f}  limit {um(c.limit):6.2f}"
        typer.echo(f"{c.name:24}{moved}  {c.verdict.replace('_', ' ')}")
