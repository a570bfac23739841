"""Does an old calibration still hold? A new scan of the artefact answers, quantity by quantity."""

from dataclasses import dataclass
from math import cos, hypot, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from truestand.core.artefact import Artefact
from truestand.core.calibrate import calibrate
from truestand.core.calibration import Calibration
from truestand.core.frames import facing, sensor_parameters, shaft_parameters
from truestand.core.scan import Scan

Array = NDArray[np.float64]
Verdict = Literal["holds", "does_not_hold", "undecided"]

LIMIT = 0.01
"""mm: how far a calibrated point may have moved on the artefact."""
K = 2.0
ORDER: tuple[Verdict, ...] = ("does_not_hold", "undecided", "holds")


@dataclass(frozen=True, slots=True)
class Change:
    """How far one thing has moved since the old calibration: mm on the artefact, with U (k = 2)."""

    name: str
    value: float
    U: float
    limit: float
    verdict: Verdict
    advice: str


@dataclass(frozen=True, slots=True)
class Verification:
    """The answer, what it rests on, and the calibration that the new scan gives."""

    verdict: Verdict
    changes: tuple[Change, ...]
    reasons: tuple[str, ...]
    calibration: Calibration


def verify(scan: Scan, old: Calibration, artefact: Artefact, limit: float = LIMIT) -> Verification:
    """Hold an old calibration against a new scan of the artefact.

    What both scans share (certificate, mounting prior) cancels: U is the repeatability of both. A change within
    ``limit`` by more than U holds, one beyond it by more than U does not, in between is undecided.

    Raises:
        NotEnoughData: the new scan can't be calibrated.
    """
    new = calibrate(scan, artefact)
    changes = tuple(_decided(*c, limit=limit) for c in _changes(old, new, artefact))
    reasons = [f"the new scan is untrusted: {r}" for r in new.reasons]
    if old.method == "paper":
        reasons.append("the old calibration is of the published method, which knows no laser plane or tilt")
    if reasons:
        return Verification("undecided", changes, tuple(reasons), new)
    verdicts = {c.verdict for c in changes}
    reasons = [f"{c.name}: {c.advice}" for c in changes if c.verdict != "holds"]
    worst: Verdict = next(v for v in ORDER if v in verdicts)
    return Verification(worst, changes, tuple(reasons), new)


def _decided(name: str, value: float, U: float, advice: str, limit: float) -> Change:
    verdict: Verdict = "undecided"
    if value + U <= limit:
        verdict = "holds"
    elif value - U > limit:
        verdict = "does_not_hold"
    return Change(name, value, U, limit, verdict, advice)


def _changes(old: Calibration, new: Calibration, artefact: Artefact) -> list[tuple[str, float, float, str]]:
    """Name, distance (mm), U (mm) and advice of everything that could have moved."""
    spread = _repeatability(old, new)
    points = _seen_points(new, artefact)
    found = []
    radial = [_sensor_move(old, new, p, spread) for p in points]
    worst = max(radial, key=lambda c: c[0])
    found.append(("sensor, radially", *worst, "the sensor has moved or turned in the laser plane: calibrate again"))
    sideways = max((_sideways_move(old, new, v, spread) for _, _, v in points), key=lambda c: c[0])
    if not {"laser_plane_offset_mm", "laser_plane_tilt_deg"} & {*old.not_identifiable, *new.not_identifiable}:
        found.append(("sensor, sideways", *sideways, "the laser plane has moved or tilted: calibrate again"))
    shaft = max((_shaft_move(old, new, v, spread) for _, _, v in points), key=lambda c: c[0])
    found.append(("shaft on the table", *shaft, "the shaft was clamped again or has slipped: calibrate again"))
    return found


def _repeatability(old: Calibration, new: Calibration) -> Array:
    """Covariance (8, 8) of the difference of two calibrations of the same artefact."""
    return new.repeatability + (old.repeatability if old.repeatability.size else new.repeatability)


def _seen_points(new: Calibration, artefact: Artefact) -> list[tuple[float, float, float]]:
    """Sensor readings x, z (mm) at the ends of the artefact's cylinders as far as seen, and their height v."""
    phi, radial, height, _, _ = sensor_parameters(new.table_from_sensor)
    side = facing(phi)
    points = []
    for profile in new.static_profiles:
        radius = next(c.radius for c in artefact.cylinders if c.name == profile.surface)
        for v in (float(profile.height[0]), float(profile.height[-1])):
            across, up = radius - radial, v - height
            x = side * cos(phi) * across + np.sin(phi) * up
            z = -side * np.sin(phi) * across + cos(phi) * up
            points.append((float(x), float(z), v))
    return points


def _along_and_across(pose: Calibration, x: float, z: float) -> tuple[float, float]:
    rotation, translation = pose.table_from_sensor.rotation, pose.table_from_sensor.translation
    across = rotation[0, 0] * x + rotation[0, 2] * z + translation[0]
    along = rotation[2, 0] * x + rotation[2, 2] * z + translation[2]
    return float(along), float(across)


def _sensor_move(
    old: Calibration, new: Calibration, point: tuple[float, float, float], spread: Array
) -> tuple[float, float]:
    x, z, v = point
    phi, _, height, _, _ = sensor_parameters(new.table_from_sensor)
    gradient = np.zeros(8)
    gradient[0], gradient[1] = -facing(phi) * (v - height), 1.0
    moved = abs(_along_and_across(new, x, z)[1] - _along_and_across(old, x, z)[1])
    return moved, _expanded(gradient, spread)


def _sideways_move(old: Calibration, new: Calibration, v: float, spread: Array) -> tuple[float, float]:
    before, after = (sensor_parameters(c.table_from_sensor) for c in (old, new))
    gradient = np.zeros(8)
    gradient[2], gradient[3] = 1.0, v
    return abs(after[4] - before[4] + v * (after[3] - before[3])), _expanded(gradient, spread)


def _shaft_move(old: Calibration, new: Calibration, v: float, spread: Array) -> tuple[float, float]:
    before, after = (shaft_parameters(c.shaft_from_rotor) for c in (old, new))
    dx, dy = (after[i] - before[i] + v * (after[i + 2] - before[i + 2]) for i in (0, 1))
    unit = np.zeros((2, 8))
    unit[0, 4], unit[0, 6], unit[1, 5], unit[1, 7] = 1.0, v, 1.0, v
    both = unit @ spread @ unit.T
    return hypot(dx, dy), K * sqrt(max(float(np.linalg.eigvalsh(both)[-1]), 0.0))


def _expanded(gradient: Array, spread: Array) -> float:
    return K * sqrt(max(float(gradient @ spread @ gradient), 0.0))
