"""Whoever breaks off a command breaks it off."""

import signal
import sys
import time
import weakref

import pytest

from patience import NOT_FOR_EVER
from truestand.station.interrupts import interrupted_by_signals, interrupts_not_lost


class Thing:
    pass


def test_an_interrupt_that_falls_into_a_weak_reference_comes_again(monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", print)
    thing = Thing()

    def forgotten(_):
        raise KeyboardInterrupt

    watched = weakref.ref(thing, forgotten)
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt), interrupts_not_lost():
        del thing
        time.sleep(NOT_FOR_EVER)
    assert watched() is None and time.monotonic() - began < NOT_FOR_EVER
    assert sys.unraisablehook is print


def test_any_other_error_that_python_drops_is_still_shown(monkeypatch):
    shown = []
    monkeypatch.setattr(sys, "unraisablehook", shown.append)
    thing = Thing()

    def forgotten(_):
        raise ValueError("lost")

    watched = weakref.ref(thing, forgotten)
    with interrupts_not_lost():
        del thing
    assert watched() is None and [str(dropped.exc_value) for dropped in shown] == ["lost"]


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_requests_to_end_interrupt(name):
    if not hasattr(signal, name):
        pytest.skip(f"no {name} here")
    number = getattr(signal, name)
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), interrupted_by_signals():
        signal.raise_signal(number)
    assert signal.getsignal(number) == before
