"""``truestand init``, ``import``, ``info`` and ``schema``: starter recipes, scan files, and the schemas of records."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import ForceOption, JsonOption, QuietOption, SensorsOption, StandOption, output_option
from truestand.cli.terminal import hint, print_json, progress
from truestand.core.errors import BadRecipe
from truestand.files.recipes.recipes import read_stand, write_starters
from truestand.files.records.schemas import schema_text
from truestand.files.scans.read import info as scan_facts
from truestand.files.scans.read import info_of_several, read_recording, recordings
from truestand.files.scans.scancontrol_raw import RawLayout
from truestand.files.scans.write_scan import write_recording

ScanArgument = Annotated[Path, typer.Argument(metavar="SCAN", help="A scan file of any readable format.")]
PickOption = Annotated[
    str | None,
    typer.Option("--pick", metavar="NAME", help="The recording of a file that holds several; `info` names them."),
]
RawTypeOption = Annotated[
    str | None,
    typer.Option("--raw-type", metavar="TYPE", help="Type of the scanCONTROL sensor of a raw dump, such as 29xx-50."),
]
PointsOption = Annotated[int | None, typer.Option("--points", help="Points in a profile of a raw dump.")]


def init(
    directory: Annotated[Path, typer.Argument(metavar="[DIR]", help="Where to write them.")] = Path(),
    views: SensorsOption = 1,
    force: ForceOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write starter recipes, commented: stand.toml, shaft.toml, gear.toml.

    Example: truestand init my-stand
    """
    for path in write_starters(directory, force, views):
        if not quiet:
            typer.echo(path)


def import_scan(
    scan: ScanArgument,
    output: Annotated[Path, output_option("--output", "-o", metavar="SCAN.h5", help="The native file to write.")],
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
    described = None if stand is None else read_stand(stand)
    with progress(f"Importing {scan.name}", quiet):
        recording = read_recording(scan, pick, _raw_layout(raw_type, points))
        write_recording(recording, output, described or recording.stand, force=force)
    if described is None and recording.stand is None:
        hint("no stand inside; pass --stand here or later", quiet)
    if not quiet:
        typer.echo(output)


def info(
    scan: ScanArgument,
    pick: PickOption = None,
    raw_type: RawTypeOption = None,
    points: PointsOption = None,
    as_json: JsonOption = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Check that it can be read, print nothing.")] = False,
) -> None:
    """Say what is in a scan file: format, profiles, points, turns; of a file of several recordings their names.

    Example: truestand info k1.csv
    """
    with progress(f"Reading {scan.name}", quiet):
        layout = _raw_layout(raw_type, points)
        several = {} if pick else recordings(scan, layout)
        facts = info_of_several(several) if len(several) > 1 else scan_facts(read_recording(scan, pick, layout))
    if quiet:
        return
    if as_json:
        print_json(facts)
        return
    listed = facts.pop("recordings", [])
    width = max(len(key) for key in facts)
    for key, value in facts.items():
        typer.echo(f"{key.replace('_', ' '):{width}}  {_as_text(value)}")
    for recording in listed:
        counts = f"{recording['profiles']} profiles, {recording['points_seen']} points seen"
        typer.echo(f"--pick {recording['pick']}  {counts}")


def _as_text(value: object) -> object:
    return "unknown" if value is None else f"{value:.6g}" if isinstance(value, float) else value


def _raw_layout(raw_type: str | None, points: int | None) -> RawLayout | None:
    """What a raw dump doesn't say of itself; None where it isn't one.

    Raises:
        BadRecipe: one of them without the other.
    """
    if raw_type is None and points is None:
        return None
    if raw_type is None or points is None:
        found, lacking = ("--points", "--raw-type") if raw_type is None else ("--raw-type", "--points")
        raise BadRecipe(f"found {found} without {lacking}; a raw dump needs both: --raw-type 29xx-50 --points 640")
    return RawLayout(raw_type, points)


def schema(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="calibration, verification, comparison, form, info, truth.")
    ],
) -> None:
    """Print the JSON Schema of a record.

    Example: truestand schema calibration > calibration.schema.json
    """
    typer.echo(schema_text(name), nl=False)
