"""``truestand acquire``: take a scan with the stand."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truestand.cli.options import ForceOption, JsonOption, OperatorOption, QuietOption, StoreOption

if TYPE_CHECKING:
    from truestand.station.scan import Taken

StandFile = Annotated[Path, typer.Option("--stand", metavar="STAND.toml", help="The stand, with its [devices].")]


def acquire(
    stand: StandFile,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="SCAN.h5", help="The scan; native.")],
    turns: Annotated[
        float | None, typer.Option(min=0.01, max=1000.0, help="Turns to scan; default: [devices.acquire] turns.")
    ] = None,
    keep_log: Annotated[bool, typer.Option("--keep-log", help="Keep the log beside the scan.")] = False,
    store: StoreOption = None,
    operator: OperatorOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check the devices, home, turn and record: 0 complete, 3 incomplete (written, with the reason), 130 interrupted.

    Not a safety function: doors, lasers and motors need their own.

    Example: truestand acquire --stand stand.toml -o k1.h5
    """
    from truestand.cli.keeping import keeping
    from truestand.cli.live import ended_by_signals, live_bar
    from truestand.core.errors import BadRecipe
    from truestand.files.scans.write_scan import NATIVE, check_output
    from truestand.station.recipe import order_of, read_devices
    from truestand.station.scan import output_of, take_scan

    if output.suffix.lower() not in NATIVE:
        raise BadRecipe(f"{output}: found suffix {output.suffix!r}, need .h5; `truestand import` writes others")
    described, devices = read_devices(stand)
    into = keeping(store, stand, operator, quiet)
    order = order_of(described, devices.acquire, turns)
    for name in (d.name for d in devices.sensor):
        check_output(output_of(output, name, len(devices.sensor)), force)
    with ended_by_signals(), live_bar(quiet) as show:
        taken = take_scan(stand, described, devices, order, output, show, keep_log)
    if taken.written:
        scans = {f"scan {one.scan.sensor}": one.path for one in taken.written}
        status = "complete" if taken.complete else "incomplete"
        into.add("scan", {"status": status, **record_of(taken)}, {**scans, "stand": stand})
    tell(taken, as_json, quiet)


def tell(taken: "Taken", as_json: bool, quiet: bool) -> None:
    """What came of it, and the exit code that says so."""
    from truestand.cli.exit_codes import INTERRUPTED, UNDECIDED
    from truestand.cli.terminal import hint, print_json

    if as_json:
        print_json(record_of(taken))
    elif not quiet:
        for one in taken.written:
            typer.echo(one.path)
    for line in _hints(taken):
        hint(f"truestand: {line}", quiet)
    if taken.interrupted:
        raise typer.Exit(INTERRUPTED)
    if not taken.complete:
        raise typer.Exit(UNDECIDED)


def _hints(taken: "Taken") -> Iterator[str]:
    """What people need to know besides the paths."""
    for one in taken.written:
        yield from (f"incomplete: {reason}" for reason in one.scan.reasons)
    if taken.fault and taken.complete:
        yield f"the scan is complete; after it {taken.fault}"
    yield from (f"NOT STOPPED, look at the stand: {what}" for what in taken.left)
    if taken.fault or taken.left:
        yield "the stand stays in fault: mend the cause, then `truestand stand reset`"


def record_of(taken: "Taken") -> dict[str, Any]:
    """The result as JSON."""
    return {
        "complete": taken.complete,
        "fault": taken.fault or None,
        "not_stopped": list(taken.left),
        "scans": [
            {"path": str(one.path), "sensor": one.scan.sensor, **(one.scan.recording.acquisition or {})}
            for one in taken.written
        ],
    }
