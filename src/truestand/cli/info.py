"""``truestand info``: what is in a scan."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import JsonOption


def info(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan file of any readable format.")],
    as_json: JsonOption = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Check that it can be read, print nothing.")] = False,
) -> None:
    """Say what is in a scan file: format, profiles, points, turns.

    Example: truestand info k1.csv
    """
    from truestand.cli.talk import print_json, working
    from truestand.files.read import info as describe
    from truestand.files.read import read_recording

    with working(f"Reading {scan.name}", quiet):
        facts = describe(read_recording(scan))
    if quiet:
        return
    if as_json:
        print_json(facts)
        return
    width = max(len(key) for key in facts)
    for key, value in facts.items():
        shown = "unknown" if value is None else f"{value:.6g}" if isinstance(value, float) else value
        typer.echo(f"{key.replace('_', ' '):{width}}  {shown}")
