"""The noise of cells, told from neighbouring cells: of a cell by itself, and what a row or a column shares.

Differences along the height show what neighbouring cells don't share: noise of readings, and speckle. How they grow
with the distance, up to three millimetres, says how far speckle goes on along the height, and whether they are alike
from one roll length to the next how far it goes on there (on a surface seen at a grazing angle it is long); the rest is
noise of single readings. Speckle can't be told from the roughness of a flank, so that counts as noise, too.
Waves that run over whole flanks (feed marks, ghost orders) look like noise from cell to cell; they are form, and taken
out first.
Differences of whole rows along the roll length show what a profile shares (jitter of the angle), those of columns along
the height what a point of the sensor's line shares. The flank's own shape is smooth at that distance; damage is left
out by medians.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import log

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.robust import MAD_TO_SD, nan_median, robust_sd
from truestand.gear.grid import TRACE_SHARE, Grid

LEAST_DIFFERENCES = 30
"""Second differences that tell a noise."""
WHOLE_ROW = 0.5
"""Of the cells of a flank's fullest row or column: fewer may be those alone that noise brought over the border."""
LEAST_SPREAD = 1e-5
"""mm: the noise of a cell is not taken for less."""
FARTHEST, MOST_OF_FACE = 3.0, 0.15
"""mm of height, and share of the face, over which noise may go on: what is longer is the flank's form."""
LAGS = 8
"""Cells of roll length up to which the correlation of noise is looked at."""
CORRELATED = np.linspace(0.0, 1.0, 21)
ALONG_ROLL = np.linspace(0.0, 0.95, 20)
ALONG_HEIGHT = np.linspace(0.0, 0.9, 19)
"""Correlated shares and AR(1) coefficients that are tried."""
TRIALS = 8
"""Of noise drawn on cells, to compare what it does with what is seen."""
MOST_MORE = 2.0
"""Factor by which noise may be more, or less, than its own cells tell."""
LEAST_WAVE_CELLS, MOST_WAVES, FINER = 200, 8, 2
"""Cells of a flank that show a wave; waves that are looked for; and how much finer than by whole waves."""
MOST_LEFT = 0.85
"""Share of the scatter that the cells may still have without a wave: of noise that goes on, one takes less."""
PROFILE_LAGS, ALONG_PROFILE = (1, 2, 4, 8), np.linspace(0.0, 0.9, 19)
"""Cells of roll length over which profiles are compared with those beside them; coefficients that are tried."""
SURE = 3.0
"""Standard deviations by which they must differ by more than noise does."""
LEAST_OF_CELL_MEAN = 0.25
"""Variance of a cell's mean over that of its places, at least: what varies faster is beyond the standard's low-pass."""
MOST_SD = 3.0
"""Standard deviations to which noise is cut where its correlation or its mean square is looked at: damage is more."""


@dataclass(frozen=True, slots=True)
class Correlation:
    """What the noise of cells shares with that of others: a part of it is first-order autoregressive both ways."""

    share: float = 0.0
    """0..1 of the variance that is correlated,"""
    along_roll: float = 0.0
    """and its correlation, 0..1, with the next cell of the roll length"""
    along_height: float = 0.0
    """and of the height."""

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Noise (2, teeth, roll lengths, heights) of standard deviation 1."""
        alone = rng.standard_normal(shape)
        if not self.share:
            return alone
        roll, height = (_factor(n, a) for n, a in zip(shape[2:], (self.along_roll, self.along_height), strict=True))
        together = roll @ rng.standard_normal(shape) @ height.T
        return np.asarray(np.sqrt(1.0 - self.share) * alone + np.sqrt(self.share) * together)

    @property
    def of_means(self) -> tuple[float, float]:
        """By how much means along the roll length, and along the height, vary more than those of white noise."""
        roll, height = (1.0 + 2.0 * self.share * a / (1.0 - a) for a in (self.along_roll, self.along_height))
        return roll, height

    def variance_of_sum(self, cells: Mask) -> float:
        """Variance of the sum of noise of standard deviation 1 over some ``cells`` (roll lengths, heights)."""
        on = cells.astype(np.float64)
        roll, height = (_alike(n, a) for n, a in zip(on.shape, (self.along_roll, self.along_height), strict=True))
        return float((1.0 - self.share) * on.sum() + self.share * np.sum(on * (roll @ on @ height)))


@dataclass(frozen=True, slots=True)
class CellNoise:
    """Standard deviations of the cells of a grid, mm."""

    variance: Array
    """(2, teeth, roll lengths, heights) mm^2 of each cell by itself; 0 where nothing was seen."""
    unevenness: Array
    """The same of a reading somewhere in its cell, where a flank is steep: its value is not known better, but no more
    scattered by it than it is."""
    correlation: Correlation
    of_row: float
    """Shared by the cells of one flank and roll length."""
    of_column: float
    """Shared by the cells of one flank and height."""
    waves: Array
    """(2, teeth, roll lengths, heights) mm of the flanks' waves, which are no noise, beyond the evaluation ranges, too;
    0 where there are none.
    """
    of_profile: float = 0.0
    """What single flanks have along the roll length at the middle of the face and others don't: form of theirs, or
    profiles that are off as a whole, because the sensor or the table shakes. Nothing tells one from the other."""
    along_profile: float = 0.0
    """Its correlation, 0..1, with the next cell of the roll length."""

    def draw(self, rng: np.random.Generator) -> Array:
        """Noise (2, teeth, roll lengths, heights) mm as the cells may have it once more."""
        sides, teeth, rolls, heights = self.variance.shape
        rows, columns = rng.standard_normal((sides, teeth, rolls, 1)), rng.standard_normal((sides, teeth, 1, heights))
        own = np.sqrt(self.variance) * self.correlation.draw(rng, self.variance.shape)
        return np.asarray(own + self.of_row * rows + self.of_column * columns)

    @property
    def of_surface(self) -> Array:
        """Standard deviation (2, teeth, roll lengths, heights) mm that single places of the flanks have if what cells
        share with others is no noise, but the surface: a cell shows the mean of its places, which vary more.
        """
        evened = _of_cell_mean(self.correlation.along_roll) * _of_cell_mean(self.correlation.along_height)
        return np.asarray(np.sqrt(self.correlation.share * self.variance / max(evened, LEAST_OF_CELL_MEAN)))

    def draw_surface(self, rng: np.random.Generator, along: int) -> Array:
        """Surface (2, teeth, roll lengths, heights) mm that has what cells share with others, as a line runs over it
        that is no wider than a point: ``along`` the height (3), or the roll length (2).
        """
        shape = self.variance.shape
        coefficient = self.correlation.along_height if along == 3 else self.correlation.along_roll
        single = rng.standard_normal([n if axis in (0, 1, along) else 1 for axis, n in enumerate(shape)])
        factor = _factor(shape[along], coefficient)
        line = single @ factor.T if along == 3 else factor @ single
        return np.asarray(self.of_surface * line)

    def draw_profiles(self, rng: np.random.Generator) -> Array:
        """Profiles (2, teeth, roll lengths, 1) mm that may be off as a whole."""
        sides, teeth, rolls, _ = self.variance.shape
        factor = _factor(rolls, self.along_profile)
        return np.asarray(self.of_profile * (factor @ rng.standard_normal((sides, teeth, rolls, 1))))

    def ratio(self, side: int, tooth: int, rest: Array, cells: Mask) -> float:
        """What the ``rest`` (roll lengths, heights) mm of one flank sums up to over some ``cells``, in standard
        deviations of what noise does there; 0 where nothing was seen.
        """
        variance = self.variance[side, tooth]
        on = cells & np.isfinite(rest) & (variance > 0)
        if not on.any():
            return 0.0
        share = np.where(on, 1.0 / np.sqrt(np.where(on, variance, 1.0)), 0.0)
        of_rows, of_columns = (float(np.square(share.sum(axis=axis)).sum()) for axis in (1, 0))
        together = of_rows * self.of_row**2 + of_columns * self.of_column**2
        return float(np.sum(share[on] * rest[on]) / np.sqrt(self.correlation.variance_of_sum(on) + together))


def _alike(number: int, coefficient: float) -> Array:
    """Correlation (number, number) of first-order autoregressive noise."""
    return np.asarray(coefficient ** np.abs(np.subtract.outer(np.arange(number), np.arange(number))), dtype=np.float64)


def _of_cell_mean(coefficient: float) -> float:
    """Variance of the mean of a cell over that of its places along one direction, where noise goes on in such a way
    that it is correlated so much with the next cell.
    """
    if not 0.0 < coefficient < 1.0:
        return coefficient
    cells = -log(coefficient)  # of one correlation length
    return 2.0 * (cells - 1.0 + coefficient) / cells**2


def _factor(number: int, coefficient: float) -> Array:
    """Factor (number, number) that makes white noise first-order autoregressive; its variance stays 1."""
    return np.asarray(np.linalg.cholesky(_alike(number, coefficient)), dtype=np.float64)


def noise_of_cells(grid: Grid, damaged: Mask | None = None) -> CellNoise:
    """The noise of a grid's cells; ``damaged`` ones (2, teeth, roll lengths, heights) have it but don't tell it."""
    whole = np.where(grid.in_ranges & grid.solid, grid.delta, np.nan)
    waves = waves_of(whole)
    sound = whole if damaged is None else np.where(damaged, np.nan, whole)
    inside = sound - waves
    count = np.maximum(grid.count, 1.0)
    farthest = _farthest(grid)
    lags = sorted({max(1, farthest // n) for n in (16, 8, 4, 2, 1)})
    single = [_singles(inside, count, grid.height, lag) for lag in lags]
    spread = np.maximum(_by_roll(single[-1]), LEAST_SPREAD)
    spread = spread * _by_flank(single[-1] / spread)
    correlation = _correlation([np.clip(s / spread, -MOST_SD, MOST_SD) for s in single], lags)
    variance = spread**2 / _seen_of_variance(correlation, farthest) / count
    of_row, of_column = (
        _shared(inside, variance * more, at, along)
        for more, at, along in zip(correlation.of_means[::-1], (grid.roll, grid.height), (2, 3), strict=True)
    )
    of_profile, along_profile = _of_profiles(sound, variance * correlation.of_means[1], grid)
    return CellNoise(
        np.where(grid.count > 0, variance, 0.0),
        np.where(grid.count > 0, _unevenness(whole) / count, 0.0),
        correlation,
        of_row,
        of_column,
        waves,
        of_profile,
        along_profile,
    )


def _of_profiles(cells: Array, variance: Array, grid: Grid) -> tuple[float, float]:
    """What profiles of single flanks have at the middle of the face (mm, standard deviation), and its correlation with
    the next cell; ``variance``: of cells, as their means along the height have it.
    """
    nominal = grid.nominal
    band = np.abs(grid.heights - nominal.middle) < TRACE_SHARE * nominal.gear.face_width
    lags = [lag for lag in PROFILE_LAGS if 2 * lag < cells.shape[2]]
    squares = [
        _shared_square(cells[..., band], variance[..., band], grid.roll[..., band], 2, lag, single=True) for lag in lags
    ]
    told = np.array([square if square > SURE * sd else 0.0 for square, sd, _ in squares])[:, None]
    number = np.array([number for *_, number in squares])[:, None]
    shown = np.array([_shown(1.0, ALONG_PROFILE, lag) for lag in lags]) / 1.5
    variances = (number * shown * told).sum(axis=0) / np.maximum((number * np.square(shown)).sum(axis=0), 1e-300)
    best = int((number * np.square(shown * variances - told)).sum(axis=0).argmin())
    return float(np.sqrt(variances[best])), float(ALONG_PROFILE[best])


def waves_of(cells: Array) -> Array:
    """Waves that run over whole flanks, in any direction, as cells (2, teeth, roll lengths, heights) mm have them; NaN:
    not seen, or not asked.

    Of each flank the strongest one, and again, as long as what is left scatters plainly less. They go on over all
    cells: next to one without its wave, that of others would look like a step.
    """
    sides, teeth = cells.shape[:2]
    return np.stack([[_waves_of_flank(cells[side, tooth]) for tooth in range(teeth)] for side in range(sides)])


def _waves_of_flank(cells: Array) -> Array:
    """The waves of one flank (roll lengths, heights) mm."""
    seen, waves = np.isfinite(cells), np.zeros(cells.shape)
    if np.count_nonzero(seen) < LEAST_WAVE_CELLS:
        return waves
    roll, height = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in cells.shape), indexing="ij")
    smooth = np.stack([np.ones_like(roll), roll, height, roll**2, roll * height, height**2], axis=-1)[seen]
    rest = _without(smooth, cells[seen] - np.median(cells[seen]))
    for _ in range(MOST_WAVES):
        basis = _strongest_wave(_clipped(rest), seen, roll, height)
        wave = basis @ _coefficients(basis[seen], rest)
        without = _without(smooth, rest - wave[seen])
        if robust_sd(without) > MOST_LEFT * robust_sd(rest):
            break
        waves += wave
        rest = without
    return waves


def _without(basis: Array, values: Array) -> Array:
    """What a basis (n, k) leaves of values (n,)."""
    return np.asarray(values - basis @ _coefficients(basis, values))


def _coefficients(basis: Array, values: Array) -> Array:
    """Of a basis (n, k) that fits values (n,) best, damage held back."""
    return np.asarray(np.linalg.lstsq(basis, _clipped(values), rcond=None)[0])


def _clipped(rest: Array) -> Array:
    """Values (n,) held within what noise and waves do: damage is no wave."""
    reach = MOST_SD * robust_sd(rest)
    return np.clip(rest, -reach, reach)


def _strongest_wave(rest: Array, seen: Mask, roll: Array, height: Array) -> Array:
    """The strongest wave of a flank (roll lengths, heights, 6): cosine and sine, and both growing along the roll length
    and the height, which lets its length be another than those that are tried.

    ``rest`` (n,) mm of the cells ``seen``; ``roll``, ``height`` (roll lengths, heights): -1..1 over the flank.
    """
    image = np.zeros(seen.shape)
    image[seen] = rest
    size = tuple(FINER * n for n in seen.shape)
    power = np.abs(np.fft.rfft2(image, size))
    along_roll, along_height = np.fft.fftfreq(size[0]), np.fft.rfftfreq(size[1])
    i, j = np.unravel_index(int(power.argmax()), power.shape)
    steps = (n - 1 for n in seen.shape)
    turns = [f * step / 2 for f, step in zip((along_roll[i], along_height[j]), steps, strict=True)]
    phase = 2 * np.pi * (turns[0] * roll + turns[1] * height)
    wave = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    return np.concatenate([wave, wave * roll[..., None], wave * height[..., None]], axis=-1)


def _farthest(grid: Grid) -> int:
    """Cells of height over which noise may go on."""
    return max(1, round(min(FARTHEST, MOST_OF_FACE * grid.nominal.gear.face_width) / grid.size[1]))


def borne_out(noise: CellNoise, grid: Grid, near: Mask, read: Callable[[Array], Array]) -> CellNoise:
    """The noise with its cells ``near`` (roll lengths,) a place scaled to what ``read`` shows there.

    ``read`` makes values along the height (2 teeth, heights), NaN: not seen, from cells (2, teeth, roll lengths,
    heights): how noise goes on along the roll length differs from place to place, and the range of a helix follows it.
    """
    rng, lag = np.random.default_rng(1), _farthest(grid)

    def scatter(cells: Array) -> Array:
        values = read(cells)
        bends = values[:, lag:-lag] - (values[:, 2 * lag :] + values[:, : -2 * lag]) / 2
        bends = bends.reshape(2, -1, bends.shape[1])
        crowned = nan_median(bends, axis=1)[:, None]
        return np.array([_inner_sd(b[np.isfinite(b)]) for b in bends - crowned])

    drawn = np.sqrt(np.mean([np.square(scatter(noise.draw(rng))) for _ in range(TRIALS)], axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        told = scatter(np.nan_to_num(grid.delta - noise.waves))
        more = np.nan_to_num(told / drawn, nan=1.0, posinf=1.0)
    factor = np.where(near, np.clip(more, 1 / MOST_MORE, MOST_MORE)[:, None], 1.0)
    return replace(noise, variance=noise.variance * np.square(factor)[:, None, :, None])


def _inner_sd(values: Array) -> float:
    """Root mean square of values (n,) but for what damage does to them: of few values it is surer than a median."""
    inner = values[np.abs(values) <= MOST_SD * robust_sd(values)] if values.size else values
    return float(np.sqrt(np.mean(np.square(inner)))) if inner.size else 0.0


def _singles(cells: Array, count: Array, height: Array, lag: int) -> Array:
    """Second differences (2, teeth, roll lengths, n) of cells ``lag`` apart along the height, as of single readings.

    Without what all flanks of a side share: they are crowned.
    """
    rest, shares, _ = _second_differences(cells, 1.0 / count, height, 3, lag)
    crowned = nan_median(rest.reshape(rest.shape[0], -1, rest.shape[3]), axis=1)
    return np.asarray((rest - crowned[:, None, None]) / np.sqrt(shares))


def _seen_of_variance(correlation: Correlation, lag: int) -> float:
    """Share of the variance that second differences of cells ``lag`` apart along the height show."""
    return float(_shown(correlation.share, correlation.along_height, lag)) / 1.5


def _shown(share: Array | float, along_height: Array | float, lag: int) -> Array | float:
    near = np.asarray(along_height) ** lag
    return 1.5 - share * (2.0 * near - 0.5 * near**2)


def _correlation(ratios: list[Array], lags: list[int]) -> Correlation:
    """The correlation of noise, from second differences of cells some ``lags`` apart along the height.

    ``ratios``: (2, teeth, roll lengths, n) each, over the standard deviation of the last; NaN where not seen. Least
    squares of how they grow with the distance, and of how alike the last are from one roll length to the next.
    """
    share, roll, height = (a.reshape(-1) for a in np.meshgrid(CORRELATED, ALONG_ROLL, ALONG_HEIGHT, indexing="ij"))
    last, whole = ratios[-1], _shown(share, height, lags[-1])
    misfit = np.zeros(share.size)
    for lag, ratio in zip(lags[:-1], ratios[:-1], strict=True):
        known = ratio[np.isfinite(ratio)]
        if known.size >= LEAST_DIFFERENCES:
            misfit += np.square(_shown(share, height, lag) / whole - robust_sd(known) ** 2)
    for lag in range(1, min(LAGS, last.shape[2] - 1) + 1):
        product = last[:, :, lag:] * last[:, :, :-lag]
        known = product[np.isfinite(product)]
        if known.size >= LEAST_DIFFERENCES:
            alike = share * roll**lag * _shown(1.0, height, lags[-1]) / whole
            misfit += np.square(alike - float(known.mean()))
    best = int(np.argmin(misfit))
    return Correlation(float(share[best]), float(roll[best]), float(height[best]))


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


def _by_flank(ratios: Array) -> Array:
    """Factor (2, teeth, 1, 1) of each flank's noise: second differences (2, teeth, roll lengths, n), NaN aside, over
    the standard deviation that all flanks have.

    An eccentric gear is seen at another incidence all round, and speckle that a second turn shows again is no less by
    it. The middle of three flanks: damage of one of them is no noise.
    """
    of_flank = ratios.reshape(*ratios.shape[:2], -1)
    number = np.isfinite(of_flank).sum(axis=2)
    told = MAD_TO_SD * nan_median(np.abs(of_flank), axis=2)
    factor = np.where(number >= LEAST_DIFFERENCES, np.clip(told, 1 / MOST_MORE, MOST_MORE), 1.0)
    beside = np.median([np.roll(factor, shift, axis=1) for shift in (-1, 0, 1)], axis=0)
    return np.asarray(beside[:, :, None, None])


def _shared(cells: Array, variance: Array, at: Array, along: int) -> float:
    """Standard deviation (mm) that the cells of a row (``along`` the roll length, 2) or a column (3) have in common."""
    return float(np.sqrt(max(_shared_square(cells, variance, at, along, 1)[0], 0.0)))


def _shared_square(
    cells: Array, variance: Array, at: Array, along: int, lag: int, single: bool = False
) -> tuple[float, float, int]:
    """Its square by the cells ``lag`` before and behind, less than 0 by chance, that square's standard deviation, and
    the number of differences that tell it; 0 where they are too few. ``single``: without what all flanks of a side
    have.
    """
    across = 5 - along
    cells = _without_form(cells, across)
    seen = np.isfinite(cells)
    number = seen.sum(axis=across, keepdims=True)
    count = np.maximum(number, 1)
    whole = number >= np.maximum(WHOLE_ROW * number.max(axis=along, keepdims=True), 1)

    def mean(values: Array, power: int = 1) -> Array:
        total = np.where(seen, values, 0.0).sum(axis=across, keepdims=True) / count**power
        return np.asarray(np.where(whole, total, np.nan))

    rest, known, factor = _second_differences(mean(cells), mean(variance, 2), mean(at), along, lag)
    rest = rest - nan_median(rest, axis=1)[:, None] if single else rest
    told = np.isfinite(rest)
    differences = int(np.count_nonzero(told))
    if differences < LEAST_DIFFERENCES:
        return 0.0, 0.0, 0
    square = robust_sd(rest[told] / np.sqrt(factor[told])) ** 2
    excess = square - float(np.median(known[told] / factor[told]))
    return excess, square * float(np.sqrt(2.0 / differences)), differences


def _without_form(cells: Array, across: int) -> Array:
    """Cells (2, teeth, roll lengths, heights) without what all flanks of a side have along the axis ``across``, nor the
    slope that each of them has there: rows that don't show the same columns of a flank differ by it.
    """
    turned = np.moveaxis(cells, across, -1)
    sides, *_, places = turned.shape
    form = nan_median(turned.reshape(sides, -1, places), axis=1)[:, None, None]
    rest, seen, at = turned - form, np.isfinite(turned), np.linspace(-1.0, 1.0, places)
    number = np.maximum(seen.sum(axis=(2, 3), keepdims=True), 1)

    def mean(values: Array) -> Array:
        return np.asarray(np.where(seen, values, 0.0).sum(axis=(2, 3), keepdims=True) / number)

    off = at - mean(at)
    slope = mean(off * rest) / np.maximum(mean(np.square(off)), 1e-300)
    return np.moveaxis(rest - slope * off, -1, across)


def _second_differences(
    values: Array, variance: Array, at: Array, axis: int, lag: int = 1
) -> tuple[Array, Array, Array]:
    """What values (2, teeth, m, n) differ by from the straight line between those ``lag`` before and after them ``at``
    their places.

    The differences, their variance, and the sum of their squared weights; NaN where one of the three was not seen.
    """
    parts = [slice(k, k - 2 * lag or None) for k in (0, lag, 2 * lag)]
    (v0, v1, v2), (s0, s1, s2), (x0, x1, x2) = (
        [np.moveaxis(a, axis, -1)[..., part] for part in parts] for a in (values, variance, at)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (x1 - x0) / (x2 - x0)
    rest = v1 - (1.0 - share) * v0 - share * v2
    return rest, s1 + (1.0 - share) ** 2 * s0 + share**2 * s2, 1.0 + (1.0 - share) ** 2 + share**2
