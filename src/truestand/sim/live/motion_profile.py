"""Trapezoidal motion profiles: motions as segments of constant acceleration. Pure; rad, s."""

from dataclasses import dataclass, field
from math import copysign, sqrt


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of constant acceleration from ``position`` and ``speed``."""

    seconds: float
    position: float
    speed: float
    acceleration: float


@dataclass(slots=True)
class MotionProfile:
    """A motion that is planned segment by segment; ``position`` and ``speed`` are those at its end so far."""

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
        if cruise > 0:
            self._add(cruise / peak, 0.0)
        self.reach_speed(0.0)

    def _add(self, seconds: float, acceleration: float) -> None:
        """Add a segment; the caller sets the speed at its end, exactly."""
        self.segments.append(Segment(seconds, self.position, self.speed, acceleration))
        self.position += self.speed * seconds + acceleration * seconds * seconds / 2
