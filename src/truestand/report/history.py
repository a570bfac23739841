"""The history of a stand as one HTML file: control charts, inspections by part, Gage R&R."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from truestand.report.control_charts import components, individuals
from truestand.report.numbers import number, places
from truestand.report.page import framed, page
from truestand.statistics.control import MR_FACTOR, ControlChart
from truestand.statistics.gage import GageStudy


@dataclass(frozen=True, slots=True)
class Course:
    """One quantity over time."""

    title: str
    unit: str
    times: tuple[str, ...]
    numbers: tuple[int, ...]
    """Of the store's entries."""
    chart: ControlChart
    clamping: bool = False
    """Whether it changes whenever the shaft is clamped again: it says nothing about the stand then."""


@dataclass(frozen=True, slots=True)
class Inspected:
    """One inspection as it stands today."""

    number: int
    time: str
    part: str
    serial: str
    operator: str
    verdict: str
    corrected: bool


def history_report(
    courses: Sequence[Course], inspected: Sequence[Inspected], head: str, company: str | None = None
) -> str:
    """The HTML text; ``head`` names the store's last entry and its hash."""
    marked = [c for c in courses if not c.clamping and not c.chart.points[-1].ok]
    verdict = "Something to look at" if marked else "Steady at the last calibration" if courses else "No calibrations"
    over = "" if company is None else f'<p class="over">{escape(company)}</p>'
    parts = [
        f'<header>{over}<h1>History of the stand</h1><div class="verdict {"untrusted" if marked else "valid"}">'
        f'{verdict}</div><p class="facts">{escape(head)}</p></header>',
        _reasons(marked),
        "<h2>Calibrations</h2><p>Each reading with its U (k = 2, pale bar), the mean, and the limits at the mean "
        f"∓ {MR_FACTOR} mean moving ranges (dashed). A diamond marks a reading beyond the limits, the eighth in a row "
        "on one side of the mean, or a change larger than both readings' U together.</p>",
        *(_course(c) for c in courses),
        _inspections(inspected),
    ]
    return page("History of the stand", parts, "Limits describe what the stand did; they are no tolerances.")


def study_report(studies: Mapping[str, GageStudy], source: str) -> str:
    """The HTML text of Gage R&R studies, by characteristic."""
    head = f'<header><h1>Gage R&amp;R</h1><p class="facts">{escape(source)}</p></header>'
    return page("Gage R&R", [head, *(_study(*item) for item in studies.items())], "AIAG MSA 4th ed., ANOVA, crossed.")


def _reasons(marked: Sequence[Course]) -> str:
    lines = "".join(f"<li>{escape(c.title)}: {', '.join(c.chart.points[-1].flags)}</li>" for c in marked)
    return f'<ul class="reasons">{lines}</ul>' if lines else ""


def _course(c: Course) -> str:
    decimals = places(c.chart.points[-1].U)
    limits = "limits need two readings"
    if c.chart.lower is not None:
        few = f", provisional: {len(c.chart.points)} readings" if c.chart.provisional else ""
        limits = (f"mean {number(c.chart.mean, decimals)}, limits {number(c.chart.lower, decimals)} to "
                  f"{number(c.chart.upper, decimals)} {c.unit}{few}")  # fmt: skip
    rows = "".join(
        f'<tr><td>{n}</td><td>{escape(t)}</td><td class="n">{number(p.value, decimals)}</td>'
        f'<td class="n">{number(p.U, decimals)}</td><td class="n">{number(p.change, decimals)}</td>'
        f'<td class="{"ok" if p.ok else "bad"}">{"ok" if p.ok else ", ".join(p.flags)}</td></tr>'
        for n, t, p in zip(c.numbers, c.times, c.chart.points, strict=True)
    )
    table = (
        "<details><summary>Readings</summary><table><tr><th>entry</th><th>time</th>"
        f'<th class="n">value ({c.unit})</th><th class="n">U</th><th class="n">change</th><th></th></tr>{rows}</table>'
        "</details>"
    )
    limits += "; changes whenever the shaft is clamped again" if c.clamping else ""
    svg = individuals(c.chart, c.times, c.unit)
    return f"<h3>{escape(c.title)}</h3>{framed(svg, escape(limits))}{table}"


def _inspections(inspected: Sequence[Inspected]) -> str:
    if not inspected:
        return ""
    rows = "".join(
        f"<tr><td>{escape(i.part)}</td><td>{escape(i.serial)}</td><td>{i.number}</td><td>{escape(i.time)}</td>"
        f'<td>{escape(i.operator)}</td><td class="v {escape(i.verdict)}">{escape(i.verdict.replace("_", " "))}'
        f"{' (corrected)' if i.corrected else ''}</td></tr>"
        for i in inspected
    )
    return (
        "<h2>Inspections</h2><table><tr><th>part</th><th>serial number</th><th>entry</th><th>time</th><th>operator</th>"
        f"<th>verdict</th></tr>{rows}</table>"
    )


def _study(name: str, s: GageStudy) -> str:
    rows = "".join(
        f'<tr><td>{label}</td><td class="n">{value:.4g}</td><td class="n">{number(s.share(value), 1)}</td>'
        f'<td class="n">{number(s.contribution(value), 1)}</td></tr>'
        for label, value in (
            ("repeatability EV", s.EV), ("between operators AV", s.AV), ("interaction", s.INT), ("Gage R&amp;R", s.GRR),
            ("between parts PV", s.PV), ("total TV", s.TV),
        )
    )  # fmt: skip
    pooled = "not significant, counted as repeatability" if s.pooled else "significant, kept"
    facts = f"{s.operators} operators × {s.parts} parts × {s.trials} trials; interaction {pooled}; ndc {s.ndc or '–'}"
    return (
        f'<h2>{escape(name)}</h2><p class="facts">{facts}</p><table class="narrow"><tr><th>source</th>'
        f'<th class="n">standard deviation</th><th class="n">% of TV</th><th class="n">% of variance</th></tr>{rows}'
        f"</table>{framed(components(s), 'Shares of standard deviations; they do not add up to 100.')}"
    )
