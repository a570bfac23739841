"""Profile and helix charts as a gear measuring machine draws them: traces running upward side by side, one a tooth.

A trace stands about its own mean within the evaluation range; where the flank stands as a whole is pitch.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from truestand.core.arrays import Array
from truestand.core.inspection import Characteristic, Flank, Inspection
from truestand.core.units import um
from truestand.gear.inspect import GearEvidence
from truestand.gear.traces import helix_points, profile_points
from truestand.report.drawing import FAILS, GREY, INK, PALE, figure, round_down, styled
from truestand.report.gear_figures import FLANKS, TOLERANCE_BAND, WIDTH, limit_of, spread
from truestand.report.notation import drawn_symbol, limit_text, number

SHOWN_TEETH, WORST_TEETH = 5, 2
"""Teeth that are drawn, and how many of them are those with the largest deviations."""
SPACING = 1.35
"""Distance of neighbouring traces, in widths of what is drawn."""
MOST_SCALE_UM = 5000.0
"""Of a scale bar."""


@dataclass(frozen=True, slots=True)
class _Chart:
    """One kind of trace of all teeth."""

    trace: Array
    """(2, teeth, n) um, NaN = not seen."""
    at: Array
    """(n,) mm."""
    ends: tuple[float, float]
    """mm, of the control length or the face."""
    limits: tuple[float, float]
    """mm, of the evaluation."""
    names: tuple[str, ...]
    """Figures printed beneath, the total first."""
    along: str
    teeth: tuple[int, ...]
    """From 0."""
    lines: dict[tuple[str, Flank | None, int], Characteristic]
    tolerance: float | None
    """um, of the total."""

    @property
    def step(self) -> float:
        """um between the nominal lines of neighbouring teeth."""
        spans = [
            np.ptp(t[np.isfinite(t)]) for side in self.trace for t in side[list(self.teeth)] if np.isfinite(t).any()
        ]
        return SPACING * max([*map(float, spans), self.tolerance or 0.0, 1.0])


@styled
def profile_chart(inspection: Inspection, e: GearEvidence) -> Figure:
    """Deviation over the roll length of a few teeth."""
    names = ("F_alpha", "f_falpha", "f_Halpha")
    ends = (e.nominal.control_roll, e.nominal.tip_roll)
    at = profile_points(e.nominal)
    return _drawn(inspection, e.measures.profile, at, ends, e.nominal.profile_range, names, "roll length (mm)")


@styled
def helix_chart(inspection: Inspection, e: GearEvidence) -> Figure:
    """Deviation over the height of a few teeth."""
    names = ("F_beta", "f_fbeta", "f_Hbeta")
    gear = e.nominal.gear
    ends = (gear.face_from, gear.face_to)
    return _drawn(
        inspection, e.measures.helix, helix_points(e.nominal), ends, e.nominal.helix_range, names, "height (mm)"
    )


def _drawn(
    inspection: Inspection,
    trace: Array,
    at: Array,
    ends: tuple[float, float],
    limits: tuple[float, float],
    names: tuple[str, ...],
    along: str,
) -> Figure:
    lines = {(c.name, c.flank, c.tooth): c for c in inspection.characteristics if c.tooth is not None}
    chart = _Chart(
        um(1) * trace, at, ends, limits, names, along, _shown_teeth(trace), lines, limit_of(inspection, names[0]),
    )  # fmt: skip
    fig = figure(WIDTH, 4.9)
    both = fig.subplots(1, 2, sharey=True)
    for side, axes in enumerate(both):
        _side(fig, axes, chart, side)
    _names_beneath(both[0], chart)
    both[0].set_ylabel(along)
    return fig


def _shown_teeth(trace: Array) -> tuple[int, ...]:
    """Teeth, from 0, whose traces (2, teeth, n) are drawn: those that range farthest, and some evenly spread."""
    seen = np.isfinite(trace)
    ranges = np.where(seen, trace, -np.inf).max(axis=2) - np.where(seen, trace, np.inf).min(axis=2)
    order = np.argsort(-ranges.max(axis=0), kind="stable")
    worst = [int(tooth) for tooth in order[:WORST_TEETH] if np.isfinite(ranges[:, tooth]).any()]
    others = [int(t) for t in np.flatnonzero(seen.any(axis=(0, 2))) if t not in worst]
    return tuple(sorted((*worst, *spread(others, SHOWN_TEETH - len(worst)))))


def _side(fig: Figure, axes: Axes, chart: _Chart, side: int) -> None:
    flank, colour, _ = FLANKS[side]
    step, (low, high), (start, stop) = chart.step, chart.limits, chart.ends
    margin = 0.04 * (stop - start)
    axes.set_title(f"{flank} flanks", pad=20, color=colour, fontweight="bold")
    axes.set(
        xlim=(-0.62 * step, (len(chart.teeth) - 0.38) * step), ylim=(start - margin, stop + margin), xticks=[],
    )  # fmt: skip
    for end in chart.limits:
        axes.axhline(end, color=GREY, lw=0.7, ls=(0, (4, 3)), zorder=0)
    for end in chart.ends:
        axes.axhline(end, color=PALE, lw=0.7, zorder=0)
    if not np.isfinite(chart.trace[side]).any():
        axes.text(0.5, 0.5, "not measurable", transform=axes.transAxes, ha="center", va="center", color=GREY)
        return
    for place, tooth in enumerate(chart.teeth):
        middle = place * step
        if chart.tolerance is not None:
            half = chart.tolerance / 2
            axes.fill_betweenx([low, high], middle - half, middle + half, color=TOLERANCE_BAND, lw=0, zorder=0)
        axes.plot([middle, middle], [start, stop], color=GREY, lw=0.6)
        axes.annotate(
            f"tooth {tooth + 1}", (middle, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 5),
            textcoords="offset points", ha="center",
        )  # fmt: skip
        _trace(axes, chart, side, tooth, middle)
        _figures_beneath(axes, chart, flank, tooth, middle)
    _scale(fig, axes, step)


def _trace(axes: Axes, chart: _Chart, side: int, tooth: int, middle: float) -> None:
    """The trace about its mean, and its mean line."""
    values, at = chart.trace[side, tooth], chart.at
    inside = np.isfinite(values) & (at >= chart.limits[0]) & (at <= chart.limits[1])
    if inside.sum() < 2:
        axes.text(middle, float(np.mean(chart.limits)), "not seen", ha="center", va="center", color=GREY, rotation=90)
        return
    about = float(values[inside].mean())
    seen = np.isfinite(values)
    axes.plot(middle + values[seen] - about, at[seen], color=FLANKS[side][1], lw=1.3)
    slope, start = np.polyfit(at[inside], values[inside] - about, 1)
    ends = np.array([at[inside].min(), at[inside].max()])
    axes.plot(middle + start + slope * ends, ends, color=INK, lw=0.9, ls=(0, (6, 2)))


def _figures_beneath(axes: Axes, chart: _Chart, flank: Flank, tooth: int, middle: float) -> None:
    for row, name in enumerate(chart.names):
        line = chart.lines.get((name, flank, tooth + 1))
        value = None if line is None or line.value is None else um(line.value)
        fails = line is not None and line.verdict == "does_not_conform"
        bound = "≥ " if line is not None and line.at_least else ""
        axes.annotate(
            f"{bound}{number(value, 1)}", (middle, 0.0), xycoords=("data", "axes fraction"),
            xytext=(0, -14 - 13 * row), textcoords="offset points", ha="center", va="center",
            color=FAILS if fails else INK, fontweight="bold" if fails else "normal",
        )  # fmt: skip


def _names_beneath(axes: Axes, chart: _Chart) -> None:
    for row, name in enumerate(chart.names):
        limited = next((c for (n, _, _), c in chart.lines.items() if n == name and c.limits), None)
        allowed = "" if limited is None else f" ({limit_text(limited)})"
        axes.annotate(
            f"{drawn_symbol(name)}{allowed} µm", (0.0, 0.0), xycoords="axes fraction", xytext=(-6, -14 - 13 * row),
            textcoords="offset points", ha="right", va="center", fontsize=8,
        )  # fmt: skip


def _scale(fig: Figure, axes: Axes, step: float) -> None:
    """A bar that says what a deviation of so many um looks like, beside the title."""
    length = min(max(round_down(step / 2), 1.0), MOST_SCALE_UM)
    right = axes.get_xlim()[1]
    raised = axes.get_xaxis_transform() + ScaledTranslation(0.0, 24 / 72, fig.dpi_scale_trans)
    axes.plot(
        [right - length, right], [1.0, 1.0], color=INK, lw=1.0, marker="|", ms=6, mew=1.0, transform=raised,
        clip_on=False,
    )  # fmt: skip
    axes.text(right - length - 0.06 * step, 1.0, f"{length:.0f} µm", transform=raised, ha="right", va="center")
