"""Whether a calibration may be applied to a scan: what ties the table angle of the two together."""

from dataclasses import replace

from truestand.core.calibration import Calibration
from truestand.core.conclude import angle_zero
from truestand.core.scan import Scan


def with_transfer_doubts(scan: Scan, calibration: Calibration, start_stated: bool = False) -> Calibration:
    """The calibration with the reasons added that speak against applying it to this scan.

    ``start_stated``: the table angle of the scan's first profile was given by the user.
    """
    reasons = list(calibration.reasons)
    own = angle_zero(scan)
    stated = start_stated and scan.angle_source in ("index", "time")
    if not stated and own != calibration.angle_zero and calibration.angle_zero != "unknown":
        reasons.append(
            f"the scan's table angle counts from {_word(own)}, the calibration's from {_word(calibration.angle_zero)}: "
            "record the same angle in both, or pass --start-angle-deg"
        )
    if scan.stand.table.direction != calibration.stand.table.direction:
        reasons.append(
            f"the scan's table turns {scan.stand.table.direction}, the calibration's "
            f"{calibration.stand.table.direction}: check [table] direction"
        )
    if scan.stand.sensor.mirrored != calibration.stand.sensor.mirrored:
        reasons.append("the scan's sensor is mirrored differently from the calibration's: check [[sensor]] mirrored")
    return replace(calibration, reasons=tuple(reasons))


def _word(zero: str) -> str:
    return {
        "index": "an angle or encoder reading",
        "home": "the table's home position",
        "witness": "a witness band",
        "unknown": "an unknown position",
    }[zero]
