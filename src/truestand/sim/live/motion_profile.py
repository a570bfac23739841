"""Motions as pieces of constant acceleration: trapezoid moves, turns, stops. Pure; rad, s."""

from dataclasses import dataclass
from math import copysign, sqrt


@dataclass(frozen=True, slots=True)
class Ramps:
    """What the drive can do, both positive, rad/s^2."""

    up: float
    down: float


@dataclass(frozen=True, slots=True)
class Leg:
    """A stretch of constant acceleration from ``position`` and ``speed``."""

    seconds: float
    position: float
    speed: float
    acceleration: float

    @property
    def end(self) -> tuple[float, float]:
        """Position and speed after it."""
        t = self.seconds
        return self.position + self.speed * t + self.acceleration * t * t / 2, self.speed + self.acceleration * t


def stop(position: float, speed: float, ramps: Ramps) -> list[Leg]:
    """Slow down to rest."""
    return [Leg(abs(speed) / ramps.down, position, speed, -copysign(ramps.down, speed))] if speed else []


def turn(position: float, speed: float, wanted: float, ramps: Ramps) -> list[Leg]:
    """Reach the speed ``wanted`` (signed), over rest where the direction changes."""
    if speed * wanted < 0:
        legs = stop(position, speed, ramps)
        return legs + turn(legs[-1].end[0], 0.0, wanted, ramps)
    if speed == wanted:
        return []
    rate = ramps.up if abs(wanted) > abs(speed) else ramps.down
    return [Leg(abs(wanted - speed) / rate, position, speed, copysign(rate, wanted - speed))]


def move(position: float, speed: float, target: float, most: float, ramps: Ramps) -> list[Leg]:
    """Go to ``target`` with at most ``most`` (positive), and be at rest there.

    Where the table runs the other way, or can't stop before the target, it comes to rest first.
    """
    halted = position + speed * abs(speed) / (2 * ramps.down)
    way = copysign(1.0, target - halted)
    if speed * way < 0 or halted == target:
        legs = stop(position, speed, ramps)
        here = legs[-1].end[0] if legs else position
        return legs + (move(here, 0.0, target, most, ramps) if halted != target else [])
    if abs(speed) > most * (1 + 1e-9):
        legs = turn(position, speed, way * most, ramps)
        return legs + move(*legs[-1].end, target, most, ramps)
    way_left = abs(target - position)
    to_peak, from_peak = 1 / (2 * ramps.up), 1 / (2 * ramps.down)
    peak = min(most, sqrt((way_left + speed * speed * to_peak) / (to_peak + from_peak)))
    cruise = way_left - (peak * peak - speed * speed) * to_peak - peak * peak * from_peak
    up = turn(position, speed, way * peak, ramps)
    start = up[-1].end[0] if up else position
    flat = [Leg(cruise / peak, start, way * peak, 0.0)] if cruise > 0 else []
    return up + flat + stop(flat[-1].end[0] if flat else start, way * peak, ramps)
