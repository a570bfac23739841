"""What is assumed where recipe, certificate and data sheet are silent. Budget lines that rest on it say *(assumed)*.

All U are expanded with k = 2, and none is smaller than what a careful person would state. Each has its place in
``ASSUMPTIONS``, by which a record tells what a result rests on.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import radians

K = 2.0
"""Coverage factor of every expanded uncertainty, U = K u (GUM 6.2)."""
ASSUMED = " (assumed)"
"""Behind the name of a budget line that rests on an assumption."""
LINEARITY_SHARE, LEAST_LINEARITY = 5e-4, 0.02
"""Share of a sensor's range that is its linearity, and mm at least."""
SCALE_U = 1e-4
"""Relative: scale of the sensor."""
SMOOTH = 10.0
"""mm over which a sensor's range error may change by all of its linearity; over less, by a share of it."""
INCIDENCE_U = 0.02
"""mm: by how much a laser sensor reads a gear's flanks differently; 10 to 40 um are usual at 60 to 84 degrees."""
SLOPE_INCIDENCE_U = 0.005
"""mm: the same on surfaces at 60 degrees, growing with the tangent."""
PLANE_OFFSET_U, PLANE_TILT_U = 1.0, radians(1.0)
"""mm, rad: how well the laser plane was mounted through and along the rotation axis."""
STABILITY_U = 0.01
"""mm: radial zero of a sensor from one scan to the next; data sheets state 0.01 % of the range a kelvin, of 50 mm."""
DIAMETER_U = 0.003
"""mm: diameter of a shaft by a micrometer."""
COAXIALITY_U = 0.002
"""mm: sideways offset of a ground shaft's steps."""
TEMPERATURE_U, EXPANSION = 2.0, 11.5e-6
"""K, of artefact and part against 20 degrees Celsius; 1/K, steel."""
BEARING_U = 5e-4
"""mm: once-per-turn error of a good table bearing, which one scan can't tell from eccentricity."""
ANGLE_ZERO_U = 2e-4
"""rad: where a scan starts against the zero of the table's angle."""
ENCODER_U, STEADY_U = 5e-5, 2e-4
"""rad: once-per-turn error of an angle that is measured (10 arc seconds), and of one taken from a steady speed."""
CLAMPED_U = radians(0.5)
"""rad: how well a shaft is clamped at a stated angle."""


@dataclass(frozen=True, slots=True)
class Assumption:
    """A number that nobody stated: a U (k = 2), but for a ``constant``."""

    name: str
    value: float
    unit: str
    source: str
    """Why this much, and where to state better."""
    constant: bool = False


SPEED = "speed of the table"
"""In the name of a line of an angle that is taken from the table's speed."""
EXPANSION_OF_STEEL = Assumption(
    "thermal expansion", EXPANSION, "1/K", "steel; expansion_per_K in the part's recipe states another", constant=True
)
ASSUMPTIONS = (
    Assumption("scale of the sensor", SCALE_U, "1", "usual of line sensors; scale_U_ppm in stand.toml states better"),
    Assumption("incidence on the flanks", INCIDENCE_U, "mm",
               "10 to 40 um are usual of lasers at 60 to 84 degrees; a master shows it: incidence_U_um in stand.toml"),
    Assumption("incidence on steep surfaces", SLOPE_INCIDENCE_U, "mm", "usual of lasers at 60 degrees"),
    Assumption("mounting of the laser plane", PLANE_OFFSET_U, "mm",
               "by eye; plane_offset_U_mm and plane_tilt_U_deg in stand.toml state better"),
    Assumption("stability of the sensor", STABILITY_U, "mm",
               "0.01 % of the range a kelvin; stability_U_um in stand.toml states better, shaft in view measures it"),
    Assumption("diameter of the artefact", DIAMETER_U, "mm",
               "a micrometer's; diameter_U_mm in shaft.toml states better"),
    Assumption("coaxiality", COAXIALITY_U, "mm",
               "a ground shaft's; coaxiality_U_mm in shaft.toml states better, two clampings measure it"),
    Assumption("temperature of the artefact", TEMPERATURE_U, "K", "a room that is not controlled"),
    Assumption("temperature of the part", TEMPERATURE_U, "K",
               "a room that is not controlled; part_temperature_C in the part's recipe states better"),
    Assumption("table bearing", BEARING_U, "mm", "once a turn, of a good bearing"),
    Assumption("zero of the table angle", ANGLE_ZERO_U, "rad", "repeatability of a home switch or an index"),
    Assumption("clamping angles", CLAMPED_U, "rad", "by marks on shaft and table"),
)  # fmt: skip
"""By the beginning of their lines' names; linearity and angle follow from the stand."""
ENCODER = Assumption(
    "angle, once per turn", ENCODER_U, "rad", "10 arc seconds of an encoder; angle_U_arcsec in stand.toml states better"
)
STEADY = Assumption(
    "angle, once per turn", STEADY_U, "rad",
    "41 arc seconds of a steady table; an encoder, or angle_U_arcsec in stand.toml, does better",
)  # fmt: skip


def assumptions_behind(lines: Iterable[str], linearity: float) -> tuple[Assumption, ...]:
    """What the budget's ``lines`` (names) rest on that nobody stated; ``linearity``: mm, of the sensor."""
    names = {name.removesuffix(ASSUMED) for name in lines if name.endswith(ASSUMED)}
    found = [a for a in ASSUMPTIONS if any(name.startswith(a.name) for name in names)]
    if any(name.startswith("linearity") for name in names):
        source = "0.05 % of the range, 20 um at least; linearity_U_um in stand.toml, of the data sheet, states better"
        found.insert(0, Assumption("linearity of the sensor", linearity, "mm", source))
    if any(name.startswith("angle, ") for name in names):
        found.append(STEADY if any(SPEED in name for name in names) else ENCODER)
    if any(a.name.startswith("temperature") for a in found):
        found.append(EXPANSION_OF_STEEL)
    return tuple(found)
