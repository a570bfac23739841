"""The virtual rotary table: its true angle at any time, the counts of its encoder, the status of its controller.

The motor follows trapezoidal motion profiles, later than the controller plans them by ``Motion.lag`` (a following error
in proportion to the speed). The table follows the motor with the error of its gearing, periodic in the angle: a speed
ripple. The encoder sits on the table and may be mounted off centre. A command changes only what comes after it: the
past stays unchanged, because the profiles of a sensor are computed a few milliseconds late.
"""

import threading
from dataclasses import dataclass, field, replace
from math import copysign, floor, inf, isfinite, radians, sqrt, tau

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.sim.live.clock import Clock

HISTORY_S = 30.0
"""Virtual time for which the past is stored."""
HOME_OVERSHOOT = radians(3.0)
"""By how much the home search runs past the mark before it comes back to it slowly."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Kinematics of the table and its errors; rad, s."""

    acceleration: float = radians(360.0)
    deceleration: float = radians(720.0)
    top_speed: float = radians(180.0)
    lag: float = 0.004
    """s by which the motor follows late: following error = lag times speed."""
    ripple: float = 0.0
    """Relative speed ripple, of the gearing: the table's angle is off by ripple / ripple_per_turn at most."""
    ripple_per_turn: int = 1
    angle_error: float = 0.0
    """rad: the encoder reads angle_error sin(angle) more than the true angle."""
    power_on: float = radians(70.0)
    """True angle at power-on; the controller's position is 0 there until it is homed."""
    home_speed: float = radians(60.0)
    """Of the home search; the way back to the mark goes at a fifth of it."""
    mark_every: float = tau
    """Between home marks; inf: there is just one, at 0."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of constant acceleration from ``position`` and ``speed``."""

    seconds: float
    position: float
    speed: float
    acceleration: float


@dataclass(slots=True)
class MotionProfile:
    """A trapezoidal motion profile, rad and s, planned by segments; ``position`` and ``speed`` are those at its end."""

    position: float
    speed: float
    acceleration: float
    """Positive, rad/s², as the deceleration."""
    deceleration: float
    segments: list[Segment] = field(default_factory=list)

    def reach_speed(self, speed: float) -> None:
        """Reach a speed (signed, rad/s), over rest where the direction changes."""
        if self.speed * speed < 0:
            self.reach_speed(0.0)
        if self.speed != speed:
            rate = self.acceleration if abs(speed) > abs(self.speed) else self.deceleration
            self._add(abs(speed - self.speed) / rate, copysign(rate, speed - self.speed))
            self.speed = speed

    def reach_position(self, target: float, max_speed: float) -> None:
        """Go to ``target`` (rad) with at most ``max_speed`` (positive, rad/s), and be at rest there.

        A motion in the other direction, or one that can't stop before the target, comes to rest first.
        """
        stopping_point = self.position + self.speed * abs(self.speed) / (2 * self.deceleration)
        direction = copysign(1.0, target - stopping_point)
        if self.speed * direction < 0 or stopping_point == target:
            self.reach_speed(0.0)
            if stopping_point != target:
                self.reach_position(target, max_speed)
        elif abs(self.speed) > max_speed * (1 + 1e-9):
            self.reach_speed(direction * max_speed)
            self.reach_position(target, max_speed)
        else:
            self._accelerate_cruise_stop(target, direction, max_speed)

    def _accelerate_cruise_stop(self, target: float, direction: float, max_speed: float) -> None:
        distance = abs(target - self.position)
        to_peak, from_peak = 1 / (2 * self.acceleration), 1 / (2 * self.deceleration)
        peak = min(max_speed, sqrt((distance + self.speed * self.speed * to_peak) / (to_peak + from_peak)))
        cruise = distance - (peak * peak - self.speed * self.speed) * to_peak - peak * peak * from_peak
        self.reach_speed(direction * peak)
        if cruise > 0 and peak > 0:  # the speed for 5e-324 rad underflows to 0
            self._add(cruise / peak, 0.0)
        self.reach_speed(0.0)

    def _add(self, seconds: float, acceleration: float) -> None:
        """Add a segment; the caller sets the speed at its end, exactly."""
        self.segments.append(Segment(seconds, self.position, self.speed, acceleration))
        self.position += self.speed * seconds + acceleration * seconds * seconds / 2


@dataclass(frozen=True, slots=True)
class TableStatus:
    """Status of the controller."""

    position: float
    """rad, from home, or from where it was switched on. The error of the gearing isn't in it."""
    moving: bool
    homed: bool
    fault: str = ""


@dataclass(frozen=True, slots=True)
class _MotorState:
    """The motor from ``start`` on, until the next state; positions from the home mark where it was switched on."""

    start: float
    position: float
    speed: float
    acceleration: float
    moving: bool
    homed: bool
    home_mark: float
    """Position of the home mark that is now 0, whole turns: homing takes the next mark, it does not unwind."""
    origin: float
    """Position where the controller's is 0."""

    def at(self, moment: float) -> "_MotorState":
        """The same from ``moment`` on."""
        t = moment - self.start
        return replace(
            self,
            start=moment,
            position=self.position + self.speed * t + self.acceleration * t * t / 2,
            speed=self.speed + self.acceleration * t,
        )


class VirtualTable:
    """A table and its controller. Commands take effect at ``clock.now()``; they may come from any thread.

    A command answers whether the controller took it: in a fault it takes none but ``reset`` and ``halt``.
    """

    def __init__(self, clock: Clock, motion: Motion | None = None) -> None:
        self.clock = clock
        self.motion = motion or Motion()
        self._lock = threading.RLock()
        self._fault = ""
        self._stalled = False
        self.part_mounted = False
        """The part is on the shaft that stands on the table."""
        self._stuck_intervals: list[tuple[float, float]] = []
        on = self.motion.power_on
        self._set([_MotorState(clock.now(), on, 0.0, 0.0, moving=False, homed=False, home_mark=0.0, origin=on)])

    def angle_at(self, times: Array | float) -> Array:
        """(N,) rad: the true table angle, many turns, 0 = home, at virtual ``times`` up to now."""
        motor = self._motor_at(np.asarray(times, dtype=float))
        m = self.motion
        angle: Array = motor + m.ripple / m.ripple_per_turn * np.sin(m.ripple_per_turn * motor)
        return angle

    def counts_at(self, times: Array | float, counts_per_turn: int) -> NDArray[np.int64]:
        """(N,) encoder counts, 0 at home. A stuck encoder stays at its count; released, it counts the true angle."""
        latched = np.asarray(times, dtype=float)
        for begin, end in tuple(self._stuck_intervals):
            latched = np.where((latched >= begin) & (latched < end), begin, latched)
        angle = self.angle_at(latched)
        reading = angle + self.motion.angle_error * np.sin(angle)
        return np.rint(reading * (counts_per_turn / tau)).astype(np.int64)

    def status(self) -> TableStatus:
        """Status now; moving from the moment when it took a command that moves it."""
        with self._lock:
            now = self.clock.now()
            motor = self._state_at(now)
            return TableStatus(motor.position - motor.origin, self._moving_from(now), motor.homed, self._fault)

    def home(self) -> bool:
        """Search for the home mark below, and take it as 0."""
        with self._lock:
            motor, profile = self._plan()
            every = self.motion.mark_every
            mark = every * floor(motor.position / every) if isfinite(every) else 0.0
            motor = replace(motor, homed=False)
            profile.reach_position(mark - HOME_OVERSHOOT, min(self.motion.home_speed, self.motion.top_speed))
            profile.reach_position(mark, self.motion.home_speed / 5)
            final = replace(_at_rest(motor, mark), homed=True, home_mark=mark, origin=mark)
            return self._accept(motor, profile, final)

    def move(self, position: float, speed: float) -> bool:
        """Go to ``position`` (rad, of the controller) at ``speed`` (rad/s, positive) and stop there."""
        if speed <= 0:
            return False
        with self._lock:
            motor, profile = self._plan()
            target = position + motor.origin
            profile.reach_position(target, min(speed, self.motion.top_speed))
            return self._accept(motor, profile, _at_rest(motor, target))

    def turn(self, speed: float) -> bool:
        """Turn endlessly at ``speed`` (rad/s, signed)."""
        with self._lock:
            motor, profile = self._plan()
            speed = copysign(min(abs(speed), self.motion.top_speed), speed)
            profile.reach_speed(speed)
            return self._accept(
                motor, profile, replace(_at_rest(motor, profile.position), speed=speed, moving=speed != 0)
            )

    def halt(self) -> bool:
        """Slow down to rest; ends a stalled motion too. Accepted in a fault."""
        with self._lock:
            motor, profile = self._plan()
            profile.reach_speed(0.0)
            self._follow(motor, profile, _at_rest(motor, profile.position))
            return True

    def reset(self) -> None:
        """Clear the controller's fault, without motion."""
        with self._lock:
            self._fault = ""

    def stall(self) -> None:
        """Block the motor: the table stands still, the controller still reports that it moves."""
        with self._lock:
            now = self.clock.now()
            self._stalled = True
            self._append([replace(self._state_at(now), speed=0.0, acceleration=0.0, moving=self._moving_from(now))])

    def stick_encoder(self) -> None:
        """Freeze the counts while the table turns."""
        with self._lock:
            self._stuck_intervals = [*self._stuck_intervals, (self.clock.now(), inf)]

    def trip(self, fault: str) -> None:
        """Put the controller into a fault of its own: it slows down and takes no command until ``reset``."""
        with self._lock:
            self._fault = fault
            self.halt()

    def release(self) -> None:
        """End ``stall`` and ``stick_encoder``. A blocked table stays where it is; it needs a new command."""
        with self._lock:
            now = self.clock.now()
            self._stuck_intervals = [(begin, min(end, now)) for begin, end in self._stuck_intervals]
            if self._stalled:
                self._stalled = False
                self._append([replace(self._state_at(now), moving=False)])

    def _plan(self) -> tuple[_MotorState, MotionProfile]:
        """The motor when a command of now reaches it, and a motion from there, still empty."""
        motor = replace(self._state_at(self.clock.now() + self.motion.lag), acceleration=0.0)
        return motor, MotionProfile(motor.position, motor.speed, self.motion.acceleration, self.motion.deceleration)

    def _accept(self, motor: _MotorState, profile: MotionProfile, final: _MotorState) -> bool:
        """Follow the profile unless the controller is in a fault; whether it does."""
        if not self._fault:
            self._follow(motor, profile, final)
        return not self._fault

    def _follow(self, motor: _MotorState, profile: MotionProfile, final: _MotorState) -> None:
        """From ``motor`` on the segments of the profile, then ``final``; a stalled motor stays where it is."""
        if self._stalled:
            self._append([replace(motor, moving=bool(profile.segments) or final.moving)])
            return
        states, start = [], motor.start
        for s in profile.segments:
            state = replace(motor, start=start, position=s.position, speed=s.speed, moving=True)
            states.append(replace(state, acceleration=s.acceleration))
            start += s.seconds
        self._append([*states, replace(final, start=start)])

    def _moving_from(self, now: float) -> bool:
        """Whether the controller has still to move."""
        return any(state.moving for state in _ending_after(now, self._states))

    def _append(self, states: list[_MotorState]) -> None:
        """Add ``states`` from their start on: what was planned after it is dropped, and the past beyond the history."""
        past = self.clock.now() - HISTORY_S
        self._set(_ending_after(past, [s for s in self._states if s.start < states[0].start]) + states)
        self._stuck_intervals = [s for s in self._stuck_intervals if s[1] > past]

    def _set(self, states: list[_MotorState]) -> None:
        """One assignment of each: readers of the past need no lock."""
        self._states = states
        rows = [(s.start, s.position - s.home_mark, s.speed, s.acceleration) for s in states]
        self._columns: Array = np.array(rows).T

    def _state_at(self, moment: float) -> _MotorState:
        """The state that holds at ``moment``, from there on."""
        return next(s for s in reversed(self._states) if s.start <= moment or s is self._states[0]).at(moment)

    def _motor_at(self, times: Array) -> Array:
        start, position, speed, acceleration = self._columns
        index = np.maximum(np.searchsorted(start, times, side="right") - 1, 0)
        t = np.maximum(times - start[index], 0.0)
        angle: Array = position[index] + speed[index] * t + acceleration[index] * t * t / 2
        return angle


def _at_rest(motor: _MotorState, position: float) -> _MotorState:
    """At rest at ``position``; otherwise as ``motor``."""
    return replace(motor, position=position, speed=0.0, acceleration=0.0, moving=False)


def _ending_after(moment: float, states: list[_MotorState]) -> list[_MotorState]:
    """Those of consecutive states that hold at ``moment`` or later."""
    ends = [*(s.start for s in states[1:]), inf]
    return [s for s, end in zip(states, ends, strict=True) if end > moment]
