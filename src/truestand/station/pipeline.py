"""From a scan to a result, its record, its report and their evidence: commands, page and demo all call these jobs.

Recipes are read first, then the scan is taken or read: a wrong recipe is found before a scan is taken.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from truestand.core.artefact import Artefact
from truestand.core.calibration import Calibration, Method, ScanSummary
from truestand.core.errors import BadRecipe, NotEnoughData, WrongDrawing
from truestand.core.inspection import Inspection
from truestand.core.message import RECIPE_CHANGED, Message
from truestand.core.scan import Scan
from truestand.core.stand import Stand
from truestand.core.surface import Surface, apply_calibration
from truestand.core.units import UM_PER_MM
from truestand.files.atomic import write_json_atomic
from truestand.files.recipes.changes import differences
from truestand.files.recipes.recipes import Company, read_company, read_shaft
from truestand.files.records.calibration_record import calibration_record, read_calibration
from truestand.files.records.record import now, read_json
from truestand.files.scans.read import sha256_of
from truestand.files.shapes.clouds import Cloud, check_suffix, write_cloud, write_clouds
from truestand.report.pdf import check_report, write_report

if TYPE_CHECKING:
    from truestand.apply.verify import Verification
    from truestand.gear.ties import PartTurned

Result = TypeVar("Result")
StepObserver = Callable[[Literal["evaluate", "report"]], AbstractContextManager[Any]]
"""Entered for the time of a step: a progress bar, or an event for the page."""
TakeScans = Callable[[Stand | None], tuple[Scan, ...]]
"""Reads the scans, or takes one; given is the calibration's stand, for a scan that carries none."""


@dataclass(frozen=True, slots=True)
class Inputs:
    """The files that a result rests on."""

    scans: tuple[Path, ...]
    stand: Path | None = None
    artefact: Path | None = None
    calibration: Path | None = None
    part: Path | None = None

    def evidence(self, main: int = 0) -> dict[str, Path]:
        """The files by role; ``main``: which of several scans is the record's own. With a part comes its CAD model."""
        own = self.scans[main]
        further = {f"scan {k + 1}": path for k, path in enumerate(self.scans) if path != own}
        others = {"artefact": self.artefact, "stand": self.stand, "calibration": self.calibration, "part": self.part}
        if self.part is not None:
            from truestand.files.recipes.parts import model_of

            others["model"] = model_of(self.part)
        return {"scan": own, **further, **{role: path for role, path in others.items() if path is not None}}


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files to write; None = not wanted."""

    record: Path | None
    cloud: Path | None = None
    report: Path | None = None
    table: Path | None = None
    """Characteristics as CSV."""

    @property
    def paths(self) -> list[Path]:
        """The files that are wanted."""
        return [p for p in (self.record, self.cloud, self.report, self.table) if p is not None]

    def check(self) -> None:
        """Refuse what can't be written, before the work is done.

        Raises:
            MissingExtra: a PDF or a cloud that needs an extra.
            BadRecipe: a cloud of an unknown kind.
        """
        check_report(self.report)
        if self.cloud is not None:
            check_suffix(self.cloud)

    def evidence(self) -> dict[str, Path]:
        """The files, by role, that are kept with the record."""
        return {role: path for role, path in (("report", self.report), ("cloud", self.cloud)) if path is not None}


@dataclass(frozen=True, slots=True)
class Outcome(Generic[Result]):
    """A result, its record, and the files by role that prove it."""

    result: Result
    record: dict[str, Any]
    evidence: dict[str, Path]

    @property
    def kind(self) -> str:
        """calibration, inspection or verification."""
        return str(self.record["format"]).removeprefix("truestand.")


def calibrate_job(
    inputs: Inputs, outputs: Outputs, take: TakeScans, during: StepObserver, *,
    method: Method = "stand", clamped: tuple[float, ...] = (), truth: Mapping[str, Any] | None = None,
) -> Outcome[tuple[Calibration, Calibration | None]]:  # fmt: skip
    """Calibrate by a scan of the artefact, by one of each view, or by several with the shaft ``clamped`` at these
    angles (rad).

    The result is the calibration and, where a report shows it, that of the published method. ``truth``: of a
    simulated scan.

    Raises:
        BadRecipe, MissingExtra: before any scan is taken.
        NotEnoughData: as ``calibrate``, ``calibrate_positions`` and ``calibrate_views``.
    """
    outputs.check()
    artefact, company = read_shaft(_needed(inputs.artefact, "the shaft's recipe (shaft.toml)")), _company(inputs)
    main = -1 if clamped else 0  # of several clampings the last gives the shaft's pose
    scans = take(None)
    with during("evaluate"):
        calibration, published = _calibrated(scans, artefact, method, clamped, outputs.report is not None)
        created = now()
        calibration = replace(calibration, created=created)
        record = calibration_record(calibration, created)
        _write_record(outputs, record)
    with during("report"):
        _write_cloud(outputs.cloud, scans[main], calibration)
        if outputs.report is not None:
            from truestand.calibration.evidence import gather
            from truestand.report.calibration import calibration_report

            evidence = gather(scans[main], artefact, calibration, published)
            write_report(outputs.report, calibration_report(calibration, evidence, published, truth, company))
    return Outcome((calibration, published), record, inputs.evidence(main) | outputs.evidence())


def inspect_job(
    inputs: Inputs, outputs: Outputs, take: TakeScans, during: StepObserver, *,
    identity: Mapping[str, str] | None = None, start_stated: bool = False, truth: Mapping[str, Any] | None = None,
    part_turned: "tuple[PartTurned, ...] | None" = None,
) -> Outcome[Inspection]:  # fmt: skip
    """Inspect a part by a scan of it on the calibrated stand, by one of each view, or by several between which it was
    clamped again, ``part_turned`` by so many teeth in each, or turned over.

    ``identity``: serial, order, operator, where they are others than the recipe's; ``start_stated``: the table angle of
    the scan's first profile was given by the user; ``truth``: of a simulated scan.

    Raises:
        BadRecipe, MissingExtra: before any scan is taken.
        NotEnoughData, WrongDrawing: as ``inspect``.
    """
    from truestand.files.recipes.parts import read_identity, read_part
    from truestand.files.records.inspection_record import inspection_record
    from truestand.parts.inspect import demand_right_views, demand_views, inspect

    outputs.check()
    recipe, record_path = _needed(inputs.part, "the part's recipe"), _needed(inputs.calibration, "a calibration")
    part, calibration, company = read_part(recipe), read_calibration(record_path), _company(inputs)
    demand_views(len(inputs.scans), part, part_turned is not None)
    sha256 = sha256_of(record_path)
    changes = _changes(inputs)
    scans = take(calibration.whole_stand)
    with during("evaluate"):
        surfaces, created = _rolled_up(scans, calibration, start_stated, part_turned is not None), now()
        identity = {**read_identity(recipe), **(identity or {})}
        try:
            inspection = inspect(surfaces, part, part_turned)
        except (NotEnoughData, WrongDrawing):
            demand_right_views(scans, calibration, part, start_stated)
            raise
        inspection = replace(inspection, created=created, identity=identity, remarks=(*changes, *inspection.remarks))
        _, applied = surfaces[0].origin
        record = inspection_record(inspection, applied, tuple(map(ScanSummary.of, scans)), sha256, created)
        _write_record(outputs, record)
    with during("report"):
        _write_inspection(outputs, inspection, surfaces, company, truth)
    return Outcome(inspection, record, inputs.evidence() | outputs.evidence())


def verify_job(
    inputs: Inputs, outputs: Outputs, take: TakeScans, during: StepObserver, *,
    limit: float | None = None, start_stated: bool = False,
) -> "Outcome[Verification]":  # fmt: skip
    """Hold a calibration against a new scan of the artefact, or one by each view; ``limit`` (mm) is the usual one where
    none is given.

    Raises:
        BadRecipe: before any scan is taken, or as ``verify_views``.
        NotEnoughData: as ``verify``.
    """
    from truestand.apply.verify import LIMIT, verify_views
    from truestand.files.records.calibration_record import verification_record

    record_path = _needed(inputs.calibration, "a calibration")
    calibration, sha256 = read_calibration(record_path), sha256_of(record_path)
    artefact = calibration.artefact if inputs.artefact is None else read_shaft(inputs.artefact)
    if artefact is None:
        raise BadRecipe(f"{record_path.name} carries no artefact; need the shaft's recipe (--artefact SHAFT.toml)")
    scans = take(calibration.whole_stand)
    with during("evaluate"):
        verification = verify_views(scans, calibration, artefact, LIMIT if limit is None else limit, start_stated)
        record = verification_record(verification, now(), sha256)
        _write_record(outputs, record)
    return Outcome(verification, record, inputs.evidence())


def _needed(path: Path | None, name: str) -> Path:
    if path is None:
        raise BadRecipe(f"found no {name}; a job of this kind needs it")
    return path


def _changes(inputs: Inputs) -> tuple[Message, ...]:
    """In what the recipes, as they are now, differ from what the calibration was made with: kept with the result."""
    record = read_json(_needed(inputs.calibration, "a calibration"))
    found = differences(record, inputs.stand, inputs.artefact)
    return tuple(Message(RECIPE_CHANGED, f"changed since the calibration: {change}") for change in found)


def _company(inputs: Inputs) -> Company | None:
    return None if inputs.stand is None else read_company(inputs.stand)


def _write_record(outputs: Outputs, record: dict[str, Any]) -> None:
    if outputs.record is not None:
        write_json_atomic(outputs.record, record)


def _calibrated(
    scans: tuple[Scan, ...], artefact: Artefact, method: Method, clamped: tuple[float, ...], both: bool
) -> tuple[Calibration, Calibration | None]:
    """The calibration, and for a report that of the published method."""
    from truestand.calibration.calibrate import calibrate, calibrate_by_both
    from truestand.calibration.positions import calibrate_positions
    from truestand.calibration.views import calibrate_views

    if clamped:
        calibration = calibrate_positions(scans, clamped, artefact)
        return calibration, calibrate(scans[-1], artefact, "paper") if both else None
    if len(scans) > 1:
        return calibrate_views(scans, artefact), calibrate(scans[0], artefact, "paper") if both else None
    if both and method == "stand":
        return calibrate_by_both(scans[0], artefact)
    calibration = calibrate(scans[0], artefact, method)
    return calibration, calibration if both else None


def _rolled_up(
    scans: tuple[Scan, ...], calibration: Calibration, start_stated: bool, clamped_again: bool
) -> tuple[Surface, ...]:
    """The scans as the calibration applies to them: one in its own view's frames, several in those of the first."""
    from truestand.apply.transfer import roll
    from truestand.apply.views import roll_views

    if len(scans) > 1:
        return roll_views(scans, calibration, start_stated, clamped_again)
    return (roll(scans[0], calibration, start_stated),)


def _write_cloud(path: Path | None, scan: Scan, calibration: Calibration) -> None:
    if path is not None:
        surface = apply_calibration(scan, calibration)
        write_cloud(path, surface.x, surface.y, surface.z)


def _write_inspection(
    outputs: Outputs, inspection: Inspection, surfaces: tuple[Surface, ...], company: Company | None,
    truth: Mapping[str, Any] | None,
) -> None:  # fmt: skip
    """The cloud with its deviations, the characteristics, the report."""
    from truestand.files.records.inspection_record import write_characteristics

    if outputs.cloud is not None:
        write_clouds(outputs.cloud, _clouds(inspection, surfaces))
    if outputs.table is not None:
        write_characteristics(outputs.table, inspection)
    if outputs.report is not None:
        from truestand.report.inspection import inspection_report

        write_report(outputs.report, inspection_report(inspection, surfaces[0].calibration, truth, company))


def _clouds(inspection: Inspection, surfaces: tuple[Surface, ...]) -> list[Cloud]:
    """The cloud of each view, with the deviations (um) of its points."""
    clouds, first = [], 0
    for surface in surfaces:
        (profiles, points), deviation = surface.x.shape, inspection.deviation
        own = None if deviation is None else UM_PER_MM * deviation[first : first + profiles, :points]
        clouds.append(Cloud(surface.x, surface.y, surface.z, own, surface.origin[1].name))
        first += profiles
    return clouds
