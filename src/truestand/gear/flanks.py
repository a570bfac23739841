"""From the points of a rolled-up scan to teeth, flanks and deviations, by the closed form: no best fit of a surface.

Every point between root and tip gets its tooth and flank from its polar angle, its roll length from its radius, and

    delta = rb (|t| - half angle of the nominal tooth),    t = angle from the centre of its tooth,

its deviation along the base tangent, positive outwards. One number is found first: the polar angle of the first tooth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Self

import numpy as np
from numpy.typing import NDArray

from truestand.apply.datum import Datum
from truestand.core.arrays import Array, Mask
from truestand.core.errors import NotEnoughData
from truestand.core.surface import Surface, each_of, sensor_origins, table_angle
from truestand.gear.geometry import SIGMA, Involute
from truestand.statistics.lone_readings import MOST_SLANT, lone_readings

Ints = NDArray[np.int32]
Indices = NDArray[np.intp]

BLOCK = 128
"""Profiles worked on at once."""
END_MARGIN = 0.2
"""mm of face left out at either end: chamfers, and the end faces themselves."""
FACE_BIN, LEAST_SHARE, FILLED = 0.1, 0.1, 0.3
"""mm of height that flanks reach or not; share of the most points below which they don't count for the usual number,
and share of that number from which flanks reach."""
TIP_MARGIN = 0.02
"""mm of radius left out at the tip: its land is no flank."""
GATE = 0.25
"""mm of delta about a flank's own position within which a point is the flank's."""
SEARCH_POINTS = 200_000
"""Points that find the toothing."""
PHASE_BINS = 720
SEARCH_DEPTH = 0.5
"""Modules of radius about the measuring circle in which the toothing is found."""
MODE_BIN = 0.05
"""mm."""
ABOUT_CIRCLE = 0.15
"""Share of the control length to either side of the measuring circle whose readings say how far a flank is seen."""
LEAST_FACING = 0.035
"""Cosine of the steepest incidence (88 degrees) at which a reading is taken for one of the flank."""
LEAST_POINTS, LEAST_TOGETHER = 10, 0.4
"""Points that must lie together, and their share of all within reach: outliers are everywhere."""
MATCH = 0.05
"""Modules of delta about the flank found, within which a point confirms the drawing."""
COLUMNS = ("delta", "roll", "height", "flank", "profile", "index")
"""Of ``FlankPoints``, one value a point."""
AT_ZERO = 3.5e-4
"""rad (0.02 degrees): a tooth whose centre is seen just below polar angle 0 is tooth 1 still; noise must not decide."""


@dataclass(frozen=True)
class Toothing:
    """The frame of the flanks: the drawing's toothing as it was found in a scan."""

    nominal: Involute
    datum: Datum
    first_tooth: float
    """Polar angle (rad, about the datum axis) of the centre of the first tooth at the middle of the face."""
    offsets: Array
    """(2 teeth,) mm: delta at which each flank was found near the measuring circle; NaN: not seen."""
    matched: float
    """Share of the points near the measuring circle that lie on these flanks."""

    def points(self, flank: tuple[Indices, Indices], roll: Array, height: Array, delta: Array) -> Array:
        """Points (n, 3) mm in C of flanks (side and tooth, (n,) each), ``delta`` (n,) mm off the drawing's.

        Roll length and height (n,) mm.
        """
        nominal, (side, tooth) = self.nominal, flank
        angle = nominal.flank_angle(tooth, side, roll, height, self.first_tooth)
        angle = angle + SIGMA[side] * delta / nominal.base_radius
        radius = nominal.radius(roll)
        in_datum = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
        return np.asarray(self.datum.pose.inverse(in_datum))

    def gradient(self, points: Array, sigma: Array) -> Array:
        """Of delta (n, 3) over the place of ``points`` (n, 3) mm in C, on flanks of a ``SIGMA`` (n,): sigma rb dtheta +
        sin alpha dr - sigma rb twist dz.
        """
        nominal, in_datum = self.nominal, self.datum.pose(points)
        rb, radius = nominal.base_radius, np.hypot(in_datum[:, 0], in_datum[:, 1])
        c, s = in_datum[:, 0] / radius, in_datum[:, 1] / radius
        sine = np.sqrt(np.maximum(1.0 - (rb / radius) ** 2, 0.0))
        around = sigma * rb / radius
        gradient = np.stack([sine * c - around * s, sine * s + around * c, -sigma * rb * nominal.twist], axis=1)
        return np.asarray(gradient @ self.datum.pose.rotation)


@dataclass(frozen=True, slots=True)
class FlankPoints:
    """Points and the flank that each one belongs to. (n,) arrays; side 0 = left, 1 = right; tooth from 0."""

    delta: Array
    """mm, against the design: modifications are no deviations."""
    roll: Array
    """mm."""
    height: Array
    """mm in C."""
    flank: Ints
    """side * teeth + tooth."""
    profile: Ints
    """Row of the scan."""
    index: NDArray[np.int64]
    """Reading of the scan, row * points + point."""

    def select(self, mask: Mask) -> Self:
        """Some of the points, by a mask (n,)."""
        return replace(self, **{name: getattr(self, name)[mask] for name in COLUMNS})

    def along_profiles(self, points: int) -> tuple[Indices, NDArray[np.int64]]:
        """The order (n,) in which profiles, of so many ``points``, have them flank by flank, and how many readings each
        of these lies before the next one (n - 1,); 0: that one is of another profile or flank.
        """
        order = np.lexsort((self.index, self.flank))
        flank, index = self.flank[order], self.index[order]
        together = (np.diff(flank) == 0) & (np.diff(index // points) == 0)
        return order, np.where(together, np.diff(index), 0)

    def joined(self, others: Sequence["FlankPoints"]) -> Self:
        """These points and others, one after the other."""
        return replace(self, **{n: np.concatenate([getattr(p, n) for p in (self, *others)]) for n in COLUMNS})


@dataclass(frozen=True, slots=True)
class Flanks(FlankPoints):
    """The points that lie on flanks."""

    toothing: Toothing
    outside_gate: FlankPoints
    """The points that lie where this toothing should, but ``GATE`` and more from the flank."""


@dataclass(frozen=True, slots=True)
class ToothedZone:
    """Points of the toothed zone, (n,): polar angle (rad) freed of the helix, radius and height (mm), reading."""

    angle: Array
    radius: Array
    height: Array
    index: NDArray[np.int64]

    def select(self, mask: Mask) -> "ToothedZone":
        """Some of the points, by a mask (n,)."""
        return ToothedZone(self.angle[mask], self.radius[mask], self.height[mask], self.index[mask])


def toothed_zone(
    surface: Surface, nominal: Involute, datum: Datum, rows: slice, low: float, high: float, thin: int = 1
) -> ToothedZone:
    """Some profiles' points inside the face with radii ``low`` to ``high`` (mm), every ``thin``-th of a profile."""
    g = nominal.gear
    x, y, z = (a[rows, ::thin] for a in (surface.x, surface.y, surface.z))
    square = x * x + y * y
    inside = (z > g.face_from + END_MARGIN) & (z < g.face_to - END_MARGIN)
    inside &= (square > (low - 1.0) ** 2) & (square < (high + 1.0) ** 2)
    row, column = np.nonzero(inside)
    points = np.stack([x[row, column], y[row, column], z[row, column]], axis=1)
    if np.abs(datum.pose.matrix - np.eye(4)).max() > 0:
        points = datum.pose(points)
    radius, height = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    angle = np.arctan2(points[:, 1], points[:, 0]) - (height - nominal.middle) * nominal.twist
    index = (row + rows.start).astype(np.int64) * surface.x.shape[1] + column * thin
    return ToothedZone(angle, radius, height, index).select((radius > low) & (radius < high))


def blocks(surface: Surface) -> list[slice]:
    """The profiles of a surface, ``BLOCK`` at a time."""
    profiles = surface.x.shape[0]
    return [slice(first, min(first + BLOCK, profiles)) for first in range(0, profiles, BLOCK)]


def find_flanks(surface: Surface, toothing: Toothing) -> Flanks:
    """Every point on a flank, with its tooth, roll length and deviation."""
    nominal = toothing.nominal
    origins = _sensor_origins(surface, toothing.datum)
    low, high = float(nominal.radius(np.asarray(nominal.control_roll))), nominal.gear.tip_diameter / 2 - TIP_MARGIN
    parts = []
    for rows in blocks(surface):
        points = toothed_zone(surface, nominal, toothing.datum, rows, low, high)
        parts.append(_on_flanks(points, toothing, origins, surface.x.shape[1]))
    found = _joined(parts)
    bottom, top = flank_heights(found)
    lowest = bottom + END_MARGIN if bottom > nominal.gear.face_from else -np.inf
    highest = top - END_MARGIN if top < nominal.gear.face_to else np.inf
    on_face, outside = ((p.height > lowest) & (p.height < highest) for p in (found, found.outside_gate))
    if on_face.all() and outside.all():
        return found
    return replace(found.select(on_face), outside_gate=found.outside_gate.select(outside))


def flank_heights(flanks: Flanks) -> tuple[float, float]:
    """Heights (mm, C) between which flanks were seen; the drawing's face where they reach its ends.

    Where the drawing's face begins below the real one, the real end face would pass for flanks.
    """
    g = flanks.toothing.nominal.gear
    first, last = g.face_from + END_MARGIN, g.face_to - END_MARGIN
    bins = max(1, round((last - first) / FACE_BIN))
    counts, edges = np.histogram(flanks.height, bins, (first, last))
    if not counts.any():
        return g.face_from, g.face_to
    usual = np.median(
        counts[counts > LEAST_SHARE * np.quantile(counts[counts > 0], 0.9)]
    )  # an end face may fill one bin
    filled = np.flatnonzero(counts > FILLED * usual)
    bottom = g.face_from if filled[0] == 0 else float(edges[filled[0] + 1])
    return bottom, g.face_to if filled[-1] == bins - 1 else float(edges[filled[-1]])


def _on_flanks(points: ToothedZone, toothing: Toothing, origins: Array | None, columns: int) -> Flanks:
    """The points on flanks, and those outside the gate, of a scan with ``columns`` points a profile."""
    nominal = toothing.nominal
    flank, delta = assign(points, nominal, toothing.first_tooth)
    roll = np.sqrt(np.maximum(points.radius**2 - nominal.base_radius**2, 0.0))
    delta = delta - nominal.modification(roll, points.height)
    off = np.abs(delta - toothing.offsets[flank])  # NaN: a flank that was not seen
    on, outside = off < GATE, off >= GATE
    profile = (points.index // columns).astype(np.int32)
    if origins is not None:
        on[on] = _facing(points.select(on), flank[on], origins[profile[on]], nominal) > LEAST_FACING
    number = flank.astype(np.int32)
    beside = FlankPoints(
        delta[outside], roll[outside], points.height[outside], number[outside], profile[outside], points.index[outside]
    )  # fmt: skip
    return Flanks(
        delta[on], roll[on], points.height[on], number[on], profile[on], points.index[on], toothing, beside
    )  # fmt: skip


def _joined(parts: list[Flanks]) -> Flanks:
    """The points of all blocks of profiles."""
    first, *others = parts
    return replace(first.joined(others), outside_gate=first.outside_gate.joined([p.outside_gate for p in others]))


def _sensor_origins(surface: Surface, datum: Datum) -> Array | None:
    """Where the sensor stands, seen from the part, at each profile (N, 3) mm; None where that isn't known."""
    if surface.scan is None or surface.calibration is None or surface.calibration.method == "paper":
        return None
    return datum.pose(sensor_origins(surface.calibration, table_angle(surface.scan, surface.calibration)))


def _facing(points: ToothedZone, flank: NDArray[np.intp], origins: Array, nominal: Involute) -> Array:
    """Cosine of the angle (n,) between each point's nominal flank normal and its ray; below 0 it faces away.

    The normal goes with (sin alpha, sigma cos alpha, -sigma rb twist) in radius, angle and height.
    """
    angle = points.angle + (points.height - nominal.middle) * nominal.twist
    c, s = np.cos(angle), np.sin(angle)
    to_sensor = origins - np.stack([points.radius * c, points.radius * s, points.height], axis=1)
    sigma = np.where(flank < nominal.gear.teeth, 1.0, -1.0)
    cosine = np.minimum(nominal.base_radius / points.radius, 1.0)
    helical = nominal.base_radius * nominal.twist
    radial = np.sqrt(1.0 - cosine * cosine) * (to_sensor[:, 0] * c + to_sensor[:, 1] * s)
    around = sigma * (cosine * (to_sensor[:, 1] * c - to_sensor[:, 0] * s) - helical * to_sensor[:, 2])
    length = np.sqrt(np.einsum("ij,ij->i", to_sensor, to_sensor) * (1.0 + helical * helical))
    return np.asarray((radial + around) / length)


def assign(points: ToothedZone, nominal: Involute, first_tooth: float) -> tuple[NDArray[np.intp], Array]:
    """side * teeth + tooth (n,) of each point, and its delta (n,) mm against the involute helicoid."""
    pitch, teeth = nominal.gear.pitch, nominal.gear.teeth
    pitches = (points.angle - first_tooth) / pitch
    tooth = np.rint(pitches)
    off = (pitches - tooth) * pitch
    flank = tooth.astype(np.intp) % teeth + np.where(off < 0, teeth, 0)
    delta = nominal.base_radius * (np.abs(off) - nominal.half_angle(points.radius))
    return flank, delta


def find_toothing(surfaces: Surface | Sequence[Surface], nominal: Involute, datum: Datum) -> Toothing:
    """Where the drawing's toothing stands in a scan, or in several in one frame.

    Raises:
        NotEnoughData: nothing of the toothing is in view.
    """
    points = near_measuring_circle(surfaces, nominal, datum)
    if points.angle.size < 100:
        g = nominal.gear
        raise NotEnoughData(
            f"found {points.angle.size} points between heights {g.face_from:g} and {g.face_to:g} mm near diameter "
            f"{2 * nominal.measuring_radius:.1f} mm, need the toothing in view; check face_from_mm, teeth, "
            "module_mm and the scan"
        )
    first_tooth = _centred(points, nominal, _phase(points, nominal))
    flank, delta = assign(points, nominal, first_tooth)
    offsets = _offsets(flank, delta, nominal)
    matched = np.count_nonzero(np.abs(delta - offsets[flank]) < MATCH * nominal.gear.module) / points.angle.size
    return Toothing(nominal, datum, first_tooth, offsets, matched)


def flank_offsets(surface: Surface, toothing: Toothing) -> Array:
    """delta (2 teeth,) mm at which a surface has most points of each flank near the measuring circle; NaN: too few."""
    nominal = toothing.nominal
    points = near_measuring_circle(surface, nominal, toothing.datum)
    return _offsets(*assign(points, nominal, toothing.first_tooth), nominal)


def near_measuring_circle(surfaces: Surface | Sequence[Surface], nominal: Involute, datum: Datum) -> ToothedZone:
    """About ``SEARCH_POINTS`` points near the measuring circle, evenly over the scans; readings numbered in each."""
    every = each_of(surfaces)
    depth = SEARCH_DEPTH * nominal.gear.module
    low = max(nominal.measuring_radius - depth, nominal.base_radius * 1.002)
    high = min(nominal.measuring_radius + depth, nominal.gear.tip_diameter / 2 - 0.05 * nominal.gear.module)
    thin = max(1, int(sum(s.x.size for s in every) / (20 * SEARCH_POINTS)))
    parts = [toothed_zone(s, nominal, datum, rows, low, high, thin) for s in every for rows in blocks(s)]
    return ToothedZone(*(np.concatenate([getattr(p, n) for p in parts]) for n in ToothedZone.__slots__))


def _phase(points: ToothedZone, nominal: Involute) -> float:
    """Angle (rad, within a pitch) at which a tooth's centre matches most points of either flank."""
    pitch, half = nominal.gear.pitch, nominal.half_angle(points.radius)
    counts = np.zeros(PHASE_BINS)
    for sigma in (1.0, -1.0):
        phase = ((points.angle - sigma * half) / pitch) % 1.0
        counts += np.bincount((phase * PHASE_BINS).astype(np.intp) % PHASE_BINS, minlength=PHASE_BINS)
    width = max(1, round(MATCH * nominal.gear.module / (pitch * nominal.base_radius) * PHASE_BINS))
    kernel = np.zeros(PHASE_BINS)
    kernel[np.arange(-width, width + 1)] = width + 1 - np.abs(np.arange(-width, width + 1))
    smooth = np.fft.irfft(np.fft.rfft(counts) * np.fft.rfft(kernel), PHASE_BINS)
    return (int(np.argmax(smooth)) + 0.5) / PHASE_BINS * pitch


def _centred(points: ToothedZone, nominal: Involute, first_tooth: float) -> float:
    """The same angle refined by the flanks' offsets, of the first tooth whose centre is at polar angle 0 or beyond."""
    for _ in range(2):
        left, right = _offsets(*assign(points, nominal, first_tooth), nominal).reshape(2, -1)
        if np.isfinite(left).any() and np.isfinite(right).any():  # one side alone can't tell place from thickness
            first_tooth += float(np.nanmean(left) - np.nanmean(right)) / 2 / nominal.base_radius
    return (first_tooth + AT_ZERO) % nominal.gear.pitch - AT_ZERO


def _offsets(flank: NDArray[np.intp], delta: Array, nominal: Involute) -> Array:
    """delta (2 teeth,) mm at which most points of each flank lie; NaN where there are too few."""
    flanks = 2 * nominal.gear.teeth
    reach = 0.45 * pi / nominal.gear.teeth * nominal.base_radius  # less than half a tooth or space
    bins = int(2 * reach / MODE_BIN)
    near = np.abs(delta) < reach
    bin_index = np.clip(((delta[near] + reach) / (2 * reach) * bins).astype(np.intp), 0, bins - 1)
    counts = np.bincount(flank[near] * bins + bin_index, minlength=flanks * bins).reshape(flanks, bins)
    smooth = counts.copy()
    smooth[:, 1:] += counts[:, :-1]
    smooth[:, :-1] += counts[:, 1:]
    mode = (np.argmax(smooth, axis=1) + 0.5) * MODE_BIN - reach
    at_mode = near & (np.abs(delta - mode[flank]) < 3 * MODE_BIN)
    number = np.bincount(flank[at_mode], minlength=flanks)
    mean = np.bincount(flank[at_mode], delta[at_mode], minlength=flanks) / np.maximum(number, 1)
    within_reach = np.bincount(flank[near], minlength=flanks)
    return np.where((number > LEAST_POINTS) & (number > LEAST_TOGETHER * within_reach), mean, np.nan)


def about_circle(flanks: Flanks) -> Flanks:
    """The flanks about the measuring circle: what is seen there says over which heights a helix is."""
    nominal = flanks.toothing.nominal
    return flanks.select(np.abs(flanks.roll - nominal.measuring_roll) < ABOUT_CIRCLE * nominal.control_length)


def without_readings(flanks: Flanks, readings: Mask) -> Flanks:
    """The flanks without some ``readings`` (profiles * points,) of the scan."""
    outside = flanks.outside_gate
    return replace(flanks.select(~readings[flanks.index]), outside_gate=outside.select(~readings[outside.index]))


def lone_readings_on(flanks: Flanks, live: Mask, angle: Array) -> Mask:
    """Readings (profiles * points,) on flanks that nothing bears out; ``live`` (points,): points of a profile that see
    anything; ``angle`` (profiles,) rad of the table.

    Those outside the gate bear each other out, too, and so do those on either side of blind points.
    """
    every = FlankPoints(*(getattr(flanks, name) for name in COLUMNS)).joined([flanks.outside_gate])
    row, column = np.divmod(every.index, live.size)
    points = int(np.count_nonzero(live))
    index = row * points + (np.cumsum(live) - 1)[column]
    alone = lone_readings(every.delta, every.flank, index, points, angle, _slant(flanks, live.size, angle))
    found = np.zeros(angle.size * live.size, dtype=bool)
    found[every.index[alone]] = True
    return found


def _slant(flanks: Flanks, points: int, angle: Array) -> float:
    """Points of a profile by which a place of a helical flank moves on from one profile to the next; 0: too many."""
    twist = flanks.toothing.nominal.twist
    if not twist or flanks.delta.size < 2:
        return 0.0
    by_height = float(np.polyfit(flanks.height, flanks.index % points, 1)[0])
    slant = -float(np.median(np.diff(angle))) / twist * by_height
    return slant if abs(slant) <= MOST_SLANT else 0.0
