"""The virtual rotary table: where it truly is at any time, what its encoder counts, what its controller says.

The motor follows trapezoid ramps, later than the controller plans them by ``Motion.lag`` (a following error in
proportion to the speed). The table follows the motor with the error of its gearing, periodic in the angle: a speed
ripple. The encoder sits on the table and may be mounted off centre. A command changes only what comes after it: the
past stays as it was, because a sensor draws what it sees a few milliseconds late.
"""

import threading
from dataclasses import dataclass, replace
from math import copysign, floor, inf, radians, tau

import numpy as np
from numpy.typing import NDArray

from truestand.sim.live import motion_profile as ramps
from truestand.sim.live.clock import Clock
from truestand.sim.live.motion_profile import Leg, Ramps

Array = NDArray[np.float64]
HISTORY = 30.0
"""Virtual s for which the past is kept."""
OVERSHOOT = radians(3.0)
"""By how much the home search runs past the mark before it comes back to it slowly."""


@dataclass(frozen=True, slots=True)
class Motion:
    """How the table moves; rad, s."""

    acceleration: float = radians(360.0)
    deceleration: float = radians(720.0)
    top_speed: float = radians(180.0)
    lag: float = 0.004
    """s by which the motor follows late: following error = lag times speed."""
    ripple: float = 0.0
    """Relative speed ripple, of the gearing: the table's angle is off by ripple / ripple_per_turn at most."""
    ripple_per_turn: int = 1
    angle_error: float = 0.0
    """rad: the encoder reads angle_error sin(angle) more than is true."""
    power_on: float = radians(70.0)
    """Where the table stands when it is switched on; its controller says 0 there until it is homed."""
    home_speed: float = radians(60.0)
    """The search runs at it, the last bit at a fifth of it."""


@dataclass(frozen=True, slots=True)
class TableStatus:
    """What the controller says."""

    time: float
    """Virtual s."""
    position: float
    """rad, as the controller counts: from home, or from where it was switched on. The gearing's error isn't in it."""
    moving: bool
    homed: bool
    fault: str = ""


@dataclass(frozen=True, slots=True)
class _Piece:
    """The motor from ``start`` on, until the next piece; positions from the home mark where it was switched on."""

    start: float
    position: float
    speed: float
    acceleration: float
    moving: bool
    homed: bool
    zero: float
    """The whole turns of the home mark that is now 0: homing takes the next mark, it does not unwind."""
    origin: float
    """Where the controller's 0 is."""

    def at(self, moment: float) -> "_Piece":
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
        self._ramps = Ramps(self.motion.acceleration, self.motion.deceleration)
        self._lock = threading.RLock()
        self._fault = ""
        self._stalled = False
        self._stuck: list[tuple[float, float]] = []
        on = self.motion.power_on
        self._set([_Piece(clock.now(), on, 0.0, 0.0, moving=False, homed=False, zero=0.0, origin=on)])

    # What people and sensors see

    def angle_at(self, times: Array | float) -> Array:
        """(N,) rad: the true table angle, many turns, 0 = home, at virtual ``times`` up to now."""
        motor = self._motor_at(np.asarray(times, dtype=float))
        m = self.motion
        angle: Array = motor + m.ripple / m.ripple_per_turn * np.sin(m.ripple_per_turn * motor)
        return angle

    def counts_at(self, times: Array | float, counts_per_turn: int) -> NDArray[np.int64]:
        """(N,) encoder counts, 0 at home. A stuck encoder stays at the count it had and knows better when released."""
        seen = np.asarray(times, dtype=float)
        for begin, end in tuple(self._stuck):
            seen = np.where((seen >= begin) & (seen < end), begin, seen)
        angle = self.angle_at(seen)
        read = angle + self.motion.angle_error * np.sin(angle)
        return np.rint(read * (counts_per_turn / tau)).astype(np.int64)

    def status(self) -> TableStatus:
        """What the controller says now; it moves as soon as it took a command that moves it."""
        with self._lock:
            now = self.clock.now()
            here = self._at(now)
            return TableStatus(now, here.position - here.origin, self._busy(now), here.homed, self._fault)

    # Commands

    def home(self) -> bool:
        """Search for the home mark below, and take it as 0."""
        with self._lock:
            here = replace(self._begin(), homed=False)
            mark = tau * floor(here.position / tau)
            legs = self._plan(here, mark - OVERSHOOT, self.motion.home_speed)
            legs += ramps.move(mark - OVERSHOOT, 0.0, mark, self.motion.home_speed / 5, self._ramps)
            return self._take(here, legs, replace(_rest(here, mark), homed=True, zero=mark, origin=mark))

    def move(self, position: float, speed: float) -> bool:
        """Go to ``position`` (rad, as the controller counts) at ``speed`` (rad/s, positive) and stop there."""
        with self._lock:
            here = self._begin()
            target = position + here.origin
            return speed > 0 and self._take(here, self._plan(here, target, speed), _rest(here, target))

    def turn(self, speed: float) -> bool:
        """Turn endlessly at ``speed`` (rad/s, signed)."""
        with self._lock:
            here = self._begin()
            wanted = copysign(min(abs(speed), self.motion.top_speed), speed)
            legs = ramps.turn(here.position, here.speed, wanted, self._ramps)
            return self._take(here, legs, replace(_rest(here, _end(here, legs)), speed=wanted, moving=wanted != 0))

    def halt(self) -> bool:
        """Slow down to rest; the end of a stalled motion too."""
        with self._lock:
            here = self._begin()
            legs = ramps.stop(here.position, here.speed, self._ramps)
            self._lay(here, legs, _rest(here, _end(here, legs)))
            return True

    def reset(self) -> None:
        """Clear the controller's fault, without motion."""
        with self._lock:
            self._fault = ""

    # Faults on request

    def stall(self) -> None:
        """Block the motor: the table stands still, the controller goes on saying that it moves."""
        with self._lock:
            now = self.clock.now()
            self._stalled = True
            self._append([replace(self._at(now), speed=0.0, acceleration=0.0, moving=self._busy(now))])

    def stick_encoder(self) -> None:
        """Freeze the counts while the table turns."""
        with self._lock:
            self._stuck = [*self._stuck, (self.clock.now(), inf)]

    def trip(self, fault: str) -> None:
        """Let the controller fall into a fault of its own: it slows down and takes no command until ``reset``."""
        with self._lock:
            self._fault = fault
            self.halt()

    def release(self) -> None:
        """End ``stall`` and ``stick_encoder``. What was blocked stays where it is; it needs a new command."""
        with self._lock:
            now = self.clock.now()
            self._stuck = [(begin, min(end, now)) for begin, end in self._stuck]
            if self._stalled:
                self._stalled = False
                self._append([replace(self._at(now), moving=False)])

    # Within

    def _begin(self) -> _Piece:
        """Where the motor will be when a command of now reaches it."""
        here = self._at(self.clock.now() + self.motion.lag)
        return replace(here, acceleration=0.0)

    def _plan(self, here: _Piece, target: float, speed: float) -> list[Leg]:
        return ramps.move(here.position, here.speed, target, min(speed, self.motion.top_speed), self._ramps)

    def _take(self, here: _Piece, legs: list[Leg], final: _Piece) -> bool:
        """Go, where the controller takes commands."""
        if self._fault:
            return False
        self._lay(here, legs, final)
        return True

    def _lay(self, here: _Piece, legs: list[Leg], final: _Piece) -> None:
        """From ``here`` on the ``legs``, then ``final``; a stalled motor stays where it is."""
        if self._stalled:
            self._append([replace(here, moving=bool(legs) or final.moving)])
            return
        pieces, start = [], here.start
        for leg in legs:
            pieces.append(
                replace(
                    here,
                    start=start,
                    position=leg.position,
                    speed=leg.speed,
                    acceleration=leg.acceleration,
                    moving=True,
                )
            )
            start += leg.seconds
        self._append([*pieces, replace(final, start=start)])

    def _busy(self, now: float) -> bool:
        """Whether the controller has still to move."""
        ends = (*(p.start for p in self._pieces[1:]), inf)
        return any(p.moving for p, end in zip(self._pieces, ends, strict=True) if end > now)

    def _append(self, pieces: list[_Piece]) -> None:
        """Lay ``pieces`` from their start on; what was planned after it is gone, what is long past forgotten."""
        old = [p for p in self._pieces if p.start < pieces[0].start]
        past = self.clock.now() - HISTORY
        self._set([p for p, end in zip(old, [*(q.start for q in old[1:]), inf], strict=True) if end > past] + pieces)
        self._stuck = [s for s in self._stuck if s[1] > past]

    def _set(self, pieces: list[_Piece]) -> None:
        """One assignment: who draws the past needs no lock."""
        self._pieces = pieces
        rows = [(p.start, p.position - p.zero, p.speed, p.acceleration) for p in pieces]
        self._columns: Array = np.array(rows).T

    def _at(self, moment: float) -> _Piece:
        """The piece that holds at ``moment``, from there on."""
        return next(p for p in reversed(self._pieces) if p.start <= moment or p is self._pieces[0]).at(moment)

    def _motor_at(self, times: Array) -> Array:
        start, position, speed, acceleration = self._columns
        piece = np.maximum(np.searchsorted(start, times, side="right") - 1, 0)
        t = np.maximum(times - start[piece], 0.0)
        angle: Array = position[piece] + speed[piece] * t + acceleration[piece] * t * t / 2
        return angle


def _rest(here: _Piece, position: float) -> _Piece:
    """At rest at ``position``; otherwise as ``here``."""
    return replace(here, position=position, speed=0.0, acceleration=0.0, moving=False)


def _end(here: _Piece, legs: list[Leg]) -> float:
    return legs[-1].end[0] if legs else here.position
