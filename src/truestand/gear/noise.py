"""The noise of cells, told from neighbouring cells: of a cell by itself, and what a row or a column shares.

Second differences along the height show what neighbouring cells don't share (noise of readings, speckle), and how much
of that goes on along the roll length (speckle of a surface seen at a grazing angle is long); those of whole rows along
the roll length what a profile shares (jitter of the angle), those of columns along the height what a point of the
sensor's line shares. The flank's own shape is smooth at that distance; damage is left out by medians.
"""

from dataclasses import dataclass

import numpy as np

from truestand.core.arrays import Array
from truestand.core.robust import MAD_TO_SD, nan_median, robust_sd
from truestand.gear.grid import Grid

LEAST_DIFFERENCES = 30
"""Second differences that tell a noise."""
LEAST_SPREAD = 1e-5
"""mm: the noise of a cell is not taken for less."""
LAGS = 8
"""Cells of roll length up to which the correlation of noise is looked at."""
AR1_COEFFICIENTS = np.linspace(0.0, 0.95, 20)
"""That are tried."""
MOST_SD = 3.0
"""Standard deviations to which noise is cut where its correlation is looked at: damage is correlated, too."""


@dataclass(frozen=True, slots=True)
class CellNoise:
    """Standard deviations of the cells of a grid, mm."""

    variance: Array
    """(2, teeth, roll lengths, heights) mm^2 of each cell by itself; 0 where nothing was seen."""
    correlated: float
    """Share 0..1 of that variance which is correlated along the roll length,"""
    ar1: float
    """and its correlation, 0..1, from one cell to the next."""
    of_row: float
    """Shared by the cells of one flank and roll length."""
    of_column: float
    """Shared by the cells of one flank and height."""

    def draw(self, rng: np.random.Generator) -> Array:
        """Noise (2, teeth, roll lengths, heights) mm as the cells may have it once more."""
        sides, teeth, rolls, heights = self.variance.shape
        rows, columns = rng.standard_normal((sides, teeth, rolls, 1)), rng.standard_normal((sides, teeth, 1, heights))
        alone = np.sqrt(1.0 - self.correlated) * rng.standard_normal(self.variance.shape)
        if self.correlated:
            alone += np.sqrt(self.correlated) * _ar1_noise(rng.standard_normal(self.variance.shape), self.ar1)
        return np.asarray(np.sqrt(self.variance) * alone + self.of_row * rows + self.of_column * columns)


def _ar1_noise(white: Array, coefficient: float) -> Array:
    """White noise (2, teeth, roll lengths, heights) made first-order autoregressive along the roll length; its variance
    stays 1.
    """
    noise = white.copy()
    for roll in range(1, white.shape[2]):
        noise[:, :, roll] = coefficient * noise[:, :, roll - 1] + np.sqrt(1 - coefficient**2) * white[:, :, roll]
    return noise


def noise_of_cells(grid: Grid) -> CellNoise:
    """The noise of a grid's cells."""
    inside = np.where(grid.in_ranges & grid.solid, grid.delta, np.nan)
    count = np.maximum(grid.count, 1.0)
    rest, shares, _ = _second_differences(inside, 1.0 / count, grid.height, 3)
    single = rest / np.sqrt(shares)
    spread = np.maximum(_by_roll(single), LEAST_SPREAD)
    variance = np.where(grid.count > 0, (spread**2 + _unevenness(inside)) / count, 0.0)
    correlated, ar1 = _correlation_along_roll(np.clip(single / spread, -MOST_SD, MOST_SD))
    of_row, of_column = _shared(inside, variance, grid.roll, 2), _shared(inside, variance, grid.height, 3)
    return CellNoise(variance, correlated, ar1, of_row, of_column)


def _unevenness(cells: Array) -> Array:
    """Variance (2, teeth, roll lengths, heights) mm^2 of a reading somewhere in its cell, where a flank is steep.

    On the edge of a groove it matters which points of the sensor's line fall on it.
    """
    step = np.diff(cells, axis=3)
    beside = np.fmax(*(np.abs(np.pad(step, ((0, 0),) * 3 + (pad,), constant_values=0.0)) for pad in ((0, 1), (1, 0))))
    return np.asarray(np.square(np.nan_to_num(beside)) / 12.0)


def _by_roll(single: Array) -> Array:
    """Standard deviation (2, 1, roll lengths, 1) mm of single readings (2, teeth, roll lengths, n), NaN aside, of each
    side and roll length: the steeper a flank is seen, the less of the sensor's noise it shows.
    """
    columns = single.transpose(0, 2, 1, 3).reshape(single.shape[0], single.shape[2], -1)
    number = np.isfinite(columns).sum(axis=2)
    spread = MAD_TO_SD * nan_median(np.abs(columns), axis=2)
    known = np.abs(columns[np.isfinite(columns)])
    overall = robust_sd(known) if known.size >= LEAST_DIFFERENCES else 0.0
    return np.where(number >= LEAST_DIFFERENCES, spread, overall)[:, None, :, None]


def _correlation_along_roll(ratio: Array) -> tuple[float, float]:
    """How noise is correlated along the roll length: ``correlated`` and ``ar1`` of ``CellNoise``.

    ``ratio`` (2, teeth, roll lengths, n): noise of cells over its standard deviation; NaN where not seen.
    """
    lags, alike = [], []
    for lag in range(1, min(LAGS, ratio.shape[2] - 1) + 1):
        product = ratio[:, :, lag:] * ratio[:, :, :-lag]
        known = product[np.isfinite(product)]
        if known.size >= LEAST_DIFFERENCES:
            lags.append(lag)
            alike.append(float(known.mean()))
    if not lags:
        return 0.0, 0.0
    powers, found = AR1_COEFFICIENTS[:, None] ** np.array(lags), np.array(alike)
    shares = np.clip((powers @ found) / np.maximum((powers**2).sum(axis=1), 1e-12), 0.0, 1.0)
    best = int(np.argmin(((shares[:, None] * powers - found) ** 2).sum(axis=1)))
    return float(shares[best]), float(AR1_COEFFICIENTS[best])


def _shared(cells: Array, variance: Array, at: Array, along: int) -> float:
    """Standard deviation (mm) that the cells of a row (``along`` the roll length, 2) or a column (3) have in common."""
    across = 5 - along
    seen = np.isfinite(cells)
    number = np.maximum(seen.sum(axis=across, keepdims=True), 1)

    def mean(values: Array, power: int = 1) -> Array:
        total = np.where(seen, values, 0.0).sum(axis=across, keepdims=True) / number**power
        return np.asarray(np.where(seen.any(axis=across, keepdims=True), total, np.nan))

    rest, known, factor = _second_differences(mean(cells), mean(variance, 2), mean(at), along)
    told = np.isfinite(rest)
    if np.count_nonzero(told) < LEAST_DIFFERENCES:
        return 0.0
    square = robust_sd(rest[told] / np.sqrt(factor[told])) ** 2 - float(np.median(known[told] / factor[told]))
    return float(np.sqrt(max(square, 0.0)))


def _second_differences(values: Array, variance: Array, at: Array, axis: int) -> tuple[Array, Array, Array]:
    """What values (2, teeth, m, n) differ by from the straight line between those before and after them at ``at``.

    The differences, their variance, and the sum of their squared weights; NaN where one of the three was not seen.
    """
    (v0, v1, v2), (s0, s1, s2), (x0, x1, x2) = (
        [np.moveaxis(a, axis, -1)[..., slice(k, k - 2 or None)] for k in range(3)] for a in (values, variance, at)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (x1 - x0) / (x2 - x0)
    rest = v1 - (1.0 - share) * v0 - share * v2
    return rest, s1 + (1.0 - share) ** 2 * s0 + share**2 * s2, 1.0 + (1.0 - share) ** 2 + share**2
