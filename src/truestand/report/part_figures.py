"""The figures of turned parts and of parts compared with their CAD model. Lengths mm inside, um on the axes."""

from collections.abc import Sequence
from math import degrees, tau
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from truestand.core.arrays import Array
from truestand.core.inspection import Inspection
from truestand.core.units import um
from truestand.parts.cad import CadEvidence
from truestand.parts.turned import SectionEvidence
from truestand.report.drawing import (
    DIVERGING,
    EXACT,
    GREY,
    INK,
    PALE,
    cell_edges,
    figure,
    image,
    polar_frame,
    robust,
    round_down,
    single,
    styled,
)
from truestand.report.gear_figures import WIDTH, line_of
from truestand.report.notation import value_text

PLOTS_PER_ROW = 3
MOST_DRAWN = 0.3
"""Share of the drawn radius that the largest deviation takes at most."""
BINS = 80


@styled
def roundness(inspection: Inspection, sections: Sequence[SectionEvidence]) -> Figure:
    """Polar plots of every section: each height's circle about its own centre, magnified."""
    rows = -(-len(sections) // PLOTS_PER_ROW)
    fig = figure(WIDTH, 3.5 * rows)
    for i, section in enumerate(sections):
        _polar(fig.add_subplot(rows, PLOTS_PER_ROW, i + 1, aspect="equal"), inspection, section)
    return fig


def _polar(axes: Axes, inspection: Inspection, s: SectionEvidence) -> None:
    largest = max(robust(s.form, share=0.999), 1e-5)
    factor = round_down(MOST_DRAWN / largest)
    circle = np.linspace(0.0, tau, 361)
    for radius, style in ((1.0, (0, (4, 3))), (1.0 - MOST_DRAWN, "-"), (1.0 + MOST_DRAWN, "-")):
        axes.plot(
            radius * np.cos(circle), radius * np.sin(circle), color=GREY if radius == 1.0 else PALE, lw=0.8, ls=style
        )
    closed = np.append(s.angle, s.angle[0])
    for row in s.form:
        wave = 1.0 + factor * np.append(row, row[0])
        axes.plot(wave * np.cos(closed), wave * np.sin(closed), color=EXACT, lw=0.5, alpha=0.25, rasterized=True)
    seen = np.flatnonzero(np.isfinite(s.form).any(axis=1))
    middle = s.form[seen[seen.size // 2] if seen.size else 0]
    wave = 1.0 + factor * np.append(middle, middle[0])
    axes.plot(wave * np.cos(closed), wave * np.sin(closed), color=INK, lw=1.2)
    line = next((c for c in inspection.characteristics if (c.name, c.section) == ("roundness", s.name)), None)
    value = "" if line is None or line.value is None else f"RONt {value_text(line)} µm\n"
    ring = um(MOST_DRAWN / factor)
    axes.text(0, 0, f"{value}⌀ {2 * s.radius:g} mm\nrings ± {ring:.3g} µm", ha="center", va="center", linespacing=1.5)
    polar_frame(axes, _plain(s.name), 1.45)


def _plain(text: str) -> str:
    """Text from outside is no mathematics."""
    return text.replace("$", r"\$")


@styled
def section_maps(sections: Sequence[SectionEvidence]) -> Figure:
    """Deviation of every section about the datum axis, over angle and height."""
    limit = um(robust(*(s.travel for s in sections), share=0.995))
    fig = figure(WIDTH, 0.3 + 1.35 * len(sections))
    rows = fig.subplots(len(sections), 1, sharex=True, squeeze=False)[:, 0]
    for axes, s in zip(rows, sections, strict=True):
        _map(axes, s.angle, s.height, s.travel, limit)
        axes.set(title=_plain(s.name), ylabel="height (mm)")
    rows[-1].set_xlabel("polar angle about the datum axis (°)")
    fig.colorbar(
        ScalarMappable(Normalize(-limit, limit), DIVERGING), ax=list(rows), label="r − R (µm)", pad=0.01, aspect=30
    )
    return fig


def _map(axes: Axes, angle: Array, height: Array, values: Array, limit: float) -> Any:
    first = int(np.argmin(angle))
    ordered = np.roll(values, -first, axis=1)
    start = degrees(float(angle[first])) - 180.0 / angle.size
    extent = (start, start + 360.0, *cell_edges(height))
    return image(axes, um(1) * ordered, extent, (-limit, limit), DIVERGING)


@styled
def cad_map(inspection: Inspection, e: CadEvidence) -> Figure:
    """Normal deviation from the model over angle and height; the limits stand on the colour scale."""
    limits = _limits(inspection)
    limit = max(um(robust(e.deviation, share=0.995)), 1.2 * max(map(abs, limits), default=0.0))
    fig, axes = single(WIDTH, 3.6)
    drawn = _map(axes, e.angle, e.height, e.deviation, limit)
    axes.set(xlabel="polar angle about the datum axis (°)", ylabel="height (mm)")
    bar = fig.colorbar(drawn, ax=axes, label="deviation (µm)", pad=0.01)
    for end in limits:
        bar.ax.axhline(end, color=INK, lw=1.6)
    return fig


def _limits(inspection: Inspection) -> list[float]:
    """Lower and upper limit of the deviation, um, where there are any."""
    ends = []
    for name, side in (("deviation_min", 0), ("deviation_max", 1)):
        line = line_of(inspection, name, None)
        ends.append(None if line is None or line.limits is None else line.limits[side])
    return [um(end) for end in ends if end is not None]


@styled
def cad_histogram(inspection: Inspection, e: CadEvidence) -> Figure:
    """How often which deviation occurs, over the patches of the surface."""
    values = um(1) * e.deviation[np.isfinite(e.deviation)]
    limits = _limits(inspection)
    reach = max(
        float(np.quantile(np.abs(values), 0.999)) if values.size else 1.0, 1.15 * max(map(abs, limits), default=0.0)
    )
    fig, axes = single(WIDTH, 2.3)
    axes.hist(np.clip(values, -reach, reach), bins=BINS, range=(-reach, reach), color=EXACT)
    for end in limits:
        axes.axvline(end, color=INK, lw=1.2, ls=(0, (5, 3)))
    axes.set(xlabel="normal deviation (µm); dashed: limits", ylabel="patches", xlim=(-reach, reach))
    return fig
