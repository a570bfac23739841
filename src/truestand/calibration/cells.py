"""From seven million readings to some ten thousand surface cells: robust means and their weights.

A cell is a few neighbouring profiles times a short piece of height on one cylinder. Within it the model is linear to
nanometres, so the means of x, z and angle carry all that the readings say. Readings far from the surface that the
present model predicts are weighted down (Tukey's biweight) before the mean is taken; none is dropped from the scan.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import tau

import numpy as np

from truestand.calibration.model import Model, Readings
from truestand.calibration.segment import Band
from truestand.core.arrays import Array, Ints, Mask
from truestand.core.frames import PHI, RADIAL, LaserPlane
from truestand.core.robust import m_estimator_correction, tukey_slopes, tukey_weights
from truestand.core.scan import Scan

BLOCK = 128
"""Profiles worked on at once: fits the processor's cache."""
GROUPS_PER_TURN = 250
"""Groups of profiles a turn: eight to the shortest wave of form that is fitted."""
BINS_PER_BAND = 16
"""Height bins on a cylinder: enough for the static profile's degree 7."""
OUTLIER_REACH_MM = 4.0
"""A keyway or a flat is as deep, and its readings count as rejected."""
LOOKUP_MM = 0.02
"""Resolution at which heights are looked up for their bin."""


@dataclass(frozen=True, slots=True)
class Grid:
    """How the scan is cut into cells: groups of profiles and bins of height."""

    group: int
    """Profiles in a group."""
    groups: int
    edges: tuple[Array, ...]
    """mm, per cylinder in use: borders of its height bins."""

    @property
    def centres(self) -> Array:
        """Height (B,) mm of the bins' middles, cylinder after cylinder."""
        return np.concatenate([(e[:-1] + e[1:]) / 2 for e in self.edges])

    @property
    def cylinder(self) -> Ints:
        """Which cylinder each bin lies on (B,)."""
        return np.concatenate([np.full(e.size - 1, k, dtype=np.intp) for k, e in enumerate(self.edges)])

    def lookup(self) -> tuple[Ints, float]:
        """Bin (B = none) over height in steps of ``LOOKUP_MM`` from the returned start, a guard cell at each end."""
        low = min(e[0] for e in self.edges) - 2 * LOOKUP_MM
        high = max(e[-1] for e in self.edges) + 2 * LOOKUP_MM
        at = low + LOOKUP_MM * (np.arange(int((high - low) / LOOKUP_MM) + 2) + 0.5)
        table = np.full(at.size, self.centres.size, dtype=np.intp)
        first = 0
        for e in self.edges:
            inside = (at >= e[0]) & (at < e[-1])
            table[inside] = first + np.searchsorted(e, at[inside], side="right") - 1
            first += e.size - 1
        table[0] = table[-1] = self.centres.size
        return table, low


@dataclass(frozen=True, slots=True)
class _Surface:
    """Where the model puts the surface in the laser plane, over the groups of profiles and the bins of height.

    Between a group's borders it goes with the table's angle, because profiles may be lost and tables turn unevenly.
    """

    angle: Array
    """Table angle (groups + 1,) rad at the groups' borders."""
    border: Array
    """u (groups + 1, B) mm there."""
    bend: Array
    """(groups, B) mm: four times how far u lies below the chord in a group's middle. Without it the deviations would
    hold the bend of the trace, and robust means take only a part of what they are given."""
    part: Array
    """How far each profile lies in its group, (N,), 0..1 of the group's angle."""

    def u(self, group: Ints, part: Array, bins: Ints | slice = slice(None)) -> Array:
        """u (mm) of the surface in groups of profiles, at a part 0..1 of each."""
        chord = self.border[group, bins] * (1 - part) + self.border[group + 1, bins] * part
        return np.asarray(chord - self.bend[group, bins] * (part * (1 - part)))


def _grid(scan: Scan, bands: tuple[Band, ...]) -> Grid:
    """A grid for the scan and the parts of the cylinders that are measured on."""
    per_turn = scan.profiles / max(scan.revolutions, 1e-9)
    group = max(1, round(per_turn / GROUPS_PER_TURN))
    edges = tuple(np.linspace(b.low, b.high, BINS_PER_BAND + 1) for b in bands)
    return Grid(group, -(-scan.profiles // group), edges)


@dataclass(frozen=True, slots=True)
class Cells:
    """Means over cells (n,), with what they rest on."""

    readings: Readings
    """Mean x, z, angle, time; which cylinder."""
    weight: Array
    """Sum of the readings' robust weights."""
    spread: Array
    """mm: weighted standard deviation of the readings in the cell about the prediction."""
    group: Ints
    groups_per_turn: int
    """After so many groups, a turn later, the same stretch of the surface comes again."""
    bin: Ints
    """Which bin of height; each lies on one cylinder."""
    points: int
    """Readings on the artefact's surfaces: within ``reach`` of the predicted surface or rejected from it."""
    rejected: int
    """Of these, the ones with no weight."""
    correction: float
    """Of the readings' score for their weights (``m_estimator_correction``)."""


def robust_cells(
    scan: Scan,
    bands: tuple[Band, ...],
    model: Model,
    parameters: Array,
    limit: Array,
    reach: float,
    outliers: Mask,
) -> Cells:
    """One robust pass over all readings.

    Args:
        scan: what the sensor saw.
        bands: the parts of the cylinders that are measured on.
        model: the model with its layout.
        parameters: present estimate.
        limit: (cylinders,) mm from the predicted surface at which a reading's weight becomes zero.
        reach: mm from the predicted surface within which a reading counts as one of the surface's at all; no less than
            any ``limit``.
        outliers: (bands, sectors of table angle) that are not the shaft's; readings there count as rejected.
    """
    grid = _grid(scan, bands)
    bins = grid.centres.size
    sums = np.zeros((5, grid.groups * (bins + 1)))
    points = kept = 0
    mass = slope = 0.0
    surface = _surface(scan, model, parameters, grid)
    per_limit = 1.0 / limit[grid.cylinder]
    trusted = _trusted(scan, model, parameters, grid, outliers)
    for block in _blocks(scan, grid, surface, trusted, parameters, model.height):
        near = np.abs(block.deviation) < reach
        weight = tukey_weights(block.deviation * per_limit[block.bin])
        if block.outlier is not None:
            near |= block.outlier & (np.abs(block.deviation) < OUTLIER_REACH_MM)
            weight[block.outlier] = 0.0
        points += int(np.count_nonzero(near))
        kept += int(np.count_nonzero(weight))
        mass, slope = mass + float(weight.sum()), slope + float(tukey_slopes(weight).sum())
        span = block.cells
        size = span.stop - span.start
        weighted = weight * block.deviation
        sums[0, span] += np.bincount(block.index, weight, size)
        sums[1, span] += np.bincount(block.index, weighted, size)
        sums[2, span] += np.bincount(block.index, weighted * block.deviation, size)
        sums[3, span] += np.bincount(block.index, weight * block.offset, size)
        sums[4, span] += np.bincount(block.index, weight * block.part, size)
    correction = m_estimator_correction(mass, slope)
    return _means(scan, model, parameters, grid, surface, sums, (points, points - kept), correction)


def _trusted(scan: Scan, model: Model, p: Array, grid: Grid, outliers: Mask) -> Mask | None:
    """Whether profile i is used in bin j, (N, bins + 1); None where everything is."""
    if not outliers.any():
        return None
    sector = np.floor(model.angle(p, scan.angle) * (outliers.shape[1] / tau)).astype(np.intp) % outliers.shape[1]
    per_bin = np.vstack([outliers[grid.cylinder], np.zeros((1, outliers.shape[1]), dtype=np.bool_)])
    return np.asarray(~per_bin[:, sector].T)


@dataclass(frozen=True, slots=True)
class _Block:
    """Readings (n,) on the bands of some groups of profiles."""

    deviation: Array
    """mm from the predicted surface."""
    offset: Array
    """mm above the middle of the bin of height."""
    part: Array
    """0..1 of the group of profiles."""
    bin: Ints
    """Of height."""
    outlier: Mask | None
    """Where they are on a stretch that is not the shaft's; None where none is known."""
    index: Ints
    """Cell, counted from the block's first."""
    cells: slice
    """The block's cells."""


def _surface(scan: Scan, model: Model, parameters: Array, grid: Grid) -> _Surface:
    """The surface that the parameters predict."""
    border = np.arange(grid.groups + 1) * grid.group
    last = np.minimum(border, scan.profiles - 1)
    angle = scan.angle[last] + scan.step * (border - last)
    half = np.arange(2 * grid.groups + 1) / 2  # borders and middles
    shape = (grid.centres.size, half.size)  # cylinder after cylinder
    u = model.radial_position(
        parameters,
        np.repeat(grid.centres, shape[1]),
        np.tile(np.interp(half, np.arange(angle.size), angle), shape[0]),
        np.tile(scan.time_at(half * grid.group), shape[0]),
        np.repeat(grid.cylinder, shape[1]),
    ).reshape(shape).T  # fmt: skip
    bend = 2 * (u[:-2:2] + u[2::2]) - 4 * u[1::2]
    return _Surface(angle, u[::2], bend, _parts(scan, grid, angle))


def _parts(scan: Scan, grid: Grid, border: Array) -> Array:
    """How far each profile lies in its group (N,), by the table angle (groups + 1,) rad at the borders."""
    n = np.arange(scan.profiles)
    group, by_number = n // grid.group, n % grid.group / grid.group
    turned = np.diff(border)[group]
    part = np.divide(scan.angle - border[group], turned, out=by_number, where=turned != 0.0)
    return np.asarray(np.clip(part, 0.0, 1.0))


def _blocks(
    scan: Scan, grid: Grid, surface: _Surface, trusted: Mask | None, p: Array, height: float
) -> Iterator[_Block]:
    """The readings on the artefact's bands, block by block: deviation from the prediction and cell index."""
    plane = LaserPlane(float(p[PHI]), float(p[RADIAL]), height)
    (ux, uz), (vx, vz) = plane.across, plane.along
    table, low = grid.lookup()
    bins = grid.centres.size
    centres = grid.centres
    per_block = max(1, BLOCK // grid.group)
    for first in range(0, grid.groups, per_block):
        last = min(first + per_block, grid.groups)
        rows = slice(first * grid.group, min(last * grid.group, scan.profiles))
        x, z = scan.x[rows], scan.z[rows]
        v = x * vx + z * vz + height
        with np.errstate(invalid="ignore"):
            step = np.clip((v - low) * (1.0 / LOOKUP_MM), 0, table.size - 1)
        step[np.isnan(step)] = 0
        bin_ = table[step.astype(np.intp)]
        on = bin_ < bins
        seen = np.count_nonzero(on, axis=1)
        chosen = bin_[on]
        n = np.arange(rows.start, rows.stop)
        group = n // grid.group
        predicted = surface.u(group, surface.part[rows, None])
        u = ux * x[on] + uz * z[on] + plane.radial
        yield _Block(
            u - predicted.reshape(-1)[np.repeat((n - rows.start) * bins, seen) + chosen],
            v[on] - centres[chosen],
            np.repeat(surface.part[rows], seen),
            chosen,
            None if trusted is None else ~trusted[np.repeat(n, seen), chosen],
            np.repeat((group - first) * (bins + 1), seen) + chosen,
            slice(first * (bins + 1), last * (bins + 1)),
        )


def _means(
    scan: Scan,
    model: Model,
    p: Array,
    grid: Grid,
    surface: _Surface,
    sums: Array,
    counts: tuple[int, int],
    correction: float,
) -> Cells:
    bins = grid.centres.size
    cell = sums.reshape(5, grid.groups, bins + 1)[:, :, :bins]
    full = cell[0] > 0.5
    bin_, group = np.nonzero(full.T)  # cylinder after cylinder
    weight = cell[0][group, bin_]
    deviation, square, offset, part = (cell[i][group, bin_] / weight for i in range(1, 5))
    plane = LaserPlane(float(p[PHI]), float(p[RADIAL]), model.height)
    readings = Readings(
        *plane.from_uv(surface.u(group, part, bin_) + deviation, grid.centres[bin_] + offset),
        surface.angle[group] + part * np.diff(surface.angle)[group],
        scan.time_at(grid.group * (group + part)),
        grid.cylinder[bin_],
    )
    spread = np.sqrt(np.maximum(square - deviation * deviation, 0.0))
    per_turn = max(1, round(scan.profiles / max(scan.revolutions, 1e-9) / grid.group))
    return Cells(readings, weight, spread, group, per_turn, bin_, *counts, correction)
