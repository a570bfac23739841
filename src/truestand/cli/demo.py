"""``truestand demo``: the main job on the virtual stand, from nothing to the verdict on a gear and its report."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from truestand.cli.options import QuietOption, SensorsOption
from truestand.cli.terminal import print_table, scan_progress, step_progress
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe, DeviceError, DeviceLost
from truestand.core.inspection import Inspection
from truestand.core.scan import Scan, interpret
from truestand.core.stand import Stand
from truestand.devices.gige.camera import Camera
from truestand.files.atomic import write_json_atomic, write_text_atomic
from truestand.files.recipes.recipes import STARTERS, write_starters
from truestand.files.records.calibration_record import write_calibration
from truestand.files.records.record import read_json
from truestand.report.terminal import inspection_table, summary_table, views_table
from truestand.station.interrupts import interrupted_by_signals
from truestand.station.pipeline import Inputs, Outputs, calibrate_job, inspect_job
from truestand.station.recipe import DevicesRecipe, read_devices, scan_settings, stops_of
from truestand.station.scan import output_paths, take_scan
from truestand.station.stand_lock import state_path

SHAFT, GEAR = "k1.h5", "gear.h5"
"""Scans; with two sensors their names are added."""
SCANS = (SHAFT, GEAR, "k1-front.h5", "k1-rear.h5", "gear-front.h5", "gear-rear.h5")
"""All that a demo may write."""
PACE = 20.0
"""Times real time; the virtual stand is slower where the machine can't draw as fast."""
RESULTS = (
    "truth.json",
    "calibration.json",
    "calibration-paper.json",
    "cloud.ply",
    "report.html",
    "gear-truth.json",
    "inspection.json",
    "gear.ply",
    "gear-report.html",
)


def demo(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where to write everything.")] = Path(
        "truestand-demo"
    ),
    views: SensorsOption = 1,
    open_report: Annotated[bool, typer.Option("--open", help="Open the reports in the browser.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Scan a shaft on the virtual stand, calibrate, scan a gear with a few errors, inspect it, report.

    Table and sensor answer over Modbus TCP and GigE Vision on this machine, as real ones would, only faster.

    Example: truestand demo --open
    """
    _refuse_real_scans(out)
    write_starters(out, True, views)
    stand = _demo_stand(out, quiet)
    with interrupted_by_signals(), _virtual_stand(out):
        calibration, paper, truth = _calibrate(stand)
        inspection, gear_truth = _inspect(stand)
    if not quiet:
        print_table(summary_table(calibration, paper, truth))
        if calibration.views:
            print_table(views_table(calibration.views))
        print_table(inspection_table(inspection, gear_truth, calibration))
        for path in (*(out / name for name in STARTERS), *stand.paths(SHAFT), *stand.paths(GEAR)):
            typer.echo(path)
        for name in RESULTS:
            typer.echo(out / name)
    if open_report:
        for name in ("report.html", "gear-report.html"):
            typer.launch(str(out / name))


@dataclass(frozen=True)
class DemoStand:
    """The recipes of the demo, and the folder that it writes to."""

    out: Path
    stand: Stand
    devices: DevicesRecipe
    quiet: bool

    def paths(self, name: str) -> tuple[Path, ...]:
        """Of the scans by that name, one by each view."""
        return output_paths(self.out / name, stops_of(self.stand, self.devices))

    def scan(self, name: str, description: str) -> tuple[Scan, ...]:
        """Take a scan by each sensor of the stand at its addresses, into the folder."""
        settings = scan_settings(self.stand, self.devices.acquire)
        with scan_progress(self.quiet, description) as show:
            outcome = take_scan(self.out / "stand.toml", self.stand, self.devices, settings, self.out / name, show)
        if outcome.interrupted:
            raise KeyboardInterrupt
        if not outcome.complete:
            reasons = "; ".join(r for w in outcome.written for r in w.scan.reasons)
            raise DeviceError(f"the virtual stand gave no complete scan: {reasons}; close other programs and try again")
        return tuple(interpret(one.scan.recording) for one in outcome.written)

    def mount_part(self) -> None:
        """Put the gear on the shaft."""
        for device in self.devices.sensor:
            with closing(Camera(device.name, device.address, device.heartbeat_ms)) as camera:
                camera.nodes.set("VirtualMounted", "Part")


def _demo_stand(out: Path, quiet: bool) -> DemoStand:
    _move_to_free_addresses(out / "stand.toml")
    state_path(out / "stand.toml").unlink(missing_ok=True)  # of the virtual stand of a demo that was broken off
    stand, devices = read_devices(out / "stand.toml")
    for earlier in (*SCANS, "k1.log", "gear.log"):
        (out / earlier).unlink(missing_ok=True)
    return DemoStand(out, stand, devices, quiet)


def _move_to_free_addresses(recipe: Path) -> None:
    """Give the demo's stand free addresses, so that demos can run side by side."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        table = f"127.0.0.1:{free.getsockname()[1]}"
    number = os.getpid() % 65_000
    text = recipe.read_text(encoding="utf-8").replace('address = "127.0.0.1:5020"', f'address = "{table}"')
    if sys.platform == "linux":  # elsewhere no other address of this machine answers
        for last in (1, 2):
            sensor = f"127.{76 + last}.{number // 250}.{number % 250 + 1}"
            text = text.replace(f'address = "127.0.0.{last}"', f'address = "{sensor}"')
    write_text_atomic(recipe, text)


@contextmanager
def _virtual_stand(out: Path) -> Iterator[None]:
    """The virtual stand, in a process of its own, as ``truestand stand simulate`` serves it."""
    command = [
        sys.executable, "-m", "truestand", "stand", "simulate", str(out / "stand.toml"),
        "--artefact", str(out / "shaft.toml"), "--part", str(out / "gear.toml"), "--mounted", "shaft",
        "--pace", str(PACE), "--truth", str(out / "gear-truth.json"),
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    assert process.stdout is not None and process.stderr is not None
    try:
        if not process.stdout.readline():
            raise DeviceLost(process.stderr.read().decode(errors="replace").removeprefix("truestand: ").strip())
        yield
    finally:
        process.terminate()
        process.communicate(timeout=10)


def _calibrate(stand: DemoStand) -> tuple[Calibration, Calibration, dict[str, Any]]:
    """Scan the shaft, calibrate by both methods, write all of it: ours, the published method's, the truth."""
    out = stand.out
    truth = read_json(out / "gear-truth.json")
    truth.pop("part")
    write_json_atomic(out / "truth.json", truth)
    outcome = calibrate_job(
        Inputs(stand.paths(SHAFT), out / "stand.toml", out / "shaft.toml"),
        Outputs(out / "calibration.json", out / "cloud.ply", out / "report.html"),
        lambda _: stand.scan(SHAFT, "Scanning the shaft"), step_progress("Calibrating", stand.quiet), truth=truth,
    )  # fmt: skip
    calibration, published = outcome.result
    assert published is not None
    write_calibration(out / "calibration-paper.json", published)
    return calibration, published, truth


def _inspect(stand: DemoStand) -> tuple[Inspection, dict[str, Any]]:
    """Scan the gear of gear.toml with its errors, inspect it, write all of it."""
    out = stand.out
    stand.mount_part()
    truth = read_json(out / "gear-truth.json")
    outcome = inspect_job(
        Inputs(stand.paths(GEAR), out / "stand.toml", calibration=out / "calibration.json", part=out / "gear.toml"),
        Outputs(out / "inspection.json", out / "gear.ply", out / "gear-report.html"),
        lambda _: stand.scan(GEAR, "Scanning the gear"), step_progress("Inspecting", stand.quiet), truth=truth,
    )  # fmt: skip
    return outcome.result, truth


def _refuse_real_scans(out: Path) -> None:
    """Raw scans are never overwritten: one without a truth beside it was not made by a demo."""
    found = next((name for name in SCANS if (out / name).exists()), None)
    if found is not None and not (out / "truth.json").exists():
        raise BadRecipe(f"{out} holds a scan {found} that no demo made; choose another --out")
