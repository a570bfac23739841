"""Rays that should have met a flank, and cells in which they show nothing of it.

A profile meets a flank at one roll length at each height, and its geometry says where. Where profiles should have met
it and no reading lies, that is no gap between two profiles: the flank is broken there, covered, or readings got lost.
"""

from dataclasses import dataclass
from math import ceil, floor, tau

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.calibration import Calibration
from truestand.core.robust import nan_median
from truestand.core.scan import Scan
from truestand.core.surface import seen_at, table_angle
from truestand.gear.flanks import Toothing
from truestand.gear.grid import Grid, bin_index

KNOTS = 12
"""Roll lengths at which it is worked out when a flank is met."""
MOST_OFF = 0.1
"""mm of delta that a smooth flank may say where nothing was seen of it."""
BESIDE = 1
"""Cells of roll length beside the one in which a ray should meet the flank where its reading may lie."""
AT_END = 2
"""Cells at the lower end of the evaluation range that are left out: rays may meet the flank below it."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Cells (2, teeth, roll lengths, heights) in which a ray should meet a flank."""

    expected: Mask
    missed: Mask
    """Those of them without a reading, there or beside."""

    @property
    def lost(self) -> Array:
        """Share (2, 1, roll lengths, 1) of the cells of each side and roll length that are missed: the steeper a flank
        is seen, the more readings get lost on sound ones too.
        """
        expected, missed = (n.sum(axis=(1, 3), keepdims=True) for n in (self.expected, self.missed))
        return np.asarray(missed / np.maximum(expected, 1))


def rays_on_flanks(grid: Grid, surface: Array, toothing: Toothing, scan: Scan, calibration: Calibration) -> Rays:
    """The rays that should meet flanks which stand at ``surface`` (2, teeth, roll lengths, heights) mm of delta, but at
    heights that stand elsewhere as a whole: in a groove along the profile.
    """
    nominal, (low, high) = grid.nominal, grid.nominal.profile_range
    rows = np.unique(np.linspace(0, grid.rolls.size - 1, KNOTS).astype(np.intp))
    stands = surface[:, :, rows] + nan_median(grid.delta - surface, axis=2)[:, :, None]
    met = _met_at(toothing, calibration, grid, rows, np.clip(np.nan_to_num(stands), -MOST_OFF, MOST_OFF))
    angle = np.sort(table_angle(scan, calibration)[np.isfinite(scan.z).any(axis=1)])
    expected = np.zeros(grid.delta.shape, dtype=bool)
    for side, tooth, column in np.ndindex(2, nominal.gear.teeth, grid.heights.size):
        roll = _rolls_met(angle, met[side, tooth, :, column], grid.rolls[rows])
        roll = roll[(roll > low + AT_END * grid.size[0]) & (roll < high)]
        expected[side, tooth, bin_index(roll, nominal.control_roll, nominal.tip_roll, grid.rolls.size), column] = True
    return Rays(expected, expected & ~_beside(grid.seen))


def _met_at(toothing: Toothing, calibration: Calibration, grid: Grid, rows: NDArray[np.intp], delta: Array) -> Array:
    """Table angle (2, teeth, rows, heights) rad at which flanks at ``delta`` (same shape) mm come into the plane."""
    side, tooth, i, j = np.indices(delta.shape).reshape(4, -1)
    points = toothing.points((side, tooth), grid.rolls[rows][i], grid.heights[j], delta.reshape(-1))
    return np.asarray(np.unwrap(seen_at(calibration, points).reshape(delta.shape), axis=2))


def _rolls_met(angle: Array, met: Array, rolls: Array) -> Array:
    """Roll lengths (m,) mm at which profiles at increasing table angles (n,) rad meet a flank.

    ``met`` (k,) rad: table angle at which it is met at ``rolls`` (k,) mm; NaN: never.
    """
    if not angle.size or not np.isfinite(met).all():
        return np.zeros(0)
    upward = slice(None, None, 1 if met[-1] >= met[0] else -1)
    low, high = float(met.min()), float(met.max())
    found = []
    for turn in range(floor((angle[0] - high) / tau), ceil((angle[-1] - low) / tau) + 1):
        first, last = np.searchsorted(angle, [low + tau * turn, high + tau * turn])
        found.append(np.interp(angle[first:last] - tau * turn, met[upward], rolls[upward]))
    return np.concatenate(found)


def _beside(seen: Mask) -> Mask:
    """The same cells (2, teeth, roll lengths, heights) and those beside them along the roll length."""
    wider = seen.copy()
    for k in range(1, BESIDE + 1):
        wider[:, :, k:] |= seen[:, :, :-k]
        wider[:, :, :-k] |= seen[:, :, k:]
    return wider
