"""The charts of a gear's inspection: how much of each limit is used, profile, helix, pitch, run-out.

Figures come from the record; the traces are drawn as they were read. Lengths mm inside, um on the axes.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from truestand.core.arrays import Array
from truestand.core.inspection import Characteristic, Flank, Inspection
from truestand.core.units import um
from truestand.gear.inspect import GearEvidence
from truestand.report.drawing import EXACT, GREY, INK, PALE, PAPER, figure, single, styled
from truestand.report.notation import drawn_symbol, number, value_text

WIDTH = 10.2
"""Inches, of every figure of an inspection."""
LEFT, RIGHT, TOLERANCE_BAND = "#1f6fb2", "#c8641b", "#e7ecf0"
FLANKS: tuple[tuple[Flank, str, str], ...] = (("left", LEFT, "o"), ("right", RIGHT, "s"))
F_I = r"$F_\mathrm{i}$"
RUNOUT_TITLE = "both flanks: radial place of the ball in the space after each tooth (µm, about its mean)"
MOST_MARKED = 40
"""Teeth up to which each has its own mark."""
MOST_SHARE = 2.5
"""Times the limit to which the overview reaches."""


def line_of(inspection: Inspection, name: str, flank: str | None) -> Characteristic | None:
    """The whole part's characteristic of that name and flank."""
    return next((c for c in inspection.characteristics if (c.name, c.flank, c.tooth) == (name, flank, None)), None)


def limit_of(inspection: Inspection, name: str) -> float | None:
    """Upper limit (um) of a deviation."""
    line = next((c for c in inspection.characteristics if c.name == name and c.limits is not None), None)
    return None if line is None or line.limits is None or line.limits[1] is None else um(line.limits[1])


def _zone(limits: tuple[float | None, float | None]) -> list[tuple[float, float]]:
    """Where nothing of the limits is used, and how far it is from there to them; a one-sided limit starts at zero."""
    low, high = limits
    if high is None:
        return []
    middle, half = (0.0, high) if low is None else ((low + high) / 2, (high - low) / 2)
    return [(middle, half)] if half > 0 else []


@styled
def limits_used(inspection: Inspection) -> Figure:
    """Every limited line of the whole gear as a share of its limit, with its U; lower bounds without."""
    lines = [
        (c, abs(c.value - middle) / half, 0.0 if c.at_least else c.U / half)
        for c in inspection.characteristics
        if c.tooth is None and not c.size and c.limits is not None and c.value is not None and c.U is not None
        for middle, half in _zone(c.limits)
    ]
    names = list(dict.fromkeys(c.name for c, _, _ in lines))
    fig, axes = single(WIDTH, 0.9 + 0.3 * len(names))
    axes.axvspan(0.0, 1.0, color=TOLERANCE_BAND, lw=0, zorder=0)
    axes.axvline(1.0, color=INK, lw=1.2)
    for c, share, u_share in lines:
        _share(axes, c.flank, share, u_share, names.index(c.name))
    for flank, colour, marker in FLANKS:
        axes.plot([], [], marker, ms=5, color=colour, label=f"{flank} flanks")
    axes.plot([], [], "D", ms=5, color=INK, label="both")
    axes.set(
        xlim=(0.0, MOST_SHARE), ylim=(len(names) - 0.5, -0.5), xlabel="share of the limit; the bars are ± U (k = 2)",
        yticks=range(len(names)), yticklabels=[drawn_symbol(n) for n in names],
    )  # fmt: skip
    axes.xaxis.set_major_formatter(lambda x, _: f"{100 * x:.0f} %")
    axes.tick_params(axis="y", length=0, labelsize=10)
    axes.legend(loc="lower right", ncols=3, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
    return fig


def _share(axes: Axes, flank: Flank | None, share: float, u_share: float, row: int) -> None:
    colour, marker, shift = {"left": (LEFT, "o", -0.16), "right": (RIGHT, "s", 0.16)}.get(flank or "", (INK, "D", 0.0))
    axes.plot([max(share - u_share, 0.0), share + u_share], [row + shift] * 2, color=colour, lw=1.6, alpha=0.45)
    if share <= MOST_SHARE:
        axes.plot([share], [row + shift], marker, ms=5, color=colour, clip_on=False, zorder=3)
    else:
        axes.text(
            MOST_SHARE, row + shift, f"{100 * share:.0f} % \N{RIGHTWARDS ARROW}", ha="right", va="center", color=colour
        )


@styled
def pitch(inspection: Inspection, evidence: GearEvidence) -> Figure:
    """Single pitches, cumulative positions and the run-out of the ball, tooth by tooth."""
    m = evidence.measures
    fig = figure(WIDTH, 6.6)
    grid = fig.add_gridspec(3, 2)
    for side, (flank, colour, _) in enumerate(FLANKS):
        _single_pitches(fig.add_subplot(grid[0, side]), inspection, m.pitch[side], flank, colour)
        cumulative = fig.add_subplot(
            grid[1, side], title=f"{flank} flanks: cumulative pitch {F_I} (µm, about its mean)"
        )
        _curve(cumulative, m.index[side], colour, line_of(inspection, "F_p", flank), limit_of(inspection, "F_p"))
    runout = fig.add_subplot(grid[2, :], title=RUNOUT_TITLE)
    _curve(runout, m.runout, INK, line_of(inspection, "F_r", None), limit_of(inspection, "F_r"))
    for axes in fig.axes:
        tooth_ticks(axes, m.runout.size, 32 if axes is runout else 16)
        axes.set_xlabel("tooth")
    _same_scale(fig.axes[0], fig.axes[2])
    _same_scale(fig.axes[1], fig.axes[3])
    return fig


def _same_scale(first: Axes, second: Axes) -> None:
    """Left and right flanks are read against each other."""
    ends = np.array([first.get_ylim(), second.get_ylim()])
    for axes in (first, second):
        axes.set_ylim(ends[:, 0].min(), ends[:, 1].max())


def _not_measurable(axes: Axes) -> None:
    axes.text(0.5, 0.5, "not measurable", transform=axes.transAxes, ha="center", va="center", color=GREY)
    axes.tick_params(axis="y", length=0, labelleft=False)


def _single_pitches(axes: Axes, inspection: Inspection, pitches: Array, flank: str, colour: str) -> None:
    axes.set_title(f"{flank} flanks: single pitch " + r"$f_\mathrm{pi}$" + " (µm)")
    if not np.isfinite(pitches).any():
        _not_measurable(axes)
        return
    teeth = np.arange(1, pitches.size + 1)
    values, limit = um(1) * pitches, limit_of(inspection, "f_p")
    beyond = np.abs(values) > (np.inf if limit is None else limit)
    axes.axhline(0.0, color=GREY, lw=0.6)
    axes.bar(teeth[~beyond], values[~beyond], 0.72, color=colour)
    axes.bar(teeth[beyond], values[beyond], 0.72, color=colour, edgecolor=INK, lw=0.9, hatch="////")
    if limit is not None:
        _limit_lines(axes, (-limit, limit), drawn_symbol("f_p", True) + f" = {limit:g}")
    axes.set_xlim(0.0, pitches.size + 1.0)


def _limit_lines(axes: Axes, ends: tuple[float, float], label: str) -> None:
    for end in ends:
        axes.axhline(end, color=INK, lw=0.9, ls=(0, (5, 3)))
    low, high = ends
    room = 0.22 * (high - low)
    bottom, top = axes.get_ylim()
    axes.set_ylim(min(bottom, low - room), max(top, high + room))
    axes.annotate(
        label, (1.0, high), xycoords=("axes fraction", "data"), xytext=(-2, 2), textcoords="offset points", ha="right",
        va="bottom", fontsize=7.5,
    )  # fmt: skip


def _curve(axes: Axes, values: Array, colour: str, line: Characteristic | None, limit: float | None) -> None:
    """Values over the teeth, the bracket of their range with the record's figure, and the limit's width."""
    seen = np.isfinite(values)
    if not seen.any() or line is None or line.value is None:
        _not_measurable(axes)
        return
    teeth = np.arange(1, values.size + 1)
    centred = um(1) * (values - values[seen].mean())
    low, high = float(centred[seen].min()), float(centred[seen].max())
    middle = (low + high) / 2
    if limit is not None:
        axes.axhspan(middle - limit / 2, middle + limit / 2, color=TOLERANCE_BAND, lw=0, zorder=0)
    axes.axhline(0.0, color=GREY, lw=0.6)
    axes.plot(teeth, centred, color=colour, lw=1.2, marker="o" if values.size <= MOST_MARKED else None, ms=3)
    if limit is not None:
        _limit_lines(axes, (middle - limit / 2, middle + limit / 2), drawn_symbol(line.name, True) + f" = {limit:g}")
    at = values.size * 1.045 + 0.6
    axes.plot([at, at], [low, high], color=INK, lw=1.0, marker="_", ms=7, mew=1.0)
    axes.annotate(
        f"{drawn_symbol(line.name)}\n{value_text(line)}", (at, middle), xytext=(6, 0), textcoords="offset points",
        va="center", linespacing=1.4,
    )  # fmt: skip
    axes.set_xlim(0.0, values.size * 1.16 + 1.5)


@styled
def published(evidence: GearEvidence, published_index: Array) -> Figure:
    """Cumulative pitch (2, teeth) mm after the published compensation and here, on one scale."""
    fig, axes = single(WIDTH, 3.0)
    axes.axhline(0.0, color=PALE, lw=0.8)
    teeth = evidence.measures.index.shape[1]
    curves = (
        ("published compensation", published_index, PAPER),
        ("here: the axis moved", evidence.measures.index, EXACT),
    )
    for label, index, colour in curves:
        for side, style in enumerate(("-", (0, (4, 2)))):
            if np.isfinite(index[side]).any():
                axes.plot(
                    np.arange(1, teeth + 1), um(1) * (index[side] - np.nanmean(index[side])), color=colour, lw=1.8,
                    ls=style, label=f"{label}, {FLANKS[side][0]} flanks",
                )  # fmt: skip
    axes.set(xlabel="tooth", ylabel=f"cumulative pitch {F_I} (µm)", xlim=(0.5, teeth + 0.5))
    tooth_ticks(axes, teeth, 24)
    axes.yaxis.set_major_formatter(lambda y, _: number(y, 0))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return fig


def tooth_ticks(axes: Axes, teeth: int, most: int) -> None:
    """Numbers on the axis: every tooth where there is room, else round ones; none beyond the last tooth."""
    step = next(s for s in (1, 2, 5, 10, 20, 50, 100, 200, 500) if teeth <= s * most)
    axes.set_xticks([1, *range(step, teeth + 1, step)] if step > 2 else range(1, teeth + 1, step))


def spread(teeth: Sequence[int], count: int) -> list[int]:
    """About ``count`` of the teeth, evenly spread, the first one among them."""
    if len(teeth) <= count:
        return list(teeth)
    return [teeth[i * len(teeth) // count] for i in range(count)]
