"""The states of the stand, as a table: the transitions, and in which states a motion or a laser is permitted.

A fault is latched: from FAULT only an explicit reset leads on. Not a safety function.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from typing import Literal

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

Action = Literal["motion", "positioning", "laser"]
PERMITTED: dict[Action, frozenset[State]] = {
    "motion": frozenset({State.HOMING, State.STARTING, State.RECORDING}),
    "positioning": frozenset({State.HOMING}),
    "laser": frozenset({State.WATCHING, State.STARTING, State.RECORDING}),
}
"""States in which a motion may be begun, the positioner moved, or a laser switched on; a halt and laser off are
permitted in all.
"""


class StateMachine:
    """The stand's state; every change passes through here, from any thread."""

    def __init__(self) -> None:
        self.state = State.IDLE
        self.reason = ""
        """Why the stand is in FAULT; the first reason stays."""
        self._lock = threading.RLock()

    def fire(self, event: Event, reason: str = "") -> None:
        """Change the state as ``event`` does in the present one.

        Raises:
            Fault: no such transition from the present state, which stays.
        """
        with self._lock:
            after = TRANSITIONS.get((self.state, event))
            if after is None:
                raise Fault(self._refusal(f"{event.value!r} is not possible while the stand is {self.state.value}"))
            if event is Event.FAIL and self.state is not State.FAULT:
                self.reason = reason
            elif event is Event.RESET:
                self.reason = ""
            self.state = after

    @contextmanager
    def permit(self, action: Action) -> Iterator[None]:
        """Begin a motion or switch a laser on inside: no change of state comes between this check and the command.

        Raises:
            Fault: not permitted in the present state; with the reason.
        """
        with self._lock:
            if self.state not in PERMITTED[action]:
                raise Fault(self._refusal(f"no {action} while the stand is {self.state.value}"))
            yield

    def _refusal(self, message: str) -> str:
        if self.state is State.FAULT:
            return f"{message}: {self.reason}; mend the cause, then `truestand stand reset`"
        return message
