"""``truestand store``: look at, correct, remark on and copy what is kept."""

from pathlib import Path
from typing import Annotated

import typer

from truestand.cli.options import JsonOption, OperatorOption, QuietOption, StoreOption

app = typer.Typer(help="What is kept: list, correct, remark on, back up.", no_args_is_help=True)
Number = Annotated[int, typer.Argument(metavar="NUMBER", help="Of the entry.")]


@app.command("list")
def listed(
    store: StoreOption = None,
    last: Annotated[int, typer.Option(min=1, help="How many, the last ones.")] = 20,
    as_json: JsonOption = False,
) -> None:
    """List the entries of all kinds.

    Example: truestand store list --store results
    """
    from truestand.cli.keeping import opened
    from truestand.cli.talk import print_json

    entries = opened(store).entries(last=last)
    if as_json:
        print_json([{"number": e.number, "kind": e.kind, "time": e.time, "part": e.part, "serial": e.serial,
                     "order": e.order, "operator": e.operator, "status": e.status, "about": e.about, "text": e.text,
                     "record": e.record, "evidence": dict(e.evidence), "hash": e.hash} for e in entries])  # fmt: skip
        return
    for e in entries:
        about = "" if e.about is None else f"of entry {e.about}"
        words = (e.part, e.serial, (e.status or "").replace("_", " "), e.operator, about, e.text)
        typer.echo(f"{e.number:6}  {e.time}  {e.kind:13}" + "  ".join(w for w in words if w))


@app.command("correct")
def correct(
    number: Number,
    reason: Annotated[str, typer.Option(help="Why; it is kept.")],
    record: Annotated[
        Path | None, typer.Option("--record", metavar="RECORD.json", help="What is right; left out: withdrawn.")
    ] = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    quiet: QuietOption = False,
) -> None:
    """Put another record in the place of an entry, or withdraw it. The entry itself stays as it is.

    Example: truestand store correct 12 --record inspection.json --reason "wrong drawing" --store results
    """
    from truestand.cli.keeping import opened
    from truestand.cli.talk import hint
    from truestand.files.records.record import read_json

    kept = opened(store)
    entry = kept.correct(number, None if record is None else read_json(record), reason=reason, operator=operator)
    done = "withdrawn" if record is None else "corrected"
    hint(f"truestand: entry {number} {done} by entry {entry.number}", quiet)


@app.command("note")
def note(
    text: Annotated[str, typer.Argument(help="The remark.")],
    about: Annotated[int | None, typer.Option(metavar="NUMBER", help="The entry it is about.")] = None,
    store: StoreOption = None,
    operator: OperatorOption = None,
    quiet: QuietOption = False,
) -> None:
    """Keep a remark: the sensor was cleaned, the lamp changed.

    Example: truestand store note "sensor cleaned" --store results
    """
    from truestand.cli.keeping import opened
    from truestand.cli.talk import hint

    hint(f"truestand: kept as entry {opened(store).note(text, about, operator=operator).number}", quiet)


@app.command("backup")
def backup(
    target: Annotated[Path, typer.Argument(metavar="DIR", help="An empty folder, or an earlier backup.")],
    store: StoreOption = None,
    quiet: QuietOption = False,
) -> None:
    """Copy the store while others use it, or bring an earlier copy up to date.

    Example: truestand store backup /mnt/backup/results --store results
    """
    from truestand.cli.keeping import opened
    from truestand.cli.talk import hint, working

    with working("Copying", quiet):
        count = opened(store).backup(target)
    hint(f"truestand: {count} entries in {target}", quiet)
