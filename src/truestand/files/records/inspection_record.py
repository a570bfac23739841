"""inspection.json (CONTRACT.md) and its characteristics as CSV. mm inside, um for deviations outside.

The CSV (RFC 4180) is for spreadsheets and statistics. Texts of others never begin like a formula there: a spreadsheet
would run it.
"""

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from truestand.core.calibration import Calibration, ScanSummary
from truestand.core.errors import UnreadableFile
from truestand.core.inspection import Characteristic, Defect, Inspection, Seam
from truestand.files.atomic import write_text_atomic
from truestand.files.records.record import (
    SOFTWARE,
    Record,
    assumptions_record,
    messages_record,
    scan_record,
    without_nan,
)
from truestand.gear.evaluate import NEVER_NEGATIVE
from truestand.uncertainty.assumed import assumptions_of

Limits = tuple[float | None, float | None]

FORMAT, VERSION = "truestand.inspection", 2
UM = 1000.0
"""um in a mm."""
CSV_COLUMNS = (
    "name", "flank", "tooth", "section", "value", "unit", "U", "k", "lower_limit", "upper_limit", "grade", "verdict",
    "status", "coverage", "standard",
)  # fmt: skip
COVERAGE_FACTOR = 2
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n", "|", "%")
"""Spreadsheets take a field that begins so for a formula, or may (OWASP, CSV injection)."""


def inspection_record(
    inspection: Inspection,
    calibration: Calibration,
    scans: tuple[ScanSummary, ...],
    calibration_sha256: str,
    created: str,
) -> Record:
    """The record of an inspection by one scan, or by one of each view; ``created`` is an ISO time."""
    i = inspection
    record: Record = {
        "format": FORMAT,
        "version": VERSION,
        "verdict": i.verdict,
        "reasons": messages_record(i.reasons),
        "remarks": messages_record(i.remarks),
        "part": {"kind": i.kind, "name": i.name, **i.identity},
        "characteristics": [
            *(_characteristic(c) for c in i.characteristics),
            *({**_characteristic(c), "without_damage": True} for c in i.without_damage),
        ],
        "defects": [_defect(d) for d in i.defects],
        "defect_limit_um": None if i.defect_depth is None else UM * i.defect_depth,
        "settings": dict(i.settings),
        "assumptions": assumptions_record(assumptions_of(calibration, (c.budget for c in i.characteristics))),
        "published": [_published(name, value) for name, value in i.published.items()],
        "calibration": {"sha256": calibration_sha256, "status": calibration.status, "created": calibration.created},
        "scan": scan_record(scans[0]),
        "software": SOFTWARE,
        "created": created,
    }
    if len(scans) > 1:
        record["scans"] = [scan_record(scan) for scan in scans]
        record["seams"] = [_seam(seam) for seam in i.seams]
    return without_nan(record)


def _seam(seam: Seam) -> Record:
    return {
        "views": list(seam.views),
        **({"flank": seam.flank} if seam.section is None else {"section": seam.section}),
        "difference_um": UM * seam.difference,
        "U_um": UM * seam.U,
        "ok": seam.ok,
    }


def _characteristic(c: Characteristic) -> Record:
    line: Record = {"name": c.name, "flank": c.flank, "tooth": c.tooth}
    scale, unit = (1.0, "U_mm") if c.size else (UM, "U_um")
    if c.section is not None:
        line["section"] = c.section
    if c.size:
        line |= {"value_mm": c.value, "U_mm": c.U, "limits_mm": None if c.limits is None else list(c.limits)}
    else:
        line |= {
            "value_um": None if c.value is None else UM * c.value,
            "U_um": None if c.U is None else UM * c.U,
            "limit_um": None if c.limits is None else _limit(c.limits),
            "limits_um": None if c.limits is None else [None if v is None else UM * v for v in c.limits],
        }
    line |= {key: getattr(c, key) for key in ("grade", "coverage", "status", "verdict", "capable", "standard")}
    if c.at_least:
        line["at_least"] = True
    if c.reason is not None:
        line["reason"] = c.reason
    if c.views:
        line["views"] = list(c.views)
    if c.tooth is None:
        line["contributions"] = [{"name": b.name, unit: scale * b.U} for b in c.budget]
    return line


def judged_lines(record: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The characteristics of a record but for those that leave damage out, which are information."""
    return [c for c in record.get("characteristics") or [] if not c.get("without_damage")]


def characteristics_from(record: Mapping[str, Any]) -> list[Characteristic]:
    """The lines of a record, without their budgets, but for those that leave damage out.

    Raises:
        UnreadableFile: they are not as truestand writes them.
    """
    try:
        return [_line(c, record) for c in judged_lines(record)]
    except (KeyError, TypeError, ValueError) as wrong:
        raise UnreadableFile(f"inspection.json: found a damaged line ({wrong}); inspect again") from wrong


def limits_of(c: Mapping[str, Any], record: Mapping[str, Any]) -> Limits | None:
    """Lower and upper limit of a record's line in the line's unit, None: that side is open; None alone: no limit.

    Records of 0.1 have the one limit of a deviation as ``limit_um`` alone: the upper one, and the lower one too where a
    gear's deviation has a sign.
    """
    both = c.get("limits_mm") or c.get("limits_um")
    if both is not None:
        low, high = both
        return low, high
    limit = c.get("limit_um")
    if limit is None:
        return None
    gear = (record.get("part") or {}).get("kind") == "gear"
    return (-limit if gear and c.get("name") not in NEVER_NEGATIVE else None), limit


def with_limits(record: Mapping[str, Any]) -> Record:
    """The record with ``limits_um`` in every line of a deviation, as records of 0.1 lack it: for who reads no rules."""
    lines = [
        c if "value_mm" in c else {**c, "limits_um": limits_of(c, record)} for c in record.get("characteristics") or ()
    ]
    return {**record, "characteristics": lines} if lines else {**record}


def _line(c: Mapping[str, Any], record: Mapping[str, Any]) -> Characteristic:
    size = "value_mm" in c
    unit, scale = ("mm", 1.0) if size else ("um", UM)
    value, U = (None if (v := c.get(f"{key}_{unit}")) is None else float(v) / scale for key in ("value", "U"))
    limits = limits_of(c, record)
    if limits is not None:
        low, high = (None if v is None else v / scale for v in limits)
        limits = (low, high)
    return Characteristic(
        c["name"], value, U, c.get("flank"), c.get("tooth"), c.get("section"), size, limits, c.get("grade"),
        c["coverage"], c["status"], c.get("verdict"), c.get("capable", True), c.get("standard"),
        reason=c.get("reason"),
    )  # fmt: skip


def _limit(limits: Limits) -> float | None:
    """The one limit of a deviation for those that take one: the upper; the lower where there is no upper."""
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


def characteristics_csv(characteristics: Iterable[Characteristic]) -> str:
    """CSV text: sizes in mm, deviations in um, with all digits of the record; empty where there is no number."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\r\n")
    writer.writerow(CSV_COLUMNS)
    writer.writerows(_csv_row(c) for c in characteristics)
    return out.getvalue()


def write_characteristics(path: Path | str, inspection: Inspection) -> None:
    """Write the CSV of an inspection, UTF-8, as a whole or not at all."""
    write_text_atomic(path, characteristics_csv(inspection.characteristics))


def _csv_row(c: Characteristic) -> list[str]:
    scale = 1.0 if c.size else UM
    value, U, lower, upper = (_csv_number(v, scale) for v in (c.value, c.U, *(c.limits or (None, None))))
    return [
        _csv_text(c.name), c.flank or "", "" if c.tooth is None else str(c.tooth), _csv_text(c.section),
        value, "mm" if c.size else "um", U, str(COVERAGE_FACTOR) if U else "", lower, upper,
        "" if c.grade is None else str(c.grade), c.verdict or "", c.status, _csv_number(c.coverage),
        _csv_text(c.standard),
    ]  # fmt: skip


def _csv_number(value: float | None, scale: float = 1.0) -> str:
    return "" if value is None else repr(float(scale * value))


def _csv_text(text: str | None) -> str:
    """A text from outside; an apostrophe before what would be a formula."""
    text = (text or "").replace("\x00", "\N{REPLACEMENT CHARACTER}")
    return f"'{text}" if text.lstrip(" ").startswith(FORMULA_STARTS) else text
