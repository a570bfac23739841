"""What commands print: results to stdout, progress and hints to stderr, nothing at all when asked for quiet."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from math import degrees
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from truestand.station.acquire import Live

Advance = Callable[[int, int], None]


def print_json(record: Any) -> None:
    """A record to stdout."""
    print(json.dumps(record, indent=2, allow_nan=False))


def print_table(table: Any) -> None:
    """A rich table to stdout, as wide as it needs to be where stdout is no terminal."""
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else 120).print(table)


def hint(message: str, quiet: bool) -> None:
    """One line to stderr."""
    if not quiet:
        print(f"truestand: {message}", file=sys.stderr)


@contextmanager
def progress(description: str, quiet: bool) -> Iterator[Advance]:
    """A progress bar on a terminal's stderr while something takes its time; silent elsewhere.

    Yields a function to call with (done, total); until it is called the bar just shows that work goes on.
    """
    with _bar(description, None, quiet) as update:
        yield lambda done, total: update(completed=done, total=total)


def step_progress(evaluating: str, quiet: bool) -> Callable[[str], AbstractContextManager[Advance]]:
    """A progress bar for each step of a job of the station's pipeline; ``evaluating`` describes the first."""
    descriptions = {"evaluate": evaluating, "report": "Writing"}
    return lambda step: progress(descriptions[step], quiet)


@contextmanager
def scan_progress(quiet: bool, description: str = "") -> Iterator[Callable[["Live"], None]]:
    """A bar with position, frames per second and lost profiles on a terminal's stderr; silent elsewhere."""
    start = f"{description}: " if description else ""
    with _bar(f"{start}checking and homing", 1.0, quiet) as update:
        yield lambda live: update(completed=live.done, description=start + _live_line(live))


def _live_line(live: "Live") -> str:
    words = [live.state.value, f"{degrees(live.position):6.1f}°"]
    words += [f"{sensor.frames_per_s:.0f} frames/s {sensor.lost} lost" for sensor in live.sensors]
    return "  ".join(words)


@contextmanager
def _bar(description: str, total: float | None, quiet: bool) -> Iterator[Callable[..., None]]:
    """A bar, with the time that remains where its total is known; yields a function that updates it."""
    if quiet or not sys.stderr.isatty():
        yield lambda **changes: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = [TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()]
    if total is not None:
        columns[1:] = [BarColumn(20), TextColumn("{task.percentage:.0f} %"), TimeRemainingColumn()]
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(description, total=total)
        yield lambda **changes: bars.update(task, **changes)
