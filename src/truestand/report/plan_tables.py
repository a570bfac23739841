"""A plan as rows of tables: places, and what is expected of each characteristic. Plain text."""

from collections.abc import Callable, Iterable, Iterator

from truestand.core.units import degrees, um
from truestand.planning.plan import Expected, Plan
from truestand.planning.target import View
from truestand.report.notation import NONE, number, places

PLACE_COLUMNS = ("phi, °", "stand-off, mm", "height, mm", "plane offset, mm", "azimuth, °", "clearance, mm")
STATUS = {"measured": "measured", "partial": "seen in part", "not_measurable": "not measurable"}


def place_row(view: View) -> tuple[str, ...]:
    """The numbers of ``PLACE_COLUMNS``."""
    p = view.mount.place
    return (
        number(degrees(p.phi), 1), number(p.standoff, 1), number(p.height, 1), number(p.plane_offset, 2),
        number(degrees(p.azimuth), 0), number(view.mount.clearance, 0),
    )  # fmt: skip


def position_text(view: View) -> str:
    """Where the axes of the positioner are: ``lift 20.0 mm, swivel 5.0°``; empty where none carries it."""
    return ", ".join(
        f"{p.axis} {number(p.value, 1)} mm" if p.linear else f"{p.axis} {number(degrees(p.value), 1)}°"
        for p in view.scan.stand.sensor.position
    )


def figures_of(lines: Iterable[Expected]) -> dict[str, Callable[[Expected], str]]:
    """What is told of each of these lines in numbers, by the heads of the columns: U first."""
    largest = {"largest tooth": largest_text} if any(e.largest is not None for e in lines) else {}
    return {"U (k = 2)": u_text, **largest, "limit": limits_text, "of the limits": share_text}


def u_text(e: Expected) -> str:
    """U with its unit; a dash where it can't be measured."""
    return _with_unit(e.U, e.size)


def largest_text(e: Expected) -> str:
    """The largest U of the teeth; a dash where there is one line only."""
    return _with_unit(e.largest, e.size)


def _with_unit(U: float | None, size: bool) -> str:
    if U is None:
        return NONE
    value, unit = (U, "mm") if size else (um(U), "µm")
    return f"{number(value, places(value))} {unit}"


def limits_text(e: Expected) -> str:
    """``12 µm``, ``± 9.5 µm`` or both ends; a dash without limits."""
    low, high = e.limits or (None, None)
    if high is None:
        return NONE
    scale, unit = (1.0, "mm") if e.size else (um(1.0), "µm")
    if low is None:
        return f"{high * scale:g} {unit}"
    return f"± {high * scale:g} {unit}" if abs(low + high) < 1e-9 else f"{low * scale:g} … {high * scale:g} {unit}"


def share_text(e: Expected) -> str:
    """The largest U as a share of what the limits leave."""
    return NONE if e.share is None else f"{100 * e.share:.0f} %"


def outcome(e: Expected) -> str:
    """Whether the line could be shown to conform, or why not."""
    if e.status != "measured":
        return STATUS[e.status]
    return "" if e.capable else "not capable: U too large"


def price(plan: Plan, written: Callable[[str], str] = str) -> Iterator[str]:
    """What one view less costs, in sentences; ``written``: how a characteristic's name is."""
    fewer = plan.fewer
    if fewer is None:
        return
    now = {(e.name, e.where): e.status for e in plan.asked}
    lost = [e for e in fewer.asked if e.status != "measured" and e.status != now.get((e.name, e.where))]
    weak = [e for e in fewer.asked if e.status == "measured" and not e.capable]
    number_of = len(plan.views) - 1
    views = "one view" if number_of == 1 else f"{number_of} views"
    for what, lines in (
        ("are not measured", [e for e in lost if e.status == "not_measurable"]),
        ("are seen in part only", [e for e in lost if e.status == "partial"]),
        ("could not be shown to conform", weak),
    ):
        if lines:
            named = ", ".join(f"{written(e.name)} {e.where}".strip() for e in lines)
            yield f"With {views}, these {what}: {named}."
    if not lost and fewer.worst is not None and plan.worst is not None and fewer.worst.share and plan.worst.share:
        yield (
            f"The largest U would be {100 * fewer.worst.share:.0f} % of the limits ({written(fewer.worst.name)}) "
            f"instead of {100 * plan.worst.share:.0f} % ({written(plan.worst.name)})."
        )
