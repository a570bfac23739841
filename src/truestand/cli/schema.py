"""``truestand schema``: the JSON Schema of a record."""

from typing import Annotated

import typer


def schema(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="calibration, verification, comparison, form, info, truth.")
    ],
) -> None:
    """Print the JSON Schema of a record.

    Example: truestand schema calibration > calibration.schema.json
    """
    from truestand.files.records.schemas import schema_text

    typer.echo(schema_text(name), nl=False)
