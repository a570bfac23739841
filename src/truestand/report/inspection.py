"""The report of an inspection: one HTML file that one may hand to a customer."""

from collections.abc import Mapping
from html import escape
from typing import Any

from truestand.core.calibration import Calibration
from truestand.core.inspection import Inspection, Verdict
from truestand.core.message import RECIPE_CHANGED
from truestand.files.recipes.recipes import Company
from truestand.gear.inspect import GearEvidence
from truestand.parts.cad import CadEvidence
from truestand.parts.turned import TurnedEvidence
from truestand.report import inspection_tables as tables
from truestand.report import part_figures
from truestand.report.causes import assumed, most_of_u
from truestand.report.gear_page import gear_facts, gear_parts
from truestand.report.notation import VERDICTS, limit_text, line_name, number, prose
from truestand.report.page import K_NOTE, framed, head, page, stamp
from truestand.report.true_values import Key, true_values
from truestand.uncertainty.assumed import assumptions_of
from truestand.uncertainty.causes import causes_of

TITLES = {"gear": "Gear inspection", "turned": "Inspection of a turned part", "cad": "Comparison with the CAD model"}
MEANINGS: dict[Verdict, str] = {
    "conforms": "every limit is kept, beyond the uncertainty",
    "does_not_conform": "at least one limit is exceeded, beyond the uncertainty",
    "undecided": "the uncertainty, or what was not seen, leaves it open",
}
GLOSSARY = (
    ("U", "expanded uncertainty, k = 2: the value lies within ± U with about 95 % confidence"),
    ("T", "width of the zone between the limits"),
    ("undecided", "within U's guard band of a limit (ISO 14253-1): neither conformance nor its opposite is shown"),
    (
        "not capable",
        "U is so large that no value at all could be shown to conform: the stand is not fit for this limit",
    ),
    ("not measurable", "not enough was seen; there is no number rather than a guessed one"),
    ("seen", "share of what the characteristic needs that was seen; partial: the rest may be worse"),
)
GEAR_GLOSSARY = (
    ("left flank", "the flank of a tooth at the larger polar angle; teeth count counter-clockwise from above"),
    ("class", "the best accuracy class of the standard that the value alone keeps, without U"),
    ("roll length", "where on the involute: the length of the tangent from the base circle"),
)


def inspection_report(
    inspection: Inspection,
    calibration: Calibration | None = None,
    truth: Mapping[str, Any] | None = None,
    company: Company | None = None,
) -> str:
    """The HTML text. ``calibration``: through which it was scanned; ``truth``: of a simulation, its key ``part``."""
    values = true_values(inspection, truth) or None
    results = {"gear": gear_parts, "turned": _turned, "cad": _cad}[inspection.kind]
    parts = [
        _head(inspection, calibration, company), *results(inspection, values), tables.seams(inspection),
        *_inputs(inspection, calibration), tables.settings(inspection), _glossary(inspection),
    ]  # fmt: skip
    note = "Lengths in the frame of the shaft; deviations positive where there is material in excess."
    return page(f"Inspection of {inspection.name}: {VERDICTS[inspection.verdict][1]}", parts, note)


def _head(inspection: Inspection, calibration: Calibration | None, company: Company | None) -> str:
    return (
        head(TITLES[inspection.kind], inspection.name, _facts(inspection, calibration), company)
        + _stamp(inspection)
        + f"{tables.unmeasured(inspection)}{tables.decisive(inspection)}{K_NOTE}{_remarks(inspection)}"
    )


def _stamp(inspection: Inspection) -> str:
    """The verdict; *conforms* is amber where recipes had changed since the calibration, as on the operator page."""
    verdict = inspection.verdict
    mark, word = VERDICTS[verdict]
    meant = "nothing may be decided on this calibration" if inspection.reasons else MEANINGS[verdict]
    if verdict not in {c.verdict for c in inspection.characteristics} and any(d.verdict for d in inspection.defects):
        meant = "a tooth is broken" if verdict == "does_not_conform" else "a tooth may be broken"
    if verdict == "conforms" and any(remark.code == RECIPE_CHANGED for remark in inspection.remarks):
        open_mark, meant = VERDICTS["undecided"][0], "recipes had changed since the calibration: see the remarks"
        return stamp("undecided", open_mark, f"{word.capitalize()}, in doubt", meant)
    return stamp(verdict, mark, word.capitalize(), meant, inspection.reasons)


def _facts(inspection: Inspection, calibration: Calibration | None) -> list[str]:
    facts = gear_facts(inspection.evidence) if isinstance(inspection.evidence, GearEvidence) else []
    if "datum" in inspection.settings:
        facts.append(f"datum: {inspection.settings['datum']}")
    if calibration is not None:
        views = sorted({view for c in inspection.characteristics for view in c.views})
        sensors = f"sensors {', '.join(views)}" if views else f"sensor {calibration.stand.sensor.name}"
        facts += [sensors, f"calibration {calibration.status}"]
        facts += [f"calibrated {calibration.created}"] if calibration.created else []
        if calibration.scan is not None and calibration.scan.sha256:
            facts.append(f"calibration scan {calibration.scan.sha256[:12]}")
    facts += [f"inspected {inspection.created}"] if inspection.created else []
    return facts + ([inspection.software] if inspection.software else [])


def _inputs(inspection: Inspection, calibration: Calibration | None) -> list[str]:
    """What makes U, the budgets in full, and what was assumed."""
    if calibration is None:
        return [_budget(inspection)]
    causes = causes_of(calibration, {line_name(c): c.budget for c in tables.main_lines(inspection)})
    budgets = (c.budget for c in inspection.characteristics)
    return [most_of_u(causes), _budget(inspection), assumed(assumptions_of(calibration, budgets))]


def _remarks(inspection: Inspection) -> str:
    items = "".join(f"<li>{prose(r)}</li>" for r in inspection.remarks)
    return f'<details class="remarks" open><summary>Remarks</summary><ul>{items}</ul></details>' if items else ""


def _lines(inspection: Inspection, values: dict[Key, float] | None) -> str:
    """One row a characteristic, by section."""
    body, section = "", None
    for c in tables.whole_part_lines(inspection):
        if c.section != section:
            section = c.section
            body += f'<tr class="group"><th colspan="11">{escape(section or "")}</th></tr>'
        cells = tables.result_cells(c, values, grade=False)
        body += f"<tr>{tables.name_cell(c)}{tables.cell(limit_text(c))}{cells}</tr>"
    columns = tables.result_headings(values is not None, grade=False)
    return tables.table(f'<tr><th></th><th class="n">limit</th>{columns}</tr>', body, "results")


def _turned(inspection: Inspection, values: dict[Key, float] | None) -> list[str]:
    parts = ["<h2>Sections</h2>", _lines(inspection, values)]
    evidence = inspection.evidence
    if not isinstance(evidence, TurnedEvidence) or not evidence.sections:
        return parts
    return [
        *parts,
        "<h2>Roundness</h2>",
        framed(
            part_figures.roundness(inspection, evidence.sections),
            "Each height's circle about its own least-squares centre, filtered and magnified; the circle at the middle "
            "height is black, all others blue. Dashed: no deviation.",
        ),
        "<h2>Deviation maps</h2>",
        framed(
            part_figures.section_maps(evidence.sections),
            "Distance from the datum axis less the drawing's radius, unrolled. One colour scale; grey: not seen. An "
            "offset of the section's axis is a wave once around.",
        ),
    ]


def _cad(inspection: Inspection, values: dict[Key, float] | None) -> list[str]:
    parts = ["<h2>Deviations from the model</h2>", _lines(inspection, values)]
    evidence = inspection.evidence
    if not isinstance(evidence, CadEvidence):
        return parts
    visible = number(100 * evidence.visible, 0)
    return [
        *parts,
        framed(
            part_figures.cad_map(inspection, evidence),
            f"Normal deviation from the model, unrolled about the datum axis; red: material in excess, grey: not seen "
            f"({visible} % of the model's surface is visible to the sensor). Lines on the scale: limits.",
        ),
        framed(
            part_figures.cad_histogram(inspection, evidence),
            "How often which deviation occurs, over patches of the surface.",
        ),
    ]


def _budget(inspection: Inspection) -> str:
    """Of the main lines."""
    largest = tables.main_lines(inspection)
    if not largest:
        return ""
    return (
        "<h2>Uncertainty</h2><p>Where each <i>U</i> (k = 2) comes from, for the line of each kind with the largest. "
        f"Contributions below {100 * tables.LEAST_SHARE:g} % are left out here and stand in the record.</p>"
        + tables.budgets(largest)
    )


def _glossary(inspection: Inspection) -> str:
    terms = (*GEAR_GLOSSARY, *GLOSSARY) if inspection.kind == "gear" else GLOSSARY
    return "<h2>Words</h2><dl>" + "".join(f"<dt>{term}</dt><dd>{meaning}</dd>" for term, meaning in terms) + "</dl>"
