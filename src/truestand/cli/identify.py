"""``truestand identify``: which gear is it?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truestand.cli.options import ForceOption, JsonOption, QuietOption, StandOption, StartAngleOption

if TYPE_CHECKING:
    from truestand.gear.match import Seen


def identify(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan of the gear on the calibrated stand.")],
    calibration: Annotated[Path, typer.Option("--calibration", metavar="CALIBRATION.json", help="The stand today.")],
    stand: StandOption = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="GEAR.toml", help="Write a recipe to start from.")
    ] = None,
    from_mm: Annotated[float | None, typer.Option(help="Lower end of the face, height; default: seen.")] = None,
    to_mm: Annotated[float | None, typer.Option(help="Upper end of the face; default: seen.")] = None,
    start_angle_deg: StartAngleOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Tell teeth, module, helix and shift of an unknown gear from its scan.

    Example: truestand identify gear.csv --calibration calibration.json -o gear.toml
    """
    from truestand.cli.calibrate import tell_doubts
    from truestand.cli.reading import scan_reader
    from truestand.cli.talk import print_json, working
    from truestand.core.errors import BadRecipe
    from truestand.core.frames import Pose
    from truestand.core.surface import apply_calibration
    from truestand.files.atomic import write_text_atomic
    from truestand.files.recipes.parts import recipe_of_identified
    from truestand.files.records.calibration_record import read_calibration
    from truestand.gear.match import identify as tell
    from truestand.gear.match import toothed_heights

    if output is not None and output.exists() and not force:
        raise BadRecipe(f"found {output} already there; choose another name or pass --force")
    known = read_calibration(calibration)
    tied = scan_reader(stand, start_angle_deg, quiet).tied(scan, known)
    with working("Identifying", quiet):
        surface = apply_calibration(tied.scan, tied.calibration)
        datum = Pose.from_matrix(IDENTITY)
        low, high = toothed_heights(surface, datum)
        low, high = low if from_mm is None else from_mm, high if to_mm is None else to_mm
        found = tell(surface, datum, low, high)
    if output is not None:
        write_text_atomic(output, recipe_of_identified(found, low, high))
    if as_json:
        print_json(_record(found, low, high))
    elif not quiet:
        typer.echo(f"{found}\nface from {low:.2f} to {high:.2f} mm, root diameter {found.root_diameter:.2f} mm")
        if output is not None:
            typer.echo(output)
    tell_doubts(tied.calibration, quiet)


IDENTITY: Any = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _record(found: "Seen", low: float, high: float) -> dict[str, Any]:
    from math import degrees

    return {
        "teeth": found.teeth,
        "module_mm": found.module,
        "pressure_angle_deg": degrees(found.pressure_angle),
        "helix_angle_deg": degrees(found.helix_angle),
        "profile_shift": found.profile_shift,
        "base_diameter_mm": 2 * found.base_radius,
        "tip_diameter_mm": found.tip_diameter,
        "root_diameter_mm": found.root_diameter,
        "face_from_mm": low,
        "face_width_mm": high - low,
        "rms_um": 1000 * found.rms,
    }
