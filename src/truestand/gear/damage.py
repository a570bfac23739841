"""What a flank's figures leave out: regions whose readings depart together, and regions that no reading confirms.

The weights that keep outliers out of the figures (``evaluate.weights_of``) also keep out a groove; cells leave out a
minority of their readings (``grid.CLIP``); readings too far from their flank are cut away before
(``flanks.GATE``). One cell that departs is dirt, a region of cells is material. Its depth goes into U of every figure
that is read there; where the depth isn't known, or a flank doesn't show what the same flank of most teeth shows, the
figure is undecided.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.gear.evaluate import Weights, residuals
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import FLANKS
from truestand.gear.grid import Grid, bridge_gaps, cell_of, step_on_flank

Zone = Literal["profile", "helix", "position", "area"]

LEFT_OUT = 0.1
"""Weight below which a cell is left out: 3.9 robust standard deviations off."""
DEPARTS, SHARE, FEW = 5.0, 0.25, 2
"""Robust standard deviations by which a reading departs; share and number of such readings that mark a cell."""
LEAST_CELLS, IN_ONE_ROW = 4, 8
"""Cells that make a region, and so many where they lie in one row: fewer may be outliers, or speckle."""
UNSEEN = 0.25
"""Weight of a cell that is merely not seen: readings get lost on sound flanks too."""
DEPTH_QUANTILE = 0.98
"""Quantile of a region's readings that is its depth: the last few may be outliers."""
CONFIRMED = 0.5
"""Of a cell's usual readings: with fewer on the flank and as many outside the gate, the cell is not confirmed."""
ON_MOST = 0.75
"""Share of the teeth that must show a cell for it to be missed on the others."""
TRACE_SHARE = 1 / 20
"""Share of the face to either side of its middle in which profile and position are read."""
STEPS_ACROSS = 3.0
"""Steps of the table that a region must be wide for its depth to be known."""
STEPS_BESIDE = 1.5
"""Steps of the table to either side of the measuring circle over which position and helix are read."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A region of one flank that its figures leave out."""

    side: int
    """0 left, 1 right."""
    tooth: int
    """From 0."""
    cells: Mask
    """(roll lengths, heights)."""
    depth: float | None
    """mm by which its readings depart, positive into the material; None: not seen, or outside the gate."""
    outside_gate: bool
    """Whether readings lie outside the gate instead, ``flanks.GATE`` mm and more from the flank."""
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


def damage_of(flanks: Flanks, weights: Weights, step: float) -> tuple[Damage, ...]:
    """Regions of cells inside the evaluation ranges that the figures leave out, tooth by tooth.

    ``step``: table angle from one profile to the next, rad.
    """
    grid, teeth = weights.grid, weights.grid.nominal.gear.teeth
    rest = residuals(grid.delta, weights)
    cell = cell_of(flanks, grid.nominal, *grid.delta.shape[2:])
    depth = (grid.delta - rest).reshape(-1)[cell] - flanks.delta
    left_out = (weights.weight.reshape(rest.shape) < LEFT_OUT) & np.isfinite(grid.delta)
    far = DEPARTS * grid.scatter
    unconfirmed, outside_gate = _unconfirmed(flanks, grid, step)
    found = []
    for sign, count in (
        (1, (left_out & (rest < 0)) | _departing(cell[depth > far], grid)),
        (-1, (left_out & (rest > 0)) | _departing(cell[depth < -far], grid)),
        (0, unconfirmed),
    ):
        count = np.where(grid.in_ranges, count, 0.0)
        bridged = bridge_gaps(count > 0, grid, step)
        for side, tooth in np.argwhere((count > 0).any(axis=(2, 3))):
            own = np.flatnonzero(flanks.flank == side * teeth + tooth)
            for region in _regions(count[side, tooth], bridged[side, tooth]):
                depths = depth[own[region.reshape(-1)[cell[own] % region.size]]] if sign else None
                found.append(_damage(grid, int(side), int(tooth), region, depths, sign, step, outside_gate))
    return tuple(sorted(found, key=lambda d: (d.tooth, d.side, d.rolls, d.heights)))


def _damage(
    grid: Grid, side: int, tooth: int, region: Mask, depths: Array | None, sign: int, step: float, outside_gate: Mask
) -> Damage:
    """One region, with the ``depths`` (n,) mm of its readings; None: the flank is not confirmed there."""
    rolls = _extent(grid.rolls, grid.size[0], np.asarray(region.any(axis=1)))
    heights = _extent(grid.heights, grid.size[1], np.asarray(region.any(axis=0)))
    if depths is None:
        return Damage(side, tooth, region, None, bool(outside_gate[side, tooth][region].any()), False, rolls, heights)
    depth = sign * float(np.quantile(sign * depths, DEPTH_QUANTILE))
    coarse = STEPS_ACROSS * float(step_on_flank(grid.nominal, sum(rolls) / 2, step))
    return Damage(side, tooth, region, depth, False, rolls[1] - rolls[0] >= coarse, rolls, heights)


def _departing(cell: NDArray[np.int64], grid: Grid) -> Mask:
    """Cells (2, teeth, roll lengths, heights) of which many a reading departs, by the cells (n,) of those that do."""
    number = np.bincount(cell, minlength=grid.delta.size).reshape(grid.delta.shape)
    return np.asarray(number >= np.maximum(SHARE * grid.count, FEW))


def _unconfirmed(flanks: Flanks, grid: Grid, step: float) -> tuple[Array, Mask]:
    """Weights of cells (2, teeth, roll lengths, heights) that a flank doesn't show and that of most teeth does.

    1 where readings lie outside the gate instead, less where none are there, and no more than profiles fall on them.
    And where readings lie outside the gate.
    """
    nominal = grid.nominal
    advance = step_on_flank(nominal, grid.rolls, step)
    lowest = grid.rolls - nominal.control_roll < step_on_flank(nominal, nominal.control_roll, step)
    shown = bridge_gaps(grid.solid, grid, step)
    shown |= bridge_gaps(grid.solid, grid, 2 * step) & lowest[:, None]  # no profile may lie below the first one
    at = cell_of(flanks.outside_gate, nominal, *grid.delta.shape[2:])
    outside = np.bincount(at, minlength=grid.delta.size).reshape(grid.delta.shape)
    enough = np.maximum(CONFIRMED * grid.usual, FEW)
    cut = (outside >= enough) & (grid.count < enough)
    missed = ~shown | cut
    missed &= (~missed).mean(axis=1, keepdims=True) >= ON_MOST
    profiles = np.minimum(nominal.gear.evaluation.resolution / advance, 1.0)[:, None]
    return np.where(missed, np.where(cut, 1.0, UNSEEN) * profiles, 0.0), cut


def _regions(count: Array, bridged: Mask) -> list[Mask]:
    """Stretches of cells (roll lengths, heights) that hang together in ``bridged`` and count enough."""
    from scipy.ndimage import label

    marked, number = label(bridged, np.ones((3, 3)))
    regions = ((count > 0) & (marked == n) for n in range(1, number + 1))
    return [r for r in regions if count[r].sum() >= (IN_ONE_ROW if r.any(axis=1).sum() == 1 else LEAST_CELLS)]


def _extent(centres: Array, size: float, on: Mask) -> tuple[float, float]:
    """From and to (mm) of some cells with ``centres`` (n,) and a ``size`` in mm."""
    return float(centres[on][0] - size / 2), float(centres[on][-1] + size / 2)


def zones_of(grid: Grid, step: float) -> dict[Zone, Mask]:
    """Cells (roll lengths, heights) that figures are read from as their standard has them, and some more about them.

    Profile: at the middle of the face. Helix: on the measuring circle. Position: where both meet.
    """
    nominal = grid.nominal
    width = nominal.gear.evaluation.resolution + STEPS_BESIDE * float(
        step_on_flank(nominal, nominal.measuring_roll, step)
    )
    height = TRACE_SHARE * nominal.gear.face_width + grid.size[1]
    circle = (np.abs(grid.rolls - nominal.measuring_roll) <= width)[:, None]
    middle = (np.abs(grid.heights - nominal.middle) <= height)[None, :]
    area = np.ones((grid.rolls.size, grid.heights.size), dtype=bool)
    return {"profile": area & middle, "helix": area & circle, "position": circle & middle, "area": area}


def damage_in(damages: tuple[Damage, ...], zone: Mask, side: int | None, tooth: int | None) -> tuple[Damage, ...]:
    """The regions that touch a figure read from ``zone`` (roll lengths, heights) of a flank; None: of every flank."""
    return tuple(
        d for d in damages if side in (None, d.side) and tooth in (None, d.tooth) and bool((d.cells & zone).any())
    )
