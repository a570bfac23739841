"""The jobs that the page can start: each takes a scan with the stand, and evaluates it as the commands do."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from truestand.core.errors import DeviceError, Fault
from truestand.core.scan import Scan, interpret
from truestand.station.acquire import Live
from truestand.station.pipeline import Inputs, Outcome, Outputs, TakeScans, calibrate_job, inspect_job, verify_job
from truestand.station.recipe import read_devices, scan_settings, stops_of
from truestand.station.scan import output_paths, take_scan

Kind = Literal["calibrate", "inspect", "verify"]
STEPS: dict[Kind, tuple[tuple[str, str], ...]] = {
    "calibrate": (("acquire", "Scan the shaft"), ("evaluate", "Calibrate"), ("report", "Write the report")),
    "inspect": (("acquire", "Scan the part"), ("evaluate", "Inspect"), ("report", "Write the report")),
    "verify": (("acquire", "Scan the shaft"), ("evaluate", "Compare with the calibration")),
}
"""Each step's name and title; ``keep`` follows in each."""


@dataclass(frozen=True, slots=True)
class Job:
    """A scan to take and evaluate: the recipes, and the folder for the results."""

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
class Observer:
    """Functions to call as a job goes on."""

    step: Callable[[str, str], None] = lambda name, state: None
    """With the name of a step, and ``running``, ``done`` or ``failed``."""
    live: Callable[[Live], None] = lambda live: None

    @contextmanager
    def during(self, name: str) -> Iterator[None]:
        """Report the begin and the end of a step."""
        self.step(name, "running")
        with ExitStack() as on_failure:
            on_failure.callback(self.step, name, "failed")
            yield
            on_failure.pop_all()
        self.step(name, "done")


def run_job(job: Job, observer: Observer) -> Outcome[Any]:
    """Take the scan of a job and evaluate it; its files lie in its folder.

    Raises:
        BadRecipe: a recipe is missing or wrong.
        Fault: the stand stopped itself; what came is in the folder and is not evaluated.
        DeviceError, NotEnoughData, WrongDrawing: as from the scan and its evaluation.
        KeyboardInterrupt: broken off by the operator.
    """
    folder, report = job.folder, job.folder / "report.html"
    shaft, part = folder / "shaft.h5", folder / "part.h5"
    stops = stops_of(*read_devices(job.stand))

    def scans(path: Path) -> tuple[Path, ...]:
        return output_paths(path, stops)

    def take(path: Path) -> TakeScans:
        return lambda stand: _scans(job, observer, path)

    if job.kind == "calibrate":
        inputs = Inputs(scans(shaft), job.stand, job.artefact)
        outputs = Outputs(folder / "calibration.json", report=report)
        return calibrate_job(inputs, outputs, take(shaft), observer.during)
    if job.kind == "inspect":
        inputs = Inputs(scans(part), job.stand, job.artefact, job.calibration, job.part)
        outputs = Outputs(folder / "inspection.json", folder / "cloud.ply", report)
        return inspect_job(inputs, outputs, take(part), observer.during, identity=job.identity)
    inputs = Inputs(scans(shaft), job.stand, job.artefact, job.calibration)
    return verify_job(inputs, Outputs(folder / "verification.json"), take(shaft), observer.during)


def _scans(job: Job, observer: Observer, path: Path) -> tuple[Scan, ...]:
    """A complete scan by each of the stand's views; an incomplete one is an error."""
    stand, devices = read_devices(job.stand)
    job.folder.mkdir(parents=True, exist_ok=True)
    with observer.during("acquire"):
        outcome = take_scan(job.stand, stand, devices, scan_settings(stand, devices.acquire), path, observer.live)
        if outcome.interrupted:
            raise KeyboardInterrupt
        if outcome.fault:
            raise Fault(f"{outcome.fault}; mend the cause, then reset the stand")
        if not outcome.complete:
            raise DeviceError("; ".join(reason for w in outcome.written for reason in w.scan.reasons))
    return tuple(interpret(one.scan.recording) for one in outcome.written)
