"""A scan while it is taken, on a terminal: what the stand does, how far it is, what the sensors send."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import degrees
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from truestand.station.acquire import Live


@contextmanager
def live_bar(quiet: bool, what: str = "") -> Iterator[Callable[["Live"], None]]:
    """A bar with position, frames per second and lost profiles on a terminal's stderr; silent elsewhere."""
    if quiet or not sys.stderr.isatty():
        yield lambda live: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(20),
        TextColumn("{task.percentage:.0f} %"),
        TimeRemainingColumn(),
    )
    start = f"{what}: " if what else ""
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"{start}checking and homing", total=1.0)
        yield lambda live: progress.update(task, completed=live.done, description=start + told(live))


def told(live: "Live") -> str:
    """One line of live numbers."""
    words = [live.state.value, f"{degrees(live.position):6.1f}°"]
    words += [f"{rate:.0f} frames/s {lost} lost" for rate, lost in zip(live.frames_per_s, live.lost, strict=True)]
    return "  ".join(words)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Have a request to end (SIGTERM, a closed terminal) act as Ctrl-C does: the stand stops, what came is kept."""

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    names = [n for n in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, n)]
    before = {n: signal.signal(getattr(signal, n), interrupt) for n in names}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)
