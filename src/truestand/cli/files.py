"""``truestand import``: any readable scan to the native file."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import (
    ForceOption,
    PickOption,
    PointsOption,
    QuietOption,
    RawTypeOption,
    StandOption,
    raw_layout,
)


def import_scan(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan file of any readable format.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="SCAN.h5", help="The native file to write.")],
    stand: StandOption = None,
    pick: PickOption = None,
    raw_type: RawTypeOption = None,
    points: PointsOption = None,
    force: ForceOption = False,
    quiet: QuietOption = False,
) -> None:
    """Bring a scan into the native file: small, lossless, quick to read, the stand inside.

    Example: truestand import k1.csv --stand stand.toml -o k1.h5
    """
    from truestand.cli.terminal import hint, working
    from truestand.files.recipes.recipes import read_stand
    from truestand.files.scans.read import read_recording
    from truestand.files.scans.write_scan import write_recording

    described = None if stand is None else read_stand(stand)
    with working(f"Importing {scan.name}", quiet):
        recording = read_recording(scan, pick, raw_layout(raw_type, points))
        write_recording(recording, output, described or recording.stand, force=force)
    if described is None and recording.stand is None:
        hint("truestand: no stand inside; pass --stand here or later", quiet)
    if not quiet:
        typer.echo(output)
