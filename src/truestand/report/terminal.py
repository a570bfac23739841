"""The result as a table for the terminal."""

from collections.abc import Mapping
from math import hypot
from typing import TYPE_CHECKING, Any

from truestand.core.calibration import Calibration, Positions
from truestand.core.units import degrees, um
from truestand.report.numbers import number, places, with_u
from truestand.report.quantities import quantities

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
