"""The jobs of a stand from start to evidence: calibrate, inspect, verify. Each takes a scan and makes its record."""

from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from truestand.core.errors import BadRecipe, DeviceError, Fault
from truestand.station.acquire import Live
from truestand.station.recipe import order_of, read_devices
from truestand.station.scan import now, take_scan

if TYPE_CHECKING:
    from collections.abc import Iterator

    from truestand.core.calibration import Calibration
    from truestand.core.scan import Scan

Kind = Literal["calibrate", "inspect", "verify"]
STEPS: dict[Kind, tuple[tuple[str, str], ...]] = {
    "calibrate": (("acquire", "Scan the shaft"), ("evaluate", "Calibrate"), ("report", "Write the report")),
    "inspect": (("acquire", "Scan the part"), ("evaluate", "Inspect"), ("report", "Write the report")),
    "verify": (("acquire", "Scan the shaft"), ("evaluate", "Compare with the calibration")),
}
"""Names and what people read; ``keep`` follows in each."""


@dataclass(frozen=True, slots=True)
class Job:
    """What is to be done."""

    kind: Kind
    stand: Path
    folder: Path
    """Where the job's files go."""
    artefact: Path | None = None
    part: Path | None = None
    calibration: Path | None = None
    """calibration.json that inspections and verifications rest on."""
    identity: Mapping[str, str] = field(default_factory=dict)
    """``serial``, ``order``, ``operator`` of what is inspected, where they differ from the recipe's."""


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a job, and the files that prove it."""

    kind: Literal["calibration", "inspection", "verification"]
    record: dict[str, Any]
    evidence: dict[str, Path]
    verdict: str | None
    status: str | None
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Watching:
    """Who is told how the job goes on."""

    step: Callable[[str, str], None] = lambda name, state: None
    """Name, and ``running``, ``done`` or ``failed``."""
    live: Callable[[Live], None] = lambda live: None

    @contextmanager
    def doing(self, name: str) -> "Iterator[None]":
        """Tell the begin and the end of a step."""
        self.step(name, "running")
        done = False
        try:
            yield
            done = True
        finally:
            self.step(name, "done" if done else "failed")


def run(job: Job, watching: Watching) -> Result:
    """Do a job.

    Raises:
        BadRecipe: a recipe is missing or wrong.
        Fault: the stand stopped itself; what came is in the folder, and nothing is concluded from it.
        DeviceError, NotEnoughData, WrongDrawing: as from the scan and its evaluation.
        KeyboardInterrupt: broken off by the operator.
    """
    return {"calibrate": _calibrate, "inspect": _inspect, "verify": _verify}[job.kind](job, watching)


def _calibrate(job: Job, watching: Watching) -> Result:
    from truestand.calibration.calibrate import calibrate
    from truestand.calibration.evidence import gather
    from truestand.files.atomic import write_text_atomic
    from truestand.files.recipes.company import read_company
    from truestand.files.recipes.recipes import read_shaft
    from truestand.files.records.records import write_calibration
    from truestand.report.calibration import calibration_report

    artefact = _needed(job.artefact, "the shaft's recipe (shaft.toml)")
    shaft = read_shaft(artefact)
    scan = _scan(job, watching, "shaft.h5")
    record, report = job.folder / "calibration.json", job.folder / "report.html"
    with watching.doing("evaluate"):
        calibration = replace(calibrate(scan, shaft), created=now())
        written = write_calibration(record, calibration)
    with watching.doing("report"):
        paper = calibrate(scan, shaft, "paper")
        evidence = gather(scan, shaft, calibration, paper)
        text = calibration_report(calibration, evidence, paper, company=read_company(job.stand))
        write_text_atomic(report, text)
    files = {"scan": job.folder / "shaft.h5", "stand": job.stand, "artefact": artefact, "report": report}
    return Result("calibration", written, files, None, calibration.status, calibration.reasons)


def _inspect(job: Job, watching: Watching) -> Result:
    from truestand.apply.transfer import transfer
    from truestand.core.calibration import ScanSummary
    from truestand.core.surface import apply_calibration
    from truestand.files.atomic import write_json_atomic, write_text_atomic
    from truestand.files.recipes.company import read_company
    from truestand.files.recipes.parts import read_identity, read_part
    from truestand.files.records.inspection_record import inspection_record
    from truestand.files.scans.read import sha256_of
    from truestand.files.shapes.clouds import write_cloud
    from truestand.parts.inspect import inspect
    from truestand.report.inspection import inspection_report

    part, against = _needed(job.part, "the part's recipe"), _needed(job.calibration, "a calibration")
    drawing, calibration = read_part(part), _known(against)
    scan = _scan(job, watching, "part.h5")
    with watching.doing("evaluate"):
        tied = transfer(scan, calibration)
        surface = apply_calibration(tied.scan, tied.calibration)
        created = now()
        found = replace(inspect(surface, drawing), created=created, identity={**read_identity(part), **job.identity})
        record = inspection_record(found, tied.calibration, ScanSummary.of(scan), sha256_of(against), created)
        write_json_atomic(job.folder / "inspection.json", record)
    files = {"scan": job.folder / "part.h5", "stand": job.stand, "part": part, "calibration": against}
    with watching.doing("report"):
        files["report"], company = job.folder / "report.html", read_company(job.stand)
        write_text_atomic(files["report"], inspection_report(found, surface.calibration, company=company))
        if found.deviation is not None:
            files["cloud"] = job.folder / "cloud.ply"
            write_cloud(files["cloud"], surface.x, surface.y, surface.z, 1000.0 * found.deviation)
    return Result("inspection", record, files, found.verdict, None, found.reasons)


def _verify(job: Job, watching: Watching) -> Result:
    from truestand.apply.verify import verify
    from truestand.files.atomic import write_json_atomic
    from truestand.files.recipes.recipes import read_shaft
    from truestand.files.records.verification_record import verification_record
    from truestand.files.scans.read import sha256_of

    against = _needed(job.calibration, "a calibration")
    old = _known(against)
    shaft = old.artefact if job.artefact is None else read_shaft(job.artefact)
    if shaft is None:
        raise BadRecipe(f"{against.name} carries no artefact; need the shaft's recipe (shaft.toml)")
    scan = _scan(job, watching, "shaft.h5")
    with watching.doing("evaluate"):
        found = verify(scan, old, shaft)
        record = verification_record(found, now(), sha256_of(against))
        write_json_atomic(job.folder / "verification.json", record)
    evidence = {"scan": job.folder / "shaft.h5", "stand": job.stand, "calibration": against}
    return Result("verification", record, evidence, found.verdict, None, found.reasons)


def _scan(job: Job, watching: Watching, name: str) -> "Scan":
    """A complete scan with the stand's one sensor; an incomplete one proves nothing."""
    from truestand.core.scan import interpret

    stand, devices = read_devices(job.stand)
    if len(devices.sensor) > 1:
        names = ", ".join(s.name for s in devices.sensor)
        raise BadRecipe(f"found sensors {names}, a job takes one; use `truestand acquire` for several")
    job.folder.mkdir(parents=True, exist_ok=True)
    with watching.doing("acquire"):
        order = order_of(stand, devices.acquire)
        taken = take_scan(job.stand, stand, devices, order, job.folder / name, watching.live)
        if taken.interrupted:
            raise KeyboardInterrupt
        if taken.fault:
            raise Fault(f"{taken.fault}; mend the cause, then reset the stand")
        if not taken.complete:
            raise DeviceError("; ".join(reason for w in taken.written for reason in w.scan.reasons))
    return interpret(taken.written[0].scan.recording)


def _known(path: Path) -> "Calibration":
    from truestand.files.records.records import read_calibration

    return read_calibration(path)


def _needed(path: Path | None, what: str) -> Path:
    if path is None:
        raise BadRecipe(f"found no {what}; a job of this kind needs it")
    return path
