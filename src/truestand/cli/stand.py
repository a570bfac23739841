"""``truestand stand``: list, test and identify devices, watch live numbers, reset a fault."""

from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truestand.cli.exit_codes import FAILS, WRONG_USE
from truestand.cli.options import JsonOption, QuietOption

if TYPE_CHECKING:
    from truestand.station.examine import Answer, StreamReport

StandFile = Annotated[Path, typer.Option("--stand", metavar="STAND.toml", help="The stand, with its [devices].")]
Seconds = Annotated[float, typer.Option(min=0.2, max=3600.0, help="How long each sensor streams.")]


def list_devices(
    stand: StandFile,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Ask the table and each sensor who they are: 0 all answer, 2 one does not. Nothing moves.

    Example: truestand stand list --stand stand.toml
    """
    from truestand.cli.terminal import print_json
    from truestand.station.examine import ask_all
    from truestand.station.recipe import read_devices

    answers = ask_all(*read_devices(stand))
    if as_json:
        print_json([_answer_record(answer) for answer in answers])
    elif not quiet:
        _print_answers(answers)
    if not all(answer.answers and not answer.problem for answer in answers):
        raise typer.Exit(WRONG_USE)


def test_devices(
    stand: StandFile,
    seconds: Seconds = 2.0,
    light: Annotated[bool, typer.Option("--laser", help="Switch the lasers on meanwhile.")] = False,
    move: Annotated[
        bool, typer.Option("--move", help="Home the table and turn it by 10 degrees, the encoder against it.")
    ] = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Have each sensor stream for a while, and say what came and what was lost: 0 all well, 1 not.

    Nothing moves without --move, and no laser goes on without --laser. Example: truestand stand test --stand stand.toml
    """
    from truestand.cli.live import ended_by_signals
    from truestand.cli.terminal import print_json, working
    from truestand.station.examine import try_all
    from truestand.station.latch import Latch
    from truestand.station.recipe import read_devices

    described, devices = read_devices(stand)
    latch = Latch(stand)
    try:
        with ended_by_signals(), _guarded(stand, light or move), working("Testing the devices", quiet):
            report = try_all(described, devices, seconds, light, move)
    finally:
        latch.close()
    if as_json:
        print_json({"sensors": {name: _stream_record(r) for name, r in report.streams.items()}, "table": report.table})
    elif not quiet:
        _print_streams(report.streams)
        for key, value in report.table.items():
            typer.echo(f"table {key.replace('_', ' ')}: {value}")
    if not report.well:
        raise typer.Exit(FAILS)


def identify_device(
    device: Annotated[str, typer.Argument(metavar="DEVICE", help="A sensor's name, or `table`.")],
    stand: StandFile,
    quiet: QuietOption = False,
) -> None:
    """Have one device show itself: a sensor blinks its laser (reduced power), the table turns by 2 degrees and back.

    The table homes first where it is not homed. Example: truestand stand identify front --stand stand.toml
    """
    from truestand.cli.live import ended_by_signals
    from truestand.station.examine import identify
    from truestand.station.latch import Latch
    from truestand.station.recipe import read_devices

    described, devices = read_devices(stand)
    latch = Latch(stand)
    try:
        with ended_by_signals(), _guarded(stand, True):
            identify(described, devices, device)
    finally:
        latch.close()
    if not quiet:
        typer.echo(f"{device} has shown itself")


def watch_devices(
    stand: StandFile,
    seconds: Annotated[float, typer.Option(min=0.2, help="End after so long; default: at Ctrl-C.")] = 1e9,
    light: Annotated[bool, typer.Option("--laser", help="Switch the lasers on meanwhile.")] = False,
) -> None:
    """Live numbers until Ctrl-C: frames per second, lost, seen, encoder, table position. Nothing moves.

    Example: truestand stand watch --stand stand.toml --laser
    """
    from rich.live import Live

    from truestand.cli.live import ended_by_signals
    from truestand.station.examine import watching
    from truestand.station.latch import Latch
    from truestand.station.recipe import read_devices

    described, devices = read_devices(stand)
    latch = Latch(stand)
    try:
        with (
            ended_by_signals(),
            _guarded(stand, light),
            Live(refresh_per_second=5) as screen,
            closing(watching(described, devices, seconds, light)) as looks,
        ):
            for rows in looks:
                screen.update(_live_table(rows))
    finally:
        latch.close()


def _guarded(stand: Path, active: bool) -> AbstractContextManager[object]:
    """A guard for what moves or shines: it stops the stand where this program is killed."""
    from truestand.station.guard import guard

    return guard(stand) if active else nullcontext()


def reset_fault(stand: StandFile, quiet: QuietOption = False) -> None:
    """Say that the cause of a fault is mended: the stand may be used again. Nothing moves.

    Example: truestand stand reset --stand stand.toml
    """
    from truestand.station.examine import reset

    told = reset(stand)
    if not quiet:
        typer.echo(f"reset; the fault was: {told}" if told else "there was no fault to reset")


def _print_answers(answers: list["Answer"]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from truestand.cli.terminal import print_table

    table = Table("device", "name", "address", "answers", "says", title="Devices")
    for a in answers:
        says = a.problem or "  ".join(f"{key} {value}" for key, value in a.told.items() if value)
        table.add_row(a.device, a.name, a.address, "yes" if a.answers else "[red]no[/red]", escape(says))
    print_table(table)


def _print_streams(streams: dict[str, "StreamReport"]) -> None:
    from rich.markup import escape
    from rich.table import Table

    from truestand.cli.terminal import print_table

    table = Table("sensor", "profiles/s", "profiles", "lost", "resent", "seen", "", title="Streams")
    for name, r in streams.items():
        table.add_row(
            name, f"{r.profiles_per_s:.0f}", str(r.profiles), str(r.lost_profiles), str(r.statistics.resent),
            f"{100 * r.seen:.0f} %", escape(r.problem) or "well",
        )  # fmt: skip
    print_table(table)


def _live_table(rows: dict[str, dict[str, str]]) -> Any:
    from rich.markup import escape
    from rich.table import Table

    columns = list(dict.fromkeys(key for row in rows.values() for key in row))
    table = Table("device", *columns)
    for name, row in rows.items():
        table.add_row(name, *(escape(row.get(key, "")) for key in columns))
    return table


def _answer_record(a: "Answer") -> dict[str, Any]:
    return {
        "device": a.device, "name": a.name, "address": a.address, "answers": a.answers, "problem": a.problem or None,
        **a.told,
    }  # fmt: skip


def _stream_record(r: "StreamReport") -> dict[str, Any]:
    return {
        "seconds": r.seconds,
        "profiles": r.profiles,
        "profiles_per_s": r.profiles_per_s,
        "lost_profiles": r.lost_profiles,
        "resent_packets": r.statistics.resent,
        "seen": r.seen,
        "problem": r.problem or None,
    }
