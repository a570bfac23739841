"""How much of what comes along the shaft's own rays is not the shaft."""

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.model import Readings
from truestand.calibration.refine import Refined
from truestand.core.frames import facing
from truestand.core.scan import Scan

Array = NDArray[np.float64]

PROFILES = 120
REACH = 5.0
"""mm from the surface within which a reading is held against the model."""
OFTEN = 0.1
"""Share of a ray's readings that must be the shaft's for it to be one of the shaft's rays."""
INSIDE = 0.1
"""mm that the shaft's readings of a ray must keep from the ends of what is measured on."""


def stray_share(scan: Scan, fit: Refined) -> float:
    """Share of the readings, along rays that always meet one surface, that lie off it; 0 where no ray does.

    Wild readings lie anywhere, so they are not seen near the surface; but their rays are known.
    """
    rows = np.unique(np.linspace(0, scan.profiles - 1, PROFILES).astype(np.intp))
    x, z, p = scan.x[rows], scan.z[rows], fit.solution.parameters
    u = facing(p[0]) * (cos(p[0]) * x - sin(p[0]) * z) + p[1]
    v = sin(p[0]) * x + cos(p[0]) * z + fit.model.height
    time = rows / max(scan.profiles - 1, 1) - 0.5
    seen = stray = 0
    for k, band in enumerate(fit.segments.bands):
        with np.errstate(invalid="ignore"):
            near = (v > band.low) & (v < band.high) & (np.abs(u - fit.model.radii[k]) < REACH)
        row, column = np.nonzero(near)
        if not row.size:
            continue
        which = np.full(row.size, k, dtype=np.intp)
        readings = Readings(x[row, column], z[row, column], scan.angle[rows][row], time[row], which)
        own = np.abs(fit.model.residuals(p, readings)) < fit.limit
        count = np.count_nonzero(np.isfinite(z), axis=0)
        shaft = np.bincount(column[own], minlength=z.shape[1])
        low, high = np.full(z.shape[1], np.inf), np.full(z.shape[1], -np.inf)
        np.minimum.at(low, column[own], v[row, column][own])
        np.maximum.at(high, column[own], v[row, column][own])
        rays = (shaft > OFTEN * count) & (low > band.low + INSIDE) & (high < band.high - INSIDE)
        seen += int(count[rays].sum())
        stray += int((count - shaft)[rays].sum())
    return stray / seen if seen else 0.0
