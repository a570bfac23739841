"""``truestand info``: what is in a scan."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import JsonOption, PickOption, PointsOption, RawTypeOption, raw_layout


def info(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan file of any readable format.")],
    pick: PickOption = None,
    raw_type: RawTypeOption = None,
    points: PointsOption = None,
    as_json: JsonOption = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Check that it can be read, print nothing.")] = False,
) -> None:
    """Say what is in a scan file: format, profiles, points, turns; of a file of several recordings their names.

    Example: truestand info k1.csv
    """
    from truestand.cli.terminal import print_json, working
    from truestand.files.scans.read import info as describe
    from truestand.files.scans.read import info_of_several, read_recording, recordings

    with working(f"Reading {scan.name}", quiet):
        layout = raw_layout(raw_type, points)
        found = {} if pick else recordings(scan, layout)
        facts = info_of_several(found) if len(found) > 1 else describe(read_recording(scan, pick, layout))
    if quiet:
        return
    if as_json:
        print_json(facts)
        return
    several = facts.pop("recordings", [])
    width = max(len(key) for key in facts)
    for key, value in facts.items():
        typer.echo(f"{key.replace('_', ' '):{width}}  {_shown(value)}")
    for one in several:
        typer.echo(f"--pick {one['pick']}  {one['profiles']} profiles, {one['points_seen']} points seen")


def _shown(value: object) -> object:
    return "unknown" if value is None else f"{value:.6g}" if isinstance(value, float) else value
