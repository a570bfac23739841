"""Model surface that this scan's rays should have met, and that no reading confirms.

Each ray is cast from the sensor onto the model. A reading confirms the surface that its ray meets first if it lies
within ``reach`` of it; one that lies behind went through where material should be. Rays without a reading point where
their place in the profile says, if the sensor's rays keep their direction.
"""

from dataclasses import dataclass
from math import degrees, tau

import numpy as np
from numpy.typing import NDArray

from truestand.core.calibration import Calibration
from truestand.core.frames import Pose
from truestand.core.scan import Scan
from truestand.core.surface import sensor_origins
from truestand.parts.cast import Solid, first_met
from truestand.parts.patches import Grid
from truestand.parts.view import LEAST_FACING

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

RAYS = 600_000
"""Rays that are cast."""
PLACE = 1.0
"""mm: edge of the places that are counted, larger where rays are few."""
ENOUGH = 8
"""Rays on a place, on average."""
LEAST_RAYS = 4
"""Rays that make a place unmet."""
LEAST_PLACES = 3
"""Unmet places side by side that make a region: single ones lie beside edges."""
NONE = 0.05
"""Share of the rays on a place: where fewer are confirmed, nothing is."""
STEADY = 2e-3
"""How far the directions of one point of all profiles may scatter to be known where it has no reading."""
ASTRAY = 10 * STEADY
"""How far off such a direction a reading may lie."""
ON_SHAFT = 0.3
"""mm by which the shaft may stand before the model where the drawing doesn't say so."""


@dataclass(frozen=True, slots=True)
class Region:
    """A region of the model's surface that the scan doesn't confirm. mm about the datum axis, rad."""

    heights: tuple[float, float]
    radii: tuple[float, float]
    angle: float
    """Polar angle of its middle."""
    behind: bool
    """Whether readings lie behind it: there is no material."""

    @property
    def text(self) -> str:
        """Where it is and why."""
        (a, b), (c, d) = self.heights, self.radii
        why = "rays went through" if self.behind else "no reading confirms it"
        return (
            f"model surface at polar angle {degrees(self.angle) % 360:.0f} deg, height {a:.1f} to {b:.1f} mm, radius "
            f"{c:.1f} to {d:.1f} mm: {why}"
        )


def unmet_regions(
    solid: Solid, model_from_shaft: Pose, scan: Scan, angle: Array, calibration: Calibration, reach: float
) -> tuple[Region, ...]:
    """Regions of the model's surface that rays of this scan should have met and no reading confirms within ``reach``.

    ``angle``: table angle (N,) rad.
    """
    rows, columns = _some(scan)
    eyes, ways, length, distance = _rays(scan, angle, calibration, rows, columns)
    shaft = _at_shaft(eyes, ways, calibration)
    eyes, ways = model_from_shaft(eyes), ways @ model_from_shaft.rotation.T
    triangle, hit = first_met(solid, eyes, ways)
    facing = np.einsum("ij,ij->i", solid.normal[triangle], ways) < -LEAST_FACING
    nearest, farthest = scan.stand.sensor.range or (float(np.nanmin(scan.z)), float(np.nanmax(scan.z)))
    with np.errstate(invalid="ignore"):
        in_range = (hit > nearest * length) & (hit < farthest * length)
        met = np.flatnonzero((triangle >= 0) & facing & in_range & (hit < shaft))
    points = eyes[met] + hit[met, None] * ways[met]
    return _regions(_grid(solid, met.size), points, distance[met] - hit[met], reach)


def _some(scan: Scan) -> tuple[Ints, Ints]:
    """Rows and columns of some ``RAYS`` rays, evenly over the scan."""
    n, m = scan.x.shape
    share = min(1.0, (RAYS / (n * m)) ** 0.5)
    rows, columns = (np.unique(np.linspace(0, k - 1, max(round(k * share), 2)).astype(np.intp)) for k in (n, m))
    return rows, columns


def _rays(
    scan: Scan, angle: Array, calibration: Calibration, rows: Ints, columns: Ints
) -> tuple[Array, Array, Array, Array]:
    """Origins and unit ways (n, 3) in C, way (n,) per mm of range, and distances (n,) mm of the readings, NaN without
    one.
    """
    x, z = scan.x[np.ix_(rows, columns)], scan.z[np.ix_(rows, columns)]
    seen = np.isfinite(x) & np.isfinite(z)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(seen, x / z, np.nan)
    usual, steady = _directions(slope)
    with np.errstate(invalid="ignore"):
        seen &= ~steady | (np.abs(slope - usual) < ASTRAY)  # a stray reading lies on no ray of the sensor's
    slope = np.where(seen, slope, np.where(steady, usual, np.nan))
    cast = np.isfinite(slope)
    row = np.nonzero(cast)[0]
    pose = calibration.table_from_sensor
    length = np.sqrt(1.0 + slope[cast] ** 2)
    in_table = (slope[cast][:, None] * pose.rotation[:, 0] + pose.rotation[:, 2]) / length[:, None]
    c, s = np.cos(angle[rows])[row], np.sin(angle[rows])[row]
    in_rotor = np.stack(
        [c * in_table[:, 0] + s * in_table[:, 1], c * in_table[:, 1] - s * in_table[:, 0], in_table[:, 2]], axis=1
    )
    eyes = sensor_origins(calibration, angle[rows])[row]
    return eyes, in_rotor @ calibration.shaft_from_rotor.rotation.T, length, np.where(seen, z, np.nan)[cast] * length


def _directions(slope: Array) -> tuple[Array, Bools]:
    """x / z (m,) of each point of a profile, and where it is the same in all profiles."""
    ordered = np.sort(slope, axis=0)  # NaN last
    number = np.isfinite(ordered).sum(axis=0)

    def quantile(q: float) -> Array:
        at = np.minimum((q * number).astype(np.intp), np.maximum(number - 1, 0))
        return np.asarray(np.take_along_axis(ordered, at[None], 0)[0])

    return quantile(0.5), (number > 0) & (quantile(0.75) - quantile(0.25) < STEADY)


def _at_shaft(eyes: Array, ways: Array, calibration: Calibration) -> Array:
    """How far (n,) mm away rays of C meet the shaft; inf where they pass it by, or where the record has no drawing."""
    nearest = np.full(len(eyes), np.inf)
    a = np.square(ways[:, :2]).sum(axis=1)
    b = (eyes[:, :2] * ways[:, :2]).sum(axis=1)
    for cylinder in calibration.artefact.cylinders if calibration.artefact is not None else ():
        c = np.square(eyes[:, :2]).sum(axis=1) - (cylinder.radius + ON_SHAFT) ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            half = np.sqrt(b * b - a * c)  # NaN: beside it
            ends = np.sort([(h - eyes[:, 2]) / ways[:, 2] for h in (cylinder.bottom, cylinder.top)], axis=0)
            enters, leaves = np.maximum((-b - half) / a, ends[0]), np.minimum((-b + half) / a, ends[1])
            nearest = np.where((enters < leaves) & (enters > 0), np.minimum(nearest, enters), nearest)
    return nearest


def _grid(solid: Solid, rays: int) -> Grid:
    """Places about the datum axis, over the model."""
    corners = solid.corners
    low, high = float(corners[:, :, 2].min()), float(corners[:, :, 2].max())
    outer = float(np.hypot(corners[:, :, 0], corners[:, :, 1]).max())
    edge = max(PLACE, (ENOUGH * float(solid.area.sum()) / 2 / max(rays, 1)) ** 0.5)
    heights, angles, radii = (max(1, round(extent / edge)) for extent in (high - low, tau * outer, outer))
    return Grid(low, high, heights, angles, radii, outer)


def _regions(grid: Grid, points: Array, off: Array, reach: float) -> tuple[Region, ...]:
    """Unmet places, as they hang together.

    ``points`` (n, 3) mm where rays meet the model, ``off`` (n,) mm by which their readings lie behind; NaN without one.
    """
    from scipy.ndimage import label

    cell = grid.cells(np.arctan2(points[:, 1], points[:, 0]), points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    size = int(np.prod(grid.shape))

    def number(of: Bools) -> Ints:
        return np.bincount(cell[of], minlength=size).reshape(grid.shape)

    with np.errstate(invalid="ignore"):
        behind, before, confirmed = number(off > reach), number(off < -reach), number(np.abs(off) <= reach)
    rays, against = number(np.ones(len(off), dtype=np.bool_)), behind + before
    unmet = (against >= LEAST_RAYS) & (against > confirmed)
    unmet |= (rays >= LEAST_RAYS) & (confirmed <= NONE * rays)
    marked, count = label(unmet, np.ones((3, 3, 3)))
    found = []
    for n in range(1, count + 1):
        at = np.nonzero(marked == n)
        if at[0].size >= LEAST_PLACES:
            found.append(_region(grid, at, bool(behind[at].sum() > rays[at].sum() / 2)))
    return tuple(found)


def _region(grid: Grid, at: tuple[Ints, ...], behind: bool) -> Region:
    height, radius = (grid.high - grid.low) / grid.heights, grid.outer / (grid.radii or 1)
    turned = np.exp(1j * grid.angle[at[1]]).mean()
    return Region(
        (float(grid.low + height * at[0].min()), float(grid.low + height * (at[0].max() + 1))),
        (float(radius * at[2].min()), float(radius * (at[2].max() + 1))),
        float(np.angle(turned)), behind,
    )  # fmt: skip
