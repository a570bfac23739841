"""``truestand store`` and ``audit``, and how other commands add their results to a store."""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from truestand.cli.options import FAILS, JsonOption, OperatorOption, QuietOption, StoreOption
from truestand.cli.terminal import hint, print_json, progress
from truestand.core.errors import BadRecipe
from truestand.files.recipes.recipes import read_store_folder
from truestand.files.records.record import messages_record, read_json
from truestand.store import Store


def open_store(store: Path | None) -> Store:
    """The store of ``--store``, or that of the stand.toml in this folder.

    Raises:
        BadRecipe: neither names one.
        BadStore: there is none.
    """
    return Store.open(_folder(store))


def _folder(store: Path | None) -> Path:
    stand = Path("stand.toml")
    folder = store or (read_store_folder(stand) if stand.is_file() else None)
    if folder is None:
        raise BadRecipe("found no --store and no stand.toml with [store] here; pass --store DIR")
    return folder


def results_folder(store: Path | None, stand: Path | None) -> Path | None:
    """Of the store that the options name; without ``--store`` that of stand.toml. To be called before the work.

    Raises:
        BadStore: a store that can't be written to.
    """
    folder = store or (None if stand is None else read_store_folder(stand))
    if folder is not None:
        Store.open(folder, create=True)
    return folder


def keep(
    folder: Path | None, kind: str, record: Mapping[str, Any], evidence: Mapping[str, Path], operator: str | None,
    quiet: bool,
) -> None:  # fmt: skip
    """Add a record with the files, by role, that it rests on, once they are written; without a store nothing is kept.

    Prints the entry's number.
    """
    if folder is not None:
        entry = Store.open(folder, create=True).add(kind, record, evidence, operator=operator)
        hint(f"kept as entry {entry.number} in {folder}", quiet)


def list_entries(
    store: StoreOption = None,
    last: Annotated[int, typer.Option(min=1, help="How many, the last ones.")] = 20,
    as_json: JsonOption = False,
) -> None:
    """List the entries of all kinds.

    Example: truestand store list --store results
    """
    opened = open_store(store)
    entries, known, now = opened.entries(last=last), opened.standing(), datetime.now(UTC)
    results = {e.number for e in entries} & known.entries.keys()
    doubts = {e.number: known.doubts(e.number, now) if e.number in results else () for e in entries}
    replaced_by = {e.number: known.replaced_by(e.number) if e.number in results else None for e in entries}
    if as_json:
        print_json([{"number": e.number, "kind": e.kind, "time": e.time, "part": e.part, "serial": e.serial,
                     "order": e.order, "operator": e.operator, "status": e.status, "about": e.about, "text": e.text,
                     "record": e.record, "evidence": dict(e.evidence), "hash": e.hash,
                     "corrected_by": replaced_by[e.number],
                     "doubts": messages_record(doubts[e.number])} for e in entries])  # fmt: skip
        return
    for e in entries:
        about = "" if e.about is None else f"of entry {e.about}"
        by = f"corrected by entry {replaced_by[e.number]}" if replaced_by[e.number] else ""
        doubt = f"in doubt: {'; '.join(doubts[e.number])}" if doubts[e.number] else ""
        words = (e.part, e.serial, (e.status or "").replace("_", " "), by, doubt, e.operator, about, e.text)
        typer.echo(f"{e.number:6}  {e.time}  {e.kind:13}" + "  ".join(w for w in words if w))


def correct(
    number: Annotated[int, typer.Argument(metavar="NUMBER", help="Of the entry.")],
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
    opened = open_store(store)
    replacement = None if record is None else read_json(record)
    entry = opened.correct(number, replacement, reason=reason, operator=operator)
    done = "withdrawn" if record is None else "corrected"
    hint(f"entry {number} {done} by entry {entry.number}", quiet)


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
    entry = open_store(store).note(text, about, operator=operator)
    hint(f"kept as entry {entry.number}", quiet)


def backup(
    target: Annotated[Path, typer.Argument(metavar="DIR", help="An empty folder, or an earlier backup.")],
    store: StoreOption = None,
    quiet: QuietOption = False,
) -> None:
    """Copy the store while others use it, or bring an earlier copy up to date.

    Example: truestand store backup /mnt/backup/results --store results
    """
    with progress("Copying", quiet):
        count = open_store(store).backup(target)
    hint(f"{count} entries in {target}", quiet)


def audit(
    store: StoreOption = None,
    noted: Annotated[
        list[str] | None,
        typer.Option(metavar="HASH", help="The hash of an entry, noted elsewhere earlier: it must be in the store."),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Check every hash of a results store: 0 sound, 1 with findings, 2 unreadable.

    Example: truestand audit --store results
    """
    with progress("Auditing", quiet) as advance:
        report = Store(_folder(store)).audit(tuple(noted or ()), advance)
    if as_json:
        print_json({
            "sound": report.sound, "sealed": report.sealed, "entries": report.entries, "files": report.files,
            "head": None if report.head is None else {"number": report.head[0], "hash": report.head[1]},
            "findings": [{"what": f.what, "where": f.where, "detail": f.detail} for f in report.findings],
        })  # fmt: skip
    elif not quiet:
        for f in report.findings:
            typer.echo(f"{f.what:22}{f.where}" + (f": {f.detail}" if f.detail else ""))
        verdict = "sound" if report.sound else f"findings: {len(report.findings)}"
        typer.echo(f"{verdict}; {report.entries} entries, {report.files} files of evidence")
        if report.head is not None:
            typer.echo(f"last entry {report.head[0]}, hash {report.head[1]}")
    if report.sound and not report.sealed:
        hint("a write was interrupted: every entry and file was checked, the database's bytes between the "
             "entries weren't; the next entry seals the store", quiet)  # fmt: skip
    if not report.sound:
        raise typer.Exit(FAILS)
