"""Rays that should have met a flank, and cells in which they show nothing of it.

A profile meets a flank at one roll length at each height, and its geometry says where. Where profiles should have met
it and no reading lies, that is no gap between two profiles: the flank is broken there, covered, or readings got lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, log, pi, radians, sqrt, tau

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Mask
from truestand.core.assumptions import INCIDENCE_U
from truestand.core.calibration import Calibration
from truestand.core.inspection import CONTRADICTS
from truestand.core.robust import nan_median
from truestand.core.stand import Sensor
from truestand.core.surface import seen_at, sensor_origins, table_angle
from truestand.gear.flanks import Flanks, Toothing
from truestand.gear.geometry import SIGMA
from truestand.gear.grid import Grid, bin_index, bridge_gaps, column_of, each_of, step_on_flank
from truestand.gear.levels import level_of
from truestand.gear.runs import between_readings
from truestand.gear.views import GearView, part_of

KNOTS = 12
"""Roll lengths at which it is worked out when a flank is met."""
MOST_OFF = 0.1
"""mm of delta that a smooth flank may say where nothing was seen of it."""
LEAST_EXPECTED, NEARLY_ALL = 20, 0.9
"""Rays that should meet a row of cells, over all teeth of a side, and share of them that don't, from which nothing is
seen of it.
"""
LEAST_IN_ROW, EMPTY_BY_CHANCE = 15, 1e-3
"""Cells of a flank's row that rays should meet, and probability that they meet none of them, from which it is empty."""
ROWS_BESIDE, SELDOM = 2, 0.25
"""Rows below and above one, and how much less of it than of them is shown, on all teeth, where it is hidden."""
STEPS_OF_INCIDENCE = 20
"""In which it is told how many rays get lost: as many rays in each."""
LIMIT_SPARE = radians(1.0)
"""By which rays must be less steep than the sensor's limit for their readings to be missed: so far flanks may lean or
bend otherwise than the drawing has them near their root.
"""
MOST_OUT = CONTRADICTS * sqrt(1.5)
"""U of incidence by which steep flanks may read farther out: a shift, half of a slope and half of a bend, and half as
much again.
"""
STEP_OF_HEIGHT = 1e-3
"""mm in which it is told how high rays near the limit pass over a flank."""
MOST_LOST_BY_OTHERS = 0.2
"""Share of the rays of other teeth that may be missed where those of one tell damage."""
MOST_SPACINGS = 2.0
"""Times as far as is usual that readings next to each other on the sensor's line may lie apart on one flank: where they
lie farther apart, an edge hides what is between them.
"""
STANDS_WITHIN = 0.01
"""mm of delta within which it is known where a flank stands. A reading may lie as far along the roll length from where
its ray should meet the flank as that explains, and a cell at least."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Cells (2, teeth, roll lengths, heights) in which a ray should meet a flank."""

    expected: Mask
    missed: Mask
    """Those of them that show nothing of it."""
    facing: Array
    """Cosine of the ray's incidence on each; NaN: never met."""
    on_end: float = 1.0
    """Cells of a profile that get lost together, usually."""

    @property
    def lost_in_row(self) -> Array:
        """Share (2, 1, roll lengths, 1) of the cells of each side and roll length that are missed."""
        expected, missed = (n.sum(axis=(1, 3), keepdims=True) for n in (self.expected, self.missed))
        return np.asarray(missed / np.maximum(expected, 1))

    @property
    def lost(self) -> Array:
        """Share (2, teeth, roll lengths, heights) of the cells like each that are missed, of its row or of those seen
        as steeply: the steeper a flank is seen, the more readings get lost on sound ones too.
        """
        shares = np.broadcast_to(self.lost_in_row, self.expected.shape).copy()
        for share, expected, missed, facing in zip(shares, self.expected, self.missed, self.facing, strict=True):
            if expected.any():
                edges = np.quantile(facing[expected], np.linspace(0.0, 1.0, STEPS_OF_INCIDENCE + 1)[1:-1])
                step = np.searchsorted(edges, facing)
                of, lost = (np.bincount(step[c], minlength=STEPS_OF_INCIDENCE) for c in (expected, missed))
                np.maximum(share, (lost / np.maximum(of, 1))[step], out=share)
        return shares

    @property
    def hidden(self) -> Mask:
        """(2,): sides on which rays should meet a row of cells, and hardly one does on any tooth: undercut, relieved or
        worn on all of them, or seen too steeply, the flanks stand out of view there.
        """
        expected = self.expected.sum(axis=(1, 3))
        return np.asarray(((expected >= LEAST_EXPECTED) & (self.lost_in_row[:, 0, :, 0] > NEARLY_ALL)).any(axis=1))

    @property
    def hidden_between(self) -> Mask:
        """(2,): sides on which a row is hidden of which plainly more is shown both below and above: the floor of a
        groove along the face of all teeth, whose rays meet its edge. Near the root, where nothing is shown below
        either, it must be far less than above.
        """
        expected = self.expected.sum(axis=(1, 3))
        often = expected >= LEAST_EXPECTED
        shown = np.where(often, 1.0 - self.lost_in_row[:, 0, :, 0], 0.0)
        beside = np.pad(shown, ((0, 0), (ROWS_BESIDE, ROWS_BESIDE)))
        below, above = (
            np.maximum.reduce([np.roll(beside, sign * k, axis=1) for k in range(1, ROWS_BESIDE + 1)])[
                :, ROWS_BESIDE:-ROWS_BESIDE
            ]
            for sign in (1, -1)
        )
        lower = np.maximum.accumulate(shown, axis=1)
        near_root = (lower < SELDOM**2 * above) & (expected * above > LEAST_IN_ROW)
        return np.asarray((often & (near_root | (shown < SELDOM * np.minimum(below, above)))).any(axis=1))

    @property
    def in_empty_rows(self) -> Mask:
        """Cells (2, teeth, roll lengths, heights) of rows of a flank all of which are missed, as chance does not: the
        floor of such a groove on this flank.
        """
        expected, missed = (cells.sum(axis=3) for cells in (self.expected, self.missed))
        by_chance = expected * np.log(np.maximum(self.lost_in_row[..., 0], 1e-6))
        empty = (expected >= LEAST_IN_ROW) & (missed == expected) & (by_chance < log(EMPTY_BY_CHANCE))
        return np.asarray(self.expected & empty[:, :, :, None])


@dataclass(frozen=True, slots=True)
class FlankRays:
    """The same rays, held to be missed for one reason or another.

    Readings beside a narrow dent hide it from the first; where the rays that should meet the floor of a groove meet its
    edge, only the last two tell.
    """

    beside: Rays
    """Missed where no reading lies about it along the roll length,"""
    between: Rays
    """where more readings are missing, between others of a profile, than are there,"""
    in_runs: Rays
    """those of them where a profile lacks far more readings on end than is usual,"""
    alone: Rays
    """and those of these that it lacks between two which show the flank,"""
    own: Rays
    """where no reading lies in the cell,"""
    inside: Rays
    """and the same of those that meet it in that cell wherever in ``STANDS_WITHIN`` it stands."""


def rays_of_views(grid: Grid, surface: Array, flanks: Flanks, views: Sequence[GearView]) -> FlankRays:
    """``rays_on_flanks`` of all views: missed is a cell that none of those which should see it shows."""
    of_views = [
        rays_on_flanks(grid, surface, level_of(view, grid), part_of(flanks, views, k), view)
        for k, view in enumerate(views)
    ]
    return FlankRays(*(_of_any([getattr(rays, kind) for rays in of_views]) for kind in FlankRays.__slots__))


def _of_any(rays: list[Rays]) -> Rays:
    """The rays of several views, but for those of a view that loses most of them where another one doesn't."""
    if len(rays) == 1:
        return rays[0]
    seen = [of_view.lost_in_row <= NEARLY_ALL for of_view in rays]
    by_none = ~np.logical_or.reduce(seen)
    expected = [of_view.expected & (able | by_none) for of_view, able in zip(rays, seen, strict=True)]
    shown = np.logical_or.reduce([own & ~of_view.missed for own, of_view in zip(expected, rays, strict=True)])
    any_expected = np.logical_or.reduce(expected)
    facing = np.fmax.reduce(
        [np.where(own | ~any_expected, of_view.facing, np.nan) for own, of_view in zip(expected, rays, strict=True)]
    )
    return Rays(any_expected, any_expected & ~shown, facing, max(of_view.on_end for of_view in rays))


def rays_on_flanks(grid: Grid, surface: Array, level: Array, flanks: Flanks, view: GearView) -> FlankRays:
    """The rays that should meet flanks which stand at ``surface`` (2, teeth, roll lengths, heights) mm of delta, but at
    heights that stand elsewhere as a whole: in a groove along the profile. ``level`` (2, teeth, roll lengths, heights)
    mm: by how much more the view reads.
    """
    nominal, scan, calibration = grid.nominal, view.scan, view.calibration
    low, high = nominal.profile_range
    rows = np.unique(np.linspace(0, grid.rolls.size - 1, KNOTS).astype(np.intp))
    stands = surface[:, :, rows] + nan_median(grid.delta - surface, axis=2)[:, :, None]
    stands = np.clip(np.nan_to_num(stands), -MOST_OFF, MOST_OFF) + level[:, :, rows]
    met, facing = _met_at(flanks.toothing, calibration, grid, rows, stands)
    truly_met = met
    if level.any():
        at_mean, _ = _met_at(flanks.toothing, calibration, grid, rows, stands - level[:, :, rows])
        truly_met = met + np.angle(np.exp(1j * (at_mean - met)))
    facing = _along_roll(facing, rows, grid.rolls.size)
    angle = np.sort(table_angle(scan, calibration)[np.isfinite(scan.z).any(axis=1)])
    turned = STANDS_WITHIN / nominal.base_radius
    limits = low + float(step_on_flank(nominal, low, turned)), high
    between = between_readings(flanks, grid, scan.live, limits)
    near_root, better_seen = _by_the_fillet(grid, view)
    nothing_looks = bridge_gaps(between.blind, grid, 2 * turned) | _between_neighbours(flanks, grid, scan.live.size)
    expected, inside = _expected(angle, met, truly_met, grid, rows, limits, turned) & ~(nothing_looks | better_seen)
    beside = bridge_gaps(grid.seen, grid, 2 * turned)
    too_steep, nearly = _too_steep(facing, grid, scan.stand.sensor, Rays(expected, expected & ~beside, facing))
    expected, inside = expected & ~too_steep, inside & ~too_steep
    untold = too_steep | near_root | (nearly & ~(expected & ~beside))
    passed, missed = between.cells & ~untold, between.missed & ~untold
    kinds = (
        (expected, ~beside), (passed, missed), (passed, missed & between.in_runs), (passed, missed & between.alone),
        (expected, ~grid.seen), (inside, ~grid.seen),
    )  # fmt: skip
    return FlankRays(*(Rays(of, of & not_seen, facing, between.on_end) for of, not_seen in kinds))


def _too_steep(facing: Array, grid: Grid, sensor: Sensor, rays: Rays) -> tuple[Mask, Mask]:
    """Cells (2, teeth, roll lengths, heights) whose ``rays``, at a cosine ``facing`` (NaN: never met) of incidence,
    come so near the sensor's limit that none need be read; or so near that it may be, where other teeth don't show
    those that come as near either. And all cells that are so near.
    """
    if sensor.incidence_limit is None:
        nowhere = np.zeros(facing.shape, dtype=bool)
        return nowhere, nowhere
    out = MOST_OUT * (INCIDENCE_U if sensor.incidence_U is None else sensor.incidence_U)
    passed = _passed_over(facing, grid, pi / 2 - sensor.incidence_limit + LIMIT_SPARE)
    with np.errstate(invalid="ignore"):
        beyond, near = passed < 0, passed < out
    lost = _lost_by_others(replace(rays, expected=rays.expected & ~beyond, missed=rays.missed & ~beyond), passed, out)
    return np.asarray(beyond | (near & (lost > MOST_LOST_BY_OTHERS))), near


def _passed_over(facing: Array, grid: Grid, steepest: float) -> Array:
    """How high, mm, rays at a cosine ``facing`` (2, teeth, roll lengths, heights) of incidence pass over a flank where
    it is as steep to them as ``steepest`` (rad, between ray and surface); below zero where they are steeper.

    A flank that reads farther out where it is steep is read where a ray passes it, before the ray meets it more
    steeply: by an angle g to the flank, whose radius r is the roll length, it comes down to it by g r dg. Both grow
    along an involute, the radius by the base radius.
    """
    roll = grid.rolls[:, None]
    less = np.arcsin(facing) - steepest
    there = np.maximum(roll - grid.nominal.base_radius * np.maximum(less, 0.0), 0.0)
    middle = 4 * (steepest + less / 2) * (there + roll) / 2
    return np.asarray(less / 6 * (steepest * there + middle + (steepest + less) * roll))


def _lost_by_others(rays: Rays, passed: Array, most: float) -> Array:
    """Share (2, teeth, roll lengths, heights) of the rays that other teeth miss which have ``passed`` over them as high
    as each ray over its own, or up to ``STANDS_WITHIN`` less; of all that are lower where those are few, and 1 where
    these are, too. Rays that pass higher than ``most`` (mm) are not told apart.
    """
    shares, teeth = np.zeros(rays.expected.shape), np.arange(rays.expected.shape[1])
    steps = ceil(most / STEP_OF_HEIGHT) + 1
    step = np.clip(np.nan_to_num(passed) / STEP_OF_HEIGHT, 0, steps - 1).astype(np.intp)
    at = teeth[:, None, None] * steps + step
    for side, share in enumerate(shares):
        (expected, lower), (missed, missed_lower) = (
            _of_others(np.bincount(at[side][cells], minlength=teeth.size * steps).reshape(-1, steps))
            for cells in (rays.expected[side], rays.missed[side])
        )
        few = expected < LEAST_EXPECTED
        of, lost = np.where(few, lower, expected), np.where(few, missed_lower, missed)
        share[...] = np.where(of < LEAST_EXPECTED, 1.0, lost / np.maximum(of, 1)).reshape(-1)[at[side]]
    return shares


def _of_others(number: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of a ``number`` (teeth, steps) of rays, those (teeth, steps) of all other teeth in a step and in
    ``STANDS_WITHIN`` below it, and all up to it.
    """
    upto, within = np.cumsum(number.sum(axis=0) - number, axis=1), round(STANDS_WITHIN / STEP_OF_HEIGHT) + 1
    below = np.pad(upto, ((0, 0), (within, 0)))[:, : upto.shape[1]]
    return upto - below, upto


def _by_the_fillet(grid: Grid, view: GearView) -> tuple[Mask, Mask]:
    """Cells (2, teeth, roll lengths, heights) near the root of which one of several views doesn't tell readings of the
    fillet apart, and those of them that another one sees less steeply.
    """
    near = np.zeros(grid.delta.shape, dtype=bool)
    if view.steeper is None or view.fillet_reach is None:
        return near, near
    near |= (grid.rolls - grid.size[0] / 2 < view.fillet_reach[:, None])[:, None, :, None]
    return near, near & view.steeper[:, None, None, None]


def _between_neighbours(flanks: Flanks, grid: Grid, points: int) -> Mask:
    """Cells (2, teeth, roll lengths, heights) that a profile, of so many ``points``, passes between two readings next
    to each other on the sensor's line: where those lie farther apart than cells are high, no ray meets some of them.
    """
    order, apart = flanks.along_profiles(points)
    roll, height = flanks.roll[order], flanks.height[order]
    spacing = np.abs(np.diff(height))
    beside = np.flatnonzero(apart == 1)
    beside = beside[spacing[beside] <= MOST_SPACINGS * np.median(spacing[beside])] if beside.size else beside
    ends = np.sort(column_of(np.stack([height[beside], height[beside + 1]]), grid.edges), axis=0)
    number = np.maximum(ends[1] - ends[0] - 1, 0)
    of, before = each_of(number)
    column = ends[0, of] + 1 + before
    pair = beside[of]
    share = (grid.heights[column] - height[pair]) / (height[pair + 1] - height[pair])
    rolls = (1.0 - share) * roll[pair] + share * roll[pair + 1]
    row = bin_index(rolls, grid.nominal.control_roll, grid.nominal.tip_roll, grid.rolls.size)
    cells = np.zeros((grid.delta.shape[0] * grid.delta.shape[1], *grid.delta.shape[2:]), dtype=bool)
    cells[flanks.flank[order][pair], row, column] = True
    return cells.reshape(grid.delta.shape)


def _expected(
    angle: Array,
    met: Array,
    truly_met: Array,
    grid: Grid,
    rows: NDArray[np.intp],
    limits: tuple[float, float],
    turned: float,
) -> Mask:
    """Cells (2, 2, teeth, roll lengths, heights) in which profiles at increasing table angles (n,) rad should meet
    flanks, at roll lengths within ``limits`` (mm): all, and those where they do even if they are met ``turned`` rad
    sooner or later.

    ``met``, ``truly_met`` (2, teeth, k, heights) rad: table angle at which they are met in these ``rows`` of cells,
    where the view reads them and where they stand; NaN: never. A ray whose reading would lie on a flank, but which
    meets what is beyond its end, need not be read there.
    """
    shape, nominal = grid.delta.shape, grid.nominal
    expected, inside = np.zeros((2, *shape), dtype=bool)
    for side, tooth, column in np.ndindex(shape[0], shape[1], shape[3]):
        on = side, tooth, slice(None), column
        at = _angles_met(angle, met[on])
        roll, true = (_rolls_at(at, of[on], grid.rolls[rows]) for of in (met, truly_met))
        roll = roll[(roll > limits[0]) & (roll < limits[1]) & (true > limits[0]) & (true < limits[1])]
        row = bin_index(roll, nominal.control_roll, nominal.tip_roll, shape[2])
        to_border = grid.size[0] / 2 - np.abs(roll - grid.rolls[row])
        expected[side, tooth, row, column] = True
        inside[side, tooth, row[to_border > step_on_flank(nominal, roll, turned)], column] = True
    return np.stack([expected, inside])


def _met_at(
    toothing: Toothing, calibration: Calibration, grid: Grid, rows: NDArray[np.intp], delta: Array
) -> tuple[Array, Array]:
    """Table angle (2, teeth, rows, heights) rad at which flanks at ``delta`` (same shape) mm come into the plane, and
    the cosine of their rays' incidence there.
    """
    side, tooth, i, j = np.indices(delta.shape).reshape(4, -1)
    points = toothing.points((side, tooth), grid.rolls[rows][i], grid.heights[j], delta.reshape(-1))
    angle = seen_at(calibration, points)
    normal = toothing.gradient(points, SIGMA[side])
    to_sensor = sensor_origins(calibration, angle) - points
    length = np.linalg.norm(normal, axis=1) * np.linalg.norm(to_sensor, axis=1)
    facing = (normal * to_sensor).sum(axis=1) / length
    return np.asarray(np.unwrap(angle.reshape(delta.shape), axis=2)), facing.reshape(delta.shape)


def _along_roll(values: Array, rows: NDArray[np.intp], number: int) -> Array:
    """Values (2, teeth, k, heights) of these ``rows`` of cells, for all rows: (2, teeth, number, heights)."""
    every = np.arange(number)
    behind = np.clip(np.searchsorted(rows, every), 1, rows.size - 1)
    share = ((every - rows[behind - 1]) / (rows[behind] - rows[behind - 1]))[:, None]
    return np.asarray((1.0 - share) * values[:, :, behind - 1] + share * values[:, :, behind])


def _angles_met(angle: Array, met: Array) -> Array:
    """Table angles (m,) rad, less whole turns, of profiles at increasing angles (n,) that meet a flank.

    ``met`` (k,) rad: angle at which it is met at k roll lengths; NaN: never.
    """
    found = [np.zeros(0)]
    if angle.size and np.isfinite(met).all():
        low, high = float(met.min()), float(met.max())
        for turn in range(floor((angle[0] - high) / tau), ceil((angle[-1] - low) / tau) + 1):
            first, last = np.searchsorted(angle, [low + tau * turn, high + tau * turn])
            found.append(angle[first:last] - tau * turn)
    return np.concatenate(found)


def _rolls_at(at: Array, met: Array, rolls: Array) -> Array:
    """Roll lengths (m,) mm at which a flank is met at table angles ``at`` (m,) rad; NaN: beyond its ends.

    ``met`` (k,) rad: table angle at which it is met at ``rolls`` (k,) mm.
    """
    upward = slice(None, None, 1 if met[-1] >= met[0] else -1)
    return np.interp(at, met[upward], rolls[upward], left=np.nan, right=np.nan)
