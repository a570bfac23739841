"""The tables of a calibration report, as HTML. Every text from outside is escaped."""

from collections.abc import Sequence
from html import escape

from truestand.core.calibration import Calibration, Positions
from truestand.core.units import degrees, um
from truestand.report.inspection_tables import table
from truestand.report.notation import number, places, prose, two_digits, with_u
from truestand.report.quantities import Quantity
from truestand.report.several_sensors import COLUMNS, view_rows

MOST_HARMONICS = 12
LEAST_AMPLITUDE_MM = 5e-5
"""Smaller harmonics stand in the record."""
NOTHING = 1e-4
"""Of a check's value: far below any limit."""


def tiles(rows: list[Quantity], calibration: Calibration) -> str:
    """The key numbers, each with its U."""
    missing = "not part of this method" if calibration.method == "paper" else "not identifiable"
    cells = []
    for q in rows:
        value = q.value if calibration.method == "stand" else q.paper
        shown = f'<div class="none">{missing}</div>'
        if value is not None:
            shown = f'<div class="value">{with_u(value, q.U)} <span class="unit">{q.unit}</span></div>'
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
    titles = ["paper's method"] + ["exact model ± U (k = 2)"] * with_exact
    titles += ["truth", "paper − truth"] * with_truth + ["exact − truth"] * (with_truth and with_exact)
    body = ""
    for q in rows:
        decimals = max(places(q.U), 3)
        cells = [number(q.paper, decimals)] + [with_u(q.value, q.U)] * with_exact
        cells += [number(q.truth, decimals), number(q.minus_truth(q.paper), decimals)] * with_truth
        cells += [number(q.minus_truth(q.value), decimals)] * (with_truth and with_exact)
        row = "".join(f'<td class="n">{text}</td>' for text in cells)
        body += f"<tr><td>{q.name} ({q.unit})<small>{q.meaning}</small></td>{row}</tr>"
    head = "<th>quantity</th>" + "".join(f'<th class="n">{title}</th>' for title in titles)
    return table(f"<tr>{head}</tr>", body, "quantities")


def harmonics(calibration: Calibration) -> str:
    """Form harmonics, the largest first."""
    shown = [h for h in calibration.harmonics if h.amplitude >= LEAST_AMPLITUDE_MM]
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
    head = (
        '<th>input</th><th class="n">its u</th><th>distribution</th><th class="n">sensitivity</th>'
        '<th class="n"><i>U</i></th><th></th>'
    )
    for key, uncertainty in calibration.uncertainty.items():
        lines = "".join(
            f'<tr><td>{escape(c.name)}</td><td class="n">{two_digits(c.value)}</td><td>{escape(c.distribution)}</td>'
            f'<td class="n">{two_digits(c.sensitivity)}</td><td class="n">{two_digits(c.U)}</td>'
            f'<td><span class="bar" style="width:{8 * c.U / max(uncertainty.U, 1e-12):.2f}rem"></span></td></tr>'
            for c in uncertainty.contributions
            if c.U >= 0.01 * uncertainty.U
        )
        name = names.get(key, "Radial position of the sensor (mm)")
        trials = "" if uncertainty.monte_carlo is None else f"Monte Carlo {two_digits(uncertainty.monte_carlo)}"
        parts.append(
            f'<tbody class="group"><tr><th colspan="4">{name}</th><th class="n">{two_digits(uncertainty.U)}</th>'
            f"<th>{trials}</th></tr>{lines}</tbody>"
        )
    return f'<div class="wide"><table class="long"><thead><tr>{head}</tr></thead>{"".join(parts)}</table></div>'


def positions(found: Positions) -> str:
    """What several clampings told apart: the steps' axes, the bearing's harmonics and the shaft's own."""
    angles = ", ".join(f"{degrees(a):g}" for a in found.clamped)
    body = "".join(
        f"<tr><td>axis of {escape(a.surface)} against the base, at {a.height:.1f} mm</td>"
        f'<td class="n">{um(a.x):.2f}, {um(a.y):.2f}</td><td class="n">{um(a.U):.2f}</td></tr>'
        for a in found.axes
    )
    for s in (*found.bearing, *found.form):
        if s.harmonic.amplitude >= LEAST_AMPLITUDE_MM:
            turn = f"{um(s.harmonic.amplitude):.2f} at {degrees(s.harmonic.phase):.1f}°"
            body += (
                f'<tr><td>{escape(s.harmonic.surface)}, {s.harmonic.upr} UPR</td><td class="n">{turn}</td>'
                f'<td class="n">{um(s.U):.2f}</td></tr>'
            )
    listed = ", ".join(map(str, found.inseparable))
    note = f"<p>Not told apart by these angles: {listed} UPR; they stand as the shaft's.</p>" if listed else ""
    head = '<th>what</th><th class="n">µm</th><th class="n">U (k = 2), µm</th>'
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<p>Shaft clamped at {angles}° for the scans, in this order.</p>{table}{note}"


def sensors(views: Sequence[Calibration]) -> str:
    """Where each of several sensors stands in the frame of the first, U with k = 2."""
    head = "".join(f'<th class="n">{title}</th>' for title in COLUMNS)
    body = "".join(
        f"<tr><td>{escape(name)}</td>" + "".join(f'<td class="n">{text}</td>' for text in texts) + "</tr>"
        for name, *texts in view_rows(views)
    )
    return table(f"<tr><th>sensor</th>{head}</tr>", body)


def checks(calibration: Calibration) -> str:
    """What the scan says about itself."""
    body = ""
    for c in calibration.checks:
        mark = '<span class="ok">✓ ok</span>' if c.ok else '<span class="bad">▲ look</span>'
        advice = "" if c.ok else f"<small>{prose(c.advice)}</small>"
        body += (
            f'<tr><td>{mark}</td><td>{prose(c.name)}{advice}</td><td class="n">{_found(c.value)}</td>'
            f'<td class="n">{c.limit:.3g}</td></tr>'
        )
    head = '<th></th><th>check</th><th class="n">found</th><th class="n">limit</th>'
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _found(value: float) -> str:
    """Three digits, as a power of ten only where it is large; what rounds to nothing is 0."""
    return f"{0.0 if abs(value) < NOTHING else value:.3g}".replace("-", "\N{MINUS SIGN}")
