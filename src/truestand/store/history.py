"""What the store has over time: the quantities of its calibrations, its inspections by part, studies of the gauge."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from truestand.core.errors import NotEnoughData
from truestand.files.records.inspection_record import judged_lines
from truestand.statistics.control import ControlChart, control_chart
from truestand.store.entry import Entry
from truestand.store.store import Result, Store

QUANTITIES = {
    "phi_deg": ("sensor", "°"),
    "laser_plane_offset_mm": ("sensor", "mm"),
    "laser_plane_tilt_deg": ("sensor", "°"),
    "eccentricity_um": ("shaft", "µm"),
    "eccentricity_direction_deg": ("shaft", "°"),
    "tilt_mrad": ("shaft", "mrad"),
    "tilt_direction_deg": ("shaft", "°"),
    "rms_um": ("residuals", "µm"),
}
"""Keys of calibration.json with the table that has them. Those of the shaft change whenever it is clamped again."""
DIRECTIONS = ("eccentricity_direction_deg", "tilt_direction_deg")


@dataclass(frozen=True, slots=True)
class Series:
    """One quantity of one sensor over all calibrations that have it."""

    sensor: str
    quantity: str
    unit: str
    entries: tuple[Entry, ...]
    """One a reading, as it stands today."""
    chart: ControlChart

    @property
    def clamping(self) -> bool:
        """Whether it changes whenever the shaft is clamped again."""
        return QUANTITIES[self.quantity][0] == "shaft"


def series(store: Store, since: str | None = None, quantity: str | None = None) -> list[Series]:
    """The quantities of all valid and untrusted calibrations that weren't withdrawn, by sensor, oldest first.

    Raises:
        BadStore: no store, or one that is damaged.
    """
    found: dict[tuple[str, str], list[tuple[Entry, float, float | None]]] = {}
    for result in store.results("calibration", since):
        if result.withdrawn:
            continue
        record = store.record(result.last)
        sensor = str((record.get("sensor") or {}).get("name") or "sensor")
        for key, (table, _) in QUANTITIES.items():
            value = (record.get(table) or {}).get(key)
            if value is not None and quantity in (None, key):
                found.setdefault((sensor, key), []).append((result.entry, float(value), _U(record, key)))
    order = list(QUANTITIES)
    return [
        Series(sensor, key, QUANTITIES[key][1], tuple(e for e, _, _ in readings), _chart(key, readings))
        for (sensor, key), readings in sorted(found.items(), key=lambda item: (item[0][0], order.index(item[0][1])))
    ]


def inspections(store: Store, since: str | None = None, part: str | None = None) -> list[Result]:
    """Inspections, of one part or all, grouped by part and serial number, oldest first.

    Raises:
        BadStore: no store, or one that is damaged.
    """
    found = [r for r in store.results("inspection", since) if part in (None, r.last.part, r.entry.part)]
    return sorted(found, key=lambda r: (r.entry.part or "", r.entry.serial or ""))


def repeated(
    store: Store, part: str, since: str | None = None, quantity: str | None = None
) -> dict[str, list[tuple[str, str, float]]]:
    """Rows (operator, serial, value) of each characteristic that was measured in all inspections of a part.

    Raises:
        NotEnoughData: no such inspections, or one without operator or serial number.
    """
    rows: dict[str, list[tuple[str, str, float]]] = {}
    studied = [result for result in inspections(store, since, part) if not result.withdrawn]
    for result in studied:
        entry = result.entry
        if entry.operator is None or entry.serial is None:
            missing = "operator" if entry.operator is None else "serial number"
            raise NotEnoughData(
                f"entry {entry.number} has no {missing}; a study needs both: inspect --operator --serial"
            )
        for name, unit, line in whole_part_lines(store.record(result.last)):
            label = f"{name} ({'µm' if unit == 'um' else unit})"
            if quantity in (None, label, line["name"]):
                rows.setdefault(label, []).append((entry.operator, entry.serial, float(line[f"value_{unit}"])))
    whole = {label: found for label, found in rows.items() if len(found) == len(studied)}
    if not whole:
        what = "inspections" if quantity is None else f"values of {quantity}"
        raise NotEnoughData(f"found no {what} of part {part!r} to study; truestand history lists them")
    return whole


def whole_part_lines(record: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """The lines of an inspection's record that were measured and belong to no single tooth.

    Each as name with flank and section, unit (mm or um), and the line itself.
    """
    for line in judged_lines(record):
        unit = "mm" if "value_mm" in line else "um"
        if line.get("tooth") is None and line.get(f"value_{unit}") is not None:
            yield " ".join(str(w) for w in (line["name"], line.get("flank"), line.get("section")) if w), unit, line


def _U(record: Mapping[str, Any], key: str) -> float | None:  # noqa: N802
    known = (record.get("uncertainty") or {}).get(key)
    return None if known is None else float(known["U"])


def _chart(key: str, readings: list[tuple[Entry, float, float | None]]) -> ControlChart:
    period = 360.0 if key in DIRECTIONS else None
    return control_chart([v for _, v, _ in readings], [U for _, _, U in readings], period)
