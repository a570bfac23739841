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

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.gear.column_reading import Reading, columns_of, gap_about, reading_at
from truestand.gear.geometry import Involute
from truestand.gear.grid import TRACE_SHARE, Grid, step_on_flank
from truestand.gear.interpolation import LEAST_COLUMNS, Interpolation, Joined, interpolation, joined_columns
from truestand.gear.noise import CellNoise
from truestand.gear.trace_line import range_of

POINTS = 201
"""Of a trace, evenly over its evaluation range."""
WIDE_STEPS = (5.0, 2.5)
"""Steps of the table to either side over which a parabola is laid: the widest that fits."""
MOST_STEPS, MOST_CELLS = 3.0, 4.0
"""Steps of the table that the nearest cells on either side of the measuring circle may be apart, and cells along the
height that points of the helix may be: farther, readings got lost, and what lies between was not seen."""
LEAST_BENT = 3
"""Values that bend."""
SHARED_BY = 8
"""Teeth that say together what all of them share: of fewer, each has too much a say in it."""
HOLE = 1.0
"""mm of height over which a gap counts."""
MOST_APART = 1.6
"""Steps of the table, two cells at least, that readings at the middle of the face may be apart along a profile: an
eccentric gear is met 1.4 steps apart near its root; farther, all columns lost some."""


@dataclass(frozen=True)
class Traces:
    """How traces and positions follow from the cells."""

    nominal: Involute
    step: float
    """rad: table angle from one profile to the next."""
    cell: tuple[float, float]
    """mm of roll length and height."""
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

    @cached_property
    def profile(self) -> Joined:
        """The trace from the columns of the band."""
        return self._profile(0.0)

    @cached_property
    def shorter_profile(self) -> tuple[float, Joined]:
        """The same where the range is some mm shorter at either end: a cell."""
        return self.cell[0], self._profile(self.cell[0])

    @cached_property
    def between(self) -> Mask:
        """(flanks, POINTS): places of a profile between readings that lie too far apart."""
        rolls = self.rolls[:, self.band]
        return _too_far_apart(rolls.reshape(rolls.shape[0], -1), self.nominal, self.step, self.cell[0])

    @cached_property
    def helix(self) -> Interpolation:
        """The trace from the points on the circle."""
        return self._helix(0.0)

    @cached_property
    def other_ends(self) -> tuple[tuple[float, Interpolation], ...]:
        """The same where the range is longer by some mm at either end: a cell, and less a cell."""
        return tuple((longer, self._helix(longer)) for longer in (self.cell[1], -self.cell[1]))

    def _profile(self, shorter: float) -> Joined:
        places, rolls = profile_points(self.nominal, shorter), self.rolls[:, self.band]
        beyond = step_on_flank(self.nominal, rolls, self.step) / 2
        columns = tuple(interpolation(rolls[:, j], places, beyond[:, j]) for j in range(rolls.shape[1]))
        return joined_columns(columns, rolls.shape[2])

    def _helix(self, longer: float) -> Interpolation:
        places, cell = helix_points(self.nominal, longer), self.cell[1]
        return interpolation(self.heights, places, np.full(self.heights.shape, cell), MOST_CELLS * cell)


def traces_of(
    grid: Grid, noise: CellNoise, shared: Array, step: float, middle: float | None = None, circle: float | None = None
) -> Traces:
    """How the flanks of a grid are read; ``step``: table angle from one profile to the next, rad; ``shared`` (2, roll
    lengths, heights) mm: the shape that all teeth of a side have, NaN where it is not known.

    Profiles about the ``middle`` height (mm in C; None: of the face), helices at the roll length ``circle`` (mm; None:
    on the measuring circle).
    """
    nominal = grid.nominal
    middle = nominal.middle if middle is None else middle
    place = nominal.measuring_roll if circle is None else circle
    rolls = np.where(columns_of(grid.count) > 0, columns_of(grid.roll), np.nan)
    delta, variance = columns_of(np.nan_to_num(grid.delta)), columns_of(noise.variance) + noise.of_row**2

    def reading(place: float) -> Reading:
        wide = [max(steps * float(step_on_flank(nominal, place, step)), 1.5 * grid.size[0]) for steps in WIDE_STEPS]
        more = columns_of(_shared_from(place, shared, grid))
        return reading_at(delta, rolls - place, variance, columns_of(noise.waves), more, wide, grid.size[0] / 2)

    on_circle = reading(place)
    share = np.abs(on_circle.weights)
    widest = MOST_STEPS * float(step_on_flank(nominal, place, step)) + grid.size[0]
    gap = gap_about(rolls - place)
    near = on_circle.seen & (gap <= widest)
    heights = (share * columns_of(grid.height)).sum(axis=2) / np.maximum(share.sum(axis=2), 1e-300)
    off_middle = np.abs(grid.heights - middle)
    band = np.asarray(off_middle <= max(TRACE_SHARE * nominal.gear.face_width, float(off_middle.min())))
    across = _widest_over(np.where(np.isfinite(gap), gap, 0.0), max(1, round(HOLE / grid.size[1])))
    ball = reading(nominal.ball_roll) if circle is None else on_circle
    return Traces(nominal, step, grid.size, band, rolls, np.where(near, heights, np.nan), across, on_circle, ball)


def _shared_from(place: float, shared: Array, grid: Grid) -> Array:
    """By how much (2, teeth, roll lengths, heights) mm more the shape that all teeth share, (2, roll lengths, heights)
    mm, stands in the cells than at the roll length ``place`` (mm); 0 where it is not known.
    """
    more = np.zeros(grid.roll.shape)
    for side, column in np.ndindex(shared.shape[0], shared.shape[2]):
        known = np.isfinite(shared[side, :, column])
        if known.any():
            rolls, shape = grid.rolls[known], shared[side, known, column]
            more[side, :, :, column] = np.interp(grid.roll[side, :, :, column], rolls, shape)
            more[side, :, :, column] -= np.interp(place, rolls, shape)
    return more


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
    return (read or traces.profile)(np.nan_to_num(columns_of(delta)[:, traces.band]))


def helix_of(delta: Array, traces: Traces) -> Array:
    """Helix traces (flanks, POINTS) of cells (2, teeth, roll lengths, heights); NaN where not seen."""
    return traces.helix(traces.circle(delta))


def circle_points(delta: Array, traces: Traces) -> Array:
    """Points of the helix (flanks, heights) mm, one a column of cells (2, teeth, roll lengths, heights); NaN: none."""
    return np.where(np.isfinite(traces.heights), traces.circle(delta), np.nan)


def position_of(points: Array, reading: Reading, traces: Traces) -> Array:
    """What a reading's ``points`` (flanks, heights) mm say at the middle of the face, (flanks,) mm.

    NaN where most columns of the band are not seen.
    """
    return _mean_of_columns(points[:, traces.band], reading.seen[:, traces.band])


def position_bend(reading: Reading, traces: Traces) -> Array:
    """By how much (flanks,) mm ``position_of`` may be off where flanks bend; NaN where most columns are not seen."""
    return position_of(np.maximum(reading.below, reading.above), reading, traces)


def _mean_of_columns(values: Array, seen: Mask) -> Array:
    """Mean (...) of the columns (..., band) that were seen; NaN where most were not."""
    number = seen.sum(axis=-1)
    mean = np.where(seen, values, 0.0).sum(axis=-1) / np.maximum(number, 1)
    return np.where(number >= LEAST_COLUMNS * seen.shape[-1], mean, np.nan)


def profile_bend(delta: Array, shape: Array, grid: Grid, traces: Traces) -> Array:
    """By how much (flanks,) mm profiles may reach beyond the cells that they are read from, where they bend otherwise
    than the ``shape`` (2, rolls, heights) mm that all teeth share (how that is sampled, ``profile_unsampled`` says).

    Noise bends columns each its way: theirs are averaged, as the profile is.
    """
    nominal, points, profiles = traces.nominal, profile_points(traces.nominal), profile_of(delta, traces)
    rest = columns_of(np.nan_to_num(delta - _where_all_show_it(shape, grid, traces)))[:, traces.band]
    found = np.zeros(profiles.shape[0])
    for flank, (profile, values, rolls) in enumerate(zip(profiles, rest, traces.rolls[:, traces.band], strict=True)):
        seen = np.isfinite(profile)
        if seen.any():
            bends = _bends_of_columns(values, rolls, points, nominal.profile_range)
            straight = profile - np.polyval(np.polyfit(points[seen], profile[seen], 1), points)
            for farthest in (np.nanargmax(straight), np.nanargmin(straight)):
                step = float(step_on_flank(nominal, points[farthest], traces.step))
                found[flank] = max(found[flank], bends[np.abs(points - points[farthest]) <= step].max())
    return found


def _bends_of_columns(values: Array, at: Array, points: Array, limits: tuple[float, float]) -> Array:
    """By how much (n,) mm a flank bends between readings about some ``points`` (n,) mm, as its columns have it on the
    mean: ``values`` (columns, rolls) mm ``at`` roll lengths (NaN: not seen).
    """
    total, number = np.zeros(points.size), 0
    for column, roll in zip(values, at, strict=True):
        on = np.flatnonzero((roll >= limits[0]) & (roll <= limits[1]))
        if on.size >= LEAST_BENT:
            total += np.interp(points, roll[on][1:-1], _bends(column[on], roll[on]))
            number += 1
    return np.abs(total) / max(number, 1)


def _where_all_show_it(shape: Array, grid: Grid, traces: Traces) -> Array:
    """The ``shape`` (2, rolls, heights) mm that all teeth share, where readings (2, teeth, rolls, heights) lie, on a
    side of which together they show the whole profile; 0 on another one, on which they may all lie beside a wave.
    """
    low, high = traces.nominal.profile_range
    inside = (grid.rolls > low) & (grid.rolls < high)
    along = _along_profile(shape, traces)
    along[~np.isfinite(along[:, inside]).all(axis=1)] = 0.0
    return np.stack([
        np.interp(roll, grid.rolls[known], of_side[known])
        for roll, of_side, known in zip(grid.roll, along, np.isfinite(along), strict=True)
    ])  # fmt: skip


def _along_profile(shape: Array, traces: Traces) -> Array:
    """What a ``shape`` (2, rolls, heights) mm has along the profile (2, rolls); NaN: not known."""
    band = shape[:, :, traces.band]
    return _mean_of_columns(band, np.isfinite(band))


def profile_unsampled(shape: Array, grid: Grid, traces: Traces) -> Array:
    """By how much profiles (flanks, POINTS) mm are off between their readings where ``shape`` (2, rolls, heights) mm,
    which all teeth share, is theirs as well; NaN: not known.
    """
    along, points = _along_profile(shape, traces), profile_points(traces.nominal)
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
    range_read = range_of(points, points, on)
    wider = range_of(points + circle.above, points - circle.below, on) - range_read
    narrower = range_read - np.maximum(range_of(points - circle.below, points + circle.above, on), 0.0)
    return np.asarray(np.maximum(wider, narrower) + _bend(points, traces.heights, (low, high)))


def _bend(values: Array, at: Array, limits: tuple[float, float]) -> Array:
    """By how much (flanks,) mm smooth curves through values (flanks, n) may reach beyond the farthest of them.

    0 for fewer than ``LEAST_BENT``.
    """
    found = np.zeros(values.shape[0])
    for flank in range(values.shape[0]):
        on = np.flatnonzero((at[flank] >= limits[0]) & (at[flank] <= limits[1]))  # NaN: not seen
        if on.size < LEAST_BENT:
            continue
        x, y = at[flank, on], values[flank, on]
        bend = np.abs(_bends(y, x))
        rest = y - np.polyval(np.polyfit(x, y, 1), x)
        for farthest in (int(np.argmax(rest)), int(np.argmin(rest))):
            found[flank] = max(found[flank], bend[max(farthest - 2, 0) : farthest + 1].max(initial=0.0))
    return found


def _bends(values: Array, at: Array) -> Array:
    """By how much (n - 2,) mm a parabola through values (n,) ``at`` increasing places bends between two of them: an
    eighth of their second difference.
    """
    share = (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
    return np.asarray((values[1:-1] - (1.0 - share) * values[:-2] - share * values[2:]) / 4.0)
