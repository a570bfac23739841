"""The maps of a gear's inspection: every flank small, all flanks unrolled with their defects, teeth folded, coverage.

Dense maps are put together as one image each, so that a page with hundreds of teeth stays light.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.inspection import Inspection
from truestand.core.units import um
from truestand.gear.defects import DefectMap
from truestand.gear.drawing import Gear
from truestand.gear.inspect import GearEvidence
from truestand.gear.teeth import FoldedMap
from truestand.report.drawing import DIVERGING, INK, cell_edges, figure, image, robust, single, styled
from truestand.report.gear_figures import FLANKS, WIDTH, limit_of, spread, tooth_ticks
from truestand.report.gear_tables import MOST_DEFECTS

MOST_TEETH = 24
"""Teeth whose flanks are shown one by one."""
TEETH_PER_ROW = 12
GUTTER = 0.12
"""Share of a small map left free about it."""
UNSEEN, BETWEEN_PROFILES = (0.76, 0.79, 0.82, 1.0), (0.955, 0.955, 0.955, 1.0)
"""Colours of what was not seen, and of what lies between two profiles that were."""
LEAST_SCALE_UM = 2.0
"""To either side: finer colours would show noise."""
MOST_LABELLED = 40
"""Teeth up to which each has its number."""


def shown_teeth(inspection: Inspection, teeth: int) -> list[int]:
    """Numbers (from 1) of the ``teeth`` whose flanks are mapped: all, or a few spread evenly and those with defects."""
    if teeth <= MOST_TEETH:
        return list(range(1, teeth + 1))
    defective = list(dict.fromkeys(d.tooth for d in inspection.defects[:MOST_DEFECTS] if d.tooth is not None))
    defective = defective[: MOST_TEETH // 2]
    rest = [t for t in range(1, teeth + 1) if t not in defective]
    return sorted([*defective, *spread(rest, MOST_TEETH - len(defective))])


@styled
def topography(inspection: Inspection, e: GearEvidence) -> Figure:
    """One small map a tooth and flank: deviation from the nominal flank, less the tooth's position."""
    position = e.measures.position[:, :, None, None]
    relative = um(1) * (e.grid.delta - np.where(np.isfinite(position), position, np.nan))
    teeth = shown_teeth(inspection, e.measures.index.shape[1])
    tolerance = limit_of(inspection, "F_alpha") or 0.0
    limit = max(robust(relative[:, [t - 1 for t in teeth]], share=0.98), tolerance / 4, LEAST_SCALE_UM)
    rows = [teeth[i : i + TEETH_PER_ROW] for i in range(0, len(teeth), TEETH_PER_ROW)]
    fig = figure(WIDTH, 0.5 + 2.05 * len(rows))
    panels = fig.subplots(len(rows), 1, squeeze=False)[:, 0]
    norm = Normalize(-limit, limit)
    for axes, row in zip(panels, rows, strict=True):
        _small_maps(axes, relative, row, norm, len(rows[0]))
    fig.colorbar(ScalarMappable(norm, DIVERGING), ax=list(panels), label="µm", pad=0.01, aspect=30)
    return fig


def _small_maps(axes: Axes, relative: Array, teeth: Sequence[int], norm: Normalize, places: int) -> None:
    """Left flanks above, right flanks below; each map roll length upward, height to the right."""
    high = wide = 1.0 + GUTTER
    for row, (flank, _, _) in enumerate(FLANKS):
        for column, tooth in enumerate(teeth):
            left, bottom = column * wide, (1 - row) * high
            axes.imshow(
                _coloured(relative[row, tooth - 1], norm), extent=(left, left + 1, bottom, bottom + 1),
                origin="lower", aspect="auto", interpolation="nearest",
            )  # fmt: skip
            if row == 0:
                axes.text(left + 0.5, 2 * high, str(tooth), ha="center", va="bottom")
        axes.text(-0.01 * places, (1 - row) * high + 0.5, flank, rotation=90, ha="right", va="center")
    axes.set(xlim=(-0.025 * places, places * wide), ylim=(-0.02, 2 * high + 0.16))
    axes.set_axis_off()


def _coloured(values: Array, norm: Normalize) -> NDArray[np.uint8]:
    """RGBA bytes of a map; grey where nothing was seen."""
    colours = colormaps[DIVERGING](norm(np.nan_to_num(values)))
    seen = np.isfinite(values)
    colours[~seen] = UNSEEN
    colours[_enclosed(seen) & ~seen] = BETWEEN_PROFILES
    return np.asarray(np.rint(255 * colours), dtype=np.uint8)


def _enclosed(seen: Mask) -> Mask:
    """Cells with something seen above and below them: the gaps between profiles, not what is hidden."""
    above = np.logical_or.accumulate(seen[::-1], axis=0)[::-1]
    return np.asarray(above & np.logical_or.accumulate(seen, axis=0))


@styled
def unrolled(inspection: Inspection, m: DefectMap) -> Figure:
    """All flanks side by side against the median tooth, tooth after tooth, with the defects numbered."""
    norm = _norm_of(inspection, np.where(np.isfinite(m.score), m.residual, np.nan))
    fig = figure(WIDTH, 4.6)
    panels = fig.subplots(2, 1, sharex=True)
    for side, axes in enumerate(panels):
        low, high = cell_edges(m.rolls)
        teeth = m.residual.shape[1]
        axes.imshow(
            _coloured(um(1) * m.residual[side].transpose(1, 0, 2).reshape(m.rolls.size, -1), norm),
            extent=(0.5, teeth + 0.5, low, high), origin="lower", aspect="auto", interpolation="nearest",
        )  # fmt: skip
        _tooth_axis(axes, teeth)
        axes.set(ylabel="roll length (mm)", title=f"{FLANKS[side][0]} flanks")
        _flank_marks(axes, inspection, m, FLANKS[side][0])
    panels[-1].set_xlabel("tooth; within each its face, from the lower end to the upper")
    fig.colorbar(ScalarMappable(norm, DIVERGING), ax=list(panels), label="µm", pad=0.01, aspect=30)
    return fig


def _norm_of(inspection: Inspection, residual: Array) -> Normalize:
    """The colour scale, um: the noise stays pale, and the shallowest defect found is well coloured."""
    depths = [
        um(abs(d.depth)) for d in inspection.defects[:MOST_DEFECTS] if d.flank is not None and d.depth is not None
    ]
    limit = max(3 * um(robust(residual)), 0.6 * min(depths, default=0.0), LEAST_SCALE_UM)
    return Normalize(-limit, limit)


def _flank_marks(axes: Axes, inspection: Inspection, m: DefectMap, flank: str) -> None:
    """The numbers of the defects on one side."""
    bottom, top = cell_edges(m.heights)
    for number, d in enumerate(inspection.defects[:MOST_DEFECTS], 1):
        if d.flank == flank and d.tooth is not None and d.height is not None:
            along = d.tooth - 0.5 + (d.height - bottom) / (top - bottom)
            _mark(axes, along, d.roll_length or float(m.rolls[0]), number)


def _tooth_axis(axes: Axes, teeth: int) -> None:
    """Lines between the teeth and their numbers on the axis."""
    if teeth <= MOST_LABELLED:
        for edge in range(1, teeth):
            axes.axvline(edge + 0.5, color="white", lw=1.0)
        axes.set_xticks(range(1, teeth + 1))
    axes.tick_params(axis="x", length=0)


def _mark(axes: Axes, x: float, y: float, number: int) -> None:
    axes.plot([x], [y], "o", ms=19, mfc="none", mec=INK, mew=1.1)
    axes.annotate(
        str(number), (x, y), xytext=(11, 11), textcoords="offset points", ha="center", va="center", fontsize=8,
        fontweight="bold", bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": INK, "lw": 0.8},
    )  # fmt: skip


@styled
def whole_teeth(inspection: Inspection, gear: Gear, folded: FoldedMap) -> Figure:
    """The gear unrolled: radius against the median tooth, over tooth number and height."""
    relative = against_median(folded)
    teeth, places, heights = relative.shape
    depth = (gear.tip_diameter - gear.root_diameter) / 2
    fig, axes = single(WIDTH, 2.2)
    low, high = cell_edges(folded.heights)
    flat = relative.reshape(teeth * places, heights).T
    drawn = image(axes, flat, (0.5, teeth + 0.5, low, high), (-0.3 * depth, 0.3 * depth), DIVERGING)
    _tooth_axis(axes, teeth)
    for number, d in enumerate(inspection.defects[:MOST_DEFECTS], 1):
        if d.flank is None and d.tooth is not None and d.height is not None:
            _mark(axes, d.tooth, d.height, number)
    axes.set(xlabel="tooth, its tip above the number", ylabel="height (mm)")
    fig.colorbar(drawn, ax=axes, label="radius (mm)", pad=0.01)
    return fig


def against_median(folded: FoldedMap) -> Array:
    """Radius (teeth, places, heights) mm less that of the median tooth; NaN where either was not seen."""
    radius = np.sort(folded.radius, axis=0)  # NaN last
    number = np.isfinite(radius).sum(axis=0)
    middle = np.take_along_axis(radius, np.maximum(number - 1, 0)[None] // 2, axis=0)
    return np.asarray(folded.radius - middle)


@styled
def coverage(e: GearEvidence) -> Figure:
    """Share of the heights at which each roll length of each tooth has readings."""
    low, high = cell_edges(e.grid.rolls)
    fig = figure(WIDTH, 2.3)
    panels = fig.subplots(1, 2, sharey=True)
    for side, axes in enumerate(panels):
        share = 100 * e.grid.seen[side].mean(axis=2).T
        teeth = share.shape[1]
        image(axes, share, (0.5, teeth + 0.5, low, high), (0.0, 100.0), "Blues")
        axes.set(xlabel="tooth", title=f"{FLANKS[side][0]} flanks")
        tooth_ticks(axes, teeth, 12)
        for end in e.nominal.profile_range:
            axes.axhline(end, color=INK, lw=0.9, ls=(0, (4, 3)))
    panels[0].set_ylabel("roll length (mm)")
    fig.colorbar(
        ScalarMappable(Normalize(0, 100), "Blues"), ax=list(panels), label="% of the face with readings", pad=0.01
    )
    return fig
