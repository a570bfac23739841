"""How much of a model's surface a scan could see, and how much of that it saw."""

import numpy as np
from numpy.typing import NDArray

from truestand.core.calibration import Calibration
from truestand.core.frames import Pose
from truestand.core.scan import Scan
from truestand.core.surface import readings_of, seen_at, sensor_origins
from truestand.parts.cast import Solid, clear_view

Array = NDArray[np.float64]

SAMPLES = 3000
SEEN_WITHIN = 0.75
"""mm: a sample with a reading so near has been seen."""
LEAST_FACING = 0.09
"""Cosine of incidence (85 degrees) from which a surface counts as visible."""
NEAR = 0.02
"""mm before a sample at which the view to it may end: the triangles are known to float32."""
FAN_PROFILES = 200


def coverage_of(
    solid: Solid, part_from_shaft: Pose, scan: Scan, calibration: Calibration, readings: Array
) -> tuple[float, float]:
    """Share of the visible surface that has readings, and share of the whole surface that is visible.

    ``readings`` (n, 3) mm on the model, in its frame: a thinned set is enough. Visible is what the laser line sweeps
    over in a full turn, within the fan and range that the scan shows, facing the sensor with nothing in between.
    """
    from scipy.spatial import cKDTree

    points, normal = _samples(solid)
    shaft_from_part = part_from_shaft.inverse
    at = shaft_from_part(points)
    angle = seen_at(calibration, at)
    reached = np.flatnonzero(np.isfinite(angle))
    x, z = readings_of(calibration, at[reached], angle[reached])
    kept = _in_fan(scan, x, z)
    reached = reached[kept]
    eyes = part_from_shaft(sensor_origins(calibration, angle[reached]))
    way = points[reached] - eyes
    way /= np.linalg.norm(way, axis=1)[:, None]
    facing = np.einsum("ij,ij->i", normal[reached], way) < -LEAST_FACING
    reached, eyes = reached[facing], eyes[facing]
    visible = points[reached[clear_view(solid, eyes, points[reached], NEAR)]] if reached.size else points[:0]
    if not len(visible) or not len(readings):
        return 0.0, len(visible) / SAMPLES
    distance, _ = cKDTree(readings).query(visible, distance_upper_bound=SEEN_WITHIN)
    return float(np.isfinite(distance).mean()), len(visible) / SAMPLES


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


def _in_fan(scan: Scan, x: Array, z: Array) -> NDArray[np.bool_]:
    """Whether readings lie within the opening of the laser fan and the range that the scan shows."""
    rows = np.unique(np.linspace(0, scan.profiles - 1, FAN_PROFILES).astype(np.intp))
    own_x, own_z = scan.x[rows], scan.z[rows]
    seen = np.isfinite(own_z) & np.isfinite(own_x)
    if not seen.any():
        return np.zeros(x.shape, dtype=np.bool_)
    slope, reach = own_x[seen] / own_z[seen], own_z[seen]
    low, high = scan.stand.sensor.range or (float(reach.min()), float(reach.max()))
    left, right = np.quantile(slope, [0.0, 1.0])
    inside = (z > low) & (z < high)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(inside & (x / z >= left) & (x / z <= right))
