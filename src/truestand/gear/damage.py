"""What a flank's figures leave out: regions whose readings depart together, and regions that no reading confirms.

The weights that keep stray readings out of the figures (``evaluate.weigh``) also keep out a groove; cells take no
notice of a minority of their readings (``grid.CLIP``); readings too far from their flank are cut away before
(``flanks.GATE``). One cell that departs is dirt, a region of cells is material. Its depth goes into U of every figure
that is read there; where the depth isn't known, or a flank doesn't show what the same flank of most teeth shows, the
figure is undecided.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from truestand.gear.coverage import across_gaps, solid_cells, step_on_flank
from truestand.gear.evaluate import Weighed, in_ranges, residuals
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import FLANKS, Involute
from truestand.gear.grid import Grid, cell_of

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Zone = Literal["profile", "helix", "position", "area"]

LEFT_OUT = 0.1
"""Weight below which a cell is left out: 3.9 robust standard deviations off."""
DEPARTS, SHARE, FEW = 5.0, 0.25, 2
"""Robust standard deviations by which a reading departs; share and number of such readings that mark a cell."""
LEAST_CELLS, IN_ONE_ROW = 4, 8
"""Cells that make a region, and so many where they lie in one row: fewer may be strays, or the speckle of a profile."""
UNSEEN = 0.25
"""What a cell counts that is merely not seen: readings get lost on sound flanks too."""
DEEPEST = 0.98
"""Quantile of a region's readings that is its depth: the last few may be strays."""
CUT = 0.5
"""Of a cell's usual readings: with fewer on the flank and more beyond the gate, the cell is not confirmed."""
ON_MOST = 0.75
"""Share of the teeth that must show a cell for it to be missed on the others."""
TRACE = 1 / 20
"""Share of the face to either side of its middle in which profile and position are read."""
STEPS_ACROSS = 3.0
"""Steps of the table that a region must be wide for its depth to be known."""
STEPS = 1.5
"""Steps of the table to either side of the measuring circle over which position and helix are read."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A region of one flank that its figures leave out."""

    side: int
    """0 left, 1 right."""
    tooth: int
    """From 0."""
    cells: Bools
    """(roll lengths, heights)."""
    depth: float | None
    """mm by which its readings depart, positive into the material; None: not seen, or beyond the gate."""
    beyond: bool
    """Whether readings lie beyond the gate instead, ``flanks.GATE`` mm and more from the flank."""
    resolved: bool
    """Whether profiles enough cross it to tell its depth."""
    rolls: tuple[float, float]
    """mm, from and to."""
    heights: tuple[float, float]
    """mm in C, from and to."""

    @property
    def text(self) -> str:
        """Where it is, and what was left out."""
        (a, b), (c, d) = self.rolls, self.heights
        flank = f"tooth {self.tooth + 1} {FLANKS[self.side]}"
        where = f"{flank}, roll length {a:.1f} to {b:.1f} mm, height {c:.1f} to {d:.1f} mm"
        if self.depth is None:
            return f"{where}: the flank is not seen where other teeth show it"
        least = "" if self.resolved else "at least "
        side = "below" if self.depth > 0 else "above"
        return f"{where}: readings {least}{1000 * abs(self.depth):.0f} um {side} the flank"


def damage_of(flanks: Flanks, grid: Grid, weighed: Weighed, nominal: Involute, step: float) -> tuple[Damage, ...]:
    """Regions of cells inside the evaluation ranges that the figures leave out, tooth by tooth.

    ``step``: table angle from one profile to the next, rad.
    """
    shape, teeth = grid.delta.shape, nominal.gear.teeth
    ranges = in_ranges(grid, nominal)
    rest = residuals(grid.delta, weighed)
    cell = cell_of(flanks, nominal, *shape[2:])
    below = (grid.delta - rest).reshape(-1)[cell] - flanks.delta
    out = (weighed.weight.reshape(shape) < LEFT_OUT) & np.isfinite(grid.delta)
    far = DEPARTS * grid.scatter
    unconfirmed, cut = _unconfirmed(flanks, grid, nominal, step)
    found = []
    for sign, count in (
        (1, (out & (rest < 0)) | _departing(cell[below > far], grid)),
        (-1, (out & (rest > 0)) | _departing(cell[below < -far], grid)),
        (0, unconfirmed),
    ):
        count = np.where(ranges, count, 0.0)
        bridged = across_gaps(count > 0, grid, nominal, step)
        for side, tooth in np.argwhere((count > 0).any(axis=(2, 3))):
            own = np.flatnonzero(flanks.which == side * teeth + tooth) if sign else None
            for region in _regions(count[side, tooth], bridged[side, tooth]):
                depth = None
                if own is not None:
                    here = own[region.reshape(-1)[cell[own] % region.size]]
                    depth = sign * float(np.quantile(sign * below[here], DEEPEST))
                rolls, heights = _extent(grid, region)
                coarse = STEPS_ACROSS * float(step_on_flank(nominal, sum(rolls) / 2, step))
                resolved = depth is not None and rolls[1] - rolls[0] >= coarse
                beyond = not sign and bool(cut[side, tooth][region].any())
                found.append(Damage(int(side), int(tooth), region, depth, beyond, resolved, rolls, heights))
    return tuple(sorted(found, key=lambda d: (d.tooth, d.side, d.rolls, d.heights)))


def _departing(cell: NDArray[np.int64], grid: Grid) -> Bools:
    """Cells (2, teeth, roll lengths, heights) of which many a reading departs, by the cells (n,) of those that do."""
    number = np.bincount(cell, minlength=grid.delta.size).reshape(grid.delta.shape)
    return np.asarray(number >= np.maximum(SHARE * grid.count, FEW))


def _unconfirmed(flanks: Flanks, grid: Grid, nominal: Involute, step: float) -> tuple[Array, Bools]:
    """What cells (2, teeth, roll lengths, heights) count that a flank doesn't show and that of most teeth does.

    1 where readings lie beyond the gate instead, less where none are there, and no more than profiles fall on them.
    And where readings lie beyond the gate.
    """
    solid = solid_cells(grid)
    advance = step_on_flank(nominal, grid.rolls, step)
    lowest = grid.rolls - nominal.control_roll < step_on_flank(nominal, nominal.control_roll, step)
    shown = across_gaps(solid, grid, nominal, step)
    shown |= across_gaps(solid, grid, nominal, 2 * step) & lowest[:, None]  # no profile may lie below the first one
    cut = np.zeros_like(shown)
    if flanks.beyond is not None:
        at = cell_of(flanks.beyond, nominal, *grid.delta.shape[2:])
        beyond = np.bincount(at, minlength=grid.delta.size).reshape(grid.delta.shape)
        enough = np.maximum(CUT * grid.usual, FEW)
        cut = (beyond >= enough) & (grid.count < enough)
    missed = ~shown | cut
    missed &= (~missed).mean(axis=1, keepdims=True) >= ON_MOST
    profiles = np.minimum(nominal.gear.evaluation.resolution / advance, 1.0)[:, None]
    return np.where(missed, np.where(cut, 1.0, UNSEEN) * profiles, 0.0), cut


def _regions(count: Array, bridged: Bools) -> list[Bools]:
    """Stretches of cells (roll lengths, heights) that hang together in ``bridged`` and count enough."""
    from scipy.ndimage import label

    marked, number = label(bridged, np.ones((3, 3)))
    regions = ((count > 0) & (marked == n) for n in range(1, number + 1))
    return [r for r in regions if count[r].sum() >= (IN_ONE_ROW if r.any(axis=1).sum() == 1 else LEAST_CELLS)]


def _extent(grid: Grid, region: Bools) -> tuple[tuple[float, float], tuple[float, float]]:
    """Roll lengths and heights (mm, from and to) of a region."""
    ends = []
    for centres, on in ((grid.rolls, region.any(axis=1)), (grid.heights, region.any(axis=0))):
        half = (centres[1] - centres[0]) / 2 if centres.size > 1 else 0.0
        ends.append((float(centres[on][0] - half), float(centres[on][-1] + half)))
    return ends[0], ends[1]


def zones_of(grid: Grid, nominal: Involute, step: float) -> dict[Zone, Bools]:
    """Cells (roll lengths, heights) that figures are read from as their standard has them, and some more about them.

    Profile: at the middle of the face. Helix: on the measuring circle. Position: where both meet.
    """
    width = nominal.gear.evaluation.resolution + STEPS * float(step_on_flank(nominal, nominal.measuring_roll, step))
    height = TRACE * nominal.gear.face_width + (grid.heights[1] - grid.heights[0] if grid.heights.size > 1 else 0.0)
    circle = (np.abs(grid.rolls - nominal.measuring_roll) <= width)[:, None]
    middle = (np.abs(grid.heights - nominal.middle) <= height)[None, :]
    area = np.ones((grid.rolls.size, grid.heights.size), dtype=bool)
    return {"profile": area & middle, "helix": area & circle, "position": circle & middle, "area": area}


def reading(damages: tuple[Damage, ...], zone: Bools, side: int | None, tooth: int | None) -> tuple[Damage, ...]:
    """The regions that a figure reads which is told from ``zone`` (roll lengths, heights); None: of every flank."""
    return tuple(
        d for d in damages if side in (None, d.side) and tooth in (None, d.tooth) and bool((d.cells & zone).any())
    )
