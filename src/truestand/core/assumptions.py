"""What is assumed where recipe, certificate and data sheet are silent. Budget lines that rest on it say *(assumed)*.

How to state or do better stands beside each and nowhere else. All U are expanded with k = 2, and none is smaller than
what a careful person would state. Each has its place in ``ASSUMPTIONS``, by which a record tells what a result rests
on.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
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
SIDEWAYS_U = 1e-3
"""mm: error motion of an ordinary table across the laser plane, beyond once a turn, which no round shaft shows;"""
SIDEWAYS_SHARE = 3.0
"""and how many times as much as what the shaft shows towards the sensor: a worm or a belt pushes one way."""
ANGLE_ZERO_U = 2e-4
"""rad: where a scan starts against the zero of the table's angle."""
ENCODER_U, STEADY_U = 5e-5, 2e-4
"""rad: once-per-turn error of an angle that is measured (10 arc seconds), and of one taken from a steady speed."""
HEIGHT_HIDDEN_U, HEIGHT_SEEN_U = 0.5, 0.01
"""mm, k = 2, of the shoulder: where its face is hidden, its edge may be broken by as much; where it is seen."""
HEIGHT_ZERO = "height zero: the shoulder"
"""Line of a calibration's budget."""
SEATED_U = 5e-4
"""mm: by how much a part without play sits otherwise on its seat when it is clamped again."""
CLAMPED_U = radians(0.5)
"""rad: how well a shaft is clamped at a stated angle."""


@dataclass(frozen=True, slots=True)
class Assumption:
    """A number that nobody stated: a U (k = 2), but for a ``constant``."""

    name: str
    value: float
    unit: str
    source: str
    """Why this much."""
    key: str = ""
    """Which key states better, and where; empty: none does."""
    otherwise: str = ""
    """What to do, beside or after stating it, for a smaller U."""
    constant: bool = False
    line: str = ""
    """The beginning of its budget lines' names, where that is not ``name``."""


SPEED = "speed of the table"
"""In the name of a line of an angle that is taken from the table's speed."""
EXPANSION_OF_STEEL = Assumption(
    "thermal expansion", EXPANSION, "1/K", "steel", "expansion_per_K in the part's recipe", constant=True
)
SENSOR, STEPS, PART = "under [[sensor]] in stand.toml", "under [[cylinder]] in shaft.toml", "in the part's recipe"
MOUNTING, SEEN_PLANE = "mounting of the laser plane", "calibrate with a larger eccentricity and two steps in view"
CLAMP_TWICE = "calibrate with the shaft clamped twice (--clamped-at-deg 0,180)"
ANGLE, ANGLE_KEY = "angle, once per turn", "angle_U_arcsec under [table] in stand.toml"
ENCODER = Assumption(
    ANGLE, ENCODER_U, "rad", "10 arc seconds of an encoder", ANGLE_KEY, "use a better encoder", line="angle, "
)
STEADY = Assumption(
    ANGLE, STEADY_U, "rad", "41 arc seconds of a steady table", ANGLE_KEY, "use an encoder", line="angle, "
)
LINEARITY = Assumption(
    "linearity of the sensor", LEAST_LINEARITY, "mm", "0.05 % of the range, 20 um at least",
    f"linearity_U_um of the data sheet {SENSOR}", "use a more linear sensor",
)  # fmt: skip
ASSUMPTIONS = (
    LINEARITY,
    Assumption("scale of the sensor", SCALE_U, "1", "usual of line sensors",
               f"scale_U_ppm of the data sheet {SENSOR}", "have the sensor's scale calibrated"),
    Assumption("incidence on the flanks", INCIDENCE_U, "mm", "10 to 40 um are usual of lasers at 60 to 84 degrees",
               f"incidence_U_um (by a master gear) {SENSOR}", "let the sensor see the flanks less aslant"),
    Assumption("incidence on steep surfaces", SLOPE_INCIDENCE_U, "mm", "usual of lasers at 60 degrees",
               otherwise="let the sensor see the surface less aslant"),
    Assumption("offset of the laser plane", PLANE_OFFSET_U, "mm", "mounted by eye", f"plane_offset_U_mm {SENSOR}",
               SEEN_PLANE, line=MOUNTING),
    Assumption("tilt of the laser plane", PLANE_TILT_U, "rad", "mounted by eye", f"plane_tilt_U_deg {SENSOR}",
               SEEN_PLANE, line=MOUNTING),
    Assumption("stability of the sensor", STABILITY_U, "mm", "0.01 % of the range a kelvin", f"stability_U_um {SENSOR}",
               "keep some shaft in view of the part's scan: it measures it"),
    Assumption("diameter of the artefact", DIAMETER_U, "mm", "a micrometer's",
               f"diameter_U_mm of the certificate {STEPS}", "have the shaft's diameter calibrated better"),
    Assumption("coaxiality", COAXIALITY_U, "mm", "a ground shaft's", f"coaxiality_U_mm {STEPS}", CLAMP_TWICE),
    Assumption("temperature of the artefact", TEMPERATURE_U, "K", "a room that is not controlled"),
    Assumption("temperature of the part", TEMPERATURE_U, "K", "a room that is not controlled",
               f"part_temperature_U_C, with part_temperature_C, {PART}", "measure the part's temperature better"),
    Assumption("table bearing", BEARING_U, "mm", "once a turn, of a good bearing"),
    Assumption("sideways motion of the table", SIDEWAYS_U, "mm", "an ordinary bearing's, twice a turn and more",
               "sideways_U_um under [table] in stand.toml"),
    Assumption("zero of the table angle", ANGLE_ZERO_U, "rad", "repeatability of a home switch or an index",
               otherwise="keep some shaft in view of the part's scan: it shows the zero"),
    ENCODER,
    STEADY,
    Assumption("clamping angles", CLAMPED_U, "rad", "by marks on shaft and table"),
)  # fmt: skip
"""In the order of reports; the sensor's linearity follows from its range."""


def behind(line: str) -> tuple[Assumption, ...]:
    """What a line of a budget rests on where it was not stated; nothing where the line is no recipe's matter."""
    other = ENCODER if SPEED in line else STEADY
    return tuple(a for a in ASSUMPTIONS if a is not other and line.startswith((a.name, a.line or a.name)))


def better(found: Iterable[Assumption], stated: bool = False) -> str:
    """How to make a line smaller that rests on these; where they are ``stated``, not by stating them. Empty: no way."""
    assumptions = tuple(found)
    keys = () if stated else tuple(a.key for a in assumptions if a.key)
    ways = [f"state {' and '.join(keys)}"] if keys else []
    return ", or ".join(dict.fromkeys(ways + [a.otherwise for a in assumptions if a.otherwise]))


def assumptions_behind(lines: Iterable[str], linearity: float) -> tuple[Assumption, ...]:
    """What the budget's ``lines`` (names) rest on that nobody stated; ``linearity``: mm, of the sensor."""
    assumed = [line for line in lines if line.endswith(ASSUMED)]
    found = [a for a in ASSUMPTIONS if any(a in behind(line) for line in assumed)]
    if found and found[0] is LINEARITY:
        found[0] = replace(LINEARITY, value=linearity)
    if any(a.name.startswith("temperature") for a in found):
        found.append(EXPANSION_OF_STEEL)
    return tuple(found)
