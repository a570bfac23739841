"""Options that mean the same in every command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from truestand.files.scans.scancontrol_raw import RawLayout

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
PickOption = Annotated[
    str | None,
    typer.Option("--pick", metavar="NAME", help="The recording of a file that holds several; `info` names them."),
]
RawTypeOption = Annotated[
    str | None,
    typer.Option("--raw-type", metavar="TYPE", help="Type of the scanCONTROL sensor of a raw dump, such as 29xx-50."),
]
PointsOption = Annotated[int | None, typer.Option("--points", help="Points in a profile of a raw dump.")]


def raw_layout(raw_type: str | None, points: int | None) -> "RawLayout | None":
    """What a raw dump doesn't say of itself; None where it isn't one.

    Raises:
        BadRecipe: one of them without the other.
    """
    from truestand.core.errors import BadRecipe
    from truestand.files.scans.scancontrol_raw import RawLayout

    if raw_type is None and points is None:
        return None
    if raw_type is None or points is None:
        found, lacking = ("--points", "--raw-type") if raw_type is None else ("--raw-type", "--points")
        raise BadRecipe(f"found {found} without {lacking}; a raw dump needs both: --raw-type 29xx-50 --points 640")
    return RawLayout(raw_type, points)


def radians_or_none(degrees: float | None, option: str = "--start-angle-deg") -> float | None:
    """An optional angle at the border, degrees in, rad out."""
    from math import isfinite, radians

    from truestand.core.errors import BadRecipe

    if degrees is not None and not isfinite(degrees):
        raise BadRecipe(f"found {option} {degrees}, need a finite number of degrees")
    return None if degrees is None else radians(degrees)
