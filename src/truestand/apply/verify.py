"""Does an old calibration still hold? A new scan of the artefact answers, quantity by quantity."""

from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import Literal

import numpy as np

from truestand.apply.transfer import configuration_doubts, transfer, untied
from truestand.apply.witness import Witness, witness
from truestand.calibration.calibrate import calibrate
from truestand.calibration.checks import angle_zero_reasons
from truestand.calibration.positions import calibrate_on_axes
from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.assumptions import K
from truestand.core.calibration import Calibration, ScanSummary
from truestand.core.errors import NotEnoughData
from truestand.core.frames import (
    ECCENTRICITY_X,
    ECCENTRICITY_Y,
    PHI,
    PLANE_OFFSET,
    PLANE_TILT,
    RADIAL,
    TILT_X,
    TILT_Y,
    UNKNOWNS,
    LaserPlane,
    facing,
    in_table,
    sensor_parameters,
    shaft_parameters,
)
from truestand.core.scan import Scan

Verdict = Literal["holds", "does_not_hold", "undecided"]
By = Literal["calibration", "witness"]

LIMIT = 0.01
"""mm: how far a calibrated point may have moved on the artefact."""
SENSOR_MOVED = "the sensor has moved or turned in the laser plane: calibrate again"
SHAFT_MOVED = "the shaft was clamped again or has slipped: calibrate again"
PUBLISHED = "the old calibration is of the published method, which knows no laser plane or tilt"
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
    calibration: Calibration | None
    """None where the scan shows too little of the artefact to be calibrated."""
    scan: ScanSummary
    by: By
    """Whether the artefact was calibrated again, or judged by the shaft in view beside a part."""


def verify(
    scan: Scan, old: Calibration, artefact: Artefact, limit: float = LIMIT, start_stated: bool = False
) -> Verification:
    """Hold an old calibration against a new scan of the artefact, or of a part beside which the shaft shows.

    What both scans share (certificate, mounting prior) cancels: U is the repeatability of both. A change within
    ``limit`` by more than U holds, one beyond it by more than U does not, in between is undecided. A scan that can't be
    calibrated by itself is judged by its witness band: where the sensor stands radially, and how the shaft runs.
    ``start_stated``: the table angle of the scan's first profile was given by the user.

    Raises:
        NotEnoughData: the new scan can't be calibrated and shows no witness band.
    """
    before = (*configuration_doubts(scan, old), *(() if old.method == "stand" else (PUBLISHED,)))
    tied = not untied(scan, old, start_stated) and old.angle_zero != "unknown"
    if not tied:
        aligned = transfer(scan, old)
        scan = aligned.scan
        if aligned.calibration.angle_zero != "witness":
            before = (*before, *(untied(scan, old) or angle_zero_reasons("unknown")))
    new, doubts = _calibrated(scan, artefact, old)
    band = None if new is not None and _shows(new) else witness(scan, replace(old, artefact=artefact))
    if band is not None:
        return _judged(_changes_in_band(band, tied), limit, before, "witness", scan, new)
    if new is None:
        raise NotEnoughData(doubts[0])
    before = (*(f"the new scan is untrusted: {d}" for d in doubts), *before)
    return _judged(_changes(old, new, artefact), limit, before, "calibration", scan, new)


def _calibrated(scan: Scan, artefact: Artefact, old: Calibration) -> tuple[Calibration | None, tuple[str, ...]]:
    """What the new scan says by itself, and why that is not to be trusted; its zero of the angle is judged before."""
    try:
        known = old.positions.axes if old.positions is not None else ()
        new = calibrate_on_axes(scan, artefact, known) if known else calibrate(scan, artefact)
    except NotEnoughData as few:
        return None, (str(few),)
    return new, tuple(r for r in new.reasons if r not in angle_zero_reasons("unknown"))


def _shows(new: Calibration) -> bool:
    """Whether the scan showed the artefact by itself, and not a part with some shaft beside it."""
    return all(c.ok for c in new.checks if c.name.startswith(("surfaces told apart", "drawing explains")))


def _judged(
    changes: list[tuple[str, float, float, str]],
    limit: float,
    before: tuple[str, ...],
    by: By,
    scan: Scan,
    new: Calibration | None,
) -> Verification:
    """The worst of the changes; undecided where there are reasons ``before`` any of them."""
    decided = tuple(_decided(*c, limit=limit) for c in changes)
    worst: Verdict = next(v for v in ORDER if v in {c.verdict for c in decided})
    reasons = tuple(_reason(c) for c in decided if c.verdict != "holds")
    if before:
        worst, reasons = "undecided", before
    return Verification(worst, decided, reasons, new, ScanSummary.of(scan), by)


def _reason(c: Change) -> str:
    if c.verdict == "undecided":
        found = f"found {1000 * c.value:.2f} um with U {1000 * c.U:.2f} um, limit {1000 * c.limit:.2f} um"
        return f"{c.name}: {found}: too near to decide, or not known well enough; scan for more turns"
    return f"{c.name}: {c.advice}"


def _changes_in_band(band: Witness, direction: bool) -> list[tuple[str, float, float, str]]:
    """What the shaft in view beside a part says; the ``direction`` counts where it doesn't tie the scan itself."""
    size = abs(band.eccentricity_size), band.eccentricity_U
    shaft = (hypot(*band.eccentricity_change), band.change_U) if direction else size
    return [
        ("sensor, radially", abs(band.radial), band.radial_U, SENSOR_MOVED),
        ("shaft on the table", *shaft, SHAFT_MOVED),
    ]


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
    found.append(("sensor, radially", *worst, SENSOR_MOVED))
    sideways = max((_sideways_move(old, new, v, spread) for _, _, v in points), key=lambda c: c[0])
    if not {"laser_plane_offset_mm", "laser_plane_tilt_deg"} & {*old.not_identifiable, *new.not_identifiable}:
        found.append(("sensor, sideways", *sideways, "the laser plane has moved or tilted: calibrate again"))
    shaft = max((_shaft_move(old, new, v, spread) for _, _, v in points), key=lambda c: c[0])
    found.append(("shaft on the table", *shaft, SHAFT_MOVED))
    return found


def _repeatability(old: Calibration, new: Calibration) -> Array:
    """Covariance (8, 8) of the difference of two calibrations of the same artefact."""
    return new.repeatability + (old.repeatability if old.repeatability.size else new.repeatability)


def _seen_points(new: Calibration, artefact: Artefact) -> list[tuple[float, float, float]]:
    """Sensor readings x, z (mm) at the ends of the artefact's cylinders as far as seen, and their height v."""
    phi, radial, height, _, _ = sensor_parameters(new.table_from_sensor)
    plane = LaserPlane(phi, radial, height)
    points = []
    for profile in new.static_profiles:
        radius = next(c.radius for c in artefact.cylinders if c.name == profile.surface)
        for v in (float(profile.height[0]), float(profile.height[-1])):
            x, z = plane.from_uv(np.array(radius), np.array(v))
            points.append((float(x), float(z), v))
    return points


def _sensor_move(
    old: Calibration, new: Calibration, point: tuple[float, float, float], spread: Array
) -> tuple[float, float]:
    x, z, v = point
    phi, _, height, _, _ = sensor_parameters(new.table_from_sensor)
    gradient = np.zeros(UNKNOWNS)
    gradient[PHI], gradient[RADIAL] = -facing(phi) * (v - height), 1.0
    after, before = (in_table(c.table_from_sensor, np.array(x), np.array(z))[0] for c in (new, old))
    return abs(float(after - before)), _expanded(gradient, spread)


def _sideways_move(old: Calibration, new: Calibration, v: float, spread: Array) -> tuple[float, float]:
    before, after = (sensor_parameters(c.table_from_sensor) for c in (old, new))
    gradient = np.zeros(UNKNOWNS)
    gradient[PLANE_OFFSET], gradient[PLANE_TILT] = 1.0, v
    return abs(after[4] - before[4] + v * (after[3] - before[3])), _expanded(gradient, spread)


def _shaft_move(old: Calibration, new: Calibration, v: float, spread: Array) -> tuple[float, float]:
    before, after = (shaft_parameters(c.shaft_from_rotor) for c in (old, new))
    dx, dy = (after[i] - before[i] + v * (after[i + 2] - before[i + 2]) for i in (0, 1))
    unit = np.zeros((2, UNKNOWNS))
    unit[0, ECCENTRICITY_X], unit[0, TILT_X], unit[1, ECCENTRICITY_Y], unit[1, TILT_Y] = 1.0, v, 1.0, v
    both = unit @ spread @ unit.T
    return hypot(dx, dy), K * sqrt(max(float(np.linalg.eigvalsh(both)[-1]), 0.0))


def _expanded(gradient: Array, spread: Array) -> float:
    return K * sqrt(max(float(gradient @ spread @ gradient), 0.0))
