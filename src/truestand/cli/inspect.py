"""``truestand inspect``, ``identify`` and ``roll``: what a scan of a part on the calibrated stand tells of the part."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from truestand.apply.views import placed, transfer_views
from truestand.cli.evaluation import end_if_untrusted, print_witness, scan_reader
from truestand.cli.options import (
    VERDICT_CODES,
    CalibrationOption,
    ForceOption,
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
from truestand.cli.terminal import hint, print_json, print_table, progress, step_progress
from truestand.core.errors import BadRecipe
from truestand.core.frames import Pose
from truestand.core.surface import apply_calibration
from truestand.core.units import um
from truestand.files.atomic import write_text_atomic
from truestand.files.recipes.parts import recipe_of_identified
from truestand.files.records.calibration_record import read_calibration
from truestand.files.records.record import read_json
from truestand.files.shapes.clouds import Cloud, check_suffix, write_clouds
from truestand.gear.match import IdentifiedGear, is_standard, toothed_heights
from truestand.gear.match import identify as identify_gear
from truestand.report.terminal import inspection_table, seams_table
from truestand.station.pipeline import Inputs, Outputs, inspect_job

if TYPE_CHECKING:
    from truestand.gear.ties import PartTurned


def inspect(
    scans: Annotated[
        list[Path],
        typer.Argument(metavar="SCAN...", help="A scan of the part on the calibrated stand, or one by each sensor."),
    ],
    calibration: CalibrationOption,
    part: Annotated[Path, typer.Option("--part", metavar="PART.toml", help="The part: gear, turned or CAD model.")],
    stand: StandOption = None,
    output: Annotated[
        Path, output_option("--output", "-o", metavar="INSPECTION.json", help="The record to write.")
    ] = Path("inspection.json"),
    report: ReportOption = None,
    table: Annotated[
        Path | None, output_option("--csv", metavar="CHARACTERISTICS.csv", help="Write the characteristics as CSV.")
    ] = None,
    cloud: Annotated[
        Path | None,
        output_option("--cloud", metavar="CLOUD", help="Write the cloud with its deviations: .ply, .xyz, .npz."),
    ] = None,
    truth: TruthOption = None,
    view: ViewOption = None,
    part_turned: Annotated[
        str | None,
        typer.Option(
            metavar="0,7,over|auto",
            help="Several scans of a gear that was clamped again: by how many teeth it sat turned in each, or over.",
        ),
    ] = None,
    start_angle_deg: StartAngleOption = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    serial: Annotated[
        str | None, typer.Option("--serial", help="Serial number of the part; default: that of PART.toml.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check a part's geometry against its drawing: 0 conforms, 1 does not, 3 undecided or untrusted.

    Scans of a gear by several sensors are inspected as one, and so are scans between which it was clamped again.

    Example: truestand inspect gear.csv --calibration calibration.json --part gear.toml --report r.html
    """
    results = results_folder(store, stand)
    reader = scan_reader(stand, start_angle_deg, quiet, view)
    known = None if truth is None else read_json(truth)
    outputs = Outputs(output, cloud, report, table)
    identity = {key: value for key, value in (("serial", serial), ("operator", operator)) if value is not None}
    outcome = inspect_job(
        Inputs(tuple(scans), stand, calibration=calibration, part=part), outputs, reader.when_asked(*scans),
        step_progress("Inspecting", quiet), identity=identity, start_stated=reader.start_stated, truth=known,
        part_turned=_teeth_turned(part_turned, len(scans)),
    )  # fmt: skip
    inspection = outcome.result
    keep(results, outcome.kind, outcome.record, outcome.evidence, operator, quiet)
    if as_json:
        print_json(outcome.record)
    elif not quiet:
        print_table(inspection_table(inspection, known, read_calibration(calibration)))
        if inspection.seams:
            print_table(seams_table(inspection.seams))
        typer.echo("\n".join(str(path) for path in outputs.paths))
    for remark in inspection.remarks:
        hint(str(remark), quiet)
    for reason in inspection.reasons:
        hint(f"untrusted: {reason}", quiet)
    raise typer.Exit(VERDICT_CODES[inspection.verdict])


def _teeth_turned(text: str | None, scans: int) -> "tuple[PartTurned, ...] | None":
    """By how many teeth the part sat turned in each scan, or turned over; None in it: the pitches tell.

    Raises:
        BadRecipe: neither.
    """
    if text is None:
        return None
    entries = [entry.strip() for entry in text.split(",")]
    known: dict[str, PartTurned] = {"auto": None, "over": "over"}
    try:
        turned = tuple(known[entry] if entry in known else int(entry) for entry in entries)
    except ValueError as wrong:
        raise BadRecipe(f"found --part-turned {text}, need numbers of teeth as 0,7,16, over, or auto") from wrong
    return (None,) * scans if turned == (None,) else turned


def roll(
    scans: Annotated[
        list[Path], typer.Argument(metavar="SCAN...", help="A scan of any part, or one by each of several sensors.")
    ],
    calibration: CalibrationOption,
    output: Annotated[
        Path, output_option("--output", "-o", metavar="CLOUD", help="By suffix: .ply, .xyz, .npz or .e57.")
    ],
    stand: StandOption = None,
    view: ViewOption = None,
    start_angle_deg: StartAngleOption = None,
    quiet: QuietOption = False,
) -> None:
    """Roll a scan up into a point cloud in the shaft's own coordinates.

    Scans of several views become one cloud, in the coordinates of the calibration's first view.

    Example: truestand roll gear.csv --calibration calibration.json -o gear.ply
    """
    check_suffix(output)
    known, reader = read_calibration(calibration), scan_reader(stand, start_angle_deg, quiet, view)
    transferred = transfer_views(reader.when_asked(*scans)(known.whole_stand), known, reader.start_stated)
    with progress("Rolling up", quiet):
        surfaces = [placed(t, known) for t in transferred]
        views = [t.scan.view for t in transferred]
        write_clouds(output, [Cloud(s.x, s.y, s.z, view=view) for s, view in zip(surfaces, views, strict=True)])
    if not quiet:
        typer.echo(output)
    for one in transferred:
        print_witness(one, quiet)
    reasons = dict.fromkeys(r for s in surfaces if s.calibration is not None for r in s.calibration.reasons)
    end_if_untrusted(tuple(reasons), quiet)


def identify(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan of the gear on the calibrated stand.")],
    calibration: CalibrationOption,
    stand: StandOption = None,
    output: Annotated[
        Path | None, output_option("--output", "-o", metavar="GEAR.toml", help="Write a recipe to start from.")
    ] = None,
    from_mm: Annotated[float | None, typer.Option(help="Lower end of the face, height; default: seen.")] = None,
    to_mm: Annotated[float | None, typer.Option(help="Upper end of the face; default: seen.")] = None,
    view: ViewOption = None,
    start_angle_deg: StartAngleOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Tell teeth, module, helix and shift of an unknown gear from its scan: 0 sure, 3 not sure, or untrusted.

    Example: truestand identify gear.csv --calibration calibration.json -o gear.toml
    """
    if output is not None and output.exists() and not force:
        raise BadRecipe(f"found {output} already there; choose another name or pass --force")
    transferred = scan_reader(stand, start_angle_deg, quiet, view).transferred(scan, calibration)
    with progress("Identifying", quiet):
        surface = apply_calibration(transferred.scan, transferred.calibration)
        datum = Pose.from_matrix(np.eye(4))
        low, high = toothed_heights(surface, datum)
        low, high = low if from_mm is None else from_mm, high if to_mm is None else to_mm
        gear = identify_gear(surface, datum, low, high)
    if output is not None:
        write_text_atomic(output, recipe_of_identified(gear, low, high))
    if as_json:
        print_json(_gear_record(gear, low, high))
    elif not quiet:
        typer.echo(
            f"{gear}\nface from {low:.2f} to {high:.2f} mm, root diameter {gear.root_diameter:.2f} mm, confidence "
            f"{gear.confidence:.2f}"
        )
        if output is not None:
            typer.echo(output)
    doubts = () if gear.sure else (_doubt(gear),)
    end_if_untrusted((*transferred.calibration.reasons, *doubts), quiet)


def _doubt(gear: IdentifiedGear) -> str:
    """Why it may be another gear."""
    if gear.rivals:
        return f"not sure which gear it is; it may also have {gear.rivals[0]}"
    if not is_standard(gear.module):
        return (
            f"not sure which gear it is: module {gear.module:.4g} is none of ISO 54; check its tip diameter by hand, "
            "or whether the sensor still stands where it was calibrated (truestand verify)"
        )
    return (
        f"not sure which gear it is: {gear.confidence:.0%} of the readings between root and tip lie on its flanks; "
        "check --from-mm and --to-mm, and whether sensor and shaft still stand where they were calibrated (truestand "
        "verify)"
    )


def _gear_record(gear: IdentifiedGear, low: float, high: float) -> dict[str, Any]:
    return {
        "teeth": gear.teeth,
        "module_mm": gear.module,
        "pressure_angle_deg": degrees(gear.pressure_angle),
        "helix_angle_deg": degrees(gear.helix_angle),
        "profile_shift": gear.profile_shift,
        "base_diameter_mm": 2 * gear.base_radius,
        "tip_diameter_mm": gear.tip_diameter,
        "root_diameter_mm": gear.root_diameter,
        "face_from_mm": low,
        "face_width_mm": high - low,
        "rms_um": um(gear.rms),
        "confidence": gear.confidence,
        "sure": gear.sure,
        "rivals": [
            {
                "teeth": r.teeth,
                "module_mm": r.module,
                "pressure_angle_deg": degrees(r.pressure_angle),
                "helix_angle_deg": degrees(r.helix_angle),
                "confidence": r.confidence,
            }
            for r in gear.rivals
        ],
    }
