"""inspection.json (CONTRACT.md): an inspection with its keys and units. mm inside, um for deviations outside."""

from collections.abc import Mapping
from typing import Any

from truestand._version import __version__
from truestand.core.calibration import Calibration, ScanSummary
from truestand.core.errors import UnreadableFile
from truestand.core.inspection import Characteristic, Defect, Inspection
from truestand.files.records.records import scan_record, without_nan
from truestand.gear.figures import NEVER_NEGATIVE

Record = dict[str, Any]

FORMAT, VERSION = "truestand.inspection", 1
UM = 1000.0


def inspection_record(
    inspection: Inspection, calibration: Calibration, scan: ScanSummary, calibration_sha256: str, created: str
) -> Record:
    """The record; ``created`` is an ISO time."""
    i = inspection
    record: Record = {
        "format": FORMAT,
        "version": VERSION,
        "verdict": i.verdict,
        "reasons": list(i.reasons),
        "remarks": list(i.remarks),
        "part": {"kind": i.kind, "name": i.name, **i.identity},
        "characteristics": [_characteristic(c) for c in i.characteristics],
        "defects": [_defect(d) for d in i.defects],
        "defect_limit_um": None if i.defect_depth is None else UM * i.defect_depth,
        "settings": dict(i.settings),
        "published": [_published(name, value) for name, value in i.published.items()],
        "calibration": {"sha256": calibration_sha256, "status": calibration.status, "created": calibration.created},
        "scan": scan_record(scan),
        "software": f"truestand {__version__}",
        "created": created,
    }
    finite: Record = without_nan(record)
    return finite


def _characteristic(c: Characteristic) -> Record:
    line: Record = {"name": c.name, "flank": c.flank, "tooth": c.tooth}
    if c.section is not None:
        line["section"] = c.section
    if c.size:
        line |= {"value_mm": c.value, "U_mm": c.U, "limits_mm": None if c.limits is None else list(c.limits)}
    else:
        line |= {
            "value_um": None if c.value is None else UM * c.value,
            "U_um": None if c.U is None else UM * c.U,
            "limit_um": None if c.limits is None else _limit(c.limits),
        }
        if c.limits is not None and c.limits[0] is not None and c.limits[0] != -(c.limits[1] or 0.0):
            line["limits_um"] = [None if v is None else UM * v for v in c.limits]
    line |= {
        "grade": c.grade,
        "coverage": c.coverage,
        "status": c.status,
        "verdict": c.verdict,
        "capable": c.capable,
        "standard": c.standard,
    }
    if c.reason is not None:
        line["reason"] = c.reason
    if c.tooth is None:
        scale = 1.0 if c.size else UM
        unit = "U_mm" if c.size else "U_um"
        line["contributions"] = [{"name": b.name, unit: scale * b.U} for b in c.budget]
    return line


def characteristics_from(record: Mapping[str, Any]) -> list[Characteristic]:
    """The lines of a record, without their budgets.

    Raises:
        UnreadableFile: they are not as truestand writes them.
    """
    gear = (record.get("part") or {}).get("kind") == "gear"
    try:
        return [_line(c, gear) for c in record.get("characteristics") or []]
    except (KeyError, TypeError, ValueError) as wrong:
        raise UnreadableFile(f"inspection.json: found a damaged line ({wrong}); inspect again") from wrong


def _line(c: Mapping[str, Any], gear: bool) -> Characteristic:
    size = "value_mm" in c
    unit, scale = ("mm", 1.0) if size else ("um", UM)
    value, U = (None if (v := c.get(f"{key}_{unit}")) is None else float(v) / scale for key in ("value", "U"))
    return Characteristic(
        c["name"], value, U, c.get("flank"), c.get("tooth"), c.get("section"), size, _limits(c, gear), c.get("grade"),
        c["coverage"], c["status"], c.get("verdict"), c.get("capable", True), c.get("standard"),
        reason=c.get("reason"),
    )  # fmt: skip


def _limits(c: Mapping[str, Any], gear: bool) -> tuple[float | None, float | None] | None:
    """Both limits in mm; one alone is an upper one, and the lower too where a gear's deviation has a sign."""
    if c.get("limits_mm") is not None:
        low, high = c["limits_mm"]
        return low, high
    if c.get("limits_um") is not None:
        low, high = (None if v is None else v / UM for v in c["limits_um"])
        return low, high
    limit = c.get("limit_um")
    if limit is None:
        return None
    signed = gear and c["name"] not in NEVER_NEGATIVE
    return (-limit / UM if signed else None), limit / UM


def _limit(limits: tuple[float | None, float | None]) -> float | None:
    """The one limit of a deviation: the upper one, and the lower where it is the same below zero."""
    low, high = limits
    return UM * high if high is not None else None if low is None else UM * low


def _defect(d: Defect) -> Record:
    return {
        "tooth": d.tooth,
        "flank": d.flank,
        "roll_length_mm": d.roll_length,
        "height_mm": d.height,
        "depth_um": None if d.depth is None else UM * d.depth,
        "U_um": None if d.U is None else UM * d.U,
        "extent_mm": d.extent,
        "kind": d.kind,
        "score": d.score,
        "second_score": d.second_score,
        "verdict": d.verdict,
    }


def _published(name: str, value: float) -> Record:
    plain, _, flank = name.partition(" ")
    return {"name": plain, "flank": flank or None, "value_um": UM * value}
