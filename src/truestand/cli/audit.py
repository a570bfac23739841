"""``truestand audit``: is everything in the store as it was written?"""

from typing import Annotated

import typer

from truestand.cli.exit_codes import FAILS
from truestand.cli.options import JsonOption, QuietOption, StoreOption


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
    from truestand.cli.keeping import folder_of
    from truestand.cli.terminal import hint, print_json, working
    from truestand.store import Store

    with working("Auditing", quiet) as advance:
        report = Store(folder_of(store)).audit(tuple(noted or ()), advance)
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
        hint("truestand: a write was interrupted: every entry and file was checked, the database's bytes between the "
             "entries weren't; the next entry seals the store", quiet)  # fmt: skip
    if not report.sound:
        raise typer.Exit(FAILS)
