"""The report of a calibration: one HTML file that explains itself."""

from collections.abc import Mapping
from html import escape
from typing import Any

from truestand.calibration.evidence import Evidence
from truestand.core.calibration import Calibration
from truestand.core.units import um
from truestand.files.recipes.recipes import Company
from truestand.report import calibration_figures as figures
from truestand.report import calibration_tables as tables
from truestand.report.causes import assumed, most_of_u
from truestand.report.notation import number
from truestand.report.page import K_NOTE, framed, head, not_measured, page, stamp
from truestand.report.quantities import Quantity, main_budgets, quantities
from truestand.uncertainty.assumed import assumptions_of
from truestand.uncertainty.causes import causes_of

STATUS = {
    "valid": ("\N{CHECK MARK}", "Valid", "it may carry a verdict"),
    "untrusted": ("!", "Untrusted", "nothing may be decided on it"),
}
NO_U_NOTE = '<p class="k">The published method states no uncertainty.</p>'
GLOSSARY = (
    ("eccentricity", "offset of the shaft axis from the rotation axis; a round shaft then shows twice as much run-out"),
    ("form", "deviation of a surface from a circle about its own axis, by undulations per revolution (UPR)"),
    ("laser plane", "the plane of the laser line; ideally it contains the rotation axis"),
    ("static profile", "what the sensor shows at every table angle alike: it does not turn, so it is not the shaft"),
    ("U", "expanded uncertainty, k = 2: the value lies within ± U with about 95 % confidence"),
)


def calibration_report(
    calibration: Calibration,
    evidence: Evidence,
    paper: Calibration | None = None,
    truth: Mapping[str, Any] | None = None,
    company: Company | None = None,
) -> str:
    """The HTML text. ``paper``: the published method's calibration of the same scan; ``truth``: of a simulation."""
    rows = quantities(calibration, paper, truth)
    exact = calibration.method == "stand"
    parts = [
        _head(calibration, company),
        _not_identifiable(calibration, rows),
        tables.tiles(rows, calibration),
        K_NOTE if exact else NO_U_NOTE,
        _sensors(calibration),
        "<h2>Published method and exact model</h2>"
        "<p>The same scan through both. The published method (Klarák et al., Sensors 2022, 22, 5306) knows no tilt and "
        "no laser plane; a dash says that it has no answer. It states no uncertainty.</p>",
        tables.comparison(rows, truth is not None, exact),
        _scan(evidence),
        _signal(evidence, paper),
        _maps(evidence),
        _residuals(calibration, evidence) if exact else "",
        _form(calibration),
        most_of_u(causes_of(calibration, main_budgets(calibration))),
        _budget(calibration, rows),
        assumed(assumptions_of(calibration, ())),
        "<h2>Checks</h2><p>Questions that this scan answers about itself.</p>" + tables.checks(calibration)
        if calibration.checks
        else "",
        _closing(calibration),
    ]
    return page(
        f"Calibration of {_name(calibration)}", parts, "Lengths in the frame of the shaft; signs as in the record."
    )


def _name(c: Calibration) -> str:
    return c.artefact.name if c.artefact is not None else "the stand"


def _head(c: Calibration, company: Company | None) -> str:
    facts = [f"artefact {_name(c)}", f"sensor {c.stand.sensor.name}", f"method {c.method}"]
    if c.artefact is not None and c.artefact.certificate is not None and c.artefact.certificate.id:
        facts.append(f"certificate {c.artefact.certificate.id}")
    if c.scan is not None:
        facts += [
            f"{number(c.scan.profiles, 0)} profiles × {c.scan.points} points",
            f"{c.scan.revolutions:.2f} turns",
            f"{100 * c.scan.seen:.1f} % seen",
        ]
        facts += [f"scan {c.scan.sha256[:12]}"] if c.scan.sha256 else []
    facts += [f"calibrated {c.created}"] if c.created else []
    facts += [f"valid until {c.valid_until}"] if c.valid_until else []
    mark, word, meaning = STATUS[c.status]
    return head("Calibration report", "Calibration of the stand", facts, company) + stamp(
        c.status, mark, word, meaning, c.reasons
    )


def _sensors(c: Calibration) -> str:
    if not c.views:
        return ""
    return (
        "<h2>Sensors</h2><p>Where each stands about the axis and how high, in the frame of the first. The numbers "
        f"above and the figures below are those of sensor {escape(c.name)}.</p>" + tables.sensors(c.views)
    )


def _scan(evidence: Evidence) -> str:
    left = framed(
        figures.raw_scan(evidence),
        "The scan as it came: each column is one laser line. The waves are the eccentricity, the steps the shaft's.",
    )
    right = framed(
        figures.projection(evidence),
        "All profiles on top of each other, coloured by the surface that each reading was taken for. The line through "
        "the base gives the angle φ.",
    )
    return f'<h2>What the sensor saw</h2><div class="pair">{left}{right}</div>'


def _signal(evidence: Evidence, paper: Calibration | None) -> str:
    text = "<h2>Eccentricity: the once-per-turn wave</h2>"
    text += framed(
        figures.radial_signal(evidence),
        "The base's radial position as the shaft turns. The nearest Fourier bin has the wrong frequency unless the "
        "scan is a whole number of turns, so its wave runs out of step.",
    )
    return text + framed(
        figures.spectrum(evidence, paper),
        "Leakage made visible. A scan of this length has only the marked bins; the true line at 1 per turn falls "
        "between them, so the nearest bin reads too little amplitude and a shifted phase. Least squares at the known "
        "frequency does not leak.",
    )


def _maps(evidence: Evidence) -> str:
    text = "<h2>Before and after</h2>"
    for m in evidence.maps:
        text += f"<h3>{escape(m.surface)}</h3>" + framed(
            figures.flat_maps(m),
            "Deviation from the nominal radius over table turns and height. The top map has a wider colour scale; the "
            "others share one.",
        )
    for r in evidence.rolled:
        text += framed(
            figures.rolled_up(r),
            f"{escape(r.surface)} rolled up at height {number(r.height, 1)} mm; deviations magnified as stated, "
            "dashed: nominal circle. All turns lie on top of each other only where angle and radius are both right.",
        )
    return text


def _residuals(c: Calibration, evidence: Evidence) -> str:
    text = "<h2>What is left</h2>"
    if c.residuals is not None:
        text += (
            f"<p>After the fitted form: {number(um(c.residuals.rms), 2)} µm rms, 90 % within "
            f"± {number(um(c.residuals.p90), 2)} µm, {number(c.residuals.points, 0)} readings, "
            f"{number(c.residuals.rejected, 0)} not trusted.</p>"
        )
    for m in evidence.maps:
        text += framed(figures.residual_map(m), f"{escape(m.surface)}: residual after form, cell means.")
    if c.static_profiles:
        text += framed(
            figures.static_shapes(c.static_profiles),
            "The static profile: what every profile shows alike. A range error of the sensor looks like this, and so "
            "do sag, taper and a wrong step. It is shown; it is never used as evidence for the laser plane.",
        )
    return text


def _form(c: Calibration) -> str:
    if not c.harmonics:
        return ""
    bars = framed(
        figures.form_bars(c),
        "Form of the artefact's surfaces and waves of the table's bearing, fitted together with the geometry. One scan "
        "gives single harmonics no U of their own; several clampings do.",
    )
    apart = "" if c.positions is None else "<h2>What the clampings tell apart</h2>" + tables.positions(c.positions)
    return "<h2>Form of the artefact, and bearing</h2>" + bars + tables.harmonics(c) + apart


def _budget(c: Calibration, rows: list[Quantity]) -> str:
    if not c.uncertainty:
        return ""
    return (
        "<h2>Uncertainty</h2><p>Where each number's <i>U</i> (k = 2) comes from, in its own unit; an input's <i>u</i> "
        "is in mm, rad, K or relative. Contributions below a hundredth are left out here and stand in the record.</p>"
        + tables.budget(c, rows)
    )


def _not_identifiable(c: Calibration, rows: list[Quantity]) -> str:
    """What this scan could not tell, before any number."""
    if not c.not_identifiable:
        return '<p class="nothing">Not identifiable: nothing. Every quantity of the stand was seen.</p>'
    names = {q.key: q.name for q in rows} | {"height": "Height zero"}
    items = [f"<b>{names.get(n, escape(n))}</b> <code>{escape(n)}</code>" for n in c.not_identifiable]
    return not_measured("Not identifiable from this scan", [", ".join(items), *_why_not_identifiable(c)])


def _closing(c: Calibration) -> str:
    words = "".join(f"<dt>{w}</dt><dd>{m}</dd>" for w, m in GLOSSARY)
    return (
        f"<h2>Repeat it</h2><p><code>truestand calibrate SCAN --stand stand.toml --artefact shaft.toml "
        f"--method {c.method} -o calibration.json --report report.html</code></p><h2>Words</h2><dl>{words}</dl>"
    )


def _why_not_identifiable(c: Calibration) -> list[str]:
    reasons = []
    if "height" in c.not_identifiable:
        reasons.append(
            "The shoulder face is hidden from this side: height zero rests on the edge of the larger step (harmless "
            "for pitch and run-out)."
        )
    if c.method == "stand" and {"eccentricity_direction_deg", "tilt_direction_deg"} & set(c.not_identifiable):
        reasons.append("A shaft that runs nearly true has no direction to run out to.")
    if {"laser_plane_offset_mm", "laser_plane_tilt_deg"} & set(c.not_identifiable):
        reasons.append(
            "The method does not ask for the laser plane or the shaft's tilt."
            if c.method == "paper"
            else "The laser plane shows only where an eccentric shaft with two steps turns: a larger eccentricity or a "
            "second step in view would help. Its doubt is carried on."
        )
    return reasons
