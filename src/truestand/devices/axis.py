"""The axis interface: a rotary table, or an axis of a positioner, that homes, moves and stops within its limits.

Drivers only start motions and read the state (``Drive``); waiting, limits and timeouts are here, once. Angles are rad
as the controller counts them, many turns, 0 = home; speeds rad/s. A linear axis counts mm where a table counts degrees.
Nothing here is a safety function.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, inf, isfinite, radians
from typing import Any, Protocol, TypeVar

from truestand.core.errors import DeviceError, DeviceLost, LimitExceeded, MoveTimeout

T = TypeVar("T")
POLL_INTERVAL_S = 0.02
"""Between two questions to a moving table."""
STALL_S = 0.6
"""Without any progress, from which an axis that says that it moves is blocked; slower than half its tolerance in this
time no axis is moved.
"""
MOVE_MARGIN_S = 2.0
"""Beyond twice the time that a motion needs at its speed: acceleration, settling, a slow controller."""


@dataclass(frozen=True, slots=True)
class DriveState:
    """State that a controller reports, and its time."""

    position: float
    """rad, many turns, 0 = home."""
    moving: bool
    homed: bool
    time: float
    """s of the host's monotonic clock, the middle between question and answer."""
    time_half_width: float = 0.0
    """s, half of the time between question and answer."""
    fault: str = ""
    """The controller's own fault in words; empty = none."""


class Drive(Protocol):
    """Interface of a driver. Calls return at once, or raise ``DeviceLost`` within the connection's timeout."""

    @property
    def name(self) -> str:
        """Protocol and address, for messages."""

    def start_home(self) -> None:
        """Begin to search for the home position."""

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move to ``position`` (rad) with at most ``speed`` (rad/s, positive), and stop there by itself."""

    def halt(self) -> None:
        """Begin to slow down to rest, whatever the state."""

    def reset(self) -> None:
        """Clear the controller's own latched fault, without motion."""

    def state(self) -> DriveState:
        """Ask the controller."""

    def close(self) -> None:
        """Close the connection; no motion is commanded."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits and timeouts of an axis."""

    speed: float = radians(90.0)
    """rad/s."""
    lowest: float = -inf
    """rad; an axis without stops turns endlessly."""
    highest: float = inf
    tolerance: float = radians(0.05)
    """rad by which a move may miss its target."""
    home_time: float = 60.0
    """s."""
    stop_time: float = 5.0
    """s to come to rest."""


@dataclass(frozen=True, slots=True)
class Axis:
    """A drive within its limits. Clock and sleep are given, so that tests repeat."""

    drive: Drive
    limits: Limits = field(default_factory=Limits)
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    what: str = "table"
    """In messages,"""
    unit: str = "deg"
    """as the unit of a linear axis, mm."""

    def home(self) -> None:
        """Find the home position; position is 0 there.

        Raises:
            MoveTimeout: not found in ``home_time``; it was halted.
            DeviceError: the controller is in a fault of its own.
        """
        self.drive.start_home()
        self.wait(self.limits.home_time, "homing")
        if not self.state().homed:
            raise DeviceError(f"{self.drive.name}: homing ended without a home; check the home switch and its wiring")

    def move_to(self, position: float, speed: float) -> None:
        """Go to ``position`` (rad) at ``speed`` (rad/s, positive) and wait for the end.

        Raises:
            LimitExceeded: beyond the limits; nothing moved.
            MoveTimeout: did not arrive; it was halted.
        """
        needed = self.start_move(position, speed)
        self.wait(2 * needed + MOVE_MARGIN_S, f"moving to {self._text(position)}", target=position)
        missed = abs(self.state().position - position)
        if missed > self.limits.tolerance:
            raise MoveTimeout(
                f"{self.drive.name}: stopped {self._text(missed)} from {self._text(position)}; "
                f"look for what blocks the {self.what}, then reset"
            )

    def start_move(self, position: float, speed: float) -> float:
        """Begin to go to ``position`` (rad); the axis stops there by itself. Returns the time (s) that it needs.

        Raises:
            LimitExceeded: beyond the limits; nothing moved.
            DeviceError: not homed.
        """
        self.demand(position, speed)
        state = self.state()
        if not state.homed:
            raise DeviceError(f"{self.drive.name}: the {self.what} is not homed; home it first")
        self.drive.start_move(position, speed)
        return abs(position - state.position) / speed

    def demand(self, position: float, speed: float) -> None:
        """Refuse a move to ``position`` (rad) at ``speed`` (rad/s) that is beyond the limits.

        Raises:
            LimitExceeded: it is.
        """
        if not 0 < speed <= self.limits.speed:
            raise LimitExceeded(
                f"found a speed of {self._text(speed)}/s, the {self.what} goes up to {degrees(self.limits.speed):.3f}; "
                f"slow down or raise max_speed_{self.unit}_per_s in stand.toml"
            )
        if not (isfinite(position) and self.limits.lowest <= position <= self.limits.highest):
            raise LimitExceeded(
                f"found a target of {self._text(position)}, the {self.what} goes from "
                f"{degrees(self.limits.lowest):.3f} to {self._text(self.limits.highest)}; change the target or the "
                "limits in stand.toml"
            )

    def stop(self) -> None:
        """Come to rest.

        Raises:
            MoveTimeout: still moving after ``stop_time``.
        """
        self.drive.halt()
        self.wait(self.limits.stop_time, "stopping", halt=False)

    def state(self) -> DriveState:
        """State of the axis now.

        Raises:
            DeviceLost: no answer.
        """
        return self.drive.state()

    def reset(self) -> None:
        """Clear the controller's own fault, without motion."""
        self.drive.reset()

    def close(self) -> None:
        """Close the connection."""
        self.drive.close()

    def wait(self, seconds: float, motion: str, halt: bool = True, target: float | None = None) -> None:
        """Wait until it is at rest; ``motion`` names what it does, in errors.

        Raises:
            MoveTimeout: still moving after ``seconds``, or it stands still on the way to a ``target`` (rad) though it
                says that it moves; halted where ``halt``.
            DeviceError: the controller reports a fault.
        """
        end = self.clock() + seconds
        left, since = inf, self.clock()
        while True:
            asked = self.clock()  # before the question: a busy computer is not a late table
            state = self.state()
            if state.fault:
                raise DeviceError(f"{self.drive.name}: {state.fault} while {motion}; mend the cause, then reset")
            if not state.moving:
                return
            missing = 0.0 if target is None else abs(state.position - target)
            if abs(missing - left) > self.limits.tolerance / 2:
                left, since = missing, asked
            elif asked - since > STALL_S and left > self.limits.tolerance:
                self.drive.halt()
                raise MoveTimeout(
                    f"{self.drive.name}: it stands still at {self._text(state.position)} while {motion}: look for what "
                    f"blocks the {self.what}, then reset"
                )
            if asked > end:
                if halt:
                    self.drive.halt()
                raise MoveTimeout(
                    f"{self.drive.name}: {motion} took longer than {seconds:.1f} s, now at "
                    f"{self._text(state.position)}; look for what blocks the {self.what}, then reset"
                )
            self.sleep(POLL_INTERVAL_S)

    def _text(self, value: float) -> str:
        return f"{degrees(value):.3f} {self.unit}"


def timed(question: Callable[..., T], *arguments: Any) -> tuple[T, float, float]:
    """The answer to a question, with ``time`` and ``time_half_width`` of a ``DriveState`` (s)."""
    before = time.monotonic()
    answer = question(*arguments)
    after = time.monotonic()
    return answer, (before + after) / 2, (after - before) / 2


def lost(name: str, found: str) -> DeviceLost:
    """For a controller that does not answer, or no longer."""
    return DeviceLost(
        f"{name}: {found}; need a controller that answers there; "
        "check power, cable, and its address under [devices] of stand.toml"
    )


def malformed(name: str, found: str, needed: str) -> DeviceError:
    """For an answer that is none of the protocol."""
    return DeviceError(
        f"{name}: found {found}, need {needed}; "
        "check that its protocol and address under [devices] of stand.toml belong to this controller"
    )


def refused(name: str, found: str, advice: str) -> DeviceError:
    """For a controller that refuses a command."""
    return DeviceError(f"{name}: refused, {found}; {advice}")
