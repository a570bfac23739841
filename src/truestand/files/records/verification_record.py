"""verification.json (CONTRACT.md): whether an old calibration still holds."""

from typing import Any

from truestand._version import __version__
from truestand.apply.verify import Verification
from truestand.files.records.calibration_record import scan_record, without_nan

Record = dict[str, Any]


def verification_record(verification: Verification, created: str, calibration_sha256: str) -> Record:
    """The record of a verification: what moved, against which limit, and what to do."""
    v = verification
    record: Record = {
        "format": "truestand.verification",
        "version": 1,
        "verdict": v.verdict,
        "reasons": list(v.reasons),
        "created": created,
        "software": f"truestand {__version__}",
        "calibration": {"sha256": calibration_sha256},
        "scan": scan_record(v.scan),
        "by": v.by,
        "changes": [
            {
                "name": c.name,
                "value_um": 1000.0 * c.value,
                "U_um": 1000.0 * c.U,
                "limit_um": 1000.0 * c.limit,
                "verdict": c.verdict,
                "advice": c.advice,
            }
            for c in v.changes
        ],
    }
    finite: Record = without_nan(record)
    return finite
