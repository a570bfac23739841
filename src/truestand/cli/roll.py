"""``truestand roll``: a scan into the calibrated cloud."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import QuietOption, StandOption, StartAngleOption


def roll(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan of any part on the calibrated stand.")],
    calibration: Annotated[Path, typer.Option("--calibration", metavar="CALIBRATION.json", help="The stand today.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="CLOUD", help="By suffix: .ply, .xyz, .npz or .e57.")
    ],
    stand: StandOption = None,
    start_angle_deg: StartAngleOption = None,
    quiet: QuietOption = False,
) -> None:
    """Roll a scan up into a point cloud in the shaft's own coordinates.

    Example: truestand roll gear.csv --calibration calibration.json -o gear.ply
    """
    from truestand.cli.calibrate import tell_doubts, tell_witness
    from truestand.cli.reading import scan_reader
    from truestand.cli.talk import working
    from truestand.core.surface import apply_calibration
    from truestand.files.records.calibration_record import read_calibration
    from truestand.files.shapes.clouds import check_suffix, write_cloud

    check_suffix(output)
    known = read_calibration(calibration)
    tied = scan_reader(stand, start_angle_deg, quiet).tied(scan, known)
    with working("Rolling up", quiet):
        surface = apply_calibration(tied.scan, tied.calibration)
        write_cloud(output, surface.x, surface.y, surface.z)
    if not quiet:
        typer.echo(output)
    tell_witness(tied, quiet)
    tell_doubts(tied.calibration, quiet)
