"""The tables of a calibration report, as HTML. Every text from outside is escaped."""

from html import escape

from truestand.core.calibration import Calibration, Positions
from truestand.core.units import degrees, um
from truestand.report.notation import number, places, with_u
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
    return f'<table class="quantities"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


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
    """The uncertainty budget: every input of every quantity with its value, distribution and sensitivity, k = 2."""
    parts = []
    names = {q.key: f"{q.name} ({q.unit})" for q in rows}
    head = '<th>input</th><th class="n">its u</th><th>distribution</th><th class="n">sensitivity</th>'
    for key, uncertainty in calibration.uncertainty.items():
        shown = [c for c in uncertainty.contributions if c.U >= 0.01 * uncertainty.U]
        lines = "".join(
            f'<tr><td>{escape(c.name)}</td><td class="n">{_short(c.value)}</td><td>{escape(c.distribution)}</td>'
            f'<td class="n">{_short(c.sensitivity)}</td><td class="n">{c.U:.2g}</td>'
            f'<td><span class="bar" style="width:{8 * c.U / max(uncertainty.U, 1e-12):.2f}rem"></span></td></tr>'
            for c in shown
        )
        name = names.get(key, "Radial position of the sensor (mm)")
        trials = "" if uncertainty.monte_carlo is None else f", Monte Carlo {uncertainty.monte_carlo:.2g}"
        parts.append(
            f'<tbody class="group"><tr><th colspan="4">{name}</th><th class="n">{uncertainty.U:.2g}</th>'
            f"<th>U, k = {uncertainty.k:g}{trials}</th></tr>{lines}</tbody>"
        )
    head += '<th class="n">U</th><th></th>'
    return f'<table class="long"><thead><tr>{head}</tr></thead>{"".join(parts)}</table>'


def _short(value: float | None) -> str:
    return "" if value is None else f"{value:.2g}"


def positions(found: Positions) -> str:
    """What several clampings told apart: the steps' axes, the bearing's harmonics and the shaft's own."""
    angles = ", ".join(f"{degrees(a):g}" for a in found.clamped)
    body = "".join(
        f"<tr><td>axis of {escape(a.surface)} against the base, at {a.height:.1f} mm</td>"
        f'<td class="n">{um(a.x):.2f}, {um(a.y):.2f}</td><td class="n">{um(a.U):.2f}</td></tr>'
        for a in found.axes
    )
    for s in (*found.bearing, *found.form):
        if s.harmonic.amplitude >= LEAST_AMPLITUDE:
            turn = f"{um(s.harmonic.amplitude):.2f} at {degrees(s.harmonic.phase):.1f}°"
            body += (
                f'<tr><td>{escape(s.harmonic.surface)}, {s.harmonic.upr} UPR</td><td class="n">{turn}</td>'
                f'<td class="n">{um(s.U):.2f}</td></tr>'
            )
    left = ", ".join(map(str, found.inseparable))
    note = f"<p>Not told apart by these angles: {left} UPR; they stand as the shaft's.</p>" if left else ""
    head = '<th>what</th><th class="n">µm</th><th class="n">U (k = 2), µm</th>'
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<p>Shaft clamped at {angles}° for the scans, in this order.</p>{table}{note}"


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
