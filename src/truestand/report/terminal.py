"""Results and history as tables for the terminal."""

from collections.abc import Mapping, Sequence
from math import hypot
from typing import Any, Literal

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from truestand.core.calibration import Calibration, Positions
from truestand.core.inspection import Characteristic, Inspection, Seam
from truestand.core.units import degrees, um
from truestand.report.causes import cause_line
from truestand.report.history import InspectionRow, QuantityHistory
from truestand.report.inspection_tables import main_lines
from truestand.report.notation import OF_WHOLE_FLANKS, limit_text, number, places, result_text, unit, with_u
from truestand.report.quantities import main_budgets, quantities
from truestand.report.several_sensors import COLUMNS, view_rows
from truestand.report.true_values import true_value, true_values
from truestand.statistics.gage import GageStudy
from truestand.uncertainty.causes import Cause, causes_of


def summary_table(
    calibration: Calibration, paper: Calibration | None = None, truth: Mapping[str, Any] | None = None
) -> RenderableType:
    """Paper's method, exact model with U (k = 2), truth and error where given."""
    exact, published = calibration.method == "stand", paper is not None or calibration.method == "paper"
    columns = ["paper's method"] if published else []
    columns += ["exact model ± U (k = 2)"] if exact else []
    columns += ["truth", "error"] if truth is not None else []
    table = text_table(f"Calibration: {calibration.status}", ("quantity",), columns)
    for q in quantities(calibration, paper, truth):
        decimals = max(places(q.U), 3)
        row = [f"{q.name} ({q.unit})"]
        row += [number(q.paper, decimals)] if published else []
        row += [with_u(q.value, q.U)] if exact else []
        if truth is not None:
            row += [number(q.truth, decimals), number(q.minus_truth(q.value if exact else q.paper), decimals)]
        table.add_row(*row)
    row = ["Residual, 90 % within (µm)"]
    for c in ([paper or calibration] if published else []) + ([calibration] if exact else []):
        row.append("" if c.residuals is None else f"± {number(um(c.residuals.p90), 1)}")
    table.add_row(*row)
    return _with_cause(table, causes_of(calibration, main_budgets(calibration)))


def positions_table(positions: Positions) -> Table:
    """What several clampings told apart: the steps' axes and the table's bearing."""
    angles = ", ".join(f"{degrees(a):g}" for a in positions.clamped)
    table = text_table(f"Told apart by clampings at {angles} deg", ("what",), ("um", "U (k = 2), um"))
    for a in positions.axes:
        offset = hypot(a.x, a.y)
        table.add_row(
            f"axis of {a.surface} off the base's, at {a.height:.1f} mm", f"{um(offset):.2f}", f"{um(a.U):.2f}"
        )
    for s in positions.bearing:
        table.add_row(f"table bearing, {s.harmonic.upr} a turn", f"{um(s.harmonic.amplitude):.2f}", f"{um(s.U):.2f}")
    if positions.inseparable:
        table.add_row(f"not told apart: {', '.join(map(str, positions.inseparable))} a turn", "", "")
    return table


def views_table(views: Sequence[Calibration]) -> Table:
    """Where each of several sensors stands in the frame of the first, with U (k = 2)."""
    table = text_table("Views", ("view",), COLUMNS)
    for row in view_rows(views):
        table.add_row(*row)
    return table


def inspection_table(
    inspection: Inspection, truth: Mapping[str, Any] | None = None, calibration: Calibration | None = None
) -> RenderableType:
    """The whole part's characteristics with U, limit, class and verdict; what was not measurable says so.

    Beside them what the published compensation makes of the same scan, and the truth where it is given; below, what
    makes most of U, where the ``calibration`` is given.
    """
    values = true_values(inspection, truth)
    further = [h for h, shown in (("paper's method", inspection.published), ("truth", values)) if shown]
    title = f"{inspection.name}: {inspection.verdict.replace('_', ' ')}"
    right = ("value ± U (k = 2)", *further, "limit", "class")
    table = text_table(title, ("characteristic", "flank"), right, ("verdict",))
    for c in inspection.characteristics:
        if c.tooth is None and c.name not in OF_WHOLE_FLANKS:
            paper, true = inspection.published.get(f"{c.name} {c.flank}"), true_value(values, c)
            cells = {"paper's method": "" if paper is None else f"{um(paper):.0f}",
                     "truth": "" if true is None else f"{true:.4f}" if c.size else f"{true:.2f}"}  # fmt: skip
            label, flank, value, limits, grade, verdict = _row(c)
            table.add_row(label, flank, value, *(cells[h] for h in further), limits, grade, verdict)
    for d in inspection.defects:
        place = "" if d.roll_length is None else f"roll length {d.roll_length:.1f} mm, "
        place += "" if d.height is None else f"height {d.height:.1f} mm"
        depth = "" if d.depth is None else f"{um(d.depth):.0f} um deep"
        verdict = "" if d.verdict is None else f"{d.verdict.replace('_', ' ')}, "
        table.add_row(
            f"{d.kind}, tooth {d.tooth}", d.flank or "", depth, *("" for _ in further), "", "", verdict + place
        )
    if calibration is None:
        return table
    budgets = {f"{c.name} {c.flank or c.section or ''}".strip(): c.budget for c in main_lines(inspection)}
    return _with_cause(table, causes_of(calibration, budgets))


def seams_table(seams: Sequence[Seam]) -> Table:
    """What two views of the same surface differ by when all others have told where the views stand."""
    table = text_table("Seams", ("views", "where"), ("difference ± U (k = 2), um",), ("agree",))
    for seam in seams:
        difference = with_u(um(seam.difference), um(seam.U))
        table.add_row(" - ".join(seam.views), seam.place, difference, "yes" if seam.ok else "no")
    return table


def _with_cause(table: Table, causes: Sequence[Cause]) -> RenderableType:
    """The table, and below it a line on what makes most of U."""
    return Group(table, Text(cause_line(causes))) if causes else table


def _row(c: Characteristic) -> tuple[str, ...]:
    value = "not measurable"
    if c.value is not None:
        value = f"{result_text(c)} {unit(c)}"
    verdict = (
        "" if c.verdict is None else c.verdict.replace("_", " ") + ("" if c.capable or c.at_least else " (U too large)")
    )
    label = c.name if c.section is None else f"{c.name}, {c.section}"
    status = "" if c.status != "partial" else " (partial)"
    limits = "" if c.limits is None else limit_text(c)
    return label, c.flank or "", value + status, limits, "" if c.grade is None else str(c.grade), verdict


def series_table(histories: Sequence[QuantityHistory]) -> Table:
    """Each quantity with its last reading, what changed, the limits and whether all is well."""
    right = ("n", "last", "U", "change", "drift", "limits", "unit")
    table = text_table("Calibrations", ("quantity",), right, ("ok",))
    for h in histories:
        last = h.chart.points[-1]
        d = places(last.U)
        state = "by clamping" if h.clamping else ", ".join(last.flags) or "ok"
        table.add_row(
            h.title, str(len(h.chart.points)), number(last.value, d), number(last.U, d), number(last.change, d),
            number(h.chart.drift, d), _control_limits(h, d), h.unit, state,
        )  # fmt: skip
    return table


def readings_table(history: QuantityHistory) -> Table:
    """One quantity, reading by reading."""
    d = places(history.chart.points[-1].U)
    title = f"{history.title} ({history.unit}), limits {_control_limits(history, d)}"
    table = text_table(title, ("time",), ("entry", "value", "U", "change"), ("ok",))
    for time, entry, p in zip(history.times, history.numbers, history.chart.points, strict=True):
        table.add_row(
            time, str(entry), number(p.value, d), number(p.U, d), number(p.change, d), ", ".join(p.flags) or "ok"
        )
    return table


def inspections_table(inspections: Sequence[InspectionRow]) -> Table:
    """Inspections by part."""
    table = text_table("Inspections", ("part", "serial"), ("entry",), ("time", "operator", "verdict"))
    for i in inspections:
        table.add_row(i.part, i.serial, str(i.number), i.time, i.operator, i.words)
    return table


def study_table(studies: Mapping[str, GageStudy], source: str) -> Table:
    """Standard deviations of each source, Gage R&R in per cent of the total variation, categories."""
    first = next(iter(studies.values()))
    title = f"{source}: {first.operators} operators x {first.parts} parts x {first.trials} trials"
    table = text_table(title, ("characteristic",), ("EV", "AV", "interaction", "GRR", "PV", "TV", "% GRR", "ndc"))
    for name, s in studies.items():
        deviations = (f"{v:.4g}" for v in (s.EV, s.AV, s.INT, s.GRR, s.PV, s.TV))
        table.add_row(name, *deviations, number(s.share(s.GRR), 1), "" if s.ndc is None else str(s.ndc))
    return table


def _control_limits(history: QuantityHistory, decimals: int) -> str:
    chart = history.chart
    if chart.lower is None:
        return ""
    few = " (provisional)" if chart.provisional else ""
    return f"{number(chart.lower, decimals)} .. {number(chart.upper, decimals)}{few}"


def text_table(title: str, left: Sequence[str], right: Sequence[str], last: Sequence[str] = ()) -> Table:
    """An empty table: columns of text, of numbers, and of text again."""
    table = Table(title=title, title_justify="left")
    groups: list[tuple[Sequence[str], Literal["left", "right"]]] = [(left, "left"), (right, "right"), (last, "left")]
    for headings, justify in groups:
        for heading in headings:
            table.add_column(heading, justify=justify)
    return table
