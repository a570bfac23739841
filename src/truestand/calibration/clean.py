"""Which readings are worth looking at when nothing is known yet. Nothing is dropped: a mask comes back."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEIGHBOUR_SLOPE = 4.0
"""Steepest surface, range over x, that a neighbouring reading still supports (76 degrees against the line)."""


def supported(x: Array, z: Array) -> NDArray[np.bool_]:
    """Mask (N, M) of readings that a neighbour on the same profile supports.

    A surface continues from point to point; a spike or a ghost stands alone. Two of three random spikes next to each
    other would pass: what is left is for the robust fit to reject.
    """
    dx = np.abs(np.diff(x, axis=1))
    dz = np.abs(np.diff(z, axis=1))
    pitch = float(np.nanmedian(dx)) if np.isfinite(dx).any() else 0.0
    with np.errstate(invalid="ignore"):
        close = dz <= NEIGHBOUR_SLOPE * (dx + pitch)
    mask = np.zeros(z.shape, dtype=np.bool_)
    mask[:, :-1] |= close
    mask[:, 1:] |= close
    return mask
