"""Where the standard reads a flank: profile at the middle of the face, helix and position on the measuring circle.

    profile   mean over the middle of the face +- b / 20, over the roll length
    helix     on the measuring circle, over the height
    position  where both meet: mean of the helix over the middle of the face +- b / 20

Cells of one height are a column. Profiles cross a flank at a few places only (4,000 a turn are 0.3 mm of roll length
apart on the measuring circle), so what a column has there is read between the nearest of them, or, where it says the
same, from a parabola through some more, which is quieter. Slopes and crowning are least squares, form and total
extremes after a Gaussian low-pass (ISO 16610-21) of the whole evaluation range, damage included. All of it is linear in
the cells, extremes aside.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import inf, log, pi, sqrt

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.gear.geometry import Involute
from truestand.gear.grid import TRACE_SHARE, Grid, step_on_flank
from truestand.gear.noise import CellNoise

POINTS = 201
"""Of a trace, evenly over its evaluation range."""
LEAST_CELLS = 6
"""Cells along a trace that it needs."""
LEAST_REACH = 0.4
"""Share of an evaluation range over which a trace must reach."""
WIDE_STEPS = (5.0, 2.5)
"""Steps of the table to either side over which a parabola is laid: the widest that fits."""
LEAST_WIDE = 5
"""Cells that it needs."""
SAME = 3.5
"""Standard deviations within which the parabola and the nearest cells say the same."""
MOST_LEVELLED = 0.0005
"""mm by which a parabola may level the waves of a flank."""
MOST_STEPS, MOST_CELLS = 3.0, 4.0
"""Steps of the table that the nearest cells on either side of the measuring circle may be apart, and cells along the
height that points of the helix may be: farther, readings got lost, and what lies between was not seen."""
HOLE = 1.0
"""mm of height over which a gap counts."""
MOST_APART = 1.6
"""Steps of the table, two cells at least, that readings at the middle of the face may be apart along a profile: an
eccentric gear is met 1.4 steps apart near its root; farther, all columns lost some."""
LEAST_COLUMNS = 0.5
"""Share of the columns at the middle of the face that must be seen."""
LEAST_CUTOFF = 0.25
"""mm: wavelength of the low-pass at least (ISO 1328-1:2013),"""
CUTOFF_SHARE = 1 / 30
"""and its share of the evaluation length or the face."""
TINY = 1e-12
"""mm: a cell at the place itself is the one before it."""
GAUSS = sqrt(log(2.0) / pi)
"""Width of the weighting function over the wavelength that it halves (ISO 16610-21)."""
SMOOTHED = 2 * pi / GAUSS**2 * (1 / 12 + 1 / 6)
"""Square of a wavelength, in cells, by which the means of cells and straight lines between them are smoother already:
variances of the weighting functions of a box and a triangle, over the Gaussian's."""


@dataclass(frozen=True, slots=True)
class Reading:
    """How each column is read at one roll length."""

    weights: Array
    """(flanks, heights, roll lengths) of its cells, 0 for those not seen."""
    seen: Mask
    """(flanks, heights): columns with cells on both sides of the place."""
    below: Array
    """(flanks, heights) mm by which the flank may lie below, where it bends between the nearest cells; else 0."""
    above: Array
    """The same above."""

    def __call__(self, delta: Array) -> Array:
        """delta (flanks, heights) there, of cells (2, teeth, roll lengths, heights); 0 where not seen."""
        return np.asarray(np.einsum("fhr,fhr->fh", self.weights, _columns(np.nan_to_num(delta))))


@dataclass(frozen=True, slots=True)
class Interpolation:
    """Straight lines between values, (flanks, places) each."""

    first: Ints
    """Index of the value before a place,"""
    last: Ints
    """and of the one behind it."""
    share: Array
    """0..1 of the way from one to the other."""
    seen: Mask
    inside: Mask
    """Places between two values; beyond the first and the last one their value holds."""

    def __call__(self, values: Array) -> Array:
        """Values (flanks, n) read at the places; NaN where not seen."""
        return np.where(self.seen, self.going_on(values), np.nan)

    def going_on(self, values: Array) -> Array:
        """The same, with any value where not seen."""
        before, behind = (np.take_along_axis(values, at, axis=1) for at in (self.first, self.last))
        return np.asarray(before + self.share * (behind - before))


@dataclass(frozen=True, slots=True)
class Joined:
    """The mean trace of columns, of each of which some was seen; linear in them, by weights.

    Where some of them end (beyond it they hold their value for a while), the mean of the others goes on by its steps:
    columns stand at other heights where damage ends between them, and the trace must not step where one of them does.
    Fewer than half of them don't say how all go on: there those that hold count, too.
    """

    columns: tuple[Interpolation, ...]
    of_mean: Array
    """(flanks, columns, places) in the mean of those seen,"""
    of_step: Array
    """(flanks, columns, places - 1) in its step to the next place,"""
    of_level: Array
    """and (flanks, places) in the mean over the places that most columns reach."""
    seen: Mask
    """(flanks, places): by most columns."""

    def __call__(self, values: Array) -> Array:
        """The trace (flanks, places) of values (flanks, columns, n); NaN where not seen."""
        read = np.stack([column.going_on(values[:, j]) for j, column in enumerate(self.columns)], axis=1)
        mean = np.einsum("fcp,fcp->fp", self.of_mean, read)
        path = np.zeros(mean.shape)
        np.cumsum(np.einsum("fcp,fcp->fp", self.of_step, np.diff(read, axis=2)), axis=1, out=path[:, 1:])
        level = np.einsum("fp,fp->f", self.of_level, mean - path)
        return np.where(self.seen, path + level[:, None], np.nan)


@dataclass(frozen=True, slots=True)
class Traces:
    """How traces and positions follow from the cells."""

    nominal: Involute
    band: Mask
    """(heights,): columns at the middle of the face."""
    rolls: Array
    """(flanks, heights, roll lengths) mm of the cells seen; NaN elsewhere."""
    heights: Array
    """(flanks, heights) mm in C of the helix' points; NaN where not seen."""
    across: Array
    """(flanks,) mm of roll length: the widest gap between the readings on either side of the circle, over ``HOLE`` of
    height."""
    circle: Reading
    """On the measuring circle."""
    ball: Reading
    """Where the ball touches."""
    profile: Joined
    """The trace from the columns of the band."""
    shorter_profile: tuple[float, Joined]
    """The same where the range is some mm shorter at either end: a cell."""
    between: Mask
    """(flanks, POINTS): places of a profile between readings that lie too far apart."""
    helix: Interpolation
    """The trace from the points on the circle."""
    other_ends: tuple[tuple[float, Interpolation], ...]
    """The same where the range is longer by some mm at either end: a cell, and less a cell."""


def traces_of(
    grid: Grid, noise: CellNoise, step: float, middle: float | None = None, circle: float | None = None
) -> Traces:
    """How the flanks of a grid are read; ``step``: table angle from one profile to the next, rad.

    Profiles about the ``middle`` height (mm in C; None: of the face), helices at the roll length ``circle`` (mm; None:
    on the measuring circle).
    """
    nominal = grid.nominal
    middle = nominal.middle if middle is None else middle
    place = nominal.measuring_roll if circle is None else circle
    rolls = np.where(_columns(grid.count) > 0, _columns(grid.roll), np.nan)
    delta, variance = _columns(np.nan_to_num(grid.delta)), _columns(noise.variance) + noise.of_row**2

    def reading(place: float) -> Reading:
        wide = [max(steps * float(step_on_flank(nominal, place, step)), 1.5 * grid.size[0]) for steps in WIDE_STEPS]
        return _reading(delta, rolls - place, variance, _columns(noise.waves), wide, grid.size[0] / 2)

    on_circle = reading(place)
    share = np.abs(on_circle.weights)
    widest = MOST_STEPS * float(step_on_flank(nominal, place, step)) + grid.size[0]
    gap = _gap(rolls - place)
    near = on_circle.seen & (gap <= widest)
    heights = (share * _columns(grid.height)).sum(axis=2) / np.maximum(share.sum(axis=2), 1e-300)
    at = np.where(near, heights, np.nan)
    band = np.asarray(np.abs(grid.heights - middle) < TRACE_SHARE * nominal.gear.face_width)
    half_step = step_on_flank(nominal, rolls, step) / 2

    def profile(shorter: float) -> Joined:
        places = profile_points(nominal, shorter)
        return _joined(tuple(_interpolation(rolls[:, j], places, half_step[:, j]) for j in np.flatnonzero(band)))

    cell = grid.size[1]

    def helix(longer: float) -> Interpolation:
        return _interpolation(at, helix_points(nominal, longer), np.full(at.shape, cell), MOST_CELLS * cell)

    other_ends = tuple((longer, helix(longer)) for longer in (cell, -cell))
    between = _too_far_apart(rolls[:, band].reshape(rolls.shape[0], -1), nominal, step, grid.size[0])
    ball = reading(nominal.ball_roll) if circle is None else on_circle
    shorter = grid.size[0], profile(grid.size[0])
    across = _widest_over(np.where(np.isfinite(gap), gap, 0.0), max(1, round(HOLE / grid.size[1])))
    return Traces(
        nominal, band, rolls, at, across, on_circle, ball, profile(0.0), shorter, between, helix(0.0), other_ends
    )


def _widest_over(gap: Array, columns: int) -> Array:
    """The widest gap (flanks,) that so many ``columns`` beside each other, of gaps (flanks, heights), have at least."""
    from scipy.ndimage import minimum_filter1d

    return np.asarray(minimum_filter1d(gap, min(columns, gap.shape[1]), axis=1, mode="constant").max(axis=1))


def _too_far_apart(rolls: Array, nominal: Involute, step: float, cell: float) -> Mask:
    """Places (flanks, POINTS) of profiles between readings at ``rolls`` (flanks, n) mm, NaN: none, of all columns
    together, that lie farther apart than one step of the table explains.
    """
    places, far = profile_points(nominal), np.zeros((rolls.shape[0], POINTS), dtype=bool)
    for flank, at in enumerate(rolls):
        at = np.sort(at[np.isfinite(at)])
        if at.size > 1:
            most = np.maximum(MOST_APART * step_on_flank(nominal, (at[1:] + at[:-1]) / 2, step), 2 * cell)
            gap = np.diff(at) > most
            behind = np.searchsorted(at, places)
            inside = (behind > 0) & (behind < at.size)
            far[flank, inside] = gap[behind[inside] - 1]
    return far


def stretches_inside(seen: Mask) -> list[tuple[int, int, int]]:
    """Stretches of traces (flanks, POINTS), not ``seen``, between points that were: flank, first and last point."""
    found = []
    for flank, points in enumerate(seen):
        on = np.flatnonzero(points)
        found += [(flank, int(a) + 1, int(b) - 1) for a, b in pairwise(on) if b - a > 1]
    return found


def profile_points(nominal: Involute, shorter: float = 0.0) -> Array:
    """Roll lengths (POINTS,) mm of a profile's trace, over a range that is so many mm ``shorter`` at either end."""
    low, high = nominal.profile_range
    return np.linspace(low + shorter, high - shorter, POINTS)


def helix_points(nominal: Involute, longer: float = 0.0) -> Array:
    """Heights (POINTS,) mm, C, of a helix' trace, over a range that is so many mm ``longer`` at either end."""
    low, high = nominal.helix_range
    return np.linspace(low - longer, high + longer, POINTS)


def profile_of(delta: Array, traces: Traces, read: Joined | None = None) -> Array:
    """Profile traces (flanks, POINTS) of cells (2, teeth, roll lengths, heights); NaN where not seen.

    ``read``: how they are read; None: over the evaluation range.
    """
    return (read or traces.profile)(np.nan_to_num(_columns(delta)[:, traces.band]))


def helix_of(delta: Array, traces: Traces) -> Array:
    """Helix traces (flanks, POINTS) of cells (2, teeth, roll lengths, heights); NaN where not seen."""
    return traces.helix(traces.circle(delta))


def circle_points(delta: Array, traces: Traces) -> Array:
    """Points of the helix (flanks, heights) mm, one a column of cells (2, teeth, roll lengths, heights); NaN: none."""
    return np.where(np.isfinite(traces.heights), traces.circle(delta), np.nan)


def position_of(delta: Array, reading: Reading, traces: Traces) -> Array:
    """What a reading says at the middle of the face, (flanks,) mm, of cells (2, teeth, roll lengths, heights).

    NaN where most columns of the band are not seen.
    """
    return _mean_of_band(reading(delta), reading, traces)


def position_bend(reading: Reading, traces: Traces) -> Array:
    """By how much (flanks,) mm ``position_of`` may be off where flanks bend; NaN where most columns are not seen."""
    return _mean_of_band(np.maximum(reading.below, reading.above), reading, traces)


def _mean_of_band(values: Array, reading: Reading, traces: Traces) -> Array:
    return _mean_of_columns(values[:, traces.band], reading.seen[:, traces.band])


def _joined(columns: tuple[Interpolation, ...]) -> Joined:
    seen, inside = (np.stack(of, axis=1) for of in ([c.seen for c in columns], [c.inside for c in columns]))
    number, reached = seen.sum(axis=1), inside.sum(axis=1)
    known = number >= LEAST_COLUMNS * len(columns)
    holding, going_on = (on[:, :, 1:] & on[:, :, :-1] for on in (seen, inside))
    most = going_on.sum(axis=1, keepdims=True) >= LEAST_COLUMNS * len(columns)
    stepping = np.where(most, going_on & holding, holding)
    level = (reached == reached.max(axis=1, keepdims=True)) & known
    return Joined(columns, _shares(seen & known[:, None]), _shares(stepping), _shares(level), known)


def _shares(on: Mask) -> Array:
    """Weights of those that count, the same for each, along the columns (flanks, columns, places) or places."""
    return np.asarray(on / np.maximum(on.sum(axis=1, keepdims=True), 1))


def _mean_of_columns(values: Array, seen: Mask) -> Array:
    """Mean (...) of the columns (..., band) that were seen; NaN where most were not."""
    number = seen.sum(axis=-1)
    mean = np.where(seen, values, 0.0).sum(axis=-1) / np.maximum(number, 1)
    return np.where(number >= LEAST_COLUMNS * seen.shape[-1], mean, np.nan)


def profile_bend(delta: Array, traces: Traces) -> Array:
    """By how much (flanks,) mm profiles may reach beyond the cells they are read from."""
    columns = np.flatnonzero(traces.band)
    cells = _columns(np.nan_to_num(delta))
    bends = [_bend(cells[:, j], traces.rolls[:, j], traces.nominal.profile_range) for j in columns]
    return np.asarray(np.mean(bends, axis=0))


def profile_unsampled(shape: Array, grid: Grid, traces: Traces) -> Array:
    """By how much profiles (flanks, POINTS) mm are off between their readings where ``shape`` (2, rolls, heights) mm,
    which all teeth share, is theirs as well; NaN: not known.
    """
    band, points = shape[:, :, traces.band], profile_points(traces.nominal)
    along = _mean_of_columns(band, np.isfinite(band))
    cells, whole = np.zeros(grid.roll.shape), np.zeros((2, 1, points.size))
    for side, known in enumerate(np.isfinite(along)):
        if known.any():
            cells[side] = np.interp(grid.roll[side], grid.rolls[known], along[side, known])
            whole[side] = np.interp(points, grid.rolls[known], along[side, known])
    read = profile_of(cells, traces)
    return np.asarray(read - np.broadcast_to(whole, (*cells.shape[:2], points.size)).reshape(read.shape))


def helix_bend(delta: Array, traces: Traces) -> Array:
    """By how much (flanks,) mm helices may reach beyond their points, or less far than they do."""
    circle, points = traces.circle, traces.circle(delta)
    low, high = traces.nominal.helix_range
    on = circle.seen & (traces.heights >= low) & (traces.heights <= high)
    range_read = _range(points, points, on)
    wider = _range(points + circle.above, points - circle.below, on) - range_read
    narrower = range_read - np.maximum(_range(points - circle.below, points + circle.above, on), 0.0)
    return np.asarray(np.maximum(wider, narrower) + _bend(points, traces.heights, (low, high)))


def _bend(values: Array, at: Array, limits: tuple[float, float]) -> Array:
    """By how much (flanks,) mm smooth curves through values (flanks, n) may reach beyond the farthest of them.

    An eighth of the second difference there, as on a parabola between two values; 0 for fewer than three.
    """
    found = np.zeros(values.shape[0])
    for flank in range(values.shape[0]):
        on = np.flatnonzero((at[flank] >= limits[0]) & (at[flank] <= limits[1]))  # NaN: not seen
        if on.size < 3:
            continue
        x, y = at[flank, on], values[flank, on]
        share = (x[1:-1] - x[:-2]) / (x[2:] - x[:-2])
        bend = np.abs(y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:]) / 4.0
        rest = y - np.polyval(np.polyfit(x, y, 1), x)
        for farthest in (int(np.argmax(rest)), int(np.argmin(rest))):
            found[flank] = max(found[flank], bend[max(farthest - 2, 0) : farthest + 1].max(initial=0.0))
    return found


@dataclass(frozen=True, slots=True)
class Line:
    """What a trace (flanks, POINTS) says; mm, (flanks,), NaN for a flank of which too little was seen."""

    slope: Array
    """Rise of the mean line over the length of slope deviations."""
    form: Array
    total: Array
    crowning: Array
    """Height of the mean parabola over the whole control length or face."""
    filtered: Array
    """(flanks, POINTS): the trace after the low-pass."""


def line_of(
    trace: Array, at: Array, cells: Ints, slope_length: float, whole: float, cutoff_of: float, cell: float = 0.0
) -> Line:
    """The figures of traces (flanks, POINTS) at places (POINTS,).

    ``cells`` (flanks,): how many it rests on; ``whole``: control length or face (mm); ``cutoff_of``: length
    (mm) whose share is the low-pass's wavelength; ``cell``: length (mm) of cells whose means, and straight lines
    between them, the trace is.
    """
    seen = np.isfinite(trace)
    able = (cells >= LEAST_CELLS) & (seen.mean(axis=1) > LEAST_REACH)
    weight, values = seen.astype(np.float64), np.where(seen, trace, 0.0)
    number = np.maximum(weight.sum(axis=1), 1.0)
    x = np.where(seen, at - ((weight * at).sum(axis=1) / number)[:, None], 0.0)
    square = np.maximum((x * x).sum(axis=1), 1e-300)
    slope = (x * values).sum(axis=1) / square
    rest = np.where(seen, values - (values.sum(axis=1) / number)[:, None] - slope[:, None] * x, 0.0)
    cutoff = max(cutoff_of * CUTOFF_SHARE, LEAST_CUTOFF)
    filtered = _low_pass(rest, weight, at, sqrt(max(cutoff**2 - SMOOTHED * cell**2, TINY)))
    full = filtered + values - rest
    bend = np.where(seen, x * x - (square / number)[:, None], 0.0)
    bend = bend - np.where(seen, ((bend * x).sum(axis=1) / square)[:, None] * x, 0.0)
    curve = (bend * values).sum(axis=1) / np.maximum((bend * bend).sum(axis=1), 1e-300)
    form, total = (_range(v, v, seen) for v in (filtered, full))
    slope, form, total, crowning = (
        np.where(able, f, np.nan) for f in (slope * slope_length, form, total, -curve * (whole / 2) ** 2)
    )
    return Line(slope, form, total, crowning, np.where(seen, full, np.nan))


def unseen_ends(trace: Array, at: Array, figures: Callable[[Array], Line]) -> Line:
    """By how much (mm) the figures of traces (flanks, POINTS) may be off because their ends were not seen.

    The larger of what they change by where the ends go on level, and where they go on as the mean parabola does.
    """
    seen = np.isfinite(trace)
    level, curved = trace.copy(), trace.copy()
    for flank in np.flatnonzero((seen.sum(axis=1) >= LEAST_CELLS) & ~seen.all(axis=1)):
        on = seen[flank]
        level[flank] = np.interp(at, at[on], trace[flank, on])
        curved[flank, ~on] = np.polyval(np.polyfit(at[on], trace[flank, on], 2), at[~on])
    base, ends = figures(trace), (figures(level), figures(curved))

    def apart(name: str) -> Array:
        return np.asarray(np.maximum(*(np.abs(getattr(end, name) - getattr(base, name)) for end in ends)))

    return Line(apart("slope"), apart("form"), apart("total"), apart("crowning"), apart("filtered"))


def _range(high: Array, low: Array, seen: Mask) -> Array:
    """Largest of ``high`` less least of ``low`` (flanks,) of what was seen; 0 where nothing was."""
    top, bottom = np.where(seen, high, -np.inf).max(axis=1), np.where(seen, low, np.inf).min(axis=1)
    return np.asarray(np.where(seen.any(axis=1), top - bottom, 0.0))


def _low_pass(values: Array, weight: Array, at: Array, cutoff: float) -> Array:
    """Traces (flanks, n) at evenly spaced places (n,) after a Gaussian that halves waves of ``cutoff`` mm."""
    kernel = _gaussian(at.size, float(at[-1] - at[0]) / (GAUSS * cutoff))
    return np.asarray((weight * values) @ kernel / np.maximum(weight @ kernel, 1e-300))


@lru_cache(maxsize=8)
def _gaussian(number: int, length: float) -> Array:
    """(number, number) by how much places over a ``length``, in widths of the Gaussian, count for each other."""
    at = np.linspace(0.0, length, number)
    return np.asarray(np.exp(-pi * np.square(at[:, None] - at)))


def _columns(cells: Array) -> Array:
    """Cells (2, teeth, roll lengths, heights) as columns (flanks, heights, roll lengths)."""
    return np.asarray(cells.reshape(-1, *cells.shape[2:]).swapaxes(1, 2))


def _reading(
    values: Array, x: Array, variance: Array, waves: Array, reaches: Sequence[float], half_cell: float
) -> Reading:
    """How columns of cells (flanks, heights, roll lengths) are read at 0, at ``x`` from it (NaN: not seen).

    On flanks whose ``waves`` a parabola would level, the nearest cells stand.

    ``reaches``: mm to either side of which a parabola may take cells, the widest first. Where cells depart from it, or
    it from the nearest cells, by more than noise does, the flank bends there: those stand, and it may be anywhere
    between them, or between the ones next to them where they reach across 0 (``half_cell`` mm).
    """
    nearest, below, above = _between(x, values, half_cell)
    seen = np.asarray(np.isfinite(nearest).all(axis=2))
    weights, bends = nearest, seen.copy()
    for reach in reaches:
        parabola, off = _parabola(np.where(np.abs(x) < reach, x, np.nan), values, reach, variance)
        apart = parabola - nearest
        noise = np.sqrt((np.nan_to_num(apart) ** 2 * variance).sum(axis=2))
        with np.errstate(invalid="ignore"):
            same = bends & (np.abs((apart * values).sum(axis=2)) <= SAME * noise) & (off <= SAME)
            levelled = np.abs((np.nan_to_num(apart) * waves).sum(axis=2)).max(axis=1) > MOST_LEVELLED
            same &= ~levelled[:, None]
        weights, bends = np.where(same[..., None], parabola, weights), bends & ~same
    return Reading(np.nan_to_num(weights), seen, np.where(bends, below, 0.0), np.where(bends, above, 0.0))


def _gap(x: Array) -> Array:
    """How far (...) mm those of some ``x`` (..., n) that are nearest to 0 on either side are apart; NaN: not seen."""
    behind, before = np.where(x > 0, x, np.inf).min(axis=-1), np.where(x <= 0, x, -np.inf).max(axis=-1)
    return np.asarray(behind - before)


def _between(x: Array, values: Array, half_cell: float) -> tuple[Array, Array, Array]:
    """Weights (..., n) of straight lines between those nearest to 0 on either side; NaN where a side has none.

    And how far (...) below and above the line at 0 they lie, and those nearest to 0 that don't reach across it.
    """
    low, first = _nearest(-x, 0.0)
    high, last = _nearest(x, TINY)
    known = np.isfinite(first) & np.isfinite(last)
    share = np.where(known, first, 0.0) / np.where(known, first + last, 1.0)
    weights = np.zeros(x.shape)
    np.put_along_axis(weights, low, 1.0 - share, -1)
    np.put_along_axis(weights, high, share, -1)
    weights[~known[..., 0]] = np.nan
    about = [(low, first), (high, last), _nearest(-x, half_cell), _nearest(x, half_cell)]
    ends = [np.where(np.isfinite(d), np.take_along_axis(values, side, -1), np.nan)[..., 0] for side, d in about]
    line = (1.0 - share[..., 0]) * ends[0] + share[..., 0] * ends[1]
    return weights, line - np.fmin.reduce(ends), np.fmax.reduce(ends) - line


def _nearest(distance: Array, least: float) -> tuple[Ints, Array]:
    """Which (..., 1) of some cells (..., n), NaN: not seen, is the nearest of those ``least`` mm and more away, and its
    distance; infinite where there is none.
    """
    away = np.where(distance >= least, distance, np.inf)
    at = away.argmin(axis=-1)[..., None]
    return at, np.take_along_axis(away, at, -1)


def _parabola(x: Array, values: Array, reach: float, variance: Array) -> tuple[Array, Array]:
    """Weights (..., n) that read a parabola through values at ``x`` at 0; NaN with fewer than ``LEAST_WIDE`` of them.

    And by how many standard deviations (...) one of them departs from it at most.
    """
    on = np.isfinite(x)
    u = np.where(on, x / reach, 0.0)
    weight = np.where(on, 1.0 / np.maximum(variance, 1e-18), 0.0)
    weight = weight / np.maximum(weight.max(axis=-1, keepdims=True), 1e-300)
    terms = np.stack([np.ones(u.shape), u, u * u], axis=-1)
    weighted = (terms * weight[..., None]).swapaxes(-1, -2)
    normal = weighted @ terms
    able = (on.sum(axis=-1) >= LEAST_WIDE) & (np.linalg.cond(normal) < 1e6)
    normal[~able] = np.eye(3)
    solver = np.linalg.inv(normal) @ weighted
    solver[~able] = np.nan
    rest = values - (terms @ (solver @ values[..., None]))[..., 0]
    off = np.where(on, np.abs(rest) / np.sqrt(np.maximum(variance, 1e-18)), 0.0).max(axis=-1)
    return np.asarray(solver[..., 0, :]), off


def _interpolation(at: Array, places: Array, beyond: Array, widest: float = inf) -> Interpolation:
    """Straight lines between values of each flank at ``at`` (flanks, n) mm, NaN: not seen, read at ``places``.

    ``beyond`` (flanks, n) mm: so far beyond the first and the last one their value holds; farther nothing is seen, nor
    between two that are more than ``widest`` mm apart.
    """
    shape = at.shape[0], places.size
    first, last, share = np.zeros(shape, dtype=np.intp), np.zeros(shape, dtype=np.intp), np.zeros(shape)
    known, inside = np.zeros((2, *shape), dtype=bool)
    for flank in range(at.shape[0]):
        seen = np.flatnonzero(np.isfinite(at[flank]))
        if not seen.size:
            continue
        x = at[flank, seen]
        inside[flank] = (places >= x[0]) & (places <= x[-1])
        known[flank] = (places >= x[0] - beyond[flank, seen[0]]) & (places <= x[-1] + beyond[flank, seen[-1]])
        place = np.interp(places, x, np.arange(x.size, dtype=np.float64))
        below = np.minimum(place.astype(np.intp), max(x.size - 2, 0))
        first[flank], last[flank] = seen[below], seen[np.minimum(below + 1, x.size - 1)]
        share[flank] = place - below
        known[flank] &= (at[flank, last[flank]] - at[flank, first[flank]] <= widest) | ~inside[flank]
    return Interpolation(first, last, share, known, inside)
