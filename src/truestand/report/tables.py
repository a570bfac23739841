"""The tables of a calibration report, as HTML. Every text from outside is escaped."""

from html import escape

from truestand.core.calibration import Calibration
from truestand.core.units import degrees, um
from truestand.report.numbers import number, places, with_u
from truestand.report.quantities import Quantity

MOST_HARMONICS = 12
LEAST_AMPLITUDE = 5e-5
"""mm: smaller ones stand in the record."""


def tiles(rows: list[Quantity], calibration: Calibration) -> str:
    """The key numbers, each with its U."""
    cells = []
    for q in rows:
        value = q.value if calibration.method == "stand" else q.paper
        if value is None:
            shown = '<div class="none">not identifiable</div>'
            if calibration.method == "paper":
                shown = '<div class="none">not part of this method</div>'
        else:
            text = with_u(value, q.U) if q.U is not None else number(value)
            shown = f'<div class="value">{text} <span class="unit">{q.unit}</span></div>'
        cells.append(f'<div class="tile"><div class="name">{q.name}</div>{shown}</div>')
    if calibration.residuals is not None:
        rms = number(um(calibration.residuals.rms), 2)
        cells.append(
            f'<div class="tile"><div class="name">Residual, rms</div><div class="value">{rms} '
            '<span class="unit">µm</span></div></div>'
        )
    return f'<div class="tiles">{"".join(cells)}</div>'


def comparison(rows: list[Quantity], with_truth: bool, with_exact: bool) -> str:
    """Paper's method, exact model, truth."""
    head = '<th>quantity</th><th class="n">paper\'s method</th>'
    head += '<th class="n">exact model ± U (k = 2)</th>' if with_exact else ""
    head += '<th class="n">truth</th><th class="n">paper − truth</th>' if with_truth else ""
    head += '<th class="n">exact − truth</th>' if with_truth and with_exact else ""
    body = ""
    for q in rows:
        decimals = max(places(q.U), 3)
        body += (
            f'<tr><td>{q.name} ({q.unit})<small>{q.meaning}</small></td><td class="n">{number(q.paper, decimals)}</td>'
        )
        body += f'<td class="n">{with_u(q.value, q.U)}</td>' if with_exact else ""
        if with_truth:
            body += (
                f'<td class="n">{number(q.truth, decimals)}</td><td class="n">{number(q.paper_error, decimals)}</td>'
            )
            body += f'<td class="n">{number(q.error, decimals)}</td>' if with_exact else ""
        body += "</tr>"
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def harmonics(calibration: Calibration) -> str:
    """Form harmonics, the largest first."""
    shown = [h for h in calibration.harmonics if h.amplitude >= LEAST_AMPLITUDE]
    largest = sorted(shown, key=lambda h: -h.amplitude)[:MOST_HARMONICS]
    top = max((h.amplitude for h in largest), default=1.0)
    body = "".join(
        f'<tr><td>{escape(h.surface)}</td><td class="n">{h.upr}</td><td class="n">{number(um(h.amplitude), 2)}</td>'
        f'<td class="n">{number(degrees(h.phase), 1)}</td>'
        f'<td><span class="bar" style="width:{12 * h.amplitude / max(top, 1e-12):.2f}rem"></span></td></tr>'
        for h in largest
    )
    head = (
        '<th>surface</th><th class="n">UPR</th><th class="n">amplitude (µm)</th><th class="n">phase (°)</th><th></th>'
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def budget(calibration: Calibration, rows: list[Quantity]) -> str:
    """The uncertainty budget: every contribution of every quantity, k = 2."""
    parts = []
    names = {q.key: f"{q.name} ({q.unit})" for q in rows}
    for key, uncertainty in calibration.uncertainty.items():
        shown = [c for c in uncertainty.contributions if c.U >= 0.01 * uncertainty.U]
        lines = "".join(
            f'<tr><td>{escape(c.name)}</td><td class="n">{c.U:.2g}</td>'
            f'<td><span class="bar" style="width:{12 * c.U / max(uncertainty.U, 1e-12):.2f}rem"></span></td></tr>'
            for c in shown
        )
        name = names.get(key, "Radial position of the sensor (mm)")
        parts.append(
            f'<tr><th>{name}</th><th class="n">{uncertainty.U:.2g}</th><th>U, k = {uncertainty.k:g}</th></tr>{lines}'
        )
    return f"<table><tbody>{''.join(parts)}</tbody></table>"


def checks(calibration: Calibration) -> str:
    """What the scan says about itself."""
    body = ""
    for c in calibration.checks:
        mark = '<span class="ok">✓ ok</span>' if c.ok else '<span class="bad">▲ look</span>'
        advice = "" if c.ok else f"<small>{escape(c.advice)}</small>"
        body += (
            f'<tr><td>{mark}</td><td>{escape(c.name)}{advice}</td><td class="n">{c.value:.3g}</td>'
            f'<td class="n">{c.limit:.3g}</td></tr>'
        )
    head = '<th></th><th>check</th><th class="n">found</th><th class="n">limit</th>'
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
