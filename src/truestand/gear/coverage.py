"""How much of each flank was seen, and whether that is enough to say something.

Radial rays sample a flank coarsely near its root: one step of the table covers rb dtheta / sin^2 alpha of roll length.
A cell between two profiles is not hidden, so it counts as seen when its neighbours within one such step are.
"""

from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from truestand.gear.geometry import Involute
from truestand.gear.grid import Grid

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEAR = 0.15
"""Share of control length and face about the middle of the measuring circle that must be seen for a position."""
SOME = 0.2
"""Share of a row or column of cells that makes a point of a trace."""
STRAY = 0.05
"""Share of the flank's usual number of points below which a cell's points are strays."""
FINE = 0.25
"""mm of roll length that a step of the table should not exceed at the root."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Shares 0..1, (2, teeth)."""

    position: Array
    """Whether the tooth's position was seen: 0 or 1."""
    profile: Array
    helix: Array
    area: Array


def coverage_of(grid: Grid, nominal: Involute, step: float) -> Coverage:
    """What was seen of each flank; ``step``: table angle from one profile to the next, rad."""
    seen = across_gaps(solid_cells(grid), grid, nominal, step)
    (low, high), (bottom, top) = nominal.profile_range, nominal.helix_range
    rolls = (grid.rolls >= low) & (grid.rolls <= high)
    heights = (grid.heights >= bottom) & (grid.heights <= top)
    area = seen[:, :, rolls][:, :, :, heights]
    near_roll = np.abs(grid.rolls - nominal.measuring_roll) < NEAR * nominal.control_length
    near_height = np.abs(grid.heights - nominal.middle) < NEAR * nominal.gear.face_width
    near = seen[:, :, near_roll][:, :, :, near_height].mean(axis=(2, 3))
    return Coverage(
        (near >= 0.5).astype(np.float64),
        (area.mean(axis=3) > SOME).mean(axis=2),
        (area.mean(axis=2) > SOME).mean(axis=2),
        area.mean(axis=(2, 3)),
    )


def step_on_flank(nominal: Involute, roll: Array | float, step: float) -> Array:
    """Roll length (mm) that one step of the table covers."""
    square = np.square(np.asarray(roll, dtype=np.float64))
    sine = square / (square + nominal.base_radius**2)
    return np.asarray(nominal.base_radius * abs(step) / np.maximum(sine, 1e-6))


def profiles_for(nominal: Involute, roll: float, fine: float = FINE) -> int:
    """Profiles a turn with which a step covers ``fine`` mm of roll length there."""
    return ceil(2 * pi / (fine / float(step_on_flank(nominal, roll, 1.0))))


def solid_cells(grid: Grid) -> Bools:
    """Cells (2, teeth, roll lengths, heights) that hold more than strays."""
    return np.asarray(grid.count > STRAY * grid.usual)


def across_gaps(cells: Bools, grid: Grid, nominal: Involute, step: float) -> Bools:
    """The same cells (2, teeth, roll lengths, heights) and those within half a ``step`` of the table (rad) of them:
    what lies between two profiles."""
    width = grid.rolls[1] - grid.rolls[0] if grid.rolls.size > 1 else 1.0
    reach = np.ceil(step_on_flank(nominal, grid.rolls, step) / 2 / width).astype(np.intp)
    spread = np.zeros_like(cells)
    for i, r in enumerate(reach):
        spread[:, :, i] = cells[:, :, max(i - r, 0) : i + r + 1].any(axis=2)
    return spread
