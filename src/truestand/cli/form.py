"""``truestand form``: associate a feature with points, and say how far they depart from it."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truestand.cli.options import JsonOption, QuietOption, StandOption, StartAngleOption

if TYPE_CHECKING:
    from truestand.apply.transfer import Transfer
    from truestand.core.artefact import Cylinder
    from truestand.core.calibration import Calibration
    from truestand.form.form import Form
    from truestand.form.sections import Section


class FeatureName(StrEnum):
    """What to associate."""

    LINE = "line"
    PLANE = "plane"
    CIRCLE = "circle"
    CYLINDER = "cylinder"
    SPHERE = "sphere"


class ReferenceName(StrEnum):
    """By which reference."""

    LSC = "LSC"
    MZC = "MZC"
    MIC = "MIC"
    MCC = "MCC"


class LengthUnit(StrEnum):
    """The unit of coordinates."""

    MM = "mm"
    UM = "um"
    M = "m"


FORM_NAMES = {
    "line": "straightness",
    "plane": "flatness",
    "circle": "roundness",
    "cylinder": "cylindricity",
    "sphere": "sphericity",
}


def form(
    points: Annotated[
        Path, typer.Argument(metavar="POINTS", help="x y z text, PLY or NIST .ds; a scan with --calibration.")
    ],
    feature: Annotated[FeatureName, typer.Option(help="What to associate.")],
    reference: Annotated[
        ReferenceName,
        typer.Option(
            help="Least squares; circle and cylinder also minimum zone, maximum inscribed, minimum circumscribed."
        ),
    ] = ReferenceName.LSC,
    columns: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Which columns are x, y and z, by name or number from 1.")
    ] = None,
    unit: Annotated[
        LengthUnit | None, typer.Option(help="Of columns whose names give none (x_um does); default: mm.")
    ] = None,
    filter_upr: Annotated[
        float | None, typer.Option(min=0.001, help="Circle: Gaussian filter, half of this many waves a turn passes.")
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option("--calibration", metavar="CALIBRATION.json", help="POINTS is a scan: roll it up.")
    ] = None,
    surface: Annotated[
        str | None, typer.Option(help="Scan: which cylinder of the artefact; default: the first.")
    ] = None,
    height_mm: Annotated[
        float | None, typer.Option(help="Scan, circle: height of the section in C; default: the cylinder's middle.")
    ] = None,
    stand: StandOption = None,
    start_angle_deg: StartAngleOption = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FORM.json", help="Write the record.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Associate a line, plane, circle, cylinder or sphere with points, and measure the form that remains.

    Example: truestand form points.xyz --feature circle --reference MZC --filter-upr 50 -o form.json

    Example: truestand form export.csv --feature plane --columns 2,3,4 --unit um
    """
    from truestand.cli.talk import print_json, working
    from truestand.core.errors import BadRecipe
    from truestand.files.atomic import write_json_atomic
    from truestand.files.records.form_record import form_record
    from truestand.files.records.record import now
    from truestand.files.scans.read import sha256_of
    from truestand.files.shapes.points import read_points
    from truestand.form.form import evaluate

    if calibration is None and any(given is not None for given in (surface, height_mm, stand, start_angle_deg)):
        raise BadRecipe(
            "--surface, --height-mm, --stand and --start-angle-deg are for scans; "
            "pass --calibration CALIBRATION.json too"
        )
    if calibration is not None and (columns is not None or unit is not None):
        raise BadRecipe("--columns and --unit are for points; leave them out with --calibration")
    run_out, known = None, None
    with working(f"Reading {points.name}", quiet):
        if calibration is None:
            cloud = read_points(points, columns, unit)
        else:
            tied = _transferred(points, calibration, stand, feature, start_angle_deg)
            cells, known = _section(tied, feature, surface, height_mm), tied.calibration
            cloud, run_out = cells.points, cells.run_out
    with working("Associating", quiet):
        found = evaluate(cloud, feature.value, reference.value, filter_upr)
    record = form_record(found, now(), sha256_of(points), run_out)
    if output is not None:
        write_json_atomic(output, record)
    if as_json:
        print_json(record)
    elif not quiet:
        _print(found, run_out)
    if known is not None:
        from truestand.cli.calibrate import tell_doubts, tell_witness

        tell_witness(tied, quiet)
        tell_doubts(known, quiet)


def _transferred(
    path: Path, calibration: Path, stand: Path | None, feature: FeatureName, start_angle_deg: float | None
) -> "Transfer":
    """The scan, and the calibration as it applies to it."""
    from truestand.cli.reading import scan_reader
    from truestand.core.errors import BadRecipe
    from truestand.files.records.calibration_record import read_calibration

    if feature not in (FeatureName.CIRCLE, FeatureName.CYLINDER):
        raise BadRecipe(f"a {feature.value} can't be taken from a scan of the artefact; use circle or cylinder")
    return scan_reader(stand, start_angle_deg, quiet=True).tied(path, read_calibration(calibration))


def _section(tied: "Transfer", feature: FeatureName, surface: str | None, height: float | None) -> "Section":
    """Cells of one cylinder of the artefact in a scan."""
    from truestand.core.surface import apply_calibration
    from truestand.form.sections import CIRCLE_CELLS, CYLINDER_CELLS, SECTION, section

    rolled = apply_calibration(tied.scan, tied.calibration)
    cylinder, low, high = _stretch(tied.calibration, surface)
    if feature is FeatureName.CYLINDER:
        return section(rolled, cylinder.radius, low, high, CYLINDER_CELLS)
    middle = (low + high) / 2 if height is None else height
    return section(rolled, cylinder.radius, middle - SECTION / 2, middle + SECTION / 2, CIRCLE_CELLS)


def _stretch(known: "Calibration", name: str | None) -> "tuple[Cylinder, float, float]":
    """A cylinder of the artefact and the heights between which the calibration measured it."""
    from truestand.core.errors import BadRecipe

    if known.artefact is None or not known.static_profiles:
        raise BadRecipe("the calibration carries no artefact; calibrate again with this version")
    seen = {p.surface: p for p in known.static_profiles}
    wanted = name or known.static_profiles[0].surface
    if wanted not in seen:
        raise BadRecipe(f"found no surface {wanted!r} in the calibration, need one of {', '.join(seen)}")
    heights = seen[wanted].height
    cylinder = next(c for c in known.artefact.cylinders if c.name == wanted)
    return cylinder, float(heights[0]), float(heights[-1])


def _print(found: "Form", run_out: float | None) -> None:
    from truestand.core.units import um

    def line(name: str, text: str, U: float | None = None) -> None:
        typer.echo(f"{name:22}{text}" + ("" if U is None else f"   U = {um(U):.3f} um (k = 2)"))

    line("feature", f"{found.feature}, {found.reference}, {found.n} points")
    line("point, mm", "  ".join(f"{v:.6f}" for v in found.point), found.U.get("point"))
    if found.direction is not None:
        line("direction", "  ".join(f"{v:.9f}" for v in found.direction))
    if found.radius is not None:
        line("radius, mm", f"{found.radius:.6f}", found.U.get("radius"))
    line("rms, um", f"{um(found.rms):.4f}")
    line(f"{FORM_NAMES[found.feature]}, um", f"{um(found.form):.4f}", found.U.get("form"))
    if found.cutoff_upr is not None:
        line("filter", f"Gaussian, {found.cutoff_upr:g} UPR")
    line("noise floor, um", f"{um(found.noise_floor):.4f}   what this form value reads from the points' noise alone")
    if run_out is not None:
        kind = "circular" if found.feature == "circle" else "total"
        line(f"{kind} run-out, um", f"{um(run_out):.4f}   about the shaft's axis, unfiltered")
    if found.certificate is not None:
        proof = "proven" if found.certificate.scope == "global" else "no small move betters it"
        line(
            "optimum",
            f"{proof}: {len(found.certificate.contacts)} contacts, balanced to {found.certificate.imbalance:.0e}",
        )
