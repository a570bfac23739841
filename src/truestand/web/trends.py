"""Trends as the page draws them: each quantity with its U, its control limits and findings."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from truestand.files.records.inspection_record import Limits, limits_of
from truestand.report.quantities import WORDS
from truestand.statistics.control import ControlChart, control_chart
from truestand.store import Entry, Store
from truestand.store.history import inspections, series
from truestand.web.models import Point, Quantity, TrendFinding

MAX_INSPECTIONS = 300
"""The newest: a record each is read."""


@dataclass(slots=True)
class _Series:
    """One characteristic over several inspections."""

    unit: str
    entries: list[Entry] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    U: list[float | None] = field(default_factory=list)
    limits: Limits | None = None
    """Of the newest."""


def calibration_trends(store: Store) -> list[Quantity]:
    """The quantities of all calibrations that were not withdrawn; of several sensors, each for itself."""
    names = {key: name for key, name, *_ in WORDS} | {"rms_um": "Residual, rms"}
    all_series = series(store)
    several = len({s.sensor for s in all_series}) > 1
    return [
        _quantity(
            f"{s.sensor} {s.quantity}" if several else s.quantity,
            f"{s.sensor}: {names[s.quantity]}" if several else names[s.quantity],
            s.unit, s.entries, s.chart,
        )
        for s in all_series
    ]  # fmt: skip


def inspection_trends(store: Store, parts: Collection[str]) -> list[Quantity]:
    """The whole part's characteristics over the newest inspections of a part, all serial numbers together."""
    matching = [i.standing for i in inspections(store) if {i.standing.entry.part, i.standing.last.part} & set(parts)]
    standing = sorted((s for s in matching if not s.withdrawn), key=lambda s: s.entry.number)[-MAX_INSPECTIONS:]
    lines: dict[str, _Series] = {}
    for inspection in standing:
        record = store.record(inspection.last)
        for name, unit, c in _measured(record):
            line = lines.setdefault(name, _Series("µm" if unit == "um" else unit))
            line.entries.append(inspection.entry)
            line.values.append(float(c[f"value_{unit}"]))
            line.U.append(c.get(f"U_{unit}"))
            line.limits = limits_of(c, record)
    return [
        _quantity(name, name, x.unit, x.entries, control_chart(x.values, x.U), x.limits) for name, x in lines.items()
    ]


def _measured(record: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Name with flank and section, unit, and the line of the record."""
    for c in record.get("characteristics") or []:
        unit = "mm" if "value_mm" in c else "um"
        if c.get("tooth") is None and c.get(f"value_{unit}") is not None:
            yield " ".join(str(w) for w in (c["name"], c.get("flank"), c.get("section")) if w), unit, c


def _quantity(
    name: str, label: str, unit: str, entries: Collection[Entry], chart: ControlChart, limits: Limits | None = None
) -> Quantity:
    pairs = list(zip(entries, chart.points, strict=True))
    return Quantity(
        name=name,
        label=label,
        unit=unit,
        points=[Point(number=e.number, time=e.time, value=p.value, U=p.U) for e, p in pairs],
        centre=chart.mean,
        lower=chart.lower,
        upper=chart.upper,
        limit=None if limits is None or unit == "mm" else limits[0] if limits[1] is None else limits[1],
        limits=limits,
        findings=[TrendFinding(number=e.number, text="; ".join(p.flags)) for e, p in pairs if p.flags],
    )
