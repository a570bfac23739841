"""``truestand recover``: a scan out of the log of a recording that was cut off."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import ForceOption, JsonOption, QuietOption


def recover(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The .log that a recording left.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="SCAN.h5", help="Default: beside the log.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write what a log holds as a native scan: 0 proven complete, 3 incomplete (written, with the reason).

    Example: truestand recover k1.log
    """
    from truestand.cli.acquire import tell
    from truestand.cli.terminal import working
    from truestand.core.errors import BadRecipe
    from truestand.files.scans.write_scan import NATIVE, check_output
    from truestand.station.convert import convert, sort_log
    from truestand.station.scan import Taken, write_scans

    target = log.with_suffix(".h5") if output is None else output
    if target.suffix.lower() not in NATIVE:
        raise BadRecipe(f"{target}: found suffix {target.suffix!r}, need .h5, which says whether the scan is complete")
    check_output(target, force)
    with working(f"Reading {log.name}", quiet):
        written = write_scans(convert(sort_log(log)), target, force)
    tell(Taken(written), as_json, quiet)
