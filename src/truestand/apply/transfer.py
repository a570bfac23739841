"""Whether a calibration may be applied to a scan: what ties the table angle of the two together, and whether sensor and
shaft still stand where they stood. Then applying it.
"""

from dataclasses import dataclass, replace

import numpy as np

from truestand.apply.right_view import demand_own_view
from truestand.apply.witness import Witness, witness
from truestand.core.assumptions import K
from truestand.core.calibration import AZIMUTH, Calibration, Check
from truestand.core.frames import PLANE_OFFSET, RADIAL, Pose, in_table
from truestand.core.message import UNTIED, Message
from truestand.core.scan import AngleZero, Scan
from truestand.core.stand import Sensor
from truestand.core.surface import Surface, apply_calibration
from truestand.uncertainty.influence import retaken

MOST_MOVED_MM = 0.01
"""By which sensor or shaft may have moved since the calibration."""
MOST_ARC_MM = 0.02
"""At the part's outside: how well the zero of the table's angle must be known."""
MOST_RETAKEN = 2.0
"""Of a positioner's U, by which a place that it has taken twice may differ."""
NOTICEABLE_MM = 0.001
"""Of a move that is taken into account, below which nothing is said."""
SAMPLED_PROFILES = 200
OUTSIDE_QUANTILE = 0.9
"""Share of the readings within the radius that counts as the part's outside: outliers lie beyond."""
ZERO_WORDS: dict[AngleZero, str] = {
    "index": "an angle or encoder reading",
    "home": "the table's home position",
    "witness": "a witness band",
    "unknown": "an unknown position",
}


@dataclass(frozen=True, slots=True)
class Transfer:
    """A scan and the calibration as it is applied to it."""

    scan: Scan
    """Its table angle counts from the calibration's zero."""
    calibration: Calibration
    """With the reasons added that speak against applying it to this scan."""
    witness: Witness | None = None
    """None where the scan shows too little of the shaft."""
    checks: tuple[Check, ...] = ()


def roll(scan: Scan, calibration: Calibration, start_stated: bool = False) -> Surface:
    """The scan's points in C, its table angle tied to the calibration's.

    What speaks against applying the calibration to this scan (another direction of the table, a scan that isn't whole,
    an angle that nothing ties, a sensor that moved) stands in the surface's calibration as reasons, so that nothing
    is decided on it. ``start_stated``: the table angle of the scan's first profile was given (``start_angle`` of
    ``interpret``).
    """
    if calibration.applied_to is scan:  # both come from ``transfer``
        return apply_calibration(scan, calibration)
    tied = transfer(scan, calibration, start_stated)
    return apply_calibration(tied.scan, tied.calibration)


def transfer(scan: Scan, calibration: Calibration, start_stated: bool = False) -> Transfer:
    """The scan with its table angle tied to the calibration's; the shaft in view is checked for moves.

    ``start_stated``: the table angle of the scan's first profile was given by the user. A scan that counts from an
    index keeps its angle; any other takes its zero from the witness band, where one shows. Of several views, the
    calibration of the one that took the scan is applied, in its own frames.

    Raises:
        BadRecipe: a view of which the calibration is not, or a scan that another view took.
    """
    whole, calibration = calibration, calibration.for_scan(scan)
    reasons = configuration_reasons(scan, calibration)
    untied = untied_reasons(scan, calibration, start_stated)
    band = witness(scan, calibration)
    demand_own_view(scan, whole, band)
    if band is None:
        return Transfer(scan, _with_reasons(calibration, (*reasons, *untied), scan))
    band, limit = _with_place_retaken(band, scan, calibration), MOST_ARC_MM / _outside(scan, calibration)
    checks = _moved(band, calibration.stand.sensor)
    calibration = replace(_moved_out(calibration, band), wobble=band.wobble)
    tied, sure = not untied and calibration.angle_zero != "unknown", band.angle_U <= limit
    by_index = scan.angle_zero == calibration.angle_zero == "index"
    if tied and (by_index or not sure):
        checks = (*checks, _still_tied(band, limit))
    if by_index or not (sure or (tied and band.gained)):  # the band only checks what ties the scan already
        reasons = (*reasons, *untied)
    elif not tied or band.gained or abs(band.angle_shift) > band.angle_U:
        others = tuple(r for r in calibration.reasons if r.code != UNTIED.code)
        faster = band.gained / (scan.angle[-1] - scan.angle[0])
        calibration = replace(
            calibration, angle_zero="witness", angle_U=band.angle_U, speed_change=faster, reasons=others
        )
        scan = band.tied(scan)
    failed = (c.reason for c in checks if not c.ok)
    return Transfer(scan, _with_reasons(calibration, (*reasons, *failed), scan), band, checks)


def _with_place_retaken(band: Witness, scan: Scan, calibration: Calibration) -> Witness:
    """The band, its angle known no better than a positioner takes a place again: a sensor farther to the side sees the
    shaft's axis in another direction.
    """
    again = retaken(replace(calibration, applied_to=scan))
    if not again.size or calibration.artefact is None:
        return band
    radius = min(c.radius for c in calibration.artefact.cylinders if c.name in band.surfaces)
    u = float(np.linalg.norm(again[PLANE_OFFSET] / radius + again[AZIMUTH]))
    return replace(band, angle_U=min(float(np.hypot(band.angle_U, K * u)), np.pi))


def _moved_out(calibration: Calibration, band: Witness) -> Calibration:
    """The calibration with its sensor as far out as the band sees it, where that is farther than the band's U; and that
    U in its covariance.

    A surface that the calibration has not seen may have another diameter than drawn: it moves nothing.
    """
    known = {s.surface for s in calibration.static_profiles}
    if not known.issuperset(band.surfaces):
        return calibration
    covariance = calibration.covariance.copy()
    if covariance.shape[0] > RADIAL:
        covariance[RADIAL, RADIAL] += (band.radial_U / K) ** 2
    calibration = replace(calibration, covariance=covariance, followed=True)
    if abs(band.radial) <= band.radial_U:
        return calibration
    return _with_sensor_out(calibration, band.radial)


def _with_sensor_out(calibration: Calibration, by: float) -> Calibration:
    """The calibration with its sensor farther out ``by`` so many mm."""
    pose = calibration.table_from_sensor
    moved = Pose(pose.rotation, pose.translation + np.array([by, 0.0, 0.0]))
    return replace(calibration, table_from_sensor=moved, moved_out=calibration.moved_out + by)


def with_sensor_as_calibrated(surface: Surface) -> Surface:
    """The same scan with its sensor where the calibration has it, for a part that is itself the shaft in view: its
    diameter must not be measured by itself.
    """
    scan, calibration = surface.origin
    calibrated = replace(calibration, followed=False)
    if not calibration.moved_out:
        return replace(surface, calibration=calibrated)
    return apply_calibration(scan, _with_sensor_out(calibrated, -calibration.moved_out))


def transfer_remarks(calibration: Calibration) -> tuple[Message, ...]:
    """What ``transfer`` found of a calibration, for the reader of an inspection."""
    found, wobble = [], calibration.wobble
    if abs(calibration.moved_out) >= NOTICEABLE_MM:
        where = "out" if calibration.moved_out > 0 else "in"
        text = (
            f"by the shaft in view the sensor stands {1000 * abs(calibration.moved_out):.1f} um farther {where} than "
            "at the calibration: taken into account"
        )
        found.append(Message("sensor_followed", text))
    if calibration.speed_change:
        text = (
            f"by the shaft in view the table turned {100 * abs(calibration.speed_change):.2g} % "
            f"{'faster' if calibration.speed_change > 0 else 'slower'} than at the calibration: taken into account"
        )
        found.append(Message("table_speed_followed", text))
    if wobble is not None and wobble.amplitude >= NOTICEABLE_MM:
        text = (
            f"the shaft in view shows a wave of {1000 * wobble.amplitude:.1f} um {wobble.waves} times a turn that the "
            "calibration does not know: it stands in U; sensor or table wobble, or the shaft has such a form"
        )
        found.append(Message("wobble", text))
    return tuple(found)


def _with_reasons(calibration: Calibration, reasons: tuple[Message, ...], scan: Scan) -> Calibration:
    return replace(calibration, reasons=(*calibration.reasons, *reasons), applied_to=scan)


def configuration_reasons(scan: Scan, calibration: Calibration) -> tuple[Message, ...]:
    """Why nothing may be decided: a scan that is not complete, settings of its stand that can't both be right."""
    reasons = list(scan.reasons)
    if scan.stand.table.direction != calibration.stand.table.direction:
        text = (
            f"the scan's table turns {scan.stand.table.direction}, the calibration's "
            f"{calibration.stand.table.direction}: check [table] direction"
        )
        reasons.append(Message("table_direction_differs", text))
    if scan.stand.sensor.mirrored != calibration.stand.sensor.mirrored:
        text = "the scan's sensor is mirrored differently from the calibration's: check [[sensor]] mirrored"
        reasons.append(Message("sensor_mirrored_differs", text))
    if scan.stand.sensor.position != calibration.stand.sensor.position:
        text = (
            f"the positioner of view {calibration.name!r} was told another position for the scan than for the "
            "calibration: check [sensor.position], or calibrate again"
        )
        reasons.append(Message("position_differs", text))
    return tuple(reasons)


def untied_reasons(scan: Scan, calibration: Calibration, start_stated: bool = False) -> tuple[Message, ...]:
    """The reason not to trust the scan's zero of the angle, where neither index, home nor the user gives it.

    A calibration whose own zero is unknown carries its reason already.
    """
    of_scan, of_calibration = scan.angle_zero, calibration.angle_zero
    if (start_stated and scan.free_speed) or of_scan == of_calibration or of_calibration == "unknown":
        return ()
    text = (
        f"the scan's table angle counts from {ZERO_WORDS[of_scan]}, the calibration's from "
        f"{ZERO_WORDS[of_calibration]}, and too little of the shaft is in view to tell them from each other: record "
        "the same angle in both, bring the shaft into view, or pass --start-angle-deg"
    )
    return (Message("angle_untied", text),)


def _moved(band: Witness, sensor: Sensor) -> tuple[Check, ...]:
    """Whether sensor and shaft stand where they stood, as far as the witness band tells; a positioner takes a place
    again no better than it can.
    """
    where, again = ", ".join(band.surfaces), MOST_RETAKEN * (sensor.position_U or 0.0)
    return (
        Check.at_most_um("sensor_moved_radially", f"sensor moved radially ({where}), um", band.radial,
                         MOST_MOVED_MM + again,
                         "the sensor has moved or warmed up since the calibration: calibrate again"),
        *_steady(band, where),
        Check.at_most_um("shaft_runs_otherwise", f"shaft runs more or less eccentrically ({where}), um",
                         band.eccentricity_size, MOST_MOVED_MM,
                         "the shaft was clamped again or has slipped since the calibration: calibrate again"),
    )  # fmt: skip


def _steady(band: Witness, where: str) -> tuple[Check, ...]:
    """Whether the sensor stood still while the scan was taken, where the band tells."""
    if band.drift_U > MOST_MOVED_MM:
        return ()
    return (
        Check.at_most_um("sensor_moved_during_scan", f"sensor moved during the scan ({where}), um", band.drift,
                         MOST_MOVED_MM + band.drift_U,
                         "the sensor warmed up or moved while the part was scanned: let it warm up and scan again"),
    )  # fmt: skip


def _still_tied(band: Witness, limit: float) -> Check:
    """Whether index or home still tie the angle: the shaft's axis lies in the direction that the calibration found."""
    shift, U = band.shift_at_start
    allowed, ok = limit + U, abs(shift) <= limit + U
    return Check(
        "shaft_turned", "shaft turned against the table's zero, mrad", 1000 * shift, 1000 * allowed, ok,
        "the shaft has turned on the table, the angle lost its zero, or the sensor moved sideways: home the table and "
        "scan again, or calibrate again",
    )  # fmt: skip


def _outside(scan: Scan, calibration: Calibration) -> float:
    """Radius (mm) of what the scan shows."""
    rows = scan.spread(SAMPLED_PROFILES)
    u, _ = in_table(calibration.table_from_sensor, scan.x[rows], scan.z[rows])
    return max(float(np.nanquantile(np.abs(u), OUTSIDE_QUANTILE)), 1.0)
