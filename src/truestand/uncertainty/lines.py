"""Lines of a part's budget that come with stand, sensor and calibration, whatever the part is."""

from math import hypot, sqrt

import numpy as np

from truestand.core.arrays import Array
from truestand.core.artefact import Cylinder
from truestand.core.assumptions import (
    ANGLE_ZERO_U,
    ASSUMED,
    BEARING_U,
    DIAMETER_U,
    ENCODER_U,
    SPEED,
    STABILITY_U,
    STEADY_U,
)
from truestand.core.assumptions import K as K
from truestand.core.calibration import Calibration, Contribution, StaticProfile
from truestand.core.scan import Scan
from truestand.core.stand import Sensor
from truestand.core.temperature import Temperature

CALIBRATION, LINEARITY = "calibration", "linearity of the sensor"
ZERO = f"zero of the table angle{ASSUMED}"
NOISE = "noise"


def line(name: str, U: float, distribution: str = "normal") -> Contribution:
    """One line: U (mm, k = 2)."""
    return Contribution(name, U, U / K, distribution, 1.0)


def together(lines: list[Contribution]) -> tuple[tuple[Contribution, ...], float]:
    """The lines with U above zero, largest first, and U (k = 2) of them all."""
    counting = tuple(sorted((c for c in lines if c.U > 0), key=lambda c: -c.U))
    return counting, sqrt(sum(c.U**2 for c in counting))


def linearity_of(sensor: Sensor, static: tuple[StaticProfile, ...]) -> float:
    """The sensor's linearity U (mm, k = 2): as its data sheet states or as assumed, unless this scan shows worse."""
    return max([sensor.linearity, *(s.peak_to_valley / 2 for s in static)])


def linearity_name(sensor: Sensor) -> str:
    """Name of the budget's line."""
    return LINEARITY + (ASSUMED if sensor.linearity_U is None else "")


def scale_name(sensor: Sensor) -> str:
    """Name of the budget's line."""
    return "scale of the sensor" + (ASSUMED if sensor.scale_U is None else "")


def stability_of(calibration: Calibration, scan: Scan) -> float:
    """U (mm, k = 2) of the sensor's radial zero since the calibration; 0 where shaft in view showed it, and in the scan
    that the calibration is from.
    """
    stated, calibrated = calibration.stand.sensor.stability_U, calibration.scan
    same = calibrated is not None and bool(scan.sha256) and scan.sha256 == calibrated.sha256
    return 0.0 if calibration.followed or same else STABILITY_U if stated is None else stated


def stability_name(sensor: Sensor) -> str:
    """Name of the budget's line."""
    return "stability of the sensor" + (ASSUMED if sensor.stability_U is None else "")


def stability_line(calibration: Calibration, scan: Scan, factor: float) -> Contribution:
    """From a sensor that may have moved since the calibration, ``factor`` times its radial zero."""
    return line(stability_name(calibration.stand.sensor), factor * stability_of(calibration, scan))


def temperature_line(length: float, temperature: Temperature) -> Contribution:
    """From the part's temperature over ``length`` mm."""
    return line(temperature.line, abs(length) * temperature.expanded_growth, "rectangular")


def bearing_line(calibration: Calibration, factor: float) -> Contribution:
    """From the table bearing's error of higher order, ``factor`` times its amplitude: as assumed, with the waves that
    the shaft shows at the calibration and beside the part.
    """
    shown = [w.amplitude for w in (*calibration.shared_waves, *filter(None, [calibration.wobble]))]
    return line("table bearing" + ("" if shown else ASSUMED), factor * hypot(BEARING_U, *shown))


def zero_line(radius: float, factor: float) -> Contribution:
    """From the zero of the table's angle, by which what lies at ``radius`` mm from the rotation axis is turned."""
    return line(ZERO, factor * ANGLE_ZERO_U * radius, "rectangular")


def once_per_turn(scan: Scan) -> tuple[str, float]:
    """Name of the budget's line and U (rad, k = 2) of the angle's error that repeats every turn."""
    measured, own = scan.angle_source in ("angle", "encoder"), scan.stand.table.angle_U
    name = "angle, once per turn" + ("" if measured else f": {SPEED}")
    if own is not None:
        return name, own
    return name + ASSUMED, ENCODER_U if measured else STEADY_U


def angle_line(scan: Scan, arm: float) -> Contribution:
    """From the angle's error that repeats every turn, which moves a surface along its normal ``arm`` mm a rad."""
    name, U = once_per_turn(scan)
    return line(name, U * arm)


def artefact_line(calibration: Calibration, factor: float) -> Contribution:
    """From the diameter of the artefact's base: ``factor`` times its U; 0 where the record has no drawing."""
    if calibration.artefact is None:
        return line(diameter_name(None), 0.0)
    base = calibration.artefact.base
    return line(diameter_name(base), factor * expanded_diameter(base))


def expanded_diameter(base: Cylinder) -> float:
    """U (mm, k = 2) of the diameter of the artefact's base: as its certificate states or as assumed."""
    return DIAMETER_U if base.diameter_U is None else base.diameter_U


def diameter_name(base: Cylinder | None) -> str:
    """Name of the budget's line."""
    return "diameter of the artefact" + (ASSUMED if base is not None and base.diameter_U is None else "")


def spread_of(changes: Array) -> Array:
    """U (k = 2) of statistics (s,) that change by (2, k, s) with each independent part of a covariance, either way."""
    return np.asarray(K * np.sqrt(np.square(np.abs(changes).max(axis=0)).sum(axis=0)))
