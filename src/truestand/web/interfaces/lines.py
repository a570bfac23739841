"""The lines of a result as machines take them: a flat object each, one unit, both limits, null where there is none."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from truestand.files.records.inspection_record import limits_of

UNITS = ("um", "mm", "mrad", "deg")
Record = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Line:
    """A characteristic of an inspection, a quantity of a calibration, or a change that a verification looked for."""

    name: str
    """Alone in its result: characteristic, section, flank and tooth, as in ``F_alpha left 3``."""
    characteristic: str
    flank: str | None
    tooth: int | None
    """None: the whole gear."""
    section: str | None
    value: float | None
    U: float | None
    """Expanded, k = 2."""
    lower: float | None
    upper: float | None
    unit: str
    """Of value, U and limits: um, mm, mrad or deg."""
    verdict: str | None
    status: str
    """measured, partial, not_measurable or not_identifiable."""
    coverage: float | None
    """0..1."""
    standard: str | None


def lines_of(kind: str, record: Record) -> tuple[Line, ...]:
    """The lines of a record of any kind, each under a name of its own."""
    readers = {"inspection": _inspected, "verification": _verified, "calibration": _calibrated}
    return tuple(_apart(readers[kind](record))) if kind in readers else ()


def _inspected(record: Record) -> Iterator[Line]:
    for c in record.get("characteristics") or ():
        unit = "mm" if "value_mm" in c else "um"
        lower, upper = limits_of(c, record) or (None, None)
        yield _line(
            c["name"], unit, section=c.get("section"), flank=c.get("flank"), tooth=c.get("tooth"),
            value=c.get(f"value_{unit}"), U=c.get(f"U_{unit}"), lower=lower, upper=upper, verdict=c.get("verdict"),
            status=c.get("status") or "measured", coverage=c.get("coverage"), standard=c.get("standard"),
        )  # fmt: skip


def _verified(record: Record) -> Iterator[Line]:
    for c in record.get("changes") or ():
        told = {key: c.get(f"{key}_um") for key in ("value", "U")}
        yield _line(c["name"], "um", **told, upper=c.get("limit_um"), verdict=c.get("verdict"))


def _calibrated(record: Record) -> Iterator[Line]:
    """What has an uncertainty, and what could not be told."""
    values = {**(record.get("sensor") or {}), **(record.get("shaft") or {})}
    for key, told in (record.get("uncertainty") or {}).items():
        name, unit = _split(key)
        if key in values:
            yield _line(name, unit, value=values[key], U=told.get("U"))
    for key in record.get("not_identifiable") or ():
        name, unit = _split(key)
        yield _line(name, unit, status="not_identifiable")


def _split(key: str) -> tuple[str, str]:
    """Name and unit of a record's key."""
    name, _, unit = key.rpartition("_")
    return (name, unit) if unit in UNITS else (key, "")


def _line(name: str, unit: str, **told: Any) -> Line:
    where = [str(told[key]) for key in ("section", "flank", "tooth") if told.get(key) is not None]
    given: dict[str, Any] = dict.fromkeys(Line.__slots__) | {"status": "measured"} | told
    return Line(**given | {"name": " ".join((name, *where)), "characteristic": name, "unit": unit})


def _apart(lines: Iterable[Line]) -> Iterator[Line]:
    """The same lines; names that come again are counted."""
    seen: dict[str, int] = {}
    for line in lines:
        count = seen[line.name] = seen.get(line.name, 0) + 1
        yield line if count == 1 else replace(line, name=f"{line.name} ({count})")
