"""Ctrl-C and requests to end, as ``KeyboardInterrupt`` in the main thread: the stand stops, frames are kept."""

import _thread
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer, main_thread
from typing import Any

AGAIN_S = 0.01
"""After an interrupt was dropped."""


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Have a request to end (SIGTERM, a closed terminal) act as Ctrl-C does."""

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    names = [n for n in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, n)]
    before = {n: signal.signal(getattr(signal, n), interrupt) for n in names}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)


@contextmanager
def interrupts_not_lost() -> Iterator[None]:
    """Interrupt again where Python drops an interrupt: one that falls into the callback of a weak reference is only
    handed to ``sys.unraisablehook``."""
    hook = sys.unraisablehook

    def interrupt_again(dropped: "sys.UnraisableHookArgs") -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt):
            Timer(AGAIN_S, _interrupt_main_thread).start()
        else:
            hook(dropped)

    sys.unraisablehook = interrupt_again
    try:
        yield
    finally:
        sys.unraisablehook = hook


def _interrupt_main_thread() -> None:
    ident = main_thread().ident
    if hasattr(signal, "pthread_kill") and ident is not None:
        signal.pthread_kill(ident, signal.SIGINT)  # ends its waiting too
    else:
        _thread.interrupt_main()
