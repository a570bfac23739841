"""Sag beyond first order: what a laser plane that is not well known leaves in the other unknowns.

A surface at x aside of the axis lies x^2 / 2 R nearer to the axis than beside it. About a plane that is taken to go
through the axis sag has no slope, and no covariance carried along slopes shows what a plane that lies elsewhere does:
offset times tilt turns phi, their squares move the sensor. That is what second differences are for.
"""

import numpy as np

from truestand.calibration.model import PLANE
from truestand.calibration.refine import Refined
from truestand.core.arrays import Array

NO_PLANE = 1e-18 * np.eye(2)
"""mm2, rad2: of a plane that is held."""
MOMENTS = np.array([[3.0, 0.0, 1.0], [0.0, 4.0, 0.0], [1.0, 0.0, 3.0]]) / 4.0
"""Of (z1^2, 2 z1 z2, z2^2) / 2 for z1, z2 normal, independent, of unit variance: E z^4 = 3."""


def covariance_of_sag(fit: Refined, plane: Array) -> Array:
    """Second moments (p, p) of how the unknowns follow the laser plane beyond their slopes; nothing of the plane's own.

    ``plane`` (2, 2): covariance of its offset and tilt, taken to be normal: L (z1, z2) with L L' that covariance. The
    others move by (z1^2 a + 2 z1 z2 b + z2^2 c) / 2.
    """
    moves = fit.following(_bends(fit, np.asarray(np.linalg.cholesky(plane + NO_PLANE))), held=PLANE)
    return np.asarray(moves @ MOMENTS @ moves.T)


def _bends(fit: Refined, root: Array) -> Array:
    """Second differences (n, 3) mm of the residuals along the columns of ``root`` (2, 2): a, b and c."""
    p = fit.solution.parameters[: fit.model.size]

    def moved(*by: float) -> Array:
        there = p.copy()
        there[list(PLANE)] += root @ by
        return fit.model.residuals(there, fit.cells.readings)

    still = 2.0 * moved(0.0, 0.0)
    first, second = (moved(*by) + moved(*-by) - still for by in np.eye(2))
    both = moved(1.0, 1.0) + moved(-1.0, -1.0) - still
    return np.stack([first, (both - first - second) / 2.0, second], axis=1)
