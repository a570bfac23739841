"""``truestand inspect``: a part's scan to characteristics, defects and a verdict."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truestand.cli.options import (
    JsonOption,
    OperatorOption,
    QuietOption,
    ReportOption,
    StandOption,
    StartAngleOption,
    StoreOption,
    radians_or_none,
)

if TYPE_CHECKING:
    from truestand.core.inspection import Inspection
    from truestand.core.surface import Surface
    from truestand.files.recipes.company import Company

EXIT_CODES = {"conforms": 0, "does_not_conform": 1, "undecided": 3}


def inspect(
    scan: Annotated[Path, typer.Argument(metavar="SCAN", help="A scan of the part on the calibrated stand.")],
    calibration: Annotated[Path, typer.Option("--calibration", metavar="CALIBRATION.json", help="The stand today.")],
    part: Annotated[Path, typer.Option("--part", metavar="PART.toml", help="The part: gear, turned or CAD model.")],
    stand: StandOption = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="INSPECTION.json", help="The record to write.")
    ] = Path("inspection.json"),
    report: ReportOption = None,
    table: Annotated[
        Path | None, typer.Option("--csv", metavar="CHARACTERISTICS.csv", help="Write the characteristics as CSV.")
    ] = None,
    cloud: Annotated[
        Path | None,
        typer.Option("--cloud", metavar="CLOUD", help="Write the cloud with its deviations: .ply, .xyz, .npz."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Simulated scans: compare with the truth.")
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

    Example: truestand inspect gear.csv --calibration calibration.json --part gear.toml --report r.html
    """
    from truestand.apply.transfer import transfer
    from truestand.cli.keeping import keeping
    from truestand.cli.talk import now, print_json, print_table, working
    from truestand.core.calibration import ScanSummary
    from truestand.core.scan import interpret
    from truestand.core.surface import apply_calibration
    from truestand.files.recipes.parts import read_part
    from truestand.files.recipes.recipes import read_stand
    from truestand.files.records.inspection_record import inspection_record
    from truestand.files.records.records import read_calibration, read_json
    from truestand.files.scans.read import read_recording, sha256_of
    from truestand.parts.inspect import inspect as judge
    from truestand.report.terminal import inspection_table

    to = planned(output, cloud, report, table, stand)
    into = keeping(store, stand, operator, quiet)
    drawn, known = read_part(part), read_calibration(calibration)
    described = None if stand is None else read_stand(stand)
    true = None if truth is None else read_json(truth)
    with working(f"Reading {scan.name}", quiet):
        recording = read_recording(scan)
        seen = interpret(recording, described or recording.stand or known.stand, radians_or_none(start_angle_deg))
    created = now()
    with working("Inspecting", quiet):
        tied = transfer(seen, known, start_angle_deg is not None)
        surface = apply_calibration(tied.scan, tied.calibration)
        inspection = replace(judge(surface, drawn), created=created, identity=_identity(part, serial, operator))
    record = inspection_record(inspection, tied.calibration, ScanSummary.of(seen), sha256_of(calibration), created)
    with working("Writing", quiet):
        write(to, record, inspection, surface, true)
    into.keep("inspection", record, _evidence(scan, calibration, part) | {"stand": stand, "report": report})
    if as_json:
        print_json(record)
    elif not quiet:
        print_table(inspection_table(inspection, true))
        typer.echo("\n".join(str(path) for path in to.paths))
    tell(inspection, quiet)
    raise typer.Exit(EXIT_CODES[inspection.verdict])


def _identity(part: Path, serial: str | None, operator: str | None) -> dict[str, str]:
    """Serial number, order and operator: what the options say, otherwise the recipe."""
    from truestand.files.recipes.parts import read_identity

    told = {"serial": serial, "operator": operator}
    return read_identity(part) | {key: value for key, value in told.items() if value is not None}


def _evidence(scan: Path, calibration: Path, part: Path) -> dict[str, Path | None]:
    """What an inspection rests on, by role; a CAD model stands in a file of its own."""
    from truestand.files.recipes.recipes import read_toml

    recipe = read_toml(part)
    model = part.parent / str(recipe["file"]) if recipe.get("kind") == "cad" else None
    return {"scan": scan, "calibration": calibration, "part": part, "model": model}


@dataclass(frozen=True)
class Written:
    """Where the results go; None = not asked for."""

    record: Path
    cloud: Path | None = None
    report: Path | None = None
    table: Path | None = None
    company: "Company | None" = None
    """At the head of the report."""

    @property
    def paths(self) -> list[Path]:
        """What was asked for."""
        return [p for p in (self.record, self.cloud, self.report, self.table) if p is not None]


def planned(record: Path, cloud: Path | None, report: Path | None, table: Path | None, stand: Path | None) -> Written:
    """Where the results go, refused before the work is done where one can't be written."""
    from truestand.files.recipes.company import read_company
    from truestand.files.shapes.clouds import check_suffix
    from truestand.report.pdf import check_report

    check_report(report)
    if cloud is not None:
        check_suffix(cloud)
    return Written(record, cloud, report, table, None if stand is None else read_company(stand))


def write(
    to: Written,
    record: dict[str, Any],
    inspection: "Inspection",
    surface: "Surface",
    truth: dict[str, Any] | None = None,
) -> None:
    """Record, cloud with deviations, characteristics, report."""
    from truestand.files.atomic import write_json_atomic
    from truestand.files.records.characteristics_csv import write_characteristics
    from truestand.files.shapes.clouds import write_cloud

    write_json_atomic(to.record, record)
    if to.cloud is not None and inspection.deviation is not None:
        write_cloud(to.cloud, surface.x, surface.y, surface.z, 1000.0 * inspection.deviation)
    if to.table is not None:
        write_characteristics(to.table, inspection)
    if to.report is not None:
        from truestand.report.inspection import inspection_report
        from truestand.report.pdf import write_report

        write_report(to.report, inspection_report(inspection, surface.calibration, truth, to.company))


def tell(inspection: "Inspection", quiet: bool) -> None:
    """Say why nothing could be decided, and what the reader should know."""
    from truestand.cli.talk import hint

    for remark in inspection.remarks:
        hint(f"truestand: {remark}", quiet)
    for reason in inspection.reasons:
        hint(f"truestand: untrusted: {reason}", quiet)
