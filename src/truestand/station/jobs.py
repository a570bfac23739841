"""The jobs that a page can start: each takes a scan with the stand, and evaluates it as the commands do."""

from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from truestand.core.errors import BadRecipe, DeviceError, Fault
from truestand.station.acquire import Live
from truestand.station.pipeline import Inputs, Outcome, Outputs, TakeScans, calibrate_job, inspect_job, verify_job
from truestand.station.recipe import order_of, read_devices
from truestand.station.scan import take_scan

if TYPE_CHECKING:
    from collections.abc import Iterator

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


def run(job: Job, watching: Watching) -> Outcome[Any]:
    """Do a job; its files lie in its folder.

    Raises:
        BadRecipe: a recipe is missing or wrong.
        Fault: the stand stopped itself; what came is in the folder, and nothing is concluded from it.
        DeviceError, NotEnoughData, WrongDrawing: as from the scan and its evaluation.
        KeyboardInterrupt: broken off by the operator.
    """
    folder, report = job.folder, job.folder / "report.html"
    shaft, part = folder / "shaft.h5", folder / "part.h5"

    def taking(path: Path) -> TakeScans:
        return lambda stand: (_scan(job, watching, path),)

    if job.kind == "calibrate":
        inputs, outputs = Inputs((shaft,), job.stand, job.artefact), Outputs(folder / "calibration.json", report=report)
        return calibrate_job(inputs, outputs, taking(shaft), watching.doing)
    if job.kind == "inspect":
        inputs = Inputs((part,), job.stand, calibration=job.calibration, part=job.part)
        outputs = Outputs(folder / "inspection.json", folder / "cloud.ply", report)
        return inspect_job(inputs, outputs, taking(part), watching.doing, identity=job.identity)
    inputs = Inputs((shaft,), job.stand, job.artefact, job.calibration)
    return verify_job(inputs, Outputs(folder / "verification.json"), taking(shaft), watching.doing)


def _scan(job: Job, watching: Watching, path: Path) -> "Scan":
    """A complete scan with the stand's one sensor; an incomplete one proves nothing."""
    from truestand.core.scan import interpret

    stand, devices = read_devices(job.stand)
    if len(devices.sensor) > 1:
        names = ", ".join(s.name for s in devices.sensor)
        raise BadRecipe(f"found sensors {names}, a job takes one; use `truestand acquire` for several")
    job.folder.mkdir(parents=True, exist_ok=True)
    with watching.doing("acquire"):
        order = order_of(stand, devices.acquire)
        taken = take_scan(job.stand, stand, devices, order, path, watching.live)
        if taken.interrupted:
            raise KeyboardInterrupt
        if taken.fault:
            raise Fault(f"{taken.fault}; mend the cause, then reset the stand")
        if not taken.complete:
            raise DeviceError("; ".join(reason for w in taken.written for reason in w.scan.reasons))
    return interpret(taken.written[0].scan.recording)
