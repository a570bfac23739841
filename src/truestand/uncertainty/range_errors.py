"""Errors of a sensor's range on their way to a part.

The calibration read the shaft by the same sensor. What is wrong with its range where it saw the base was taken for
where the sensor stands: a level for its radial position, a slope along the shaft for its angle, and at the shoulder's
face a level for its height. A part shows what is wrong with the range where it lies, less what was taken up so, the
more of it the farther it lies from the shaft. The two belong together: near the shaft they cancel, beyond it they may
add up.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import tau

import numpy as np

from truestand.core.arrays import Array
from truestand.core.assumptions import SCALE_U, K
from truestand.core.calibration import HEIGHT, VIEW_UNKNOWNS, Calibration
from truestand.core.frames import PHI, RADIAL, LaserPlane
from truestand.core.stand import Sensor
from truestand.uncertainty.influence import unknowns_of
from truestand.uncertainty.lines import linearity_name, linearity_of, scale_name

WAVES = (1, 2)
"""Over the sensor's range: a smooth error is made of them, the first as large as its linearity, the second half of it.
"""
PERIOD = 50.0
"""mm of range that the first of them takes, where the range isn't known."""
STEP = 1e-6
"""rad: to differentiate by."""


@dataclass(frozen=True, slots=True)
class RangeError:
    """One error of a sensor's range, as large as its U (k = 2), and what a calibration takes up of it."""

    name: str
    """Of its line in the budget."""
    u: float
    """Standard uncertainty of the input (mm or relative)."""
    of_range: Callable[[Array], Array]
    """mm by which a range is read too long, along its ray."""
    taken_up: Array
    """(``VIEW_UNKNOWNS``,) mm and rad: by how much the calibration's unknowns, azimuth and height are off for it."""


def change_along_range(sensor: Sensor, times: int = 1, apart: float | None = None) -> float:
    """1/mm^times: by what share of its linearity the error of a sensor's range, differentiated so many ``times`` over
    it, may be off; or differ between places so many mm of range ``apart``.
    """
    low, high = sensor.range or (0.0, PERIOD)
    numbers = tau / (high - low) * np.array(WAVES)
    differs = 1.0 if apart is None else 2.0 - 2.0 * np.cos(numbers * apart)
    return float(np.sqrt(np.sum(np.square(numbers**times / WAVES) * differs)))


def waves_of_range(sensor: Sensor, linearity: float) -> tuple[tuple[float, Callable[[Array], Array]], ...]:
    """What a smooth error of a sensor's range is made of that is as large as its ``linearity`` (mm, k = 2): U of each
    wave, mm, and by how much a range is read too long for it.
    """
    low, high = sensor.range or (0.0, PERIOD)

    def wave(n: int, shape: Callable[[Array], Array]) -> Callable[[Array], Array]:
        return lambda z: linearity / n * shape(n * tau / (high - low) * (z - low))

    return tuple((linearity / n, wave(n, shape)) for n in WAVES for shape in (np.cos, np.sin))


def range_errors(calibration: Calibration) -> tuple[RangeError, ...]:
    """Linearity and scale of a view's sensor."""
    sensor = calibration.stand.sensor
    linearity, name = linearity_of(sensor, calibration.static_profiles), linearity_name(sensor)
    scale = SCALE_U if sensor.scale_U is None else sensor.scale_U
    low, high = sensor.range or (0.0, PERIOD)

    def stretch(z: Array) -> Array:
        return scale * (z - (low + high) / 2)

    waves = [(name, U / K, wave) for U, wave in waves_of_range(sensor, linearity)]
    found = [*waves, (scale_name(sensor), scale / K, stretch)]
    return tuple(RangeError(name, u, error, _taken_up(calibration, error)) for name, u, error in found)


def lifts_of_range(calibration: Calibration, z: Array, along: Array, follow: Array) -> list[tuple[str, Array]]:
    """By how much each error of range lifts readings at ranges z (n,) mm off their surface: name of its line, and (n,)
    mm, standard.

    ``along`` (n,): by how much a mm of range lifts them; ``follow`` (``VIEW_UNKNOWNS``, n): the calibration's unknowns.
    """
    return [(e.name, (along * e.of_range(z) + e.taken_up @ follow) / K) for e in range_errors(calibration)]


def _taken_up(calibration: Calibration, error: Callable[[Array], Array]) -> Array:
    """By how much (``VIEW_UNKNOWNS``,) mm and rad the calibration is off for an error over range: the angle by its
    slope along the longest cylinder in view, the radial position by its level on the base, the height by that of the
    shoulder's face.
    """
    off, artefact = np.zeros(VIEW_UNKNOWNS), calibration.artefact
    if artefact is None:
        return off
    base, radii = artefact.base, {c.name: c.radius for c in artefact.cylinders}
    by_shoulder = {base.name: np.clip(np.zeros(1), base.bottom, base.top)}  # where the record doesn't say what was seen
    seen = by_shoulder | {s.surface: s.height for s in calibration.static_profiles if s.surface in radii}
    longest = max(seen, key=lambda name: float(np.ptp(seen[name])))
    if seen[longest].size > 1:
        (turned, _), (read, _) = _moves(calibration, radii[longest], seen[longest], error)
        off[PHI] = -_slope(seen[longest], read) / _slope(seen[longest], turned)
    (turned, _), (read, _) = _moves(calibration, base.radius, seen[base.name], error)
    off[RADIAL] = -float((read + off[PHI] * turned).mean())
    if len(radii) > 1:
        (_, turned), (_, read) = _moves(calibration, calibration.shoulder_radius, np.array([artefact.shoulder]), error)
        off[HEIGHT] = -float((read + off[PHI] * turned).mean())
    return off


def _moves(
    calibration: Calibration, radius: float, height: Array, error: Callable[[Array], Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """How readings of places at a radius and at heights (n,), mm, move outwards and along the shaft with the sensor's
    angle, mm a rad, and by the ``error`` of their range, mm.
    """
    unknowns, origin = unknowns_of(calibration)
    phi, radial = unknowns[PHI], unknowns[RADIAL]
    plane, turned = LaserPlane(phi, radial, origin), LaserPlane(phi + STEP, radial, origin)
    x, z = plane.from_uv(np.full(height.size, radius), height)
    along_ray = 1.0 + error(z) / z
    (u, v), (u_read, v_read) = turned.to_uv(x, z), plane.to_uv(x * along_ray, z * along_ray)
    return ((u - radius) / STEP, (v - height) / STEP), (u_read - radius, v_read - height)


def _slope(height: Array, values: Array) -> float:
    return float(np.polyfit(height, values, 1)[0])
