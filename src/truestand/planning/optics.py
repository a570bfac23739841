"""What a sensor's data sheet says of what it can see, and what is assumed where it is silent."""

from dataclasses import dataclass, replace
from math import cos, degrees, radians, tan

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor

FAN = radians(30.0)
"""Opening of the laser fan."""
INCIDENCE_LIMIT = radians(85.0)
"""Gears are read by lasers up to there, with growing error."""
NOISE = 0.005
"""mm, standard deviation."""
HOUSING = (100.0, 40.0, 90.0)
"""mm along x, y and z."""
RANGE_SPARE, LINE_SPARE, INCIDENCE_SPARE = 2.0, 0.06, radians(0.5)
"""mm of range at either end, share of the laser line, and rad of incidence that a plan leaves unused: nobody puts a
sensor just where it is planned."""
POINTS, LEAST_POINTS = 640, 8
"""Of a profile: assumed, and needed to plan anything."""


@dataclass(frozen=True, slots=True)
class Optics:
    """What the sensor can see. mm and rad."""

    range: tuple[float, float]
    line: tuple[float, float]
    """Length of the laser line at either end of the range."""
    triangulation: float
    """Between laser and camera, + towards y; 0: the camera sees whatever the laser meets."""
    incidence_limit: float
    noise: float
    housing: tuple[float, float, float]
    points: int

    @property
    def least_facing(self) -> float:
        """Cosine of the steepest incidence."""
        return cos(self.incidence_limit)

    @property
    def middle(self) -> float:
        """Of the range."""
        return sum(self.range) / 2

    def half_line(self, z: Array | float) -> Array:
        """Half the length of the laser line at ranges z."""
        (near, far), (narrow, wide) = self.range, self.line
        return np.asarray(narrow + (np.asarray(z) - near) * (wide - narrow) / (far - near)) / 2

    def in_view(self, x: Array, z: Array) -> Mask:
        """Whether readings x, z lie within range and line."""
        low, high = self.range
        with np.errstate(invalid="ignore"):
            return np.asarray((z >= low) & (z <= high) & (np.abs(x) <= self.half_line(z)))

    def spacing(self, z: Array | float) -> Array:
        """mm along x between neighbouring points at ranges z."""
        return 2 * self.half_line(z) / self.points

    @property
    def tightened(self) -> "Optics":
        """What is surely in view where the sensor stands a degree or a millimetre off its place."""
        near, far = self.range
        inset = min(RANGE_SPARE, (far - near) / 4)
        ends = [2 * float(self.half_line(z)) * (1.0 - LINE_SPARE) for z in (near + inset, far - inset)]
        limit = max(self.incidence_limit - INCIDENCE_SPARE, self.incidence_limit / 2)
        return replace(self, range=(near + inset, far - inset), line=(ends[0], ends[1]), incidence_limit=limit)

    @property
    def slopes(self) -> Array:
        """x over z (points,) of the points of a profile: of a fan with its apex at z = 0, as wide as the line is at the
        middle of the range.
        """
        half = float(self.half_line(self.middle)) / self.middle
        return np.linspace(-half, half, self.points)


def optics_of(sensor: Sensor) -> tuple[Optics, tuple[str, ...]]:
    """The optics of a sensor, and which of its keys are assumed, with the value.

    Raises:
        BadRecipe: its range is not stated or reaches behind it, or it has too few points.
    """
    if sensor.range is None:
        raise BadRecipe(
            f"[[sensor]] {sensor.name!r}: found no range_mm, need [nearest, farthest] to plan where to put it; see its "
            "data sheet"
        )
    near, far = sensor.range
    if near <= 0:
        raise BadRecipe(
            f"[[sensor]] {sensor.name!r}: found range_mm = {[near, far]}, need distances from the sensor's origin, "
            "above 0, to plan where to put it"
        )
    if sensor.points is not None and sensor.points < LEAST_POINTS:
        raise BadRecipe(f"[[sensor]] {sensor.name!r}: found points = {sensor.points}, need {LEAST_POINTS} or more")
    fan = (2 * near * tan(FAN / 2), 2 * far * tan(FAN / 2))
    assumed = {
        "line_mm": f"a fan of {degrees(FAN):g} degrees, {fan[0]:.0f} mm wide at the near end of the range",
        "triangulation_deg": "0: the camera sees whatever the laser meets",
        "incidence_limit_deg": f"{degrees(INCIDENCE_LIMIT):g}",
        "noise_um": f"{1000 * NOISE:g}",
        "housing_mm": f"{list(HOUSING)}",
        "points": f"{POINTS}",
    }
    stated = {
        "line_mm": sensor.line,
        "triangulation_deg": sensor.triangulation,
        "incidence_limit_deg": sensor.incidence_limit,
        "noise_um": sensor.noise,
        "housing_mm": sensor.housing,
        "points": sensor.points,
    }
    optics = Optics(
        (near, far),
        sensor.line or fan,
        sensor.triangulation or 0.0,
        sensor.incidence_limit or INCIDENCE_LIMIT,
        sensor.noise or NOISE,
        sensor.housing or HOUSING,
        sensor.points or POINTS,
    )
    return optics, tuple(f"{key}: {text}" for key, text in assumed.items() if stated[key] is None)
