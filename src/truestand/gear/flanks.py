"""From the points of a rolled-up scan to teeth, flanks and deviations, by the closed form: no best fit of a surface.

Every point between root and tip gets its tooth and flank from its polar angle, its roll length from its radius, and

    delta = rb (|t| - half angle of the nominal tooth),    t = angle from the centre of its tooth,

its deviation along the base tangent, positive outwards. One number is found first: how the toothing is turned in C.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from truestand.core.errors import NotEnoughData
from truestand.core.frames import Pose
from truestand.core.surface import Surface, sensor_origins, table_angle
from truestand.gear.geometry import Involute

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

BLOCK = 128
"""Profiles worked on at once."""
END_MARGIN = 0.2
"""mm of face left out at either end: chamfers, and the end faces themselves."""
FACE_BIN, FEW, FILLED = 0.1, 0.1, 0.3
"""mm of height that flanks reach or not; share of the most points below which they don't count for the usual number,
and share of that number from which flanks reach."""
TIP_MARGIN = 0.02
"""mm of radius left out at the tip: its land is no flank."""
GATE = 0.25
"""mm of delta about a flank's own position within which a point is the flank's."""
COARSE = 200_000
"""Points that find the flanks."""
BINS = 720
NEAR_MEASURING = 0.5
"""Modules of radius about the measuring circle in which the flanks are found."""
MODE_BIN = 0.05
"""mm."""
LEAST_FACING = 0.035
"""Cosine of the steepest incidence (88 degrees) at which a reading is taken for one of the flank."""
FEW_POINTS, TOGETHER = 10, 0.4
"""Points that must lie together, and their share of all within reach: strays are everywhere."""
EXPLAINED = 0.05
"""Modules of delta about the toothing found, within which a point speaks for the drawing."""
AT_ZERO = 3.5e-4
"""rad (0.02 degrees): a tooth whose centre is seen just below polar angle 0 is tooth 1 still; noise must not decide."""


@dataclass(frozen=True, slots=True)
class FlankPoints:
    """Points and the flank that each one belongs to. (n,) arrays; flank 0 = left, 1 = right; tooth from 0."""

    roll: Array
    """mm."""
    height: Array
    """mm in C."""
    which: Ints
    """flank * teeth + tooth."""


@dataclass(frozen=True, slots=True)
class Flanks:
    """The points that lie on flanks. (n,) arrays; flank 0 = left, 1 = right; tooth from 0."""

    delta: Array
    """mm, against the design: modifications are no deviations."""
    roll: Array
    height: Array
    which: Ints
    """flank * teeth + tooth."""
    profile: Ints
    """Row of the scan."""
    index: NDArray[np.int64]
    """Reading of the scan, row * points + point."""
    turned: float
    """Polar angle (rad, C) of the centre of the first tooth at the middle of the face."""
    beyond: FlankPoints | None = None
    """The points that lie where this toothing should, but beyond ``GATE`` from the flank."""


@dataclass(frozen=True, slots=True)
class Located:
    """Points of the toothed zone, (n,): polar angle (rad) freed of the helix, radius and height (mm), reading."""

    angle: Array
    radius: Array
    height: Array
    index: NDArray[np.int64]


def located(
    surface: Surface, nominal: Involute, datum: Pose, rows: slice, low: float, high: float, thin: int = 1
) -> Located:
    """The points of some profiles with radii low..high inside the face; every ``thin``-th point of a profile."""
    g = nominal.gear
    x, y, z = (a[rows, ::thin] for a in (surface.x, surface.y, surface.z))
    with np.errstate(invalid="ignore"):
        square = x * x + y * y
        inside = (z > g.face_from + END_MARGIN) & (z < g.face_to - END_MARGIN)
        inside &= (square > (low - 1.0) ** 2) & (square < (high + 1.0) ** 2)
    row, point = np.nonzero(inside)
    points = np.stack([x[row, point], y[row, point], z[row, point]], axis=1)
    if np.abs(datum.matrix - np.eye(4)).max() > 0:
        points = datum(points)
    radius = np.hypot(points[:, 0], points[:, 1])
    kept = (radius > low) & (radius < high)
    height = points[kept, 2]
    angle = np.arctan2(points[kept, 1], points[kept, 0]) - (height - nominal.middle) * nominal.twist
    index = (row + rows.start).astype(np.int64) * surface.x.shape[1] + point * thin
    return Located(angle, radius[kept], height, index[kept])


def find_flanks(surface: Surface, nominal: Involute, datum: Pose) -> Flanks:
    """Every point on a flank, with its tooth, roll length and deviation.

    Raises:
        NotEnoughData: nothing of the toothing is in view.
    """
    turned, offsets, _ = settle(surface, nominal, datum)
    eyes = _eyes(surface, datum)
    low, high = float(nominal.radius(np.asarray(nominal.control_roll))), nominal.gear.tip_diameter / 2 - TIP_MARGIN
    parts, others = [], []
    for first in range(0, surface.x.shape[0], BLOCK):
        rows = slice(first, min(first + BLOCK, surface.x.shape[0]))
        points = located(surface, nominal, datum, rows, low, high)
        on, beyond = _on_flanks(points, nominal, turned, offsets, eyes, surface.x.shape[1])
        parts.append(on)
        others.append(beyond)
    joined, far = ([np.concatenate(columns) for columns in zip(*p, strict=True)] for p in (parts, others))
    beyond_all = FlankPoints(far[0], far[1], far[2])
    found = Flanks(joined[0], joined[1], joined[2], joined[3], joined[4], joined[5], turned, beyond_all)
    bottom, top = flank_heights(found, nominal)
    low = bottom + END_MARGIN if bottom > nominal.gear.face_from else -np.inf
    high = top - END_MARGIN if top < nominal.gear.face_to else np.inf
    kept = (found.height > low) & (found.height < high)
    return found if kept.all() else only(found, kept)


def flank_heights(flanks: Flanks, nominal: Involute) -> tuple[float, float]:
    """Heights (C) between which flanks were seen; the drawing's face where they reach its ends.

    Where the drawing's face begins below the real one, the real end face would pass for flanks.
    """
    g = nominal.gear
    first, last = g.face_from + END_MARGIN, g.face_to - END_MARGIN
    bins = max(1, round((last - first) / FACE_BIN))
    counts, edges = np.histogram(flanks.height, bins, (first, last))
    if not counts.any():
        return g.face_from, g.face_to
    usual = np.median(counts[counts > FEW * np.quantile(counts[counts > 0], 0.9)])  # an end face may fill one bin
    filled = np.flatnonzero(counts > FILLED * usual)
    bottom = g.face_from if filled[0] == 0 else float(edges[filled[0] + 1])
    return bottom, g.face_to if filled[-1] == bins - 1 else float(edges[filled[-1]])


def only(f: Flanks, kept: NDArray[np.bool_]) -> Flanks:
    """Some of the points; those beyond the gate stay."""
    columns = (f.delta[kept], f.roll[kept], f.height[kept], f.which[kept], f.profile[kept], f.index[kept])
    return Flanks(*columns, f.turned, f.beyond)


def _on_flanks(
    p: Located, nominal: Involute, turned: float, offsets: Array, eyes: Array | None, points: int
) -> tuple[tuple[Array, Array, Array, Ints, Ints, NDArray[np.int64]], tuple[Array, Array, Ints]]:
    """The columns of ``Flanks`` for points on flanks, and those of ``FlankPoints`` for points beyond the gate."""
    which, delta = assigned(p, nominal, turned)
    roll = np.sqrt(np.maximum(p.radius**2 - nominal.base_radius**2, 0.0))
    delta = delta - nominal.modification(roll, p.height)
    off = np.abs(delta - offsets[which])  # NaN: a flank that nobody saw
    on, beyond = off < GATE, off >= GATE
    profile = (p.index // points).astype(np.int32)
    if eyes is not None:
        on[on] = _facing(_taken(p, on), which[on], eyes[profile[on]], nominal) > LEAST_FACING
    profile = profile[on]
    flank = which.astype(np.int32)
    return (
        (delta[on], roll[on], p.height[on], flank[on], profile, p.index[on]),
        (roll[beyond], p.height[beyond], flank[beyond]),
    )


def _taken(p: Located, on: NDArray[np.bool_]) -> Located:
    return Located(p.angle[on], p.radius[on], p.height[on], p.index[on])


def _eyes(surface: Surface, datum: Pose) -> Array | None:
    """Where the sensor stands, seen from the part, at each profile (N, 3) mm; None where that isn't known."""
    if surface.scan is None or surface.calibration is None or surface.calibration.method == "paper":
        return None
    return datum(sensor_origins(surface.calibration, table_angle(surface.scan, surface.calibration)))


def _facing(p: Located, which: NDArray[np.intp], eyes: Array, nominal: Involute) -> Array:
    """Cosine of the angle (n,) between each point's nominal flank normal and its ray; below 0 it looks away.

    The normal goes with (sin alpha, sigma cos alpha, -sigma rb twist) in radius, angle and height.
    """
    angle = p.angle + (p.height - nominal.middle) * nominal.twist
    c, s = np.cos(angle), np.sin(angle)
    way = eyes - np.stack([p.radius * c, p.radius * s, p.height], axis=1)
    side = np.where(which < nominal.gear.teeth, 1.0, -1.0)
    cosine = np.minimum(nominal.base_radius / p.radius, 1.0)
    helical = nominal.base_radius * nominal.twist
    out = np.sqrt(1.0 - cosine * cosine) * (way[:, 0] * c + way[:, 1] * s)
    around = side * (cosine * (way[:, 1] * c - way[:, 0] * s) - helical * way[:, 2])
    length = np.sqrt(np.einsum("ij,ij->i", way, way) * (1.0 + helical * helical))
    return np.asarray((out + around) / length)


def assigned(p: Located, nominal: Involute, turned: float) -> tuple[NDArray[np.intp], Array]:
    """flank * teeth + tooth (n,) of each point, and its delta (n,) mm against the involute helicoid."""
    pitch, teeth = nominal.gear.pitch, nominal.gear.teeth
    places = (p.angle - turned) / pitch
    tooth = np.rint(places)
    off = (places - tooth) * pitch
    which = tooth.astype(np.intp) % teeth + np.where(off < 0, teeth, 0)
    delta = nominal.base_radius * (np.abs(off) - nominal.half_angle(p.radius))
    return which, delta


def near_measuring(surface: Surface, nominal: Involute, datum: Pose) -> Located:
    """About ``COARSE`` points near the measuring circle, evenly over the scan."""
    reach = NEAR_MEASURING * nominal.gear.module
    low = max(nominal.measuring_radius - reach, nominal.base_radius * 1.002)
    high = min(nominal.measuring_radius + reach, nominal.gear.tip_diameter / 2 - 0.05 * nominal.gear.module)
    thin = max(1, int(surface.x.size / (20 * COARSE)))
    parts = [
        located(surface, nominal, datum, slice(first, min(first + BLOCK, surface.x.shape[0])), low, high, thin)
        for first in range(0, surface.x.shape[0], BLOCK)
    ]
    return Located(*(np.concatenate([getattr(p, n) for p in parts]) for n in Located.__slots__))


def settle(surface: Surface, nominal: Involute, datum: Pose) -> tuple[float, Array, float]:
    """How the toothing is turned (rad), delta (2 teeth,) mm at which each flank is found (NaN: nobody saw it), and the
    share of the points near the measuring circle that lie on these flanks.

    Raises:
        NotEnoughData: nothing of the toothing is in view.
    """
    points = near_measuring(surface, nominal, datum)
    if points.angle.size < 100:
        g = nominal.gear
        raise NotEnoughData(
            f"found {points.angle.size} points between heights {g.face_from:g} and {g.face_to:g} mm near diameter "
            f"{2 * nominal.measuring_radius:.1f} mm, need the toothing in view; check face_from_mm and the scan"
        )
    turned, offsets = _numbered(points, nominal, _phase(points, nominal))
    return turned, offsets, _explained(points, nominal, turned, offsets)


def _phase(p: Located, nominal: Involute) -> float:
    """Angle (rad, within a pitch) at which a tooth's centre explains most points of either flank."""
    pitch, half = nominal.gear.pitch, nominal.half_angle(p.radius)
    counts = np.zeros(BINS)
    for side in (1.0, -1.0):
        place = ((p.angle - side * half) / pitch) % 1.0
        counts += np.bincount((place * BINS).astype(np.intp) % BINS, minlength=BINS)
    width = max(1, round(EXPLAINED * nominal.gear.module / (pitch * nominal.base_radius) * BINS))
    kernel = np.zeros(BINS)
    kernel[np.arange(-width, width + 1)] = width + 1 - np.abs(np.arange(-width, width + 1))
    smooth = np.fft.irfft(np.fft.rfft(counts) * np.fft.rfft(kernel), BINS)
    return (int(np.argmax(smooth)) + 0.5) / BINS * pitch


def _numbered(p: Located, nominal: Involute, turned: float) -> tuple[float, Array]:
    """The same angle, of tooth 1, refined by the flanks' positions; and these positions."""
    teeth, pitch = nominal.gear.teeth, nominal.gear.pitch
    for _ in range(2):
        which, delta = assigned(p, nominal, turned)
        offsets = _positions(which, delta, nominal)
        left, right = (
            float(np.nanmean(o)) if np.isfinite(o).any() else np.nan for o in (offsets[:teeth], offsets[teeth:])
        )
        if np.isfinite(left) and np.isfinite(right):  # one side alone can't tell place from thickness
            turned += (left - right) / 2 / nominal.base_radius
    turned = (turned + AT_ZERO) % pitch - AT_ZERO
    which, delta = assigned(p, nominal, turned)
    return turned, _positions(which, delta, nominal)


def _positions(which: NDArray[np.intp], delta: Array, nominal: Involute) -> Array:
    """delta (2 teeth,) mm at which most points of each flank lie; NaN where there are too few."""
    flanks = 2 * nominal.gear.teeth
    reach = 0.45 * pi / nominal.gear.teeth * nominal.base_radius  # less than half a tooth or space
    bins = int(2 * reach / MODE_BIN)
    near = np.abs(delta) < reach
    place = np.clip(((delta[near] + reach) / (2 * reach) * bins).astype(np.intp), 0, bins - 1)
    counts = np.bincount(which[near] * bins + place, minlength=flanks * bins).reshape(flanks, bins)
    smooth = counts.copy()
    smooth[:, 1:] += counts[:, :-1]
    smooth[:, :-1] += counts[:, 1:]
    mode = (np.argmax(smooth, axis=1) + 0.5) * MODE_BIN - reach
    kept = near & (np.abs(delta - mode[which]) < 3 * MODE_BIN)
    number = np.bincount(which[kept], minlength=flanks)
    mean = np.bincount(which[kept], delta[kept], minlength=flanks) / np.maximum(number, 1)
    near_all = np.bincount(which[near], minlength=flanks)
    return np.where((number > FEW_POINTS) & (number > TOGETHER * near_all), mean, np.nan)


def _explained(points: Located, nominal: Involute, turned: float, offsets: Array) -> float:
    """Share of the points near the measuring circle that lie on the flanks which the drawing expects."""
    which, delta = assigned(points, nominal, turned)
    near = np.abs(delta - offsets[which]) < EXPLAINED * nominal.gear.module
    return float(np.count_nonzero(near)) / max(points.angle.size, 1)
