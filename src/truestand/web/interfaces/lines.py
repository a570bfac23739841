"""A result's lines for other machines: a flat object each, one unit, both limits, null where there is none."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from truestand.files.records.inspection_record import judged_lines, limits_of

UNITS = ("um", "mm", "mrad", "deg")
Record = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A characteristic of an inspection, a quantity of a calibration, or a change that a verification looked for."""

    name: str
    """Unique in its result: characteristic, section, flank and tooth, as in ``F_alpha left 3``."""
    characteristic: str
    flank: str | None = None
    tooth: int | None = None
    """None: the whole gear."""
    section: str | None = None
    value: float | None = None
    U: float | None = None
    """Expanded, k = 2."""
    lower: float | None = None
    upper: float | None = None
    unit: str
    """Of value, U and limits: um, mm, mrad or deg."""
    verdict: str | None = None
    status: str = "measured"
    """measured, partial, not_measurable or not_identifiable."""
    coverage: float | None = None
    """0..1."""
    standard: str | None = None


def lines_of(kind: str, record: Record) -> tuple[Line, ...]:
    """The lines of a record of any kind, each under a name of its own."""
    readers = {"inspection": _of_inspection, "verification": _of_verification, "calibration": _of_calibration}
    return tuple(_with_unique_names(readers[kind](record))) if kind in readers else ()


def _of_inspection(record: Record) -> Iterator[Line]:
    for c in judged_lines(record):
        unit = "mm" if "value_mm" in c else "um"
        lower, upper = limits_of(c, record) or (None, None)
        yield _line(
            c["name"], unit, section=c.get("section"), flank=c.get("flank"), tooth=c.get("tooth"),
            value=c.get(f"value_{unit}"), U=c.get(f"U_{unit}"), lower=lower, upper=upper, verdict=c.get("verdict"),
            status=c.get("status") or "measured", coverage=c.get("coverage"), standard=c.get("standard"),
        )  # fmt: skip


def _of_verification(record: Record) -> Iterator[Line]:
    for c in record.get("changes") or ():
        yield _line(
            c["name"], "um", value=c.get("value_um"), U=c.get("U_um"), upper=c.get("limit_um"), verdict=c.get("verdict")
        )


def _of_calibration(record: Record) -> Iterator[Line]:
    """Quantities with an uncertainty, and those that are not identifiable."""
    values = {**(record.get("sensor") or {}), **(record.get("shaft") or {})}
    for key, stated in (record.get("uncertainty") or {}).items():
        if key in values:
            yield _line(*_split(key), value=values[key], U=stated.get("U"))
    for key in record.get("not_identifiable") or ():
        yield _line(*_split(key), status="not_identifiable")


def _split(key: str) -> tuple[str, str]:
    """Name and unit of a record's key."""
    name, _, unit = key.rpartition("_")
    return (name, unit) if unit in UNITS else (key, "")


def _line(name: str, unit: str, **fields: Any) -> Line:
    place = [str(fields[key]) for key in ("section", "flank", "tooth") if fields.get(key) is not None]
    return Line(name=" ".join((name, *place)), characteristic=name, unit=unit, **fields)


def _with_unique_names(lines: Iterable[Line]) -> Iterator[Line]:
    """The same lines; a name that comes again gets a number."""
    seen: dict[str, int] = {}
    for line in lines:
        count = seen[line.name] = seen.get(line.name, 0) + 1
        yield line if count == 1 else replace(line, name=f"{line.name} ({count})")
