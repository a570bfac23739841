"""Whether a calibration may be applied to a scan: what ties the table angle of the two together, and whether sensor and
shaft still stand where they stood. Then applying it.
"""

from dataclasses import dataclass, replace

import numpy as np

from truestand.apply.witness import Witness, witness
from truestand.calibration.checks import angle_zero_reasons
from truestand.core.calibration import Calibration, Check
from truestand.core.frames import in_table
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration

MOST_MOVED = 0.01
"""mm by which sensor or shaft may have moved since the calibration."""
MOST_ARC = 0.02
"""mm at the part's outside: how well the zero of the table's angle must be known."""
SAMPLED_PROFILES = 200
MOSTLY_INSIDE = 0.9
"""Share of the readings within the radius that counts as the part's outside: wild readings lie beyond."""


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
    no tie of the angle, a sensor that moved) stands in the surface's calibration as reasons, so that nothing is decided
    on it. ``start_stated``: the table angle of the scan's first profile was given (``start_angle`` of ``interpret``).
    """
    if calibration.applied_to is scan:  # both come from ``transfer``
        return apply_calibration(scan, calibration)
    tied = transfer(scan, calibration, start_stated)
    return apply_calibration(tied.scan, tied.calibration)


def transfer(scan: Scan, calibration: Calibration, start_stated: bool = False) -> Transfer:
    """Tie the scan's table angle to the calibration's, and ask the shaft in view whether anything moved.

    ``start_stated``: the table angle of the scan's first profile was given by the user. A scan that counts from an
    index keeps its angle; any other takes its zero from the witness band, where one shows.
    """
    doubts = configuration_doubts(scan, calibration)
    loose = untied(scan, calibration, start_stated)
    found = witness(scan, calibration)
    if found is None:
        return Transfer(scan, _doubted(calibration, (*doubts, *loose), scan))
    limit = MOST_ARC / _outside(scan, calibration)
    checks = _moved(found)
    by_index = scan.angle_zero == calibration.angle_zero == "index"
    if by_index or found.angle_U > limit:  # the band only checks what ties the scan already
        doubts = (*doubts, *loose)
        checks = checks if loose or calibration.angle_zero == "unknown" else (*checks, _still_tied(found, limit))
    elif loose or calibration.angle_zero == "unknown" or abs(found.angle_shift) > found.angle_U:
        scan = replace(scan, angle=scan.angle + found.angle_shift)
        told = tuple(r for r in calibration.reasons if r not in angle_zero_reasons("unknown"))
        calibration = replace(calibration, angle_zero="witness", angle_U=found.angle_U, reasons=told)
    failed = (c.reason for c in checks if not c.ok)
    return Transfer(scan, _doubted(calibration, (*doubts, *failed), scan), found, checks)


def _doubted(calibration: Calibration, doubts: tuple[str, ...], scan: Scan) -> Calibration:
    return replace(calibration, reasons=(*calibration.reasons, *doubts), applied_to=scan)


def configuration_doubts(scan: Scan, calibration: Calibration) -> tuple[str, ...]:
    """A scan that isn't whole, and settings of its stand that can't both be right."""
    doubts = list(scan.reasons)
    if scan.stand.table.direction != calibration.stand.table.direction:
        doubts.append(
            f"the scan's table turns {scan.stand.table.direction}, the calibration's "
            f"{calibration.stand.table.direction}: check [table] direction"
        )
    if scan.stand.sensor.mirrored != calibration.stand.sensor.mirrored:
        doubts.append("the scan's sensor is mirrored differently from the calibration's: check [[sensor]] mirrored")
    return tuple(doubts)


def untied(scan: Scan, calibration: Calibration, start_stated: bool = False) -> tuple[str, ...]:
    """The reason not to trust the scan's zero of the angle, where neither index, home nor the user gives it.

    A calibration whose own zero is unknown carries its reason already.
    """
    own, its = scan.angle_zero, calibration.angle_zero
    stated = start_stated and scan.angle_source in ("index", "time")
    if stated or own == its or its == "unknown":
        return ()
    return (
        f"the scan's table angle counts from {_word(own)}, the calibration's from {_word(its)}, and too little of the "
        "shaft is in view to tell them from each other: record the same angle in both, bring the shaft into view, or "
        "pass --start-angle-deg",
    )


def _word(zero: str) -> str:
    return {
        "index": "an angle or encoder reading",
        "home": "the table's home position",
        "witness": "a witness band",
        "unknown": "an unknown position",
    }[zero]


def _moved(w: Witness) -> tuple[Check, ...]:
    """Whether sensor and shaft stand where they stood, as far as the witness band tells."""
    where = ", ".join(w.surfaces)
    return (
        _change(f"sensor moved radially ({where}), um", w.radial,
                "the sensor has moved or warmed up since the calibration: calibrate again"),
        _change(f"shaft runs more or less eccentrically ({where}), um", w.eccentricity_size,
                "the shaft was clamped again or has slipped since the calibration: calibrate again"),
    )  # fmt: skip


def _change(name: str, value: float, advice: str) -> Check:
    return Check(name, 1000 * value, 1000 * MOST_MOVED, abs(value) <= MOST_MOVED, advice)


def _still_tied(w: Witness, limit: float) -> Check:
    """Whether index or home still tie the angle: the shaft's axis lies in the direction that the calibration found."""
    allowed, ok = limit + w.angle_U, abs(w.angle_shift) <= limit + w.angle_U
    return Check(
        "shaft turned against the table's zero, mrad", 1000 * w.angle_shift, 1000 * allowed, ok,
        "the shaft has turned on the table, the angle lost its zero, or the sensor moved sideways: home the table and "
        "scan again, or calibrate again",
    )  # fmt: skip


def _outside(scan: Scan, calibration: Calibration) -> float:
    """Radius (mm) of what the scan shows."""
    rows = scan.spread(SAMPLED_PROFILES)
    u, _ = in_table(calibration.table_from_sensor, scan.x[rows], scan.z[rows])
    return max(float(np.nanquantile(np.abs(u), MOSTLY_INSIDE)), 1.0)
