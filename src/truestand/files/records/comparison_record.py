"""comparison.json: what every method for the eccentricity says of one scan, with errors where the truth is given."""

from collections.abc import Mapping
from math import atan2, degrees, hypot
from pathlib import Path
from typing import Any

from truestand.calibration.peers import Finding, Peer
from truestand.core.calibration import ScanSummary
from truestand.core.errors import UnreadableFile
from truestand.core.frames import Pose, sensor_parameters, shaft_parameters
from truestand.core.harmonics import wrap
from truestand.core.scan import Scan
from truestand.files.records.record import SOFTWARE, Record, scan_record

Truth = tuple[float, tuple[float, float, float, float]]
"""phi (rad) and (ex, ey, tx, ty) of the shaft's axis: mm and slopes."""


FINDINGS = (
    "eccentricity_um", "eccentricity_direction_deg", "height_mm", "tilt_mrad", "phi_deg", "rms_um", "seconds",
    "axis_error_um", "phi_error_deg", "reason",
)  # fmt: skip


def axis_of(truth: Mapping[str, Any], path: Path) -> Truth:
    """What truth.json says of the sensor's angle and the shaft's axis.

    Raises:
        UnreadableFile: it holds no poses.
    """
    try:
        sensor = Pose.from_matrix(truth["sensor"]["table_from_sensor"])
        shaft = Pose.from_matrix(truth["shaft"]["shaft_from_rotor"])
    except (KeyError, TypeError, ValueError, IndexError) as wrong:
        raise UnreadableFile(f"{path}: found no table_from_sensor and shaft_from_rotor, need a truth.json") from wrong
    return sensor_parameters(sensor)[0], shaft_parameters(shaft)


def comparison_row(peer: Peer, found: Finding | str, seconds: float, truth: Truth | None) -> Record:
    """One method's line; nulls and a ``reason`` where it found nothing."""
    row: Record = {"method": peer.name, "library": peer.library} | dict.fromkeys(FINDINGS)
    if isinstance(found, str):
        return {**row, "reason": found}
    x, y = found.axis
    row |= {
        "eccentricity_um": 1000 * hypot(x, y),
        "eccentricity_direction_deg": degrees(atan2(y, x)),
        "height_mm": found.height,
        "tilt_mrad": None if found.tilt is None else 1000 * found.tilt,
        "phi_deg": None if found.phi is None else degrees(found.phi),
        "rms_um": 1000 * found.rms,
        "seconds": seconds,
    }
    if truth is not None:
        phi, (ex, ey, tx, ty) = truth
        row["axis_error_um"] = 1000 * hypot(x - ex - tx * found.height, y - ey - ty * found.height)
        row["phi_error_deg"] = None if found.phi is None else degrees(wrap(found.phi - phi))
    return row


def comparison_record(scan: Scan, rows: list[Record], created: str) -> Record:
    """The record; ``created`` is an ISO time."""
    return {
        "format": "truestand.comparison",
        "version": 1,
        "created": created,
        "software": SOFTWARE,
        "scan": scan_record(ScanSummary.of(scan)),
        "rows": rows,
    }
