"""How much of a model's surface a scan could see, how much of that it saw, and what it should have seen and did not.

Coverage: samples of the surface that the laser line sweeps over, with readings near them. Unconfirmed regions: each ray
is cast from the sensor onto the model. A reading confirms the surface that its ray hits first if it lies within
``reach`` of it; one that lies behind went through where material should be. Rays without a reading point where their
place in the profile says, if the sensor's rays keep their direction.
"""

from collections.abc import Sequence
from math import degrees, tau

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.calibration import Calibration
from truestand.core.frames import Pose, in_rotor
from truestand.core.scan import Scan
from truestand.core.surface import readings_of, seen_at, sensor_origins
from truestand.parts.patches import Grid
from truestand.parts.rays import Solid, clear_view, first_hits
from truestand.parts.views import PartView

SAMPLES = 3000
SEEN_WITHIN = 0.75
"""mm: a sample with a reading so near has been seen."""
LEAST_FACING = 0.09
"""Cosine of incidence (85 degrees) from which a surface counts as visible."""
NEAR = 0.02
"""mm before a sample at which the view to it may end: the triangles are known to float32."""
FAN_PROFILES = 200
MOST_RAYS = 600_000
"""Rays that are cast."""
CELL = 1.0
"""mm: edge of the cells in which rays are counted, larger where rays are few."""
RAYS_PER_CELL = 8
LEAST_RAYS = 4
"""Rays that make a cell unconfirmed."""
LEAST_CELLS = 3
"""Unconfirmed cells side by side that make a region: single ones lie beside edges."""
LEAST_BLOCK, MOST_BLOCK = 3, 12
"""Rays wide and high: a block of so many side by side that nothing confirms is a hole, however small in cells: along an
edge that lies a bit elsewhere they are no three deep. Larger holes fill cells."""
BLOCK_FACING = 0.35
"""Cosine of incidence (70 degrees) from which blocks count: nearer to grazing, rays get lost and pass by in blocks."""
BLOCK_AROUND = 21
"""Rays about a block from which it is told how many get lost anyway,"""
BLOCK_CHANCE = 1e-3
"""and how likely they make one block of a scan."""
LEAST_CONFIRMED = 0.05
"""Share of the rays on a cell: where fewer are confirmed, nothing is."""
STEADY = 2e-3
"""How far the directions of one point of all profiles may scatter to be known where it has no reading."""
OUTLIER = 10 * STEADY
"""How far off such a direction a reading may lie."""
SHAFT_MARGIN = 0.3
"""mm by which the shaft may stand before the model where the drawing doesn't say so."""


def coverage_of(solid: Solid, part_from_shaft: Pose, views: Sequence[PartView], readings: Array) -> tuple[float, float]:
    """Share of the surface visible to any view that has readings, and share of the whole surface that is visible.

    ``readings`` (n, 3) mm on the model, in its frame: a thinned set is enough. Visible is what the laser line sweeps
    over in a full turn, within the fan and range that the scan shows, facing the sensor with nothing in between.
    """
    from scipy.spatial import cKDTree

    points, normal = _samples(solid)
    seen = [_visible(solid, part_from_shaft, view, points, normal) for view in views]
    visible = points[np.unique(np.concatenate(seen))]
    if not len(visible) or not len(readings):
        return 0.0, len(visible) / SAMPLES
    distance, _ = cKDTree(readings).query(visible, distance_upper_bound=SEEN_WITHIN)
    return float(np.isfinite(distance).mean()), len(visible) / SAMPLES


def _visible(solid: Solid, part_from_shaft: Pose, view: PartView, points: Array, normal: Array) -> Ints:
    """Which of the surface's ``points`` (n, 3) a view could see."""
    scan, calibration = view.scan, view.calibration
    at = part_from_shaft.inverse(points)
    angle = seen_at(calibration, at)
    reached = np.flatnonzero(np.isfinite(angle))
    x, z = readings_of(calibration, at[reached], angle[reached])
    reached = reached[_in_fan(scan, x, z)]
    origins = part_from_shaft(sensor_origins(calibration, angle[reached]))
    directions = points[reached] - origins
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    facing = np.einsum("ij,ij->i", normal[reached], directions) < -LEAST_FACING
    reached, origins = reached[facing], origins[facing]
    return np.asarray(reached[clear_view(solid, origins, points[reached], NEAR)])


def _samples(solid: Solid) -> tuple[Array, Array]:
    """Points (SAMPLES, 3) spread evenly over the surface, and their normals; the same ones every time."""
    rng = np.random.default_rng(7)
    ends = np.cumsum(solid.area)
    evenly = (np.arange(SAMPLES) + 0.5) / SAMPLES * ends[-1]
    triangle = np.minimum(np.searchsorted(ends, evenly), ends.size - 1)
    u, v = rng.random((2, SAMPLES))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    a, b, c = np.moveaxis(solid.corners[triangle], 1, 0)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), solid.normal[triangle]


def _in_fan(scan: Scan, x: Array, z: Array) -> Mask:
    """Whether readings lie within the opening of the laser fan and the range that the scan shows."""
    rows = scan.spread(FAN_PROFILES)
    seen_x, seen_z = scan.x[rows], scan.z[rows]
    seen = np.isfinite(seen_z) & np.isfinite(seen_x)
    if not seen.any():
        return np.zeros(x.shape, dtype=np.bool_)
    slope, z_seen = seen_x[seen] / seen_z[seen], seen_z[seen]
    low, high = scan.stand.sensor.range or (float(z_seen.min()), float(z_seen.max()))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((z > low) & (z < high) & (x / z >= slope.min()) & (x / z <= slope.max()))


def unconfirmed_regions(
    solid: Solid, model_from_shaft: Pose, views: Sequence[PartView], reach: float
) -> tuple[str, ...]:
    """Regions of the model's surface that rays of a view should have hit and no reading of it confirms within
    ``reach``: where each is about the datum axis, and why.
    """
    found = (_unconfirmed(solid, model_from_shaft, view, reach) for view in views)
    return tuple(dict.fromkeys(region for of_view in found for region in of_view))


def _unconfirmed(solid: Solid, model_from_shaft: Pose, view: PartView, reach: float) -> tuple[str, ...]:
    """The same of one view."""
    scan, calibration = view.scan, view.calibration
    rows, columns = _sampled(scan)
    origins, directions, length, distance, place = _rays(scan, view.angle, calibration, rows, columns)
    shaft = _at_shaft(origins, directions, calibration)
    origins, directions = model_from_shaft(origins), directions @ model_from_shaft.rotation.T
    triangle, hit = first_hits(solid, origins, directions)
    facing = -np.einsum("ij,ij->i", solid.normal[triangle], directions)
    nearest, farthest = scan.stand.sensor.range or (float(np.nanmin(scan.z)), float(np.nanmax(scan.z)))
    with np.errstate(invalid="ignore"):
        in_range = (hit > nearest * length) & (hit < farthest * length)
        expected = np.flatnonzero((triangle >= 0) & (facing > LEAST_FACING) & in_range & (hit < shaft))
    points = origins[expected] + hit[expected, None] * directions[expected]
    off = distance[expected] - hit[expected]
    hole, able = np.zeros(expected.size, dtype=np.bool_), facing[expected] > BLOCK_FACING
    hole[able] = _in_blocks((rows.size, columns.size), place[expected][able], ~(np.abs(off[able]) <= reach))
    return _regions(_grid(solid, expected.size), points, off, reach, hole)


def _in_blocks(shape: tuple[int, int], place: Ints, bad: Mask) -> Mask:
    """Which rays (n,), at their ``place`` in the image of a scan, lie in blocks that are all ``bad``, larger than those
    that single lost readings make about there by chance.
    """
    from scipy.ndimage import maximum_filter, minimum_filter, uniform_filter

    image, cast = np.zeros((2, *shape), dtype=np.float32)
    image.flat[place[bad]], cast.flat[place] = 1.0, 1.0
    lost, among = (uniform_filter(a, BLOCK_AROUND, mode="constant") for a in (image, cast))
    share = np.clip(lost / np.maximum(among, 1e-6), 1e-6, 0.99)
    needed = np.sqrt(np.log(max(bad.size, 1) / BLOCK_CHANCE) / -np.log(share))
    found = np.zeros(shape, dtype=np.bool_)
    for size in range(LEAST_BLOCK, MOST_BLOCK + 1):
        middles = minimum_filter(image, size, mode="constant")
        if not middles.any():
            break
        within = maximum_filter(middles, size, origin=-1 if size % 2 == 0 else 0, mode="constant") > 0
        found |= within & (needed <= size)
    return np.asarray(found.flat[place])


def _sampled(scan: Scan) -> tuple[Ints, Ints]:
    """Rows and columns of about ``MOST_RAYS`` rays, evenly over the scan."""
    n, m = scan.x.shape
    share = min(1.0, (MOST_RAYS / (n * m)) ** 0.5)
    rows, columns = (np.unique(np.linspace(0, k - 1, max(round(k * share), 2)).astype(np.intp)) for k in (n, m))
    return rows, columns


def _rays(
    scan: Scan, angle: Array, calibration: Calibration, rows: Ints, columns: Ints
) -> tuple[Array, Array, Array, Array, Ints]:
    """Origins and unit directions (n, 3) in C, path (n,) per mm of range, distances (n,) mm of the readings, NaN
    without one, and where (n,) each ray stands among these rows and columns.
    """
    x, z = scan.x[np.ix_(rows, columns)], scan.z[np.ix_(rows, columns)]
    seen = np.isfinite(x) & np.isfinite(z)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(seen, x / z, np.nan)
    usual, steady = _directions(slope)
    with np.errstate(invalid="ignore"):
        seen &= ~steady | (np.abs(slope - usual) < OUTLIER)  # an outlier lies on no ray of the sensor's
    slope = np.where(seen, slope, np.where(steady, usual, np.nan))
    cast = np.isfinite(slope)
    row = np.nonzero(cast)[0]
    pose = calibration.table_from_sensor
    length = np.sqrt(1.0 + slope[cast] ** 2)
    in_table = (slope[cast][:, None] * pose.rotation[:, 0] + pose.rotation[:, 2]) / length[:, None]
    rotor = np.stack([*in_rotor(in_table[:, 0], in_table[:, 1], angle[rows][row]), in_table[:, 2]], axis=1)
    origins = sensor_origins(calibration, angle[rows])[row]
    directions = rotor @ calibration.shaft_from_rotor.rotation.T
    return origins, directions, length, np.where(seen, z, np.nan)[cast] * length, np.flatnonzero(cast)


def _directions(slope: Array) -> tuple[Array, Mask]:
    """x / z (m,) of each point of a profile, and where it is the same in all profiles."""
    ordered = np.sort(slope, axis=0)  # NaN last
    number = np.isfinite(ordered).sum(axis=0)

    def quantile(q: float) -> Array:
        at = np.minimum((q * number).astype(np.intp), np.maximum(number - 1, 0))
        return np.asarray(np.take_along_axis(ordered, at[None], 0)[0])

    return quantile(0.5), (number > 0) & (quantile(0.75) - quantile(0.25) < STEADY)


def _at_shaft(origins: Array, directions: Array, calibration: Calibration) -> Array:
    """How far (n,) mm away rays of C hit the shaft; inf where they pass it by, or where the record has no drawing."""
    nearest = np.full(len(origins), np.inf)
    a = np.square(directions[:, :2]).sum(axis=1)
    b = (origins[:, :2] * directions[:, :2]).sum(axis=1)
    for cylinder in calibration.artefact.cylinders if calibration.artefact is not None else ():
        c = np.square(origins[:, :2]).sum(axis=1) - (cylinder.radius + SHAFT_MARGIN) ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            half = np.sqrt(b * b - a * c)  # NaN: beside it
            ends = np.sort([(h - origins[:, 2]) / directions[:, 2] for h in (cylinder.bottom, cylinder.top)], axis=0)
            enters, leaves = np.maximum((-b - half) / a, ends[0]), np.minimum((-b + half) / a, ends[1])
            nearest = np.where((enters < leaves) & (enters > 0), np.minimum(nearest, enters), nearest)
    return nearest


def _grid(solid: Solid, rays: int) -> Grid:
    """Cells about the datum axis, over the model."""
    low, high, outer = float(solid.low[2]), float(solid.high[2]), solid.outer
    edge = max(CELL, (RAYS_PER_CELL * float(solid.area.sum()) / 2 / max(rays, 1)) ** 0.5)
    heights, angles, radii = (max(1, round(extent / edge)) for extent in (high - low, tau * outer, outer))
    return Grid(low, high, heights, angles, radii, outer)


def _regions(grid: Grid, points: Array, off: Array, reach: float, hole: Mask) -> tuple[str, ...]:
    """Unconfirmed cells, as they hang together.

    ``points`` (n, 3) mm where rays hit the model, ``off`` (n,) mm by which their readings lie behind, NaN without
    one; ``hole`` (n,): rays of a block that nothing confirms.
    """
    from scipy.ndimage import label

    cell = grid.cells(np.arctan2(points[:, 1], points[:, 0]), points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    size = int(np.prod(grid.shape))

    def number(of: Mask) -> Ints:
        return np.bincount(cell[of], minlength=size).reshape(grid.shape)

    with np.errstate(invalid="ignore"):
        behind, before, confirmed = number(off > reach), number(off < -reach), number(np.abs(off) <= reach)
    rays, against = number(np.ones(len(off), dtype=np.bool_)), behind + before
    unconfirmed = (against >= LEAST_RAYS) & (against > confirmed)
    unconfirmed |= (rays >= LEAST_RAYS) & (confirmed <= LEAST_CONFIRMED * rays)
    holes = number(hole) > 0
    marked, count = label(unconfirmed | holes, np.ones((3, 3, 3)))
    found = []
    for n in range(1, count + 1):
        at = np.nonzero(marked == n)
        if at[0].size >= LEAST_CELLS or holes[at].any():
            found.append(_region(grid, at, bool(behind[at].sum() > rays[at].sum() / 2)))
    return tuple(found)


def _region(grid: Grid, at: tuple[Ints, ...], behind: bool) -> str:
    """Where these cells are, and why they are not confirmed: without material, readings lie behind them."""
    height, radius = (grid.high - grid.low) / grid.heights, grid.outer / (grid.radii or 1)
    bottom, top = grid.low + height * at[0].min(), grid.low + height * (at[0].max() + 1)
    inner, outer = radius * at[2].min(), radius * (at[2].max() + 1)
    angle = degrees(np.angle(np.exp(1j * grid.angle[at[1]]).mean())) % 360
    why = "rays went through" if behind else "no reading confirms it"
    return (
        f"model surface at polar angle {angle:.0f} deg, height {bottom:.1f} to {top:.1f} mm, radius "
        f"{inner:.1f} to {outer:.1f} mm: {why}"
    )
