"""The result as a table for the terminal."""

from collections.abc import Mapping
from math import hypot
from typing import TYPE_CHECKING, Any

from truestand.core.calibration import Calibration, Positions
from truestand.core.inspection import Characteristic, Inspection
from truestand.core.units import degrees, um
from truestand.report.numbers import number, places, with_u
from truestand.report.quantities import quantities
from truestand.report.true_values import true_value, true_values

if TYPE_CHECKING:
    from rich.table import Table


def summary_table(
    calibration: Calibration, paper: Calibration | None = None, truth: Mapping[str, Any] | None = None
) -> "Table":
    """Paper's method, exact model with U (k = 2), truth and error where given."""
    from rich.table import Table

    both = paper is not None or calibration.method == "paper"
    table = Table(title=f"Calibration: {calibration.status}", title_justify="left")
    table.add_column("quantity")
    if both:
        table.add_column("paper's method", justify="right")
    if calibration.method == "stand":
        table.add_column("exact model ± U (k = 2)", justify="right")
    if truth is not None:
        table.add_column("truth", justify="right")
        table.add_column("error", justify="right")
    for q in quantities(calibration, paper, truth):
        decimals = max(places(q.U), 3)
        cells = [f"{q.name} ({q.unit})"]
        if both:
            cells.append(number(q.paper, decimals))
        if calibration.method == "stand":
            cells.append(with_u(q.value, q.U))
        if truth is not None:
            error = q.error if calibration.method == "stand" else q.paper_error
            cells += [number(q.truth, decimals), number(error, decimals)]
        table.add_row(*cells)
    cells = ["Residual, 90 % within (µm)"]
    for c in ([paper or calibration] if both else []) + ([calibration] if calibration.method == "stand" else []):
        cells.append("" if c.residuals is None else f"± {number(um(c.residuals.p90), 1)}")
    table.add_row(*cells)
    return table


def positions_table(positions: Positions) -> "Table":
    """What several clampings told apart: the steps' axes and the table's bearing."""
    from rich.table import Table

    angles = ", ".join(f"{degrees(a):g}" for a in positions.clamped)
    table = Table(title=f"Told apart by clampings at {angles} deg", title_justify="left")
    for heading in ("what", "um", "U (k = 2), um"):
        table.add_column(heading, justify="left" if heading == "what" else "right")
    for a in positions.axes:
        size = hypot(a.x, a.y)
        table.add_row(f"axis of {a.surface} off the base's, at {a.height:.1f} mm", f"{um(size):.2f}", f"{um(a.U):.2f}")
    for s in positions.bearing:
        table.add_row(f"table bearing, {s.harmonic.upr} a turn", f"{um(s.harmonic.amplitude):.2f}", f"{um(s.U):.2f}")
    if positions.inseparable:
        table.add_row(f"not told apart: {', '.join(map(str, positions.inseparable))} a turn", "", "")
    return table


def inspection_table(inspection: Inspection, truth: Mapping[str, Any] | None = None) -> "Table":
    """The whole part's characteristics with U, limit, class and verdict; what was not measurable says so.

    Beside them what the published compensation makes of the same scan, and the truth where it is given.
    """
    from rich.table import Table

    told = true_values(inspection, truth)
    table = Table(title=f"{inspection.name}: {inspection.verdict.replace('_', ' ')}", title_justify="left")
    table.add_column("characteristic")
    table.add_column("flank")
    further = [h for h, on in (("paper's method", inspection.published), ("truth", told)) if on]
    for heading in ("value ± U (k = 2)", *further, "limit", "class"):
        table.add_column(heading, justify="right")
    table.add_column("verdict")
    for c in inspection.characteristics:
        if c.tooth is None:
            paper = inspection.published.get(f"{c.name} {c.flank}")
            true = true_value(told, c)
            cells = {"paper's method": "" if paper is None else f"{um(paper):.0f}",
                     "truth": "" if true is None else f"{true:.4f}" if c.size else f"{true:.2f}"}  # fmt: skip
            label, flank, value, limits, grade, verdict = _row(c)
            table.add_row(label, flank, value, *(cells[h] for h in further), limits, grade, verdict)
    for d in inspection.defects:
        where = "" if d.roll_length is None else f"roll length {d.roll_length:.1f} mm, "
        where += "" if d.height is None else f"height {d.height:.1f} mm"
        depth = "" if d.depth is None else f"{um(d.depth):.0f} um deep"
        judged = "" if d.verdict is None else f"{d.verdict.replace('_', ' ')}, "
        table.add_row(
            f"{d.kind}, tooth {d.tooth}", d.flank or "", depth, *("" for _ in further), "", "", judged + where
        )
    return table


def _row(c: Characteristic) -> tuple[str, ...]:
    unit, scale = ("mm", 1.0) if c.size else ("um", 1000.0)
    value = "not measurable"
    if c.value is not None:
        U = None if c.U is None else scale * c.U
        decimals = min(places(U), 2) if not c.size else places(U)
        value = number(scale * c.value, decimals) + ("" if U is None else f" ± {number(U, decimals)}") + f" {unit}"
    verdict = "" if c.verdict is None else c.verdict.replace("_", " ") + ("" if c.capable else " (U too large)")
    label = c.name if c.section is None else f"{c.name}, {c.section}"
    status = "" if c.status != "partial" else " (partial)"
    return label, c.flank or "", value + status, _limits(c, scale), "" if c.grade is None else str(c.grade), verdict


def _limits(c: Characteristic, scale: float) -> str:
    if c.limits is None:
        return ""
    low, high = (None if v is None else scale * v for v in c.limits)
    if low is None or high is None:
        return f"{(high if low is None else low) or 0.0:g}"
    return f"± {high:g}" if low == -high else f"{low:g} .. {high:g}"
