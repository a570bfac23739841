"""What a map of r - R about an axis reads: circles at each height, the cylinder through all, roundness and run-out.

Circles and the cylinder are least squares of distances, for any offset from the axis; form goes through the Gaussian
filter along the circumference, the run-out that a section's own offset makes does not.
"""

from dataclasses import dataclass
from math import pi, tau

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.inspection import PARTIAL
from truestand.form.upr import UprFilter, filtered_evenly

STATISTICS = ("d", "roundness", "cylindricity", "runout", "total_runout")
STEPS = 5
"""Of the fits: each gains the ratio of radius to offset, 10 and more."""
GAP = 1.5
"""Of half the shortest wave that passes the filter: the largest gap of a closed profile (as in ``form.upr``)."""


@dataclass(frozen=True, slots=True)
class Rings:
    """A section's cells: which were seen, and what the fits need of it."""

    radius: float
    """mm, nominal."""
    angle: Array
    """(A,) rad."""
    height: Array
    """(H,) mm."""
    seen: Mask
    """(H, A)."""
    cutoff: float

    @property
    def used(self) -> Mask:
        """(H,) heights with enough of their circumference to hold a circle."""
        return np.asarray(self.seen.mean(axis=1) >= PARTIAL)

    @property
    def closed(self) -> Mask:
        """(H,) heights with a closed circumference, as far as the filter can tell."""
        highest = max(1, min(UprFilter(self.cutoff).highest, self.angle.size / 4))
        limit = GAP * pi / highest / (tau / self.angle.size)
        return np.array([_widest_gap(row) <= limit for row in self.seen])

    @property
    def coverage(self) -> float:
        """Share of the section's surface that was seen."""
        return float(self.seen.mean())


@dataclass(frozen=True, slots=True)
class Reading:
    """What a map reads; the leading axes are those of the maps that were given."""

    statistics: Array
    """(..., 5) mm, in the order of ``STATISTICS``."""
    form: Array
    """(..., H, A) mm: filtered deviations from each height's own circle; NaN = not seen."""
    travel: Array
    """(..., H, A) mm: what an indicator shows that turns about the datum axis."""
    centres: Array
    """(..., H, 2) mm of the circles."""


def _widest_gap(seen: Mask) -> float:
    """Cells from one seen to the next around the circle; infinite where there is none."""
    at = np.flatnonzero(seen)
    if not at.size:
        return float("inf")
    return float(np.diff(np.append(at, at[0] + seen.size)).max())


def read_rings(rings: Rings, deviation: Array) -> Reading:
    """What maps (..., H, A) mm of r - R about the datum axis read; at least one height must be ``used``."""
    weight = rings.seen & rings.used[:, None]
    radius = rings.radius + np.where(weight, deviation, 0.0)
    centres, form = _circles(rings, weight, radius)
    passed = _filtered(rings, weight, form)
    rough = form - passed
    own, mean = _cylinder(rings, weight, radius)
    travel = radius - rings.radius - rough
    statistics = [
        2 * mean, _range(passed, weight, -1).max(axis=-1), _range(own - rough, weight, (-2, -1)),
        _range(travel, weight, -1).max(axis=-1), _range(travel, weight, (-2, -1)),
    ]  # fmt: skip
    nothing = np.where(weight, 0.0, np.nan)
    return Reading(np.stack(statistics, axis=-1), passed + nothing, travel + nothing, centres)


def _circles(rings: Rings, weight: Mask, radius: Array) -> tuple[Array, Array]:
    """Centres (..., H, 2) of the least-squares circle of each height, and the deviations (..., H, A) from it."""
    design = np.column_stack([np.cos(rings.angle), np.sin(rings.angle), np.ones(rings.angle.size)])
    normal = np.einsum("ha,ai,aj->hij", weight.astype(np.float64), design, design)
    normal[~rings.used] = np.eye(3)
    inverse = np.linalg.inv(normal)
    found = np.zeros((*radius.shape[:-1], 3))
    distance = radius
    for _ in range(STEPS):
        right = np.where(weight, distance - found[..., 2, None], 0.0) @ design
        found = found + np.einsum("hij,...hj->...hi", inverse, right)
        across = radius * design[:, 0] - found[..., 0, None]
        distance = np.hypot(across, radius * design[:, 1] - found[..., 1, None])
    return found[..., :2], np.where(weight, distance - found[..., 2, None], 0.0)


def _cylinder(rings: Rings, weight: Mask, radius: Array) -> tuple[Array, Array]:
    """Deviations (..., H, A) from the least-squares cylinder, and its radius (...)."""
    lever = (rings.height - rings.height.mean()) / max(float(np.ptp(rings.height)), 1.0)
    cos, sin = np.cos(rings.angle), np.sin(rings.angle)
    ones = np.ones((rings.height.size, 1))
    columns = [ones * cos, ones * sin, ones * np.ones(cos.size)]
    if np.count_nonzero(rings.used) > 1:
        columns += [lever[:, None] * cos, lever[:, None] * sin]
    design = np.stack([np.where(weight, c, 0.0).ravel() for c in columns])
    inverse = np.linalg.inv(design @ design.T) @ design
    found = np.zeros((*radius.shape[:-2], design.shape[0]))
    distance = radius
    for _ in range(STEPS):
        left = np.where(weight, distance - found[..., 2, None, None], 0.0)
        found = found + left.reshape(*left.shape[:-2], -1) @ inverse.T
        lean = found[..., 3:] if found.shape[-1] > 3 else np.zeros((*found.shape[:-1], 2))
        x, y = (found[..., i, None, None] + lean[..., i, None, None] * lever[:, None] for i in (0, 1))
        distance = np.hypot(radius * cos - x, radius * sin - y)
    return np.where(weight, distance - found[..., 2, None, None], 0.0), found[..., 2]


def _filtered(rings: Rings, weight: Mask, form: Array) -> Array:
    """The Gaussian filter along each circumference; gaps are bridged straight from end to end."""
    bridged = form.copy()
    for h in np.flatnonzero(rings.used & ~weight.all(axis=1)):
        bridged[..., h, :] = form[..., h, :] @ _bridge(weight[h])
    return filtered_evenly(bridged, UprFilter(rings.cutoff))


def _bridge(seen: Mask) -> Array:
    """(A, A): seen values to all values, straight lines across the gaps."""
    n, at = seen.size, np.flatnonzero(seen)
    matrix = np.zeros((n, n))
    matrix[at, at] = 1.0
    for start, stop in zip(at, np.append(at[1:], at[0] + n), strict=True):
        for k in range(start + 1, stop):
            share = (k - start) / (stop - start)
            matrix[start, k % n] += 1.0 - share
            matrix[stop % n, k % n] += share
    return matrix


def _range(values: Array, weight: Mask, axes: int | tuple[int, ...]) -> Array:
    """Range along some axes of the map; 0 where nothing was seen."""
    high, low = np.where(weight, values, -np.inf).max(axis=axes), np.where(weight, values, np.inf).min(axis=axes)
    return np.asarray(np.where(np.isfinite(high), high - low, 0.0))
