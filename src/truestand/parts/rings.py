"""What a map of r - R about an axis reads: circles at each height, the cylinder through all, roundness and run-out.

Circles and the cylinder are least squares of distances, for any offset from the axis; form goes through the Gaussian
filter along the circumference, the run-out that a section's own offset makes does not.
"""

from dataclasses import dataclass, replace
from math import pi, tau

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.inspection import PARTIAL
from truestand.core.robust import nan_median, tukey_fit
from truestand.form.upr import UprFilter, filtered_evenly

STATISTICS = ("d", "roundness", "cylindricity", "runout", "total_runout")
STEPS = 5
"""Of the fits: each gains the ratio of radius to offset, 10 and more."""
GAP = 1.5
"""Of half the shortest wave that passes the filter: the largest gap of a closed profile (as in ``form.upr``)."""
PLACES = 9
"""Heights at which a trend is looked at, from end to end: a parabola's peak lies within a sixteenth of one."""
FEW_WAVES = 3
"""Waves around, whose growth along the height is looked at: centre, oval, three lobes."""
MOST_OFF = 0.25
"""Of what a trend goes along the height: so far heights may lie off it."""
STEEPER, USUAL = 4.0, 0.25
"""Times the usual change from one height to the next that makes it a step, and which share of them is no larger than
usual: a groove takes most heights of a short section.
"""
ROUGH_CELLS = 1e-3
"""mm: means of cells that lie nearer to the trend are never outliers."""


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


@dataclass(frozen=True, slots=True)
class Trend:
    """How a section's shape goes along its height: r - R (mm) as a sum of few waves around times powers of t."""

    low: float
    high: float
    """mm: the section's ends, t = -1 and 1."""
    factors: Array
    """(P, 2 FEW_WAVES + 1) mm: of 1, cos and sin of each wave, for the powers 0 to P - 1 of t."""

    def along(self, height: Array) -> Array:
        """(n, 2 FEW_WAVES + 1) mm: factors of the waves at heights (n,) mm."""
        return np.asarray(self._powers(height) @ self.factors)

    def at(self, angle: Array, height: Array) -> Array:
        """r - R (n,) mm at polar angles (n,) rad and heights (n,) mm."""
        return np.asarray(np.einsum("nw,nw->n", self.along(height), _waves(angle)))

    @property
    def mean(self) -> float:
        """mm of r - R, from end to end and all round."""
        k = np.arange(0, len(self.factors), 2)  # odd powers have none
        return float((self.factors[k, 0] / (k + 1)).sum())

    def _powers(self, height: Array) -> Array:
        t = (2 * height - self.low - self.high) / (self.high - self.low)
        return np.asarray(t[:, None] ** np.arange(len(self.factors)))


LEVEL = Trend(-1.0, 1.0, np.zeros((1, 2 * FEW_WAVES + 1)))
"""That goes nowhere."""


def _waves(angle: Array) -> Array:
    """(n, 2 FEW_WAVES + 1): 1, cosines and sines of the few waves at polar angles (n,) rad."""
    turned = angle[:, None] * np.arange(1, FEW_WAVES + 1)
    return np.concatenate([np.ones((angle.size, 1)), np.cos(turned), np.sin(turned)], axis=1)


def trend_of(low: float, high: float, angle: Array, height: Array, mean: Array) -> Trend:
    """The trend of cells (H, A) with means of r - R (mm; NaN: not seen): a parabola where their heights can tell.

    Level where the heights are none: a parabola through a step or a kink reaches beyond both sides of it.
    """
    seen = np.isfinite(mean)
    powers = min(3, int(np.count_nonzero(seen.mean(axis=1) >= PARTIAL)))
    flat = Trend(low, high, np.zeros((powers, 2 * FEW_WAVES + 1)))
    if not powers:
        return flat
    row, column = np.nonzero(seen)
    design = flat._powers(height)[row][:, :, None] * _waves(angle)[column][:, None, :]
    factors, _ = tukey_fit(design.reshape(row.size, -1), mean[seen], ROUGH_CELLS)
    trend = Trend(low, high, factors.reshape(powers, -1))
    left = mean[seen] - trend.at(angle[column], height[row])
    shares = np.stack([np.bincount(row, left * wave, height.size) for wave in _waves(angle)[column].T])
    on, norm = seen.any(axis=1), np.where(np.arange(len(shares)) > 0, 2.0, 1.0)
    off = norm[:, None] * shares[:, on] / seen.sum(axis=1)[on]
    follows = np.ptp(off, axis=1).max() <= MOST_OFF * np.ptp(trend.along(height), axis=0).max()
    return trend if follows else flat


def read_trend(rings: Rings, deviation: Array, trend: Trend, low: float, high: float) -> Array:
    """What more (5,) mm a map (H, A) reads where it goes on between its heights, and beyond them, as the trend does;
    ``low`` to ``high`` mm.
    """
    used = np.flatnonzero(rings.used)
    places = np.linspace(low, high, PLACES)
    nearest = used[np.abs(places[:, None] - rings.height[used]).argmin(axis=1)]
    further = (trend.along(places) - trend.along(rings.height[nearest])) @ _waves(rings.angle).T
    seen = np.concatenate([rings.seen, rings.seen[nearest]])
    longer = Rings(rings.radius, rings.angle, np.append(rings.height, places), seen, rings.cutoff)
    longer_map = np.concatenate([deviation, deviation[nearest] + further])
    more = np.maximum(read_rings(longer, longer_map).statistics - read_rings(rings, deviation).statistics, 0.0)
    more[0] = 2 * (trend.mean - trend.along(rings.height[used])[:, 0].mean())
    return np.asarray(more)


def read_edges(rings: Rings, deviation: Array, share: Array, steep: float) -> Array:
    """By how much (5,) mm a map (H, A) reads more or less where a ``share`` (H, A) of cells at steep edges is as what
    lies beside them. ``steep`` mm: from one cell to the next.
    """
    beside = np.stack([np.roll(deviation, k, axis=-1) for k in (-1, 0, 1)])
    down, up = deviation - np.fmin.reduce(beside), np.fmax.reduce(beside) - deviation
    with np.errstate(invalid="ignore"):
        down, up = (share * np.where(rise > steep, rise, 0.0) for rise in (down, up))
    if not down.any():
        return np.zeros(len(STATISTICS))
    moved = deviation - down, deviation + up
    apart = read_rings(rings, np.stack(moved)).statistics - read_rings(rings, deviation).statistics
    return np.asarray(np.abs(apart).max(axis=0))


def read_steps(rings: Rings, deviation: Array, steep: float) -> Array:
    """By how much (5,) mm a map (H, A) reads less without the heights at which a step runs all round: a groove, a
    shoulder. There the readings of one height lie on both sides of it, here more on one, there on the other, and the
    circle reads a form that it has not. ``steep`` mm: from one height to the next at least.

    What is read over all heights together holds the step itself, which is form.
    """
    none = np.zeros(len(STATISTICS))
    step = np.nan_to_num(nan_median(np.abs(np.diff(deviation, axis=0)), axis=1))
    at = step > max(steep, STEEPER * float(np.quantile(step, USUAL)) if step.size else 0.0)
    beside = np.append(at, False) | np.append(False, at)
    smooth = replace(rings, seen=rings.seen & ~beside[:, None])
    if not beside.any() or not smooth.used.any():
        return none
    less = read_rings(rings, deviation).statistics - read_rings(smooth, deviation).statistics
    return np.where([name in ("roundness", "runout") for name in STATISTICS], np.maximum(less, 0.0), none)


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
