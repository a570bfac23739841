"""Control charts and Gage R&R bars as SVG."""

from collections.abc import Sequence
from datetime import datetime

from matplotlib.figure import Figure

from truestand.report.drawing import EXACT, GREY, INK, PALE, PAPER, figure, styled
from truestand.statistics.control import ControlChart
from truestand.statistics.gage import GageStudy

MARK = "#a8240b"


@styled
def individuals(chart: ControlChart, times: Sequence[str], label: str) -> Figure:
    """The readings with U, their mean and limits, and below them the moving range."""
    fig = figure(9.4, 3.4)
    upper, lower = fig.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    x = list(range(len(chart.points)))
    values = [p.value for p in chart.points]
    for k, p in zip(x, chart.points, strict=True):
        if p.U is not None:
            upper.plot([k, k], [p.value - p.U, p.value + p.U], color=PALE, lw=3.0, zorder=1)
    upper.plot(x, values, "-o", ms=4.0, lw=1.0, color=EXACT, zorder=3)
    marked = [k for k, p in zip(x, chart.points, strict=True) if not p.ok]
    upper.plot(marked, [values[k] for k in marked], "D", ms=7.0, mfc="none", mec=MARK, mew=1.6, zorder=4)
    if chart.mean is not None:
        upper.axhline(chart.mean, color=INK, lw=0.8, zorder=2)
    for limit in (chart.lower, chart.upper):
        if limit is not None:
            upper.axhline(limit, color=PAPER, lw=1.0, ls=(0, (5, 3)), zorder=2)
    upper.set_ylabel(label)
    upper.ticklabel_format(axis="y", useOffset=False)
    lower.plot(x[1:], [abs(p.change or 0.0) for p in chart.points[1:]], "-o", ms=3.0, lw=0.8, color=GREY)
    lower.set_ylabel("moving\nrange")
    lower.set_ylim(bottom=0.0)
    every = max(1, -(-len(x) // 12))
    lower.set_xticks(x[::every], [_day(t) for t in times[::every]], rotation=30, ha="right")
    return fig


@styled
def components(study: GageStudy) -> Figure:
    """What each source contributes, per cent of the total variation."""
    fig = figure(6.0, 1.9)
    axes = fig.add_subplot()
    names = ("repeatability EV", "operators AV", "interaction", "Gage R&R", "parts PV")
    values = (study.EV, study.AV, study.INT, study.GRR, study.PV)
    shares = [study.share(v) or 0.0 for v in values]
    axes.barh(names[::-1], shares[::-1], color=[EXACT, PAPER, GREY, GREY, GREY])
    axes.set_xlabel("% of total variation")
    axes.set_xlim(0.0, 105.0)
    for name, share in zip(names, shares, strict=True):
        axes.annotate(f"{share:.1f}", (share, name), xytext=(3, 0), textcoords="offset points", va="center")
    return fig


def _day(time: str) -> str:
    """The day of an ISO time, or the text itself."""
    try:
        return datetime.fromisoformat(time).strftime("%Y-%m-%d")
    except ValueError:
        return time
