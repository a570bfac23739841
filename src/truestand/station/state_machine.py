"""The states of the stand, as a table: what may happen next, and in which states anything may move or shine.

A fault is latched: from FAULT only an explicit reset leads on. Not a safety function.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum

from truestand.core.errors import Fault


class State(Enum):
    """Where the stand is."""

    IDLE = "idle"
    CHECKING = "checking"
    CHECKED = "checked"
    WATCHING = "watching"
    HOMING = "homing"
    READY = "ready"
    STARTING = "starting"
    RECORDING = "recording"
    STOPPING = "stopping"
    FAULT = "fault"


class Event(Enum):
    """What happens."""

    CHECK = "check"
    PASSED = "passed"
    WATCH = "watch"
    HOME = "home"
    HOMED = "homed"
    START = "start"
    TURNING = "turning"
    STOP = "stop"
    STOPPED = "stopped"
    FAIL = "fail"
    RESET = "reset"


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.IDLE, Event.CHECK): State.CHECKING,
    (State.CHECKING, Event.PASSED): State.CHECKED,
    (State.CHECKED, Event.CHECK): State.CHECKING,
    (State.CHECKED, Event.HOME): State.HOMING,
    (State.CHECKED, Event.WATCH): State.WATCHING,
    (State.READY, Event.WATCH): State.WATCHING,
    (State.WATCHING, Event.STOP): State.STOPPING,
    (State.HOMING, Event.HOMED): State.READY,
    (State.READY, Event.CHECK): State.CHECKING,
    (State.READY, Event.HOME): State.HOMING,
    (State.READY, Event.START): State.STARTING,
    (State.STARTING, Event.TURNING): State.RECORDING,
    (State.CHECKING, Event.STOP): State.STOPPING,
    (State.HOMING, Event.STOP): State.STOPPING,
    (State.STARTING, Event.STOP): State.STOPPING,
    (State.RECORDING, Event.STOP): State.STOPPING,
    (State.STOPPING, Event.STOPPED): State.IDLE,
    **{(state, Event.FAIL): State.FAULT for state in State},
    (State.FAULT, Event.RESET): State.IDLE,
}

MAY_MOVE = frozenset({State.HOMING, State.STARTING, State.RECORDING})
"""States in which a motion may be begun; a halt is allowed in all."""
MAY_SHINE = frozenset({State.WATCHING, State.STARTING, State.RECORDING})
"""States in which a laser may be switched on; off is allowed in all."""


class Machine:
    """The stand's state; every change passes through here, from any thread."""

    def __init__(self, on_change: Callable[[State, str], None] = lambda state, reason: None) -> None:
        self.state = State.IDLE
        self.reason = ""
        """Why the stand is in FAULT; the first reason stays."""
        self._lock = threading.RLock()
        self._on_change = on_change

    def fire(self, event: Event, reason: str = "") -> State:
        """Take the step that ``event`` means here.

        Raises:
            Fault: no such step in this state; the stand stays where it is.
        """
        with self._lock:
            after = TRANSITIONS.get((self.state, event))
            if after is None:
                raise Fault(self._refusal(f"{event.value!r} is not possible while the stand is {self.state.value}"))
            if event is Event.FAIL and self.state is not State.FAULT:
                self.reason = reason
            elif event is Event.RESET:
                self.reason = ""
            changed, self.state = after is not self.state, after
            if changed:
                self._on_change(after, reason)
            return after

    @contextmanager
    def motion(self) -> Iterator[None]:
        """Begin a motion inside: no change of state comes between this look at the state and the command.

        Raises:
            Fault: a state that allows no motion; with the reason.
        """
        with self._lock:
            if self.state not in MAY_MOVE:
                raise Fault(self._refusal(f"no motion while the stand is {self.state.value}"))
            yield

    @contextmanager
    def light(self) -> Iterator[None]:
        """Switch a laser on inside, as ``motion``.

        Raises:
            Fault: a state that allows no laser; with the reason.
        """
        with self._lock:
            if self.state not in MAY_SHINE:
                raise Fault(self._refusal(f"no laser while the stand is {self.state.value}"))
            yield

    def _refusal(self, what: str) -> str:
        if self.state is State.FAULT:
            return f"{what}: {self.reason}; mend the cause, then `truestand stand reset`"
        return what
