"""Options that mean the same in every command."""

from pathlib import Path
from typing import Annotated

import typer

StandOption = Annotated[
    Path | None, typer.Option("--stand", metavar="STAND.toml", help="The stand; default: the one the input carries.")
]
ArtefactOption = Annotated[
    Path, typer.Option("--artefact", metavar="SHAFT.toml", help="The reference shaft's drawing and certificate.")
]
StartAngleOption = Annotated[
    float | None,
    typer.Option(
        "--start-angle-deg", help="Table angle of the first profile, for scans without an angle of their own."
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Overwrite an existing scan or recipe.")]


def radians_or_none(degrees: float | None, option: str = "--start-angle-deg") -> float | None:
    """An optional angle at the border, degrees in, rad out."""
    from math import isfinite, radians

    from truestand.core.errors import BadRecipe

    if degrees is not None and not isfinite(degrees):
        raise BadRecipe(f"found {option} {degrees}, need a finite number of degrees")
    return None if degrees is None else radians(degrees)
