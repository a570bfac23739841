"""``truestand init``: starter recipes."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import ForceOption, QuietOption


def init(
    directory: Annotated[Path, typer.Argument(metavar="[DIR]", help="Where to write them.")] = Path(),
    force: ForceOption = False,
    quiet: QuietOption = False,
) -> None:
    """Write starter recipes, commented: stand.toml, shaft.toml, gear.toml.

    Example: truestand init my-stand
    """
    from truestand.files.recipes.recipes import write_starters

    for path in write_starters(directory, force=force):
        if not quiet:
            typer.echo(path)
