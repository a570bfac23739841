"""``truestand acquire`` and ``recover``: take a scan with the stand, or write what the log of one holds."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from truestand.cli.options import (
    INTERRUPTED,
    UNDECIDED,
    DevicesOption,
    ForceOption,
    JsonOption,
    OperatorOption,
    QuietOption,
    StoreOption,
    output_option,
    view_names,
)
from truestand.cli.store import keep, results_folder
from truestand.cli.terminal import hint, print_json, progress, scan_progress
from truestand.core.errors import BadRecipe
from truestand.files.scans.write_scan import NATIVE, check_output
from truestand.station.convert import convert
from truestand.station.interrupts import interrupted_by_signals
from truestand.station.log import load_log
from truestand.station.recipe import read_devices, scan_settings, stops_of
from truestand.station.scan import ScanOutcome, output_paths, take_scan, write_scans


def acquire(
    stand: DevicesOption,
    output: Annotated[Path, output_option("--output", "-o", metavar="SCAN.h5", help="The scan; native.")],
    turns: Annotated[
        float | None, typer.Option(min=0.01, max=1000.0, help="Turns to scan; default: [devices.acquire] turns.")
    ] = None,
    view: Annotated[
        str | None,
        typer.Option("--view", metavar="front,rear,...", help="The views to scan by; default: all of the stand."),
    ] = None,
    keep_log: Annotated[bool, typer.Option("--keep-log", help="Keep the log beside the scan.")] = False,
    store: StoreOption = None,
    operator: OperatorOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check the devices, home, turn and record: 0 complete, 3 incomplete (written, with the reason), 130 interrupted.

    Of views that a positioner goes to, one after the other; with several views their names are added to that of the
    scan.

    Not a safety function: doors, lasers and motors need their own.

    Example: truestand acquire --stand stand.toml -o k1.h5
    """
    if output.suffix.lower() not in NATIVE:
        raise BadRecipe(f"{output}: found suffix {output.suffix!r}, need .h5; `truestand import` writes others")
    described, devices = read_devices(stand)
    results = results_folder(store, stand)
    settings = scan_settings(described, devices.acquire, turns)
    views = view_names(view)
    for path in output_paths(output, stops_of(described, devices, views)):
        check_output(path, force)
    with interrupted_by_signals(), scan_progress(quiet) as show:
        outcome = take_scan(stand, described, devices, settings, output, show, keep_log, views)
    if outcome.written:
        evidence = {f"scan {one.scan.sensor}": one.path for one in outcome.written} | {"stand": stand}
        status = "complete" if outcome.complete else "incomplete"
        keep(results, "scan", {"status": status, **_record(outcome)}, evidence, operator, quiet)
    _print_and_exit(outcome, as_json, quiet)


def recover(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The .log that a recording left.")],
    output: Annotated[
        Path | None, output_option("--output", "-o", metavar="SCAN.h5", help="Default: beside the log.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write what a log holds as a native scan: 0 proven complete, 3 incomplete (written, with the reason).

    Example: truestand recover k1.log
    """
    target = log.with_suffix(".h5") if output is None else output
    if target.suffix.lower() not in NATIVE:
        raise BadRecipe(f"{target}: found suffix {target.suffix!r}, need .h5, which says whether the scan is complete")
    check_output(target, force)
    with progress(f"Reading {log.name}", quiet):
        written = write_scans(convert(load_log(log)), target, force)
    _print_and_exit(ScanOutcome(written), as_json, quiet)


def _print_and_exit(outcome: ScanOutcome, as_json: bool, quiet: bool) -> None:
    """Print the result, and end with the exit code that says how complete it is."""
    if as_json:
        print_json(_record(outcome))
    elif not quiet:
        for one in outcome.written:
            typer.echo(one.path)
    for line in _hints(outcome):
        hint(line, quiet)
    if outcome.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not outcome.complete:
        raise typer.Exit(UNDECIDED)


def _hints(outcome: ScanOutcome) -> Iterator[str]:
    """One line for each thing to know besides the paths."""
    for one in outcome.written:
        yield from (f"incomplete: {reason}" for reason in one.scan.reasons)
    if outcome.fault and outcome.complete:
        yield f"the scan is complete; after it {outcome.fault}"
    yield from (f"NOT STOPPED, look at the stand: {hazard}" for hazard in outcome.not_stopped)
    if outcome.fault or outcome.not_stopped:
        yield "the stand stays in fault: mend the cause, then `truestand stand reset`"


def _record(outcome: ScanOutcome) -> dict[str, Any]:
    """The result as JSON."""
    return {
        "complete": outcome.complete,
        "fault": outcome.fault or None,
        "not_stopped": list(outcome.not_stopped),
        "scans": [
            {"path": str(one.path), "sensor": one.scan.sensor, **(one.scan.recording.acquisition or {})}
            for one in outcome.written
        ],
    }
