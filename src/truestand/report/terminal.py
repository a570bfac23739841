"""The result as a table for the terminal."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from truestand.core.calibration import Calibration
from truestand.core.units import um
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
