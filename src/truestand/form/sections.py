"""A calibrated surface cut into cells: robust means over polar angle and height, as form is read from them.

Millions of readings of one cylinder become some thousand points. A mean of many readings has less noise than one of
them, which is what makes micrometres of form visible under five micrometres of noise.
"""

import numpy as np

from truestand.core.arrays import Array
from truestand.core.errors import NotEnoughData
from truestand.core.robust import trimmed_means
from truestand.core.surface import Surface

NEAR_MM = 0.5
"""mm: readings this near to the drawing's radius are the surface's."""
LEAST_READINGS, USUAL_READINGS = 3, 9
"""A cell's at least; and on average at least, lest cells are filled where profiles happen to meet the section only, and
the feature leans there: of fewer readings, cells are wider."""
LEAST_AROUND = 36
CIRCLE_CELLS, CYLINDER_CELLS = (720, 1), (180, 20)
"""Cells around and along."""
SECTION = 0.5
"""mm: height of a section."""


def section(surface: Surface, radius: float, low: float, high: float, cells: tuple[int, int]) -> Array:
    """Cell means (n, 3) mm in C of the readings near ``radius`` (mm) between two heights (mm in C).

    Raises:
        NotEnoughData: fewer than a tenth of the cells hold readings.
    """
    on = (surface.z >= low) & (surface.z < high)
    x, y, z = (part[on] for part in (surface.x, surface.y, surface.z))
    deviation = np.hypot(x, y) - radius
    near = np.abs(deviation) < NEAR_MM
    x, y, z, deviation = x[near], y[near], z[near], deviation[near]
    around, along = cells
    around = max(min(around, x.size // (USUAL_READINGS * along)), LEAST_AROUND)
    column = ((np.arctan2(y, x) / (2 * np.pi) + 0.5) * around).astype(np.intp) % around
    row = np.minimum(((z - low) / (high - low) * along).astype(np.intp), along - 1)
    means, count = trimmed_means(row * around + column, deviation, around * along)
    full = count >= LEAST_READINGS
    if np.count_nonzero(full) < 0.1 * full.size:
        raise NotEnoughData(
            f"found readings in {np.count_nonzero(full)} of {full.size} cells between {low:.2f} and {high:.2f} mm at "
            f"radius {radius:.3f} mm, need a tenth; look at another height or surface"
        )
    angle = ((np.arange(around) + 0.5) / around - 0.5) * 2 * np.pi
    height = low + (np.arange(along) + 0.5) * (high - low) / along
    psi, level = np.tile(angle, along)[full], np.repeat(height, around)[full]
    rho = radius + means[full]
    return np.column_stack([rho * np.cos(psi), rho * np.sin(psi), level])


def run_out(points: Array) -> float:
    """Indicator travel of points (n, 3) mm about C's axis, mm: circular for one section, total for many (ISO 1101)."""
    return float(np.ptp(np.hypot(points[:, 0], points[:, 1])))
