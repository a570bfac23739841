"""``truestand stand``: list, test and identify devices, watch live numbers, reset a fault."""

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from truestand.cli.options import FAILS, WRONG_USE, DevicesOption, JsonOption, QuietOption
from truestand.cli.terminal import print_json, print_table, progress
from truestand.station import diagnostics
from truestand.station.diagnostics import DeviceAnswer, StreamReport
from truestand.station.guard import guard
from truestand.station.interrupts import interrupted_by_signals
from truestand.station.recipe import read_devices
from truestand.station.stand_lock import StandLock

LaserOption = Annotated[bool, typer.Option("--laser", help="Switch the lasers on meanwhile.")]


def list_devices(
    stand: DevicesOption,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Ask the table and each sensor who they are: 0 all answer, 2 one does not. Nothing moves.

    Example: truestand stand list --stand stand.toml
    """
    answers = diagnostics.ask_devices(*read_devices(stand))
    if as_json:
        print_json([_answer_record(answer) for answer in answers])
    elif not quiet:
        _print_answers(answers)
    if not all(answer.answers and not answer.problem for answer in answers):
        raise typer.Exit(WRONG_USE)


def test_devices(
    stand: DevicesOption,
    seconds: Annotated[float, typer.Option(min=0.2, max=3600.0, help="How long each sensor streams.")] = 2.0,
    laser: LaserOption = False,
    move: Annotated[
        bool, typer.Option("--move", help="Home the table and turn it by 10 degrees, the encoder against it.")
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Have each sensor stream for a while, and say what came and what was lost: 0 all well, 1 not.

    Nothing moves without --move, and no laser goes on without --laser. Example: truestand stand test --stand stand.toml
    """
    described, devices = read_devices(stand)
    with _stand_in_use(stand, laser or move), progress("Testing the devices", quiet):
        report = diagnostics.check_devices(described, devices, seconds, laser, move)
    if as_json:
        streams = {name: _stream_record(stream) for name, stream in report.streams.items()}
        print_json({"sensors": streams, "table": report.table})
    elif not quiet:
        _print_streams(report.streams)
        for key, value in report.table.items():
            typer.echo(f"table {key.replace('_', ' ')}: {value}")
    if not report.passed:
        raise typer.Exit(FAILS)


def identify_device(
    device: Annotated[str, typer.Argument(metavar="DEVICE", help="A sensor's name, or `table`.")],
    stand: DevicesOption,
    quiet: QuietOption = False,
) -> None:
    """Have one device show itself: a sensor blinks its laser (reduced power), the table turns by 2 degrees and back.

    The table homes first where it is not homed. Example: truestand stand identify front --stand stand.toml
    """
    described, devices = read_devices(stand)
    with _stand_in_use(stand, active=True):
        diagnostics.identify_device(described, devices, device)
    if not quiet:
        typer.echo(f"{device} has shown itself")


def watch_devices(
    stand: DevicesOption,
    seconds: Annotated[float, typer.Option(min=0.2, help="End after so long; default: at Ctrl-C.")] = 1e9,
    laser: LaserOption = False,
) -> None:
    """Live numbers until Ctrl-C: frames per second, lost, seen, encoder, table position. Nothing moves.

    Example: truestand stand watch --stand stand.toml --laser
    """
    described, devices = read_devices(stand)
    with (
        _stand_in_use(stand, laser),
        Live(refresh_per_second=5) as screen,
        closing(diagnostics.live_values(described, devices, seconds, laser)) as updates,
    ):
        for rows in updates:
            screen.update(_live_table(rows))


@contextmanager
def _stand_in_use(stand: Path, active: bool) -> Iterator[None]:
    """Lock the stand; ``active``: something moves or a laser is on, and a guard stops it if this program is killed."""
    with closing(StandLock(stand)), interrupted_by_signals(), guard(stand) if active else nullcontext():
        yield


def reset_fault(stand: DevicesOption, quiet: QuietOption = False) -> None:
    """Say that the cause of a fault is mended: the stand may be used again. Nothing moves.

    Example: truestand stand reset --stand stand.toml
    """
    fault = diagnostics.reset_fault(stand)
    if not quiet:
        typer.echo(f"reset; the fault was: {fault}" if fault else "there was no fault to reset")


def _print_answers(answers: list[DeviceAnswer]) -> None:
    table = Table("device", "name", "address", "answers", "says", title="Devices")
    for a in answers:
        details = a.problem or "  ".join(f"{key} {value}" for key, value in a.details.items() if value)
        table.add_row(a.device, a.name, a.address, "yes" if a.answers else "[red]no[/red]", escape(details))
    print_table(table)


def _print_streams(streams: Mapping[str, StreamReport]) -> None:
    table = Table("sensor", "profiles/s", "profiles", "lost", "resent", "seen", "", title="Streams")
    for name, r in streams.items():
        table.add_row(
            name, f"{r.profiles_per_s:.0f}", str(r.profiles), str(r.lost_profiles), str(r.statistics.resent),
            f"{100 * r.seen:.0f} %", escape(r.problem) or "well",
        )  # fmt: skip
    print_table(table)


def _live_table(rows: dict[str, dict[str, str]]) -> Table:
    columns = list(dict.fromkeys(key for row in rows.values() for key in row))
    table = Table("device", *columns)
    for name, row in rows.items():
        table.add_row(name, *(escape(row.get(key, "")) for key in columns))
    return table


def _answer_record(a: DeviceAnswer) -> dict[str, Any]:
    return {
        "device": a.device, "name": a.name, "address": a.address, "answers": a.answers, "problem": a.problem or None,
        **a.details,
    }  # fmt: skip


def _stream_record(r: StreamReport) -> dict[str, Any]:
    return {
        "seconds": r.seconds,
        "profiles": r.profiles,
        "profiles_per_s": r.profiles_per_s,
        "lost_profiles": r.lost_profiles,
        "resent_packets": r.statistics.resent,
        "seen": r.seen,
        "problem": r.problem or None,
    }
