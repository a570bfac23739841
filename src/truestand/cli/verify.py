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
    radians_or_none,
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
    from truestand.apply.verify import verify as hold
    from truestand.cli.keeping import keeping
    from truestand.cli.talk import hint, now, print_json, working
    from truestand.core.errors import BadRecipe
    from truestand.core.scan import interpret
    from truestand.core.units import mm_from_um
    from truestand.files.atomic import write_json_atomic
    from truestand.files.recipes.recipes import read_shaft, read_stand
    from truestand.files.records.records import read_calibration
    from truestand.files.records.verification_record import verification_record
    from truestand.files.scans.read import read_recording, sha256_of

    into = keeping(store, stand, operator, quiet)
    old = read_calibration(calibration)
    shaft = old.artefact if artefact is None else read_shaft(artefact)
    if shaft is None:
        raise BadRecipe(f"{calibration} carries no artefact; pass --artefact SHAFT.toml")
    described = None if stand is None else read_stand(stand)
    with working(f"Reading {scan.name}", quiet):
        recording = read_recording(scan)
        seen = interpret(recording, described or recording.stand or old.stand, radians_or_none(start_angle_deg))
    with working("Verifying", quiet):
        verification = hold(seen, old, shaft, mm_from_um(limit_um), start_angle_deg is not None)
    record = verification_record(verification, now(), sha256_of(calibration))
    if output is not None:
        write_json_atomic(output, record)
    into.keep("verification", record, {"scan": scan, "calibration": calibration, "artefact": artefact, "stand": stand})
    if as_json:
        print_json(record)
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
