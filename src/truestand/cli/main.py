"""The commands by name, and the one place where expected errors are caught and printed in one line.

A command's module is imported when the command is called: the list of commands stays quick, and a command loads only
its own module.
"""

import os
import sys
from collections.abc import Mapping
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

from truestand._version import __version__
from truestand.cli.options import DONE, WRONG_USE, refuse_overwriting
from truestand.core.errors import TruestandError
from truestand.station.interrupts import interrupts_not_lost

COMMANDS = {
    "demo": (
        "demo:demo",
        "Scan a shaft on the virtual stand, calibrate, scan a gear with a few errors, inspect it, report.",
    ),
    "init": ("files:init", "Write starter recipes, commented: stand.toml, shaft.toml, gear.toml."),
    "simulate": ("simulate:simulate", "Scan a shaft, or a part on it, on the virtual stand."),
    "import": (
        "files:import_scan",
        "Bring a scan into the native file: small, lossless, quick to read, the stand inside.",
    ),
    "info": (
        "files:info",
        "Say what is in a scan file: format, profiles, points, turns; of a file of several recordings their names.",
    ),
    "calibrate": (
        "calibrate:calibrate",
        "Find where the sensor stands and how the shaft runs, from a scan of the reference shaft.",
    ),
    "verify": (
        "calibrate:verify",
        "Hold a calibration against a new scan of the artefact, or one by each view: 0 holds, 1 does not, 3 undecided.",
    ),
    "roll": ("inspect:roll", "Roll a scan up into a point cloud in the shaft's own coordinates."),
    "inspect": (
        "inspect:inspect",
        "Check a part's geometry against its drawing: 0 conforms, 1 does not, 3 undecided or untrusted.",
    ),
    "identify": (
        "inspect:identify",
        "Tell teeth, module, helix and shift of an unknown gear from its scan: 0 sure, 3 not sure, or untrusted.",
    ),
    "form": (
        "form:form",
        "Associate a line, plane, circle, cylinder, sphere or cone with points, and measure the form that remains.",
    ),
    "compare": (
        "compare:compare",
        "Hold the exact model against the published method and against what general libraries make of the same scan.",
    ),
    "plan": (
        "plan:plan",
        "Find where to put the sensors for a part: 0 found, 3 not everything can be seen or shown to conform.",
    ),
    "acquire": (
        "acquire:acquire",
        "Check the devices, home, turn and record: 0 complete, 3 incomplete (written, with the reason), "
        "130 interrupted.",
    ),
    "recover": (
        "acquire:recover",
        "Write what a log holds as a native scan: 0 proven complete, 3 incomplete (written, with the reason).",
    ),
    "history": (
        "history:history",
        "Show the calibrations' quantities over time with control limits, and the inspections by part.",
    ),
    "audit": ("store:audit", "Check every hash of a results store: 0 sound, 1 with findings, 2 unreadable."),
    "serve": ("serve:serve", "Serve the operator page of a stand until Ctrl-C; a job that runs then is aborted first."),
    "certificate": (
        "certificate:certificate",
        "Write the calibration as a Digital Calibration Certificate (DCC 3.3): 0 written, 3 there can be none.",
    ),
    "schema": ("files:schema", "Print the JSON Schema of a record."),
}
"""By name: module and function in this package, and the first paragraph of that function's docstring."""
STAND_COMMANDS = {
    "list": (
        "stand:list_devices",
        "Ask the table and each sensor who they are: 0 all answer, 2 one does not. Nothing moves.",
    ),
    "test": (
        "stand:test_devices",
        "Have each sensor stream for a while, and say what came and what was lost: 0 all well, 1 not.",
    ),
    "identify": (
        "stand:identify_device",
        "Have one device show itself: a sensor blinks its laser (reduced power), "
        "the table turns by 2 degrees and back.",
    ),
    "watch": (
        "stand:watch_devices",
        "Live numbers until Ctrl-C: frames per second, lost, seen, encoder, table position. Nothing moves.",
    ),
    "reset": (
        "stand:reset_fault",
        "Say that the cause of a fault is mended: the stand may be used again. Nothing moves.",
    ),
    "simulate": (
        "simulate:serve_virtual_stand",
        "Serve a virtual table, positioner and sensors at the addresses of [devices], until Ctrl-C or SIGTERM.",
    ),
}
STORE_COMMANDS = {
    "list": ("store:list_entries", "List the entries of all kinds."),
    "correct": (
        "store:correct",
        "Put another record in the place of an entry, or withdraw it. The entry itself stays as it is.",
    ),
    "note": ("store:note", "Keep a remark: the sensor was cleaned, the lamp changed."),
    "backup": ("store:backup", "Copy the store while others use it, or bring an earlier copy up to date."),
}
GROUPS = {
    "stand": (
        "The stand's devices: list, test, identify and watch them, reset a fault, or simulate a stand.",
        STAND_COMMANDS,
    ),
    "store": ("What is kept: list, correct, remark on, back up.", STORE_COMMANDS),
}


class LazyCommand(TyperCommand):
    """A command that is listed by its summary; its module is imported when it is called."""

    def __init__(self, name: str, function: str, summary: str) -> None:
        super().__init__(name, help=summary)
        self._function = function

    def load(self) -> Any:
        """The function, with its options in its annotations."""
        module, function = self._function.split(":")
        return getattr(import_module(f"truestand.cli.{module}"), function)

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """The context of the command itself, which click then runs."""
        function = self.load()
        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        app.command()(function)
        context = get_command(app).make_context(*arguments, **options)
        refuse_overwriting(function, context.params)
        return context


root = typer.Typer(
    name="truestand",
    help="Calibrate a rotary laser inspection stand from one scan, and know how well.",
    epilog="New here? Run: truestand demo",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(show: bool) -> None:
    if show:
        typer.echo(f"truestand {__version__}")
        raise typer.Exit


@root.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Calibrate a rotary laser inspection stand from one scan, and know how well."""


def command_line() -> TyperGroup:
    """All commands."""
    group = get_group(root)
    _add_commands(group, COMMANDS)
    for name, (summary, commands) in GROUPS.items():
        part = TyperGroup(name=name, help=summary, no_args_is_help=True, rich_markup_mode=None)
        _add_commands(part, commands)
        group.add_command(part)
    return group


def _add_commands(group: TyperGroup, commands: Mapping[str, tuple[str, str]]) -> None:
    for name, (function, summary) in commands.items():
        group.add_command(LazyCommand(name, function, summary))


def main() -> NoReturn:
    """Run the command line: 0 done or holds, 1 does not hold, 2 wrong use or input, 3 undecided, 130 interrupted."""
    _one_thread()
    try:
        with interrupts_not_lost():
            command_line()()
    except TruestandError as error:
        _stop(str(error))
    except OSError as error:
        file = f"{error.filename}: " if error.filename else ""
        _stop(f"{file}{error.strerror or error}; check the path, permissions and free space")
    except MemoryError:
        _stop("out of memory; close other programs or use the native format (truestand import)")
    sys.exit(DONE)


def _one_thread() -> None:
    """Keep linear algebra on one thread, before numpy is loaded: small matrices gain nothing, waiting threads cost.

    It also makes the last digit of a record the same on every machine of one kind.
    """
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _stop(message: str) -> NoReturn:
    print(f"truestand: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(WRONG_USE)
