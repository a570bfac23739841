"""Options and exit codes that mean the same in every command."""

from collections.abc import Callable, Iterator, Mapping
from math import isfinite, radians
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from truestand.core.errors import BadRecipe, UnreadableFile

DONE = 0
"""Done, conforms, holds."""
FAILS = 1
"""Does not conform, does not hold."""
WRONG_USE = 2
"""Wrong use, or input that can't be read."""
UNDECIDED = 3
"""Undecided or untrusted: the record says why."""
INTERRUPTED = 130
"""Broken off by the user."""
VERDICT_CODES = {
    "conforms": DONE, "does_not_conform": FAILS, "holds": DONE, "does_not_hold": FAILS, "undecided": UNDECIDED,
}  # fmt: skip


def output_option(*names: str, metavar: str, help: str) -> Any:
    """An option that names a file to write; commands refuse one that they also read."""
    return typer.Option(*names, metavar=metavar, help=help, dir_okay=False, writable=True)


def refuse_overwriting(command: Callable[..., None], given: Mapping[str, Any]) -> None:
    """Refuse to write over what a command reads, or over a scan, unless it is forced to; and two things to one file.

    ``given``: its parameters by name.

    Raises:
        BadRecipe: with both options, or the scan.
    """
    if given.get("force"):
        return
    taken: dict[Path, str] = {}
    for is_written, name, path in sorted(_paths(command, given), key=lambda p: p[0]):  # what is read comes first
        other = taken.setdefault(path.resolve(), name)
        if is_written and other != name:
            raise BadRecipe(f"found {path} as {name} and as {other}; choose another name for what is written")
        if is_written and _is_scan(path):
            advice = "without --force" if "force" in given else "by this command; choose another name"
            raise BadRecipe(f"{path} is already there; a raw scan is never overwritten {advice}")


def _is_scan(path: Path) -> bool:
    """Whether there is a scan already, in a format that scans are written in."""
    if not path.is_file():
        return False
    from truestand.files.scans.read import recordings
    from truestand.files.scans.write_scan import NATIVE

    try:
        return path.suffix.lower() in (*NATIVE, ".csv") and bool(recordings(path))
    except UnreadableFile:
        return False


def _paths(command: Callable[..., None], given: Mapping[str, Any]) -> Iterator[tuple[bool, str, Path]]:
    """Of each path among the parameters: whether it is written, the parameter's name, the path."""
    for name, hint in get_type_hints(command, include_extras=True).items():
        kind, *options = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        value = given.get(name)
        if value is not None and Path in (kind, *get_args(kind)):
            for path in value if isinstance(value, (list, tuple)) else [value]:
                yield any(o.writable for o in options), name.replace("_", " "), Path(path)


StandOption = Annotated[
    Path | None, typer.Option("--stand", metavar="STAND.toml", help="The stand; default: the one the input carries.")
]
DevicesOption = Annotated[Path, typer.Option("--stand", metavar="STAND.toml", help="The stand, with its [devices].")]
ArtefactOption = Annotated[
    Path, typer.Option("--artefact", metavar="SHAFT.toml", help="The reference shaft's drawing and certificate.")
]
CalibrationOption = Annotated[Path, typer.Option("--calibration", metavar="CALIBRATION.json", help="The stand today.")]
StartAngleOption = Annotated[
    float | None,
    typer.Option(
        "--start-angle-deg", help="Table angle of the first profile, for scans without an angle of their own."
    ),
]
ViewOption = Annotated[
    str | None,
    typer.Option(
        "--view", metavar="front,rear,...",
        help="Several sensors: the name of the one that took the scan, one each; default: the scan carries it.",
    ),
]  # fmt: skip


def view_names(text: str | None) -> tuple[str, ...] | None:
    """The names of ``--view``; None where it is not given."""
    return None if text is None else tuple(name.strip() for name in text.split(","))


SensorsOption = Annotated[
    int, typer.Option("--views", min=1, max=2, help="Sensors of the stand; with two the gear is a helical one.")
]
TruthOption = Annotated[
    Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Simulated scans: compare with the truth.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
StoreOption = Annotated[
    Path | None,
    typer.Option("--store", metavar="DIR", help="The results store; default: [store] of STAND.toml where it has one."),
]
OperatorOption = Annotated[
    str | None, typer.Option("--operator", metavar="NAME", help="Who did it, for the results store.")
]
ReportOption = Annotated[
    Path | None,
    output_option("--report", metavar="REPORT", help="Write the report: one HTML file, or PDF where its name ends so."),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Overwrite an existing scan or recipe.")]


def radians_or_none(degrees: float | None, option: str = "--start-angle-deg") -> float | None:
    """The angle (rad) that an ``option`` gives in degrees; None where it was left out.

    Raises:
        BadRecipe: infinite, or no number.
    """
    if degrees is not None and not isfinite(degrees):
        raise BadRecipe(f"found {option} {degrees}, need a finite number of degrees")
    return None if degrees is None else radians(degrees)
