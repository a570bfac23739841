"""A part's deviations on patches of its surface: robust means over cells of angle and height.

Readings that are anywhere (dust, reflections, another surface) don't move a patch: its median stands while most of its
readings are the surface's, and the mean is taken of what lies about it. Nothing is dropped in the record; what is not
trusted only doesn't count here.
"""

from dataclasses import dataclass
from math import pi, prod, tau

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.robust import medians, robust_sd

TRUSTED = 6.0
"""Robust standard deviations from the patch's median within which a reading counts."""
LEAST_READINGS = 3
LEAST_SHARE = 0.15
"""Of the usual number of a patch's readings: fewer are outliers."""
PRIOR_READINGS = 2.0
"""Readings' worth of the usual scatter that go into each patch's own."""
OFF_SIGMA = 6.0
"""Standard deviations of a patch's mean from which it lies off the others."""
MANY, SHARE = 3, 0.1
"""Readings to one side of the trusted ones, and their share of the patch, that are no outliers."""
FULL = 0.5
"""Of the usual number of a patch's readings: so many that don't agree are no outliers."""
PASSED_OVER = 1
"""Readings at either end of a patch that may be outliers and are no lowest or highest."""
DEPARTS = 3.0
"""Standard deviations of a reading from which it departs."""
LEAST_DEEPER, MOST_DEEPER = 1.25, 2.5
"""Factors: of a bowl of a patch's size; of one that is hardly seen."""
SCATTER_READINGS = 200_000
"""Readings that the scatter is taken from."""
LEAST_SCATTER = 5e-4
"""mm: no sensor reads better; below it, readings differ by where in the cell they lie."""


@dataclass(frozen=True, slots=True)
class Readings:
    """Readings of a surface: where they stand in the scan (n,), their deviations (n,) mm and cells (n,)."""

    flat: Ints
    deviation: Array
    cell: Ints
    lone: Mask | None = None
    """(n,): those that nothing bears out (``statistics.lone_readings``); None: not known."""


@dataclass(frozen=True, slots=True)
class Patches:
    """Means over a grid's cells, (H, A) or (H, A, R): heights from below, polar angles from -pi, radii from within."""

    mean: Array
    """mm; NaN = not seen."""
    count: Ints
    """Trusted readings."""
    scatter: float
    """mm: standard deviation of one trusted reading about its patch."""
    noise: Array
    """mm: standard deviation of the means, where a reading's noise is its own; 0 where nothing was seen. Steep
    surfaces scatter less along their normal: each patch has its own."""
    pick: Ints
    """Position of one trusted reading of each patch among those that were given; -1 = none."""

    @property
    def seen(self) -> Mask:
        """Patches that were seen."""
        return np.asarray(np.isfinite(self.mean))


@dataclass(frozen=True, slots=True)
class Grid:
    """Cells of equal angle about the axis and equal height from ``low`` to ``high`` mm, and of equal radius up to
    ``outer`` mm where ``radii`` is given: a face square to the axis lies at one height."""

    low: float
    high: float
    heights: int
    angles: int
    radii: int | None = None
    outer: float = 1.0

    @property
    def shape(self) -> tuple[int, ...]:
        """Of arrays over the cells."""
        return (self.heights, self.angles) if self.radii is None else (self.heights, self.angles, self.radii)

    @property
    def height(self) -> Array:
        """Middles of the cells (H,) mm."""
        return np.asarray(self.low + (np.arange(self.heights) + 0.5) * (self.high - self.low) / self.heights)

    @property
    def angle(self) -> Array:
        """Middles of the cells (A,) rad."""
        return np.asarray(-pi + (np.arange(self.angles) + 0.5) * tau / self.angles)

    def cells(self, psi: Array, height: Array, radius: Array | None = None) -> Ints:
        """In which cell (n,) each reading lies; heights are within the grid."""
        column = ((psi + pi) * (self.angles / tau)).astype(np.intp)
        row = ((height - self.low) * (self.heights / (self.high - self.low))).astype(np.intp)
        np.clip(column, 0, self.angles - 1, out=column)
        np.clip(row, 0, self.heights - 1, out=row)
        cell = row * self.angles + column
        if self.radii is None or radius is None:
            return np.asarray(cell)
        ring = np.minimum((radius * (self.radii / self.outer)).astype(np.intp), self.radii - 1)
        return np.asarray(cell * self.radii + ring)


def patches_of(grid: Grid, readings: Readings, reach: float) -> Patches:
    """Robust means over the grid of the readings' deviations, all within ``reach`` mm."""
    shape, size = grid.shape, prod(grid.shape)
    cell, deviation = readings.cell, readings.deviation
    if not deviation.size:
        return Patches(np.full(shape, np.nan), np.zeros(shape, np.intp), 0.0, np.zeros(shape), np.full(shape, -1))
    off = deviation - medians(cell, deviation, size, 2 * reach)[0][cell]
    scatter = max(robust_sd(off[:: max(1, off.size // SCATTER_READINGS)]), LEAST_SCATTER)
    kept = np.flatnonzero((np.abs(off) <= TRUSTED * scatter) | _borne_out(readings, off, TRUSTED * scatter, size))
    count = np.bincount(cell[kept], minlength=size)
    least = max(float(LEAST_READINGS), LEAST_SHARE * float(np.median(count[count > 0])))
    total = np.bincount(cell[kept], deviation[kept], minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count >= least, total / count, np.nan)
    noise = np.where(np.isfinite(mean), _noise(cell[kept], off[kept], count), 0.0)
    pick = np.full(size, -1)
    pick[cell[kept]] = kept
    pick[~np.isfinite(mean)] = -1
    return Patches(mean.reshape(shape), count.reshape(shape), scatter, noise.reshape(shape), pick.reshape(shape))


def _borne_out(readings: Readings, off: Array, far: float, cells: int) -> Mask:
    """Readings (n,) that lie ``far`` (mm) off their patch's median and are material all the same: many of the patch do
    that others bear out.
    """
    if readings.lone is None:
        return np.zeros(off.size, dtype=bool)
    material = ~readings.lone & (np.abs(off) > far)
    number, total = (np.bincount(readings.cell[on], minlength=cells) for on in (material, np.s_[:]))
    return np.asarray(material & (number >= np.maximum(MANY, SHARE * total))[readings.cell])


def _noise(cell: Ints, off: Array, count: Ints) -> Array:
    """Standard deviation (size,) mm of the means, by each patch's own scatter, or the usual one for few readings."""
    total = np.bincount(cell, off, minlength=count.size)
    squares = np.bincount(cell, off * off, minlength=count.size)
    within = np.maximum(squares - total**2 / np.maximum(count, 1), 0.0)
    usual = float(within.sum()) / max(float((count - 1)[count > 0].sum()), 1.0)
    variance = (within + PRIOR_READINGS * usual) / (np.maximum(count - 1, 0) + PRIOR_READINGS)
    return np.asarray(np.sqrt(variance / np.maximum(count, 1)))


def farthest(patches: Patches, readings: Readings) -> tuple[float, float]:
    """How low and how high (mm) the surface reaches within patches that lie off the others, reading by reading.

    A patch's mean flattens what is smaller than the patch and leaves out its farthest readings; where few agree there
    is no mean. Between readings it may be deeper still. The readings are those that the patches were made of.
    """
    cell, deviation = readings.cell, readings.deviation
    mean, noise, count = patches.mean.ravel(), patches.noise.ravel(), patches.count.ravel()
    middle = float(np.nanmedian(mean))
    off = np.isnan(mean) & (np.bincount(cell, minlength=mean.size) > FULL * np.median(count[count > 0]))
    with np.errstate(invalid="ignore"):
        off |= np.abs(mean - middle) > OFF_SIGMA * noise
        beyond = deviation - mean[cell]
    depart = {
        s: np.bincount(cell[s * (deviation - middle) > DEPARTS * patches.scatter], minlength=mean.size) for s in (-1, 1)
    }
    for sign in (-1, 1):
        with np.errstate(invalid="ignore", divide="ignore"):
            # A small dent scatters the readings of its patch: that is no noise.
            off |= (sign * (mean - middle) > OFF_SIGMA * patches.scatter / np.sqrt(count)) & (depart[sign] >= MANY)
        off |= _together(np.bincount(cell[sign * beyond > TRUSTED * patches.scatter], minlength=mean.size), patches)
    inside = np.flatnonzero(off[cell])
    if not inside.size:
        return middle, middle
    level = np.where(np.isnan(mean), middle, mean)
    order = inside[np.lexsort((deviation[inside], cell[inside]))]
    ends = np.flatnonzero(np.diff(cell[order], append=-1))
    starts = np.append(0, ends[:-1] + 1)
    second, last_but_one = np.minimum(starts + PASSED_OVER, ends), np.maximum(ends - PASSED_OVER, starts)
    found = []
    for sign, at in ((-1, order[second]), (1, order[last_but_one])):
        beyond = np.maximum(sign * (deviation[at] - level[cell[at]]), 0.0)
        plain = np.maximum(beyond - DEPARTS * patches.scatter, 0.0)
        deepest = LEAST_DEEPER * beyond + (_deeper(depart[sign][cell[at]]) - LEAST_DEEPER) * plain
        found.append(sign * float((sign * level[cell[at]] + deepest).max()))
    return found[0], found[1]


def _deeper(number: Ints) -> Array:
    """How much deeper (n,) a bowl may be than the deepest but one of a ``number`` (n,) of readings in it.

    So many readings share its area evenly; a bowl (1 - (d / radius)^2)^2 has fallen to its value there.
    """
    return np.clip(np.square((number + 1) / np.maximum(number - 1, 1)), LEAST_DEEPER, MOST_DEEPER)


def _together(number: Ints, patches: Patches) -> Mask:
    """Patches (cells,) with so many untrusted readings to one side, and one beside them with as many: no outliers."""
    from scipy.ndimage import maximum_filter

    many = ((number.reshape(patches.count.shape) >= MANY)
            & (number.reshape(patches.count.shape) >= SHARE * patches.count))  # fmt: skip
    about = np.ones((3,) * many.ndim, dtype=np.bool_)
    about[(1,) * many.ndim] = False
    return np.asarray(many & maximum_filter(many, footprint=about, mode="constant")).ravel()
