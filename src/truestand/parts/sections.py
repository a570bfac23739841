"""One section of a turned part: its readings, and the statistics of the map r - R that they make."""

from dataclasses import dataclass, replace
from math import sqrt, tau

import numpy as np

from truestand.apply.datum import Datum
from truestand.core.arrays import Array, Ints, Mask
from truestand.parts.drawings import Section, Turned
from truestand.parts.patches import TRUSTED, Grid, Patches, Readings, patches_of
from truestand.parts.rings import (
    LEVEL,
    Reading,
    Rings,
    Trend,
    read_edges,
    read_rings,
    read_steps,
    read_trend,
    trend_of,
)
from truestand.parts.views import PartView
from truestand.statistics.lone_readings import lone_readings
from truestand.statistics.noise import cleared, from_noise

REACH = 1.0
"""mm: a surface farther than this from its drawing is another one's, or an outlier."""
MARGIN = 0.3
"""mm from a section's ends: chamfers, fillets, burrs."""
CELLS_PER_WAVE, FINE_CELLS_PER_WAVE = 20, 6
"""At the filter's cut-off: their width takes 0.4 % of its amplitude, or 5 % where they are low instead."""
LEAST_ANGLES = 36
CIRCLE_HEIGHT = 1.0
"""mm of height that one circle is read from."""
READINGS_PER_CELL, READINGS_PER_FINE_CELL = 12, 4
"""On average, where there are so many."""
PLAINLY = 3.0
"""Standard deviations by which lower cells must read more to count."""
FINE_HEIGHT, SPACINGS, FINE_SPACINGS = 0.25, 2.0, 1.5
"""mm of height, and points of a profile at least, by which it is told what was seen; and points by which it is told
what higher cells flatten."""
END_BIN, END_FILLED = 0.25, 0.3
"""mm of height, and share of the usual number of its readings, from which the part reaches there."""
END_FACE, END_FACE_SHARE, MORE_AT_END = 0.05, 0.05, 2.0
"""mm off the section's median; share of the readings next to an end that are so, and how many times that of the others,
from which some are of its end face."""
END_SHARE = 1e-3
"""Of a section's readings: those beyond its ends as seen may be strays."""
TREND_PASSES = 2
"""The second from readings that the first has brought to the middle of their cells."""
EXTREMES = np.array([False, True, True, True, True])
"""Of the statistics, those that are ranges: all but the diameter."""
BLOCK = 256
"""Profiles worked on at once."""


@dataclass(frozen=True, slots=True)
class Inspected:
    """The part and the view that it is inspected by."""

    part: Turned
    view: PartView
    datum: Datum

    @property
    def a_turn(self) -> float:
        """Profiles of one turn."""
        return self.view.scan.profiles / max(self.view.scan.revolutions, 1.0)


@dataclass(frozen=True, slots=True)
class Seen:
    """Readings (n,) of a section: where they stand in the scan, r - R (mm), polar angle (rad) and height (mm) about the
    datum axis; and the heights (mm) between which the section is read.
    """

    flat: Ints
    deviation: Array
    angle: Array
    height: Array
    lone: Mask
    """Those that nothing bears out."""
    low: float
    high: float
    trend: Trend

    def readings(self, grid: Grid) -> Readings:
        """The readings in the cells of a grid, brought to the middle of their cells' heights along the trend."""
        cell, trend = grid.cells(self.angle, self.height), self.trend
        middle = grid.height[cell // grid.angles]
        level = self.deviation - trend.at(self.angle, self.height) + trend.at(self.angle, middle)
        return Readings(self.flat, level, cell, self.lone)

    @property
    def spacing(self) -> float:
        """mm of height from one point of a profile to the next."""
        return float(np.median(np.abs(np.diff(self.height)))) if self.height.size > 1 else self.high - self.low

    @property
    def grid(self) -> Grid:
        """Cells by which it is told what was seen, whatever the height of those that form is read from."""
        heights = max(int((self.high - self.low) / max(FINE_HEIGHT, SPACINGS * self.spacing)), 1)
        return Grid(self.low, self.high, heights, LEAST_ANGLES)

    @property
    def share(self) -> float:
        """Of the section's surface that the readings show."""
        cells = self.grid.cells(self.angle, self.height)
        return float((np.bincount(cells, minlength=int(np.prod(self.grid.shape))) > 0).mean())

    @property
    def ends(self) -> tuple[float, float]:
        """mm of height from which and to which there are readings, but for a few."""
        low, high = np.quantile(self.height, (END_SHARE, 1 - END_SHARE))
        return float(low), float(high)


@dataclass(frozen=True, slots=True)
class Figures:
    """A section's statistics, read from cells of one height."""

    grid: Grid
    readings: Readings
    patches: Patches
    rings: Rings
    used: Array
    """(H, A) mm: the map that they are read from."""
    reading: Reading
    value: Array
    """(5,) mm, without the noise's share of ranges, as far as the section was seen."""
    more: Array
    """(5,) mm of it, which the trend says of what lies between the cells' middles and beyond them."""
    beyond: Array
    """(5,) mm: how much more it were if the trend went on where the ends were not seen."""
    edges: Array
    """(5,) mm: by how much the statistics change with where steep edges run."""
    noise: Array
    """(5,) mm: their standard deviation."""
    floor: Array
    """(5,) mm: what the noise alone would read."""


def readings_of(inspected: Inspected, section: Section) -> Seen:
    """The section's readings within the drawing's reach."""
    surface, view = inspected.view.surface, inspected.view
    margin = min(MARGIN, 0.15 * (section.top - section.bottom))
    low, high = section.bottom + margin, section.top - margin
    pose, width = inspected.datum.pose, surface.x.shape[1]
    flats, places = [], []
    for first in range(0, view.scan.profiles, BLOCK):
        rows = slice(first, first + BLOCK)
        z = surface.z[rows]
        near = np.flatnonzero((z > low - REACH) & (z < high + REACH))  # NaN compares false
        points = pose(np.stack([a[rows].ravel()[near] for a in (surface.x, surface.y, surface.z)], axis=-1))
        off = np.hypot(points[:, 0], points[:, 1]) - section.diameter / 2
        on = np.flatnonzero((np.abs(off) < REACH) & (points[:, 2] > low) & (points[:, 2] < high))
        flats.append(near[on] + first * width)
        places.append(points[on])
    (x, y, z), flat = np.concatenate(places).T, np.concatenate(flats)
    off = np.hypot(x, y) - section.diameter / 2
    clear = _clear_of_end_faces(z, off, low, high)
    x, y, z, flat, off = x[clear], y[clear], z[clear], flat[clear], off[clear]
    lone = lone_readings(off, np.zeros(off.size, dtype=np.int64), flat, width, view.angle)
    seen = Seen(flat, off, np.arctan2(y, x), z, lone, low, high, LEVEL)
    for _ in range(TREND_PASSES):
        mean = patches_of(seen.grid, seen.readings(seen.grid), REACH).mean
        seen = replace(seen, trend=trend_of(low, high, seen.grid.angle, seen.grid.height, mean))
    return seen


def _clear_of_end_faces(height: Array, off: Array, low: float, high: float) -> Mask:
    """Which of the readings (n,) at heights and ``off`` the drawing, mm, lie clear of the part's ends, where it ends
    before the section does: its end faces are no part of it. Where the sensor's view ends, there are none.
    """
    counts, edges = np.histogram(height, max(round((high - low) / END_BIN), 1), (low, high))
    on = np.ones(height.size, dtype=bool)
    if not counts.any():
        return on
    filled = np.flatnonzero(counts > END_FILLED * np.median(counts[counts > 0]))
    far = np.abs(off - np.median(off)) > END_FACE
    for end, inwards, ends_inside in (
        (edges[filled[0]], 1.0, filled[0] > 0),
        (edges[filled[-1] + 1], -1.0, filled[-1] < counts.size - 1),
    ):
        beyond = inwards * (height - end) < MARGIN
        if beyond.all():
            continue
        if ends_inside and far[beyond].mean() > END_FACE_SHARE + MORE_AT_END * far[~beyond].mean():
            on &= ~beyond
    return on


def figures_of(inspected: Inspected, section: Section, seen: Seen, fine: bool = False) -> Figures | None:
    """A section's statistics, or those that lower and wider cells (``fine``) tell of it; None where no height holds a
    circle.
    """
    if fine:
        lowest = max(FINE_HEIGHT, FINE_SPACINGS * seen.spacing)
        grid = _cells(inspected, seen, lowest, FINE_CELLS_PER_WAVE, READINGS_PER_FINE_CELL)
    else:
        grid = _cells(inspected, seen, CIRCLE_HEIGHT, CELLS_PER_WAVE, READINGS_PER_CELL)
    readings = seen.readings(grid)
    patches = patches_of(grid, readings, REACH)
    rings = Rings(section.diameter / 2, grid.angle, grid.height, patches.seen, float(inspected.part.upr))
    if not rings.used.any():
        return None
    used = np.where(patches.seen & rings.used[:, None], patches.mean, np.nan)
    reading = read_rings(rings, used)

    def read(maps: Array) -> Array:
        return read_rings(rings, maps).statistics

    clear = cleared(read, used, patches.noise, EXTREMES)
    more, whole = (read_trend(rings, used, seen.trend, *between) for between in (seen.ends, (seen.low, seen.high)))
    value = np.append(reading.statistics[0], clear.value[1:]) + more  # a mean has no bias
    noise = np.append(clear.scatter[0], clear.u[1:]) * _rougher(patches, rings, used)
    floor = from_noise(read, used, patches.noise)
    edges = _read_edges(grid, readings, patches, rings, used, tau / inspected.a_turn)
    return Figures(grid, readings, patches, rings, used, reading, value, more, whole - more, edges, noise, floor)


def _cells(inspected: Inspected, seen: Seen, height: float, per_wave: int, readings_per_cell: int) -> Grid:
    """Cells as narrow as the filter needs, and as high as ``height`` mm, or higher where readings are few."""
    angles = int(np.clip(min(per_wave * inspected.part.upr, inspected.a_turn / 2), LEAST_ANGLES, None))
    filled = seen.height.size / (readings_per_cell * angles)
    heights = int(np.clip(min((seen.high - seen.low) / height, filled), 1, None))
    return Grid(seen.low, seen.high, heights, angles)


def _read_edges(grid: Grid, readings: Readings, patches: Patches, rings: Rings, used: Array, step: float) -> Array:
    """By how much (5,) mm the statistics of the map ``used`` change with where steep edges run.

    Nobody knows it between two profiles, ``step`` rad apart, and readings that were not trusted may be what lies beyond
    an edge; nor on which side of a step that runs all round the readings of its heights lie.
    """
    total = np.bincount(readings.cell, minlength=patches.count.size).reshape(patches.count.shape)
    untrusted = 1.0 - patches.count / np.maximum(total, 1)
    steep = TRUSTED * sqrt(2.0) * float(np.median(patches.noise[patches.seen]))
    across = read_edges(rings, used, step / 2 * grid.angles / tau + untrusted, steep)
    return np.hypot(across, read_steps(rings, used, steep))


def with_shape_within(coarse: Figures, fine: Figures | None) -> tuple[Figures, Array]:
    """The figures, and by how much (5,) mm cells may flatten what they read.

    Where lower cells, seen all round, read plainly more than their noise explains, they count. What they flatten in
    turn is a sixth of the second difference along the height, as of a parabola whose peak lies between two cells, and
    half of it where it is as large as the figure: of a dent no longer than two cells are high. What the trend adds is
    doubted by a sixth, too, and by half where no lower cells bear it out.
    """
    if fine is None or fine.grid.heights == coarse.grid.heights or not fine.rings.closed.all():
        return coarse, np.abs(coarse.more) / 2
    known = np.hypot(coarse.value, fine.floor) + np.hypot(coarse.edges, fine.edges)
    more = np.maximum(fine.reading.statistics + fine.more - known, 0.0)
    more[0] = 0.0  # a mean has no extremes
    plain = more > np.maximum(PLAINLY * np.hypot(fine.noise, coarse.noise), fine.floor)
    bend = float(np.nanmax(np.abs(np.diff(fine.reading.form, 2, axis=0)), initial=0.0))
    left = bend * (1 / 6 + np.minimum(bend / np.maximum(fine.value, 1e-9), 1.0) / 3)
    pairs = {key: (getattr(fine, key), getattr(coarse, key)) for key in ("value", "more", "beyond", "edges", "noise")}
    drawn = fine if plain.any() else coarse  # the report shows what was read
    read = replace(drawn, **{key: np.where(plain, *pair) for key, pair in pairs.items()})
    return read, np.where(plain, left, more) + np.abs(read.more) / 6


def _rougher(patches: Patches, rings: Rings, used: Array) -> float:
    """By how much neighbouring cells differ more than their readings' own noise explains: speckle, drift, fine form."""
    usual = float(np.sqrt(np.nanmean(np.square(patches.noise[patches.seen]))))
    step = np.diff(np.where(rings.used[:, None], used, np.nan), axis=1)
    return max(1.0, float(np.sqrt(np.nanmedian(np.square(step)) / 0.4549 / 2)) / max(usual, 1e-12))
