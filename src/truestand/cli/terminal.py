"""How commands talk: results to stdout, progress and hints to stderr, nothing at all when asked for quiet."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

Advance = Callable[[int, int], None]


def print_json(record: Any) -> None:
    """A record to stdout."""
    print(json.dumps(record, indent=2, allow_nan=False))


def hint(message: str, quiet: bool) -> None:
    """One line to stderr."""
    if not quiet:
        print(message, file=sys.stderr)


@contextmanager
def working(what: str, quiet: bool) -> Iterator[Advance]:
    """A progress bar on a terminal's stderr while something takes its time; silent elsewhere.

    Yields a function to call with (done, total); until it is called the bar just shows that work goes on.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def steps(evaluating: str, quiet: bool) -> Callable[[str], AbstractContextManager[Advance]]:
    """A progress bar for each step of a job of the station's pipeline; ``evaluating`` names the first."""
    names = {"evaluate": evaluating, "report": "Writing"}
    return lambda step: working(names[step], quiet)


def print_table(table: Any) -> None:
    """A rich table to stdout, as wide as it needs to be where stdout is no terminal."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else 120
    Console(width=width).print(table)
