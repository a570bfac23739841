"""``truestand plan``: where to put the sensors for a part."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import DONE, UNDECIDED, ArtefactOption, JsonOption, QuietOption, ReportOption, output_option
from truestand.cli.terminal import hint, print_json, print_table, progress
from truestand.devices.positioner import read_carrier
from truestand.files.atomic import write_json_atomic, write_text_atomic
from truestand.files.recipes.parts import read_part
from truestand.files.recipes.plan import planned_stand, read_task
from truestand.files.recipes.recipes import read_company, read_shaft, read_stand
from truestand.files.records.plan_record import plan_record
from truestand.files.records.record import now
from truestand.planning.plan import plan as plan_views

STEPS = 1000
"""Of the progress bar."""


def plan(
    part: Annotated[Path, typer.Argument(metavar="PART.toml", help="What is to be inspected: its drawing.")],
    stand: Annotated[
        Path, typer.Option("--stand", metavar="STAND.toml", help="The sensors' data sheets, and [plan]: the room.")
    ],
    artefact: ArtefactOption,
    views: Annotated[
        int | None, typer.Option("--views", min=1, help="So many views; default: the fewest that do.")
    ] = None,
    output: Annotated[Path, output_option("--output", "-o", metavar="PLAN.json", help="The record to write.")] = Path(
        "plan.json"
    ),
    report: ReportOption = None,
    stand_out: Annotated[
        Path | None,
        output_option("--stand-out", metavar="PLANNED.toml", help="Write the stand with its sensors as planned."),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find where to put the sensors for a part: 0 found, 3 not everything can be seen or shown to conform.

    Example: truestand plan gear.toml --stand stand.toml --artefact shaft.toml -o plan.json --report plan.html
    """
    described, shaft, drawing = read_stand(stand), read_shaft(artefact), read_part(part)
    task = replace(read_task(stand), carrier=read_carrier(stand, described))
    with progress("Looking for places", quiet) as advance:
        found = plan_views(drawing, described, shaft, task, views, lambda share: advance(round(STEPS * share), STEPS))
    created = now()
    record = plan_record(found, created)
    write_json_atomic(output, record)
    written = [output]
    if stand_out is not None and found.views:
        write_text_atomic(stand_out, planned_stand(stand.read_text(encoding="utf-8-sig"), found))
        written.append(stand_out)
    if report is not None:
        from truestand.report.pdf import write_report
        from truestand.report.plan import plan_report

        write_report(report, plan_report(found, read_company(stand), created))
        written.append(report)
    if as_json:
        print_json(record)
    elif not quiet:
        from truestand.report.plan_tables import price
        from truestand.report.plan_terminal import plan_tables

        print_table(plan_tables(found))
        typer.echo("\n".join([*price(found), *map(str, written)]))
    for text in found.unseen:
        hint(text, quiet)
    raise typer.Exit(DONE if found.complete else UNDECIDED)
