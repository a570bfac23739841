"""``truestand form``: associate a feature with points, and say how far they depart from it."""

from collections.abc import Sequence
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Annotated, Literal

import typer

from truestand.apply.transfer import Transfer, with_sensor_as_calibrated
from truestand.cli.evaluation import end_if_untrusted, print_witness, scan_reader
from truestand.cli.options import JsonOption, QuietOption, StandOption, StartAngleOption, output_option
from truestand.cli.terminal import hint, print_json, progress
from truestand.core.arrays import Array
from truestand.core.artefact import Cylinder
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe
from truestand.core.message import Message
from truestand.core.surface import apply_calibration
from truestand.core.units import um
from truestand.files.atomic import write_json_atomic, write_text_atomic
from truestand.files.records.form_record import deviations_csv, form_record
from truestand.files.records.record import now
from truestand.files.scans.read import sha256_of
from truestand.files.shapes.points import read_points
from truestand.form.associate import Feature
from truestand.form.form import Form, Reference, evaluate
from truestand.form.sections import CIRCLE_CELLS, CYLINDER_CELLS, SECTION, run_out, section
from truestand.form.upr import FilterKind, UprFilter

FORM_NAMES = {
    "line": "straightness",
    "plane": "flatness",
    "circle": "roundness",
    "cylinder": "cylindricity",
    "sphere": "sphericity",
    "cone": "conicity",
}
PLANAR: tuple[Feature, ...] = ("line", "circle")
"""Features that points of a plane have."""


def form(
    points: Annotated[
        Path,
        typer.Argument(metavar="POINTS", help="x y z text, PLY, PCD, NPY, STL or NIST .ds; a scan with --calibration."),
    ],
    feature: Annotated[Feature, typer.Option(help="What to associate.")],
    reference: Annotated[
        Reference,
        typer.Option(
            help="LSC least squares, MZC minimum zone; circle, cylinder and sphere also MIC maximum inscribed and MCC "
            "minimum circumscribed."
        ),
    ] = "LSC",
    columns: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="Which columns are x, y and z, by name or number from 1; X,Y of a profile."),
    ] = None,
    unit: Annotated[
        Literal["mm", "um", "m"] | None,
        typer.Option(help="Of columns whose names give none (x_um does); default: as a comment tells, or mm."),
    ] = None,
    filter_upr: Annotated[
        float | None, typer.Option(min=0.001, help="Circle: low-pass filter with its cut-off in waves a turn.")
    ] = None,
    filter_kind: Annotated[
        FilterKind | None, typer.Option(help="Gaussian: half of the wave at the cut-off passes; sharp: all up to it.")
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
        Path | None, output_option("--output", "-o", metavar="FORM.json", help="Write the record.")
    ] = None,
    deviations: Annotated[
        Path | None, output_option("--points", metavar="OUT.csv", help="Write every point with its deviation.")
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Associate a line, plane, circle, cylinder, sphere or cone with points, and measure the form that remains.

    Ends 3 where the fit is doubtful.

    Example: truestand form points.xyz --feature circle --reference MZC --filter-upr 50 -o form.json

    Example: truestand form export.csv --feature plane --columns 2,3,4 --unit um
    """
    of_scans = (surface, height_mm, stand, start_angle_deg)
    _refuse_mixed(of_scans, (columns, unit), calibration is not None)
    low_pass = _low_pass(filter_upr, filter_kind)
    travel, transferred = None, None
    remarks: tuple[Message, ...] = ()
    with progress(f"Reading {points.name}", quiet):
        if calibration is None:
            file = read_points(points, columns, unit, planar=feature in PLANAR)
            cloud, remarks = file.points, file.remarks
        else:
            transferred = _transferred(points, calibration, stand, feature, start_angle_deg)
            cloud = _section(transferred, feature, surface, height_mm)
            travel = run_out(cloud)
    with progress("Associating", quiet):
        result = evaluate(cloud, feature, reference, low_pass)
        result = replace(result, remarks=(*remarks, *result.remarks))
    doubts = () if transferred is None else transferred.calibration.reasons
    record = form_record(result, now(), sha256_of(points), travel, doubts)
    if output is not None:
        write_json_atomic(output, record)
    if deviations is not None:
        write_text_atomic(deviations, deviations_csv(cloud, result))
    if as_json:
        print_json(record)
    elif not quiet:
        _print(result, travel)
    if transferred is not None:
        print_witness(transferred, quiet)
    for remark in result.remarks:
        hint(remark, quiet)
    end_if_untrusted((*doubts, *result.reasons), quiet)


def _refuse_mixed(of_scans: Sequence[object], of_points: Sequence[object], is_scan: bool) -> None:
    """Refuse options of scans with points, and of points with a scan."""
    if not is_scan and any(given is not None for given in of_scans):
        raise BadRecipe(
            "--surface, --height-mm, --stand and --start-angle-deg are for scans; "
            "pass --calibration CALIBRATION.json too"
        )
    if is_scan and any(given is not None for given in of_points):
        raise BadRecipe("--columns and --unit are for points; leave them out with --calibration")


def _low_pass(cutoff: float | None, kind: FilterKind | None) -> UprFilter | None:
    if cutoff is None and kind is not None:
        raise BadRecipe("found --filter-kind and no --filter-upr, which says the cut-off; add it")
    return None if cutoff is None else UprFilter(cutoff, kind or "gaussian")


def _transferred(
    path: Path, calibration: Path, stand: Path | None, feature: Feature, start_angle_deg: float | None
) -> Transfer:
    """The scan, and the calibration as it applies to it."""
    if feature not in ("circle", "cylinder"):
        raise BadRecipe(f"a {feature} can't be taken from a scan of the artefact; use circle or cylinder")
    return scan_reader(stand, start_angle_deg, quiet=True).transferred(path, calibration)


def _section(transferred: Transfer, feature: Feature, surface: str | None, height: float | None) -> Array:
    """Cell means (n, 3) mm of one cylinder of the artefact in a scan."""
    rolled = with_sensor_as_calibrated(apply_calibration(transferred.scan, transferred.calibration))
    cylinder, low, high = _measured_cylinder(transferred.calibration, surface)
    if feature == "cylinder":
        return section(rolled, cylinder.radius, low, high, CYLINDER_CELLS)
    middle = (low + high) / 2 if height is None else height
    return section(rolled, cylinder.radius, middle - SECTION / 2, middle + SECTION / 2, CIRCLE_CELLS)


def _measured_cylinder(calibration: Calibration, name: str | None) -> tuple[Cylinder, float, float]:
    """A cylinder of the artefact (default: the first) and the heights (mm) between which it was measured."""
    if calibration.artefact is None or not calibration.static_profiles:
        raise BadRecipe("the calibration carries no artefact; calibrate again with this version")
    heights_of = {p.surface: p.height for p in calibration.static_profiles}
    name = name or calibration.static_profiles[0].surface
    if name not in heights_of:
        raise BadRecipe(f"found no surface {name!r} in the calibration, need one of {', '.join(heights_of)}")
    heights = heights_of[name]
    cylinder = next(c for c in calibration.artefact.cylinders if c.name == name)
    return cylinder, float(heights[0]), float(heights[-1])


def _print(result: Form, run_out: float | None) -> None:
    def line(name: str, text: str, U: float | None = None) -> None:
        typer.echo(f"{name:22}{text}" + ("" if U is None else f"   U = {um(U):.3f} um (k = 2)"))

    line("feature", f"{result.feature}, {result.reference}, {result.n} points")
    line("point, mm", "  ".join(f"{v:.6f}" for v in result.point), result.U.get("point"))
    if result.direction is not None:
        line("direction", "  ".join(f"{v:.9f}" for v in result.direction))
    if result.radius is not None:
        line("radius, mm", f"{result.radius:.6f}", result.U.get("radius"))
    if result.half_angle is not None:
        U = result.U.get("half_angle")
        doubt = "" if U is None else f"   U = {degrees(U):.6f} (k = 2)"
        line("half angle, degrees", f"{degrees(result.half_angle):.6f}{doubt}")
    line("rms, um", f"{um(result.rms):.4f}")
    line(f"{FORM_NAMES[result.feature]}, um", f"{um(result.form):.4f}", result.U.get("form"))
    if result.low_pass is not None:
        line("filter", f"{result.low_pass.kind}, {result.low_pass.cutoff:g} UPR")
    line("noise floor, um", f"{um(result.noise_floor):.4f}   what this form value reads from the points' noise alone")
    if run_out is not None:
        kind = "circular" if result.feature == "circle" else "total"
        line(f"{kind} run-out, um", f"{um(run_out):.4f}   about the shaft's axis, unfiltered")
    if result.certificate is not None:
        proof = "proven" if result.certificate.scope == "global" else "no small move betters it"
        line(
            "optimum",
            f"{proof}: {len(result.certificate.contacts)} contacts, balanced to {result.certificate.imbalance:.0e}",
        )
