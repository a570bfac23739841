"""Options and exit codes that mean the same in every command."""

from math import isfinite, radians
from pathlib import Path
from typing import Annotated

import typer

from truestand.core.errors import BadRecipe

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
    typer.Option("--report", metavar="REPORT", help="Write the report: one HTML file, or PDF where its name ends so."),
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
