"""``truestand calibrate``: the main job."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truestand.cli.exit_codes import UNDECIDED
from truestand.cli.options import (
    ArtefactOption,
    JsonOption,
    OperatorOption,
    QuietOption,
    ReportOption,
    StandOption,
    StartAngleOption,
    StoreOption,
)

if TYPE_CHECKING:
    from truestand.apply.transfer import Transfer
    from truestand.core.calibration import Calibration


class Method(StrEnum):
    """Which procedure."""

    STAND = "stand"
    PAPER = "paper"


def calibrate(
    scans: Annotated[list[Path], typer.Argument(metavar="SCAN...", help="A scan of the artefact, or several.")],
    artefact: ArtefactOption,
    stand: StandOption = None,
    method: Annotated[Method, typer.Option(help="The exact model, or the published procedure.")] = Method.STAND,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="CALIBRATION.json", help="The record to write.")
    ] = Path("calibration.json"),
    report: ReportOption = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Simulated scans: compare with the truth.")
    ] = None,
    clamped_at_deg: Annotated[
        str | None,
        typer.Option(
            metavar="0,180,...",
            help="Several scans: the angle at which the shaft was clamped for each, counter-clockwise from above.",
        ),
    ] = None,
    start_angle_deg: StartAngleOption = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find where the sensor stands and how the shaft runs, from a scan of the reference shaft.

    Several scans, the shaft clamped again at another angle for each, tell the laser plane from the coaxiality of the
    steps and the table's bearing from the shaft's form; the shaft's pose is that of the last.

    Example: truestand calibrate k1.csv --stand stand.toml --artefact shaft.toml -o calibration.json --report r.html
    """
    from truestand.cli.keeping import keeping
    from truestand.cli.reading import scan_reader
    from truestand.cli.talk import print_json, print_table, steps
    from truestand.files.records.record import read_json
    from truestand.station.pipeline import Inputs, Outputs, calibrate_job

    clamped = _clamped(scans, clamped_at_deg, method)
    into = keeping(store, stand, operator, quiet)
    reader = scan_reader(stand, start_angle_deg, quiet)
    known = None if truth is None else read_json(truth)
    done = calibrate_job(
        Inputs(tuple(scans), stand, artefact), Outputs(output, report=report), reader.taking(*scans),
        steps("Calibrating", quiet), method=method.value, clamped=clamped, truth=known,
    )  # fmt: skip
    calibration, _ = done.result
    into.keep(done)
    if as_json:
        print_json(done.record)
    elif not quiet:
        from truestand.report.terminal import positions_table, summary_table

        print_table(summary_table(calibration, truth=known))
        if calibration.positions is not None:
            print_table(positions_table(calibration.positions))
        typer.echo(output if report is None else f"{output}\n{report}")
    tell_doubts(calibration, quiet)


def _clamped(scans: list[Path], stated: str | None, method: Method) -> tuple[float, ...]:
    """The clamping angles in rad, one a scan; none for a single scan."""
    from math import isfinite, radians

    from truestand.core.errors import BadRecipe

    if len(scans) == 1 and stated is None:
        return ()
    if len(scans) > 1 and method is Method.PAPER:
        raise BadRecipe(f"found {len(scans)} scans, the published method knows one; leave out --method paper")
    if len(scans) == 1 or stated is None:
        found = "one scan and --clamped-at-deg" if len(scans) == 1 else f"{len(scans)} scans and no clamping angles"
        raise BadRecipe(f"found {found}, need an angle for each of several scans: k1.h5 k2.h5 --clamped-at-deg 0,180")
    try:
        angles = tuple(radians(float(part)) for part in stated.split(","))
    except ValueError:
        raise BadRecipe(f"found --clamped-at-deg {stated!r}, need numbers like 0,180") from None
    if not all(isfinite(a) for a in angles):
        raise BadRecipe(f"found --clamped-at-deg {stated!r}, need finite numbers like 0,180")
    return angles


def tell_witness(tied: "Transfer", quiet: bool) -> None:
    """Say what the shaft in view of a scan told about the zero of the table's angle."""
    from math import degrees

    from truestand.cli.talk import hint

    if tied.witness is not None and tied.calibration.angle_zero == "witness":
        turn, U = degrees(tied.witness.angle_shift), degrees(tied.witness.angle_U)
        where = ", ".join(tied.witness.surfaces)
        hint(f"truestand: table angle tied by the shaft in view ({where}): {turn:+.4f} deg, U = {U:.4f} deg", quiet)


def tell_doubts(calibration: "Calibration", quiet: bool) -> None:
    """Say why a calibration is untrusted and end with exit code 3; do nothing where it is valid."""
    from truestand.cli.talk import hint

    for reason in calibration.reasons:
        hint(f"truestand: untrusted: {reason}", quiet)
    if calibration.reasons:
        raise typer.Exit(UNDECIDED)
