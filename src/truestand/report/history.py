"""The history of a stand as one HTML file: control charts, inspections by part, Gage R&R."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from typing import TYPE_CHECKING

from truestand.report.drawing import EXACT, FAILS, GREY, INK, PALE, PAPER, figure, single, styled
from truestand.report.notation import number, places
from truestand.report.page import framed, page
from truestand.statistics.control import MR_FACTOR, ControlChart
from truestand.statistics.gage import GageStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class QuantityHistory:
    """One quantity of one sensor over time."""

    title: str
    unit: str
    times: tuple[str, ...]
    numbers: tuple[int, ...]
    """Of the store's entries."""
    chart: ControlChart
    clamping: bool = False
    """Whether it changes whenever the shaft is clamped again: it says nothing about the stand then."""


@dataclass(frozen=True, slots=True)
class InspectionRow:
    """One inspection, as last corrected."""

    number: int
    time: str
    part: str
    serial: str
    operator: str
    verdict: str
    corrected: bool
    doubts: tuple[str, ...] = ()
    """What became of its calibration, where that speaks against it."""

    @property
    def words(self) -> str:
        """The verdict with what speaks against it."""
        corrected = " (corrected)" if self.corrected else ""
        doubts = f", in doubt: {'; '.join(self.doubts)}" if self.doubts else ""
        return f"{self.verdict.replace('_', ' ')}{corrected}{doubts}"


def history_report(
    histories: Sequence[QuantityHistory], inspected: Sequence[InspectionRow], head: str, company: str | None = None
) -> str:
    """The HTML text; ``head`` names the store's last entry and its hash."""
    marked = [c for c in histories if not c.clamping and not c.chart.points[-1].ok]
    verdict = "Something to look at" if marked else "Steady at the last calibration" if histories else "No calibrations"
    over = "" if company is None else f'<p class="over">{escape(company)}</p>'
    parts = [
        f'<header>{over}<h1>History of the stand</h1><div class="verdict {"untrusted" if marked else "valid"}">'
        f'{verdict}</div><p class="facts">{escape(head)}</p></header>',
        _reasons(marked),
        "<h2>Calibrations</h2><p>Each reading with its U (k = 2, pale bar), the mean, and the limits at the mean "
        f"∓ {MR_FACTOR} mean moving ranges (dashed). A diamond marks a reading beyond the limits, the eighth in a row "
        "on one side of the mean, or a change larger than both readings' U together.</p>",
        *(_quantity(c) for c in histories),
        _inspections(inspected),
    ]
    return page("History of the stand", parts, "Limits describe what the stand did; they are no tolerances.")


def study_report(studies: Mapping[str, GageStudy], source: str) -> str:
    """The HTML text of Gage R&R studies, by characteristic."""
    head = f'<header><h1>Gage R&amp;R</h1><p class="facts">{escape(source)}</p></header>'
    return page("Gage R&R", [head, *(_study(*item) for item in studies.items())], "AIAG MSA 4th ed., ANOVA, crossed.")


def _reasons(marked: Sequence[QuantityHistory]) -> str:
    lines = "".join(f"<li>{escape(c.title)}: {', '.join(c.chart.points[-1].flags)}</li>" for c in marked)
    return f'<ul class="reasons">{lines}</ul>' if lines else ""


def _quantity(c: QuantityHistory) -> str:
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
    svg = _control_chart(c.chart, c.times, c.unit)
    return f"<h3>{escape(c.title)}</h3>{framed(svg, escape(limits))}{table}"


def _inspections(inspected: Sequence[InspectionRow]) -> str:
    if not inspected:
        return ""
    rows = "".join(
        f"<tr><td>{escape(i.part)}</td><td>{escape(i.serial)}</td><td>{i.number}</td><td>{escape(i.time)}</td>"
        f'<td>{escape(i.operator)}</td><td class="{escape(_verdict_class(i))}">{escape(i.words)}</td></tr>'
        for i in inspected
    )
    return (
        "<h2>Inspections</h2><table><tr><th>part</th><th>serial number</th><th>entry</th><th>time</th><th>operator</th>"
        f"<th>verdict</th></tr>{rows}</table>"
    )


def _verdict_class(i: InspectionRow) -> str:
    if i.doubts:
        return "bad" if i.verdict == "does_not_conform" else "open"
    return f"v {i.verdict}"


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
        f"</table>{framed(_variation_bars(s), 'Shares of standard deviations; they do not add up to 100.')}"
    )


@styled
def _control_chart(chart: ControlChart, times: Sequence[str], label: str) -> "Figure":
    """The readings with U, their mean and limits, and below them the moving range."""
    fig = figure(9.4, 3.4)
    upper, lower = fig.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    x = list(range(len(chart.points)))
    values = [p.value for p in chart.points]
    for k, p in enumerate(chart.points):
        if p.U is not None:
            upper.plot([k, k], [p.value - p.U, p.value + p.U], color=PALE, lw=3.0, zorder=1)
    upper.plot(x, values, "-o", ms=4.0, lw=1.0, color=EXACT, zorder=3)
    marked = [k for k, p in enumerate(chart.points) if not p.ok]
    upper.plot(marked, [values[k] for k in marked], "D", ms=7.0, mfc="none", mec=FAILS, mew=1.6, zorder=4)
    if chart.mean is not None:
        upper.axhline(chart.mean, color=INK, lw=0.8, zorder=2)
    for limit in (chart.lower, chart.upper):
        if limit is not None:
            upper.axhline(limit, color=PAPER, lw=1.0, ls=(0, (5, 3)), zorder=2)
    upper.set_ylabel(label)
    upper.ticklabel_format(axis="y", useOffset=False)
    lower.plot(x[1:], [abs(p.change or 0.0) for p in chart.points[1:]], "-o", ms=3.0, lw=0.8, color=GREY)
    lower.set(ylabel="moving\nrange", ylim=(0.0, None))
    every = max(1, -(-len(x) // 12))
    lower.set_xticks(x[::every], [_day(t) for t in times[::every]], rotation=30, ha="right")
    return fig


@styled
def _variation_bars(study: GageStudy) -> "Figure":
    """What each source contributes, per cent of the total variation."""
    fig, axes = single(6.0, 1.9)
    names = ("repeatability EV", "operators AV", "interaction", "Gage R&R", "parts PV")
    shares = [study.share(v) or 0.0 for v in (study.EV, study.AV, study.INT, study.GRR, study.PV)]
    axes.barh(names[::-1], shares[::-1], color=[EXACT, PAPER, GREY, GREY, GREY])
    axes.set(xlabel="% of total variation", xlim=(0.0, 105.0))
    for name, share in zip(names, shares, strict=True):
        axes.annotate(f"{share:.1f}", (share, name), xytext=(3, 0), textcoords="offset points", va="center")
    return fig


def _day(time: str) -> str:
    """The day of an ISO time, or the text itself."""
    try:
        return datetime.fromisoformat(time).strftime("%Y-%m-%d")
    except ValueError:
        return time
