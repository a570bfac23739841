"""Teeth, helix, base circle, module and shift of a gear from the points alone; and whether the drawing fits it."""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import asin, atan, cos, degrees, pi, radians, sin, tan

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints
from truestand.core.errors import NotEnoughData, WrongDrawing
from truestand.core.frames import Pose
from truestand.core.surface import Surface
from truestand.gear.drawing import Gear
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import inv

ComplexArray = NDArray[np.complex128]

LEAST_MATCHED = 0.55
"""Share of the points near the measuring circle that must lie on the drawing's flanks."""
MOST_SLOPE = 0.1
"""mm over the flank: a mean slope beyond it is another pressure angle, module or helix, and no deviation."""
STRETCHES = 12
"""Of a flank, whose slopes are compared."""
MOST_THICKNESS = 0.2
"""Modules by which the teeth may be thicker or thinner than drawn."""
CERTAIN, MOST_FLANKS = 0.8, 0.6
"""Shares of these points, and of the flanks of one side, below which teeth are counted as well: the flanks of half as
many teeth lie on those of a drawing of twice as many."""
LEAST_TURN = 0.25
"""Share of a turn that must be in view to count teeth."""
SAMPLE_POINTS = 400_000
HEIGHT_SLICES = 24
MOST_TEETH = 400
RADIUS_BIN = 0.05
TRACE_ROWS, LEAST_ROWS, LEAST_IN_ROW = 60, 10, 30
PRESSURE_ANGLES = (20.0, 14.5, 15.0, 17.5, 22.5, 25.0)
MODULES = (
    0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.125, 1.25, 1.375, 1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0, 3.25, 3.5, 3.75,
    4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 28.0, 32.0,
)  # fmt: skip
"""Normal modules of ISO 54, both series, and a few below."""
STANDARD_TOLERANCE = 0.002
"""Relative, by which a module may be off a standard one to be taken for it."""
TIP_BAND, FACE_BIN, FILLED, MOST_GAP = 0.15, 0.1, 0.3, 1.0
"""mm below the tip in which the face shows; mm of height that it fills or not; share of the usual number of points from
which it does; mm of it that may be empty."""
STRONG, AGREES = 0.3, 0.6
"""Share of the strongest pattern's power, and of the best twist's agreement, from which another one is tried."""
MOST_TWISTS = 3
ON_FLANK = 0.03
"""Modules of delta within which a reading lies on a flank."""
SURE, AHEAD = 0.7, 0.15
"""Confidence from which a gear is sure, and by which it must be ahead of its rivals."""


@dataclass(frozen=True, slots=True)
class IdentifiedGear:
    """The gear as the points show it; mm and rad."""

    teeth: int
    base_radius: float
    helix_angle: float
    """+ right hand, - left hand."""
    module: float
    pressure_angle: float
    """The standard one with which the module comes out as a standard one; 20 degrees where none does."""
    profile_shift: float | None
    """None where only one side of the teeth was seen."""
    tip_diameter: float
    root_diameter: float
    rms: float
    """Of the traces about the involute."""
    confidence: float = 1.0
    """Share 0..1 of the readings between root and tip that lie on this gear's flanks, times that of its teeth which
    show any."""
    rivals: tuple["IdentifiedGear", ...] = ()
    """Other gears that the points may be, the likeliest first."""

    @property
    def sure(self) -> bool:
        """Whether it is this gear and no other, with a standard module."""
        ahead = all(r.confidence < self.confidence - AHEAD for r in self.rivals)
        return self.confidence >= SURE and ahead and is_standard(self.module)

    def __str__(self) -> str:
        shift = "" if self.profile_shift is None else f", profile shift {self.profile_shift:+.3f}"
        return (
            f"{self.teeth} teeth, module {self.module:.4g} mm at {degrees(self.pressure_angle):g} degrees, helix "
            f"{degrees(self.helix_angle):+.2f} degrees{shift}, tip diameter {self.tip_diameter:.2f} mm"
        )


def is_standard(module: float) -> bool:
    """Whether a module (mm) is a standard one, as near as a scan can tell."""
    return min(abs(module / m - 1) for m in MODULES) < STANDARD_TOLERANCE


def check_drawing(surface: Surface, flanks: Flanks, slope_U: float = 0.0) -> None:
    """Refuse a gear that is not the drawing's; ``slope_U``: mm (k = 2) by which the calibration leaves slopes open.

    Raises:
        WrongDrawing: with what was seen instead.
    """
    toothing = flanks.toothing
    g = toothing.nominal.gear
    sides = [o[np.isfinite(o)] for o in toothing.offsets.reshape(2, -1)]
    thick = sum(float(s.mean()) for s in sides) if all(s.size for s in sides) else 0.0
    fits = (
        toothing.matched >= LEAST_MATCHED
        and abs(thick) < MOST_THICKNESS * g.module
        and _steepest(flanks) < MOST_SLOPE + slope_U
    )
    flanks_seen = max(s.size for s in sides) / g.teeth
    if fits and flanks_seen >= MOST_FLANKS and toothing.matched >= CERTAIN:
        return
    try:
        seen = identify(surface, toothing.datum.pose, g.face_from, g.face_to)
        instead = f"saw {seen}{'' if seen.sure else ', which is not sure'}{_moved(seen, g)}"
    except NotEnoughData:
        if not flanks.delta.size:
            raise
        seen, instead = None, "could not tell which gear it is"
    if fits and (seen is None or seen.teeth == g.teeth):
        return
    raise WrongDrawing(
        f"the drawing has {g.teeth} teeth, module {g.module:g} mm at {degrees(g.pressure_angle):g} degrees, helix "
        f"{degrees(g.helix_angle):+g} degrees, tip diameter {g.tip_diameter:g} mm; {instead}; check the part and "
        "its recipe"
    )


def _moved(seen: IdentifiedGear, drawn: Gear) -> str:
    """What may have made the drawing's gear look like another one."""
    return "" if seen.teeth != drawn.teeth else "; or sensor or shaft have moved since the calibration (verify it)"


def _steepest(flanks: Flanks) -> float:
    """The largest slope of a side, over its control length or face, mm, without the tips: chamfers are there.

    Another pressure angle, module or helix slopes evenly; a worn band is a step.
    """
    nominal, steepest = flanks.toothing.nominal, 0.0
    evaluated = flanks.roll < nominal.profile_range[1]
    for side in range(2):
        on = evaluated & (flanks.flank >= side * nominal.gear.teeth) & (flanks.flank < (side + 1) * nominal.gear.teeth)
        if np.count_nonzero(on) < 1000:
            continue
        few = np.flatnonzero(on)[:: max(1, int(on.sum() / 50_000))]
        by_roll, by_height = (_even_slope(at[few], flanks.delta[few]) for at in (flanks.roll, flanks.height))
        steepest = max(steepest, abs(by_roll) * nominal.control_length, abs(by_height) * nominal.gear.face_width)
    return steepest


def _even_slope(at: Array, delta: Array) -> float:
    """Median slope of delta (n,) mm from one stretch of places (n,) mm to the next."""
    stretches = np.array_split(np.argsort(at), STRETCHES)
    place, height = (np.array([np.median(of[s]) for s in stretches]) for of in (at, delta))
    return float(np.median(np.diff(height) / np.diff(place)))


def identify(surface: Surface, datum: Pose, bottom: float, top: float) -> IdentifiedGear:
    """The gear whose toothing lies between two heights (mm, C); ``datum``: from C to the axis of the gear.

    Source: involute by ISO 21771, standard modules by ISO 54.

    Raises:
        NotEnoughData: no toothing there that could be identified.
    """
    angle, radius, height = _points(surface, datum, bottom, top)
    root, tip = root_and_tip(radius)
    cloud = _Cloud(angle, radius, height - (bottom + top) / 2, root, tip)
    found = []
    for teeth, twist in _patterns(angle, radius, height, root, tip):
        found += _gears_through(cloud, teeth, _refined(cloud, teeth, twist))
    if not found:
        raise NotEnoughData("found too few points on the flanks, need both sides of the teeth or one of them in view")
    best, *others = sorted(found, key=lambda gear: -gear.confidence)
    return replace(best, rivals=tuple(o for o in others if o.confidence > best.confidence / 2))


@dataclass(frozen=True, slots=True)
class _Cloud:
    """Polar angle (rad), radius and height from mid-face (mm) of points (n,); radii of root and tip (mm)."""

    angle: Array
    radius: Array
    height: Array
    root: float
    tip: float


def _refined(cloud: _Cloud, teeth: int, twist: float) -> float:
    """The twist (rad/mm) by the slope of the flanks themselves over the height."""
    folded = _fold(cloud, teeth, twist)
    if folded is None:
        return twist
    base, half, _ = _involute_through(folded, cloud.root, cloud.tip)
    off = folded.off_flank(base, half)
    on = np.abs(off) * base < ON_FLANK * (cloud.tip - cloud.root)
    return twist + float(np.polyfit(folded.height[on], off[on], 1)[0]) if np.count_nonzero(on) > LEAST_IN_ROW else twist


def _gears_through(cloud: _Cloud, teeth: int, twist: float) -> list[IdentifiedGear]:
    """The gears of so many teeth that fit the points: one for each standard pair of module and pressure angle; none
    where too few points lie on flanks.
    """
    folded = _fold(cloud, teeth, twist)
    if folded is None:
        return []
    root, tip = cloud.root, cloud.tip
    base, half, rms = _involute_through(folded, root, tip)
    found = []
    for alpha, module, beta in _standard(base, atan(twist * base), teeth):
        shift = None
        if np.isfinite(half).all():
            transverse = atan(tan(alpha) / cos(beta))
            arc = (float(half.mean()) - inv(transverse)) * 2 * (base / cos(transverse))
            shift = (arc / (module / cos(beta)) - pi / 2) / (2 * tan(alpha))
        on = folded.share_on(base, half, ON_FLANK * module)
        found.append(IdentifiedGear(teeth, base, beta, module, alpha, shift, 2 * tip, 2 * root, rms, on))
    return found


def toothed_heights(surface: Surface, datum: Pose) -> tuple[float, float]:
    """Heights (mm, C) between which the part reaches out to its largest radius.

    Raises:
        NotEnoughData: no such stretch.
    """
    from scipy.ndimage import binary_closing, label

    _, radius, height = _points(surface, datum, -1e9, 1e9)
    _, tip = root_and_tip(radius)
    out = height[np.abs(radius - tip) < TIP_BAND]
    if out.size < 100:
        raise NotEnoughData("found no stretch of largest radius, need a toothing in view; pass --from-mm and --to-mm")
    low, high = float(out.min()), float(out.max())
    counts, edges = np.histogram(out, max(1, round((high - low) / FACE_BIN)), (low, high))
    usual = np.sort(counts)[::-1].cumsum().searchsorted(out.size / 2)  # bins that hold half of the points
    filled = counts > FILLED * np.sort(counts)[::-1][usual]
    joined, number = label(binary_closing(np.pad(filled, 10), np.ones(round(MOST_GAP / FACE_BIN)))[10:-10])
    longest = 1 + int(np.argmax([(joined == n).sum() for n in range(1, number + 1)]))
    on = np.flatnonzero(joined == longest)
    inside = out[(out >= edges[on[0]]) & (out <= edges[on[-1] + 1])]
    return float(inside.min()), float(inside.max())


def _points(surface: Surface, datum: Pose, bottom: float, top: float) -> tuple[Array, Array, Array]:
    """Polar angle, radius, height (n,) of about ``SAMPLE_POINTS`` points between two heights."""
    thin = max(1, int(surface.x.size / SAMPLE_POINTS / 4))
    x, y, z = (a[:, ::thin] for a in (surface.x, surface.y, surface.z))
    inside = np.isfinite(x) & (z > bottom + 0.3) & (z < top - 0.3)
    points = datum(np.stack([x[inside], y[inside], z[inside]], axis=1))
    if points.shape[0] < 1000:
        raise NotEnoughData(
            f"found {points.shape[0]} points between heights {bottom:g} and {top:g} mm, need a toothing in view; check "
            "face_from_mm, face_width_mm and the scan"
        )
    return np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1]), points[:, 2]


def root_and_tip(radius: Array) -> tuple[float, float]:
    """Radii of the root and of the tip: the outermost and the innermost radius at which many points lie."""
    bins = np.arange(0.0, float(np.quantile(radius, 0.999)) + 5.0, RADIUS_BIN)
    counts, _ = np.histogram(radius, bins)
    many = np.flatnonzero(counts > 0.1 * counts.max())
    low, high = bins[many[0]], bins[many[-1] + 1]
    near_tip = radius[(radius > high - 3 * RADIUS_BIN) & (radius < high + RADIUS_BIN)]
    near_root = radius[(radius < low + 3 * RADIUS_BIN) & (radius > low - RADIUS_BIN)]
    return float(np.median(near_root)), float(np.median(near_tip))


def _patterns(angle: Array, radius: Array, height: Array, root: float, tip: float) -> list[tuple[int, float]]:
    """How often the radius may go up and down a turn, and by how much (rad/mm) that pattern turns going up.

    The strongest first.
    """
    waves, middle = _waves(angle, radius, height, root, tip)
    power = np.abs(waves).mean(axis=0)
    power[:3] = 0.0
    strongest = int(np.argmax(power[:MOST_TEETH]))
    if power[strongest] < 4 * np.median(power[3:MOST_TEETH]):
        raise NotEnoughData("found no regular toothing, need one in view over most of a turn")
    strong = {int(n) for n in np.argsort(power[:MOST_TEETH])[-3:] if power[n] > STRONG * power[strongest]}
    candidates = (strongest, *sorted(strong - {strongest}))
    return [(teeth, twist) for teeth in candidates for twist in _twists(waves[:, teeth], middle, teeth, tip)]


def _waves(angle: Array, radius: Array, height: Array, root: float, tip: float) -> tuple[ComplexArray, Array]:
    """Waves (slices, n) of up and down round the part in slices of height, and the slices' heights about their middle.

    n: times a turn.
    """
    on = (radius > root - 0.3) & (radius < tip + 0.3)
    up = np.where(radius[on] > (root + tip) / 2, 1.0, -1.0)
    at, h = angle[on], height[on]
    edges = np.linspace(h.min(), h.max(), HEIGHT_SLICES + 1)
    places = 4 * MOST_TEETH
    sums = np.zeros((HEIGHT_SLICES, places))
    counts = np.zeros((HEIGHT_SLICES, places))
    row = np.clip(np.searchsorted(edges, h) - 1, 0, HEIGHT_SLICES - 1)
    column = ((at / (2 * pi)) % 1.0 * places).astype(np.intp) % places
    np.add.at(sums, (row, column), up)
    np.add.at(counts, (row, column), 1.0)
    mean = sums / np.maximum(counts, 1.0)
    if np.count_nonzero(counts.any(axis=0)) < LEAST_TURN * places:
        raise NotEnoughData("found too small a part of a turn, need a regular toothing in view over most of it")
    mean -= mean.mean(axis=1, keepdims=True)
    return np.fft.rfft(mean, axis=1), (edges[1:] + edges[:-1]) / 2 - (edges[0] + edges[-1]) / 2


def _twists(wave: ComplexArray, middle: Array, teeth: int, tip: float) -> list[float]:
    """Twists (rad/mm) with which the wave (slices,) of the teeth agrees over the heights ``middle``, the best first."""
    steepest = tan(radians(50.0)) / tip
    twists = np.linspace(-steepest, steepest, 4001)
    agreement = np.abs(np.exp(1j * teeth * np.outer(twists, middle)) @ wave)
    beside = np.pad(agreement, 1)
    peaks = np.flatnonzero(
        (agreement >= beside[:-2]) & (agreement > beside[2:]) & (agreement > AGREES * agreement.max())
    )
    peaks = peaks[np.argsort(-agreement[peaks])][:MOST_TWISTS]
    found = []
    for best in twists[peaks]:
        rest = np.unwrap(np.angle(wave * np.exp(1j * teeth * best * middle)))
        slope = float(np.polyfit(middle, rest, 1, w=np.abs(wave))[0])
        found.append(float(best - slope / teeth))
    return found


@dataclass(frozen=True, slots=True)
class _Folded:
    """All teeth laid over one another."""

    off: Array
    """(n,) rad from the tooth's centre, -half a pitch..half a pitch, of the readings between root and tip."""
    tooth: Ints
    """(n,) and which tooth it is."""
    radius: Array
    """(n,) mm."""
    height: Array
    """(n,) mm from the middle of the face."""
    teeth: int
    at: Array
    """(m,) mm: radii of the traces' points,"""
    places: Array
    """(m,) rad: how far from the tooth's centre they are,"""
    sides: Ints
    """(m,) and on which side: 0 ccw, 1 cw."""

    def off_flank(self, base: float, half: Array) -> Array:
        """Angle (n,) rad, ccw, from the flanks with half a tooth's angle ``half`` (2,) on the base circle; NaN where a
        side has no trace.
        """
        alpha = np.arccos(np.minimum(base / self.radius, 1.0))
        expected = half[np.where(self.off > 0, 0, 1)] - (np.tan(alpha) - alpha)
        return np.asarray(self.off - np.sign(self.off) * expected)

    def share_on(self, base: float, half: Array, within: float) -> float:
        """Share of the readings on flanks, ``within`` mm, times the share of the teeth whose better side shows any."""
        off = base * np.abs(self.off_flank(base, half))
        known = np.isfinite(off)
        if not known.any():
            return 0.0
        flank = (np.where(self.off > 0, 0, 1) * self.teeth + self.tooth)[known & (off < within)]
        number = np.bincount(flank, minlength=2 * self.teeth).reshape(2, -1)
        shown = (number > FILLED * number.mean(axis=1, keepdims=True)).mean(axis=1)
        return float(np.mean(off[known] < within)) * float(shown.max())


def _fold(cloud: _Cloud, teeth: int, twist: float) -> _Folded | None:
    """The teeth laid over one another, with traces along their two edges; None where those show too little."""
    pitch, radius, root, tip = 2 * pi / teeth, cloud.radius, cloud.root, cloud.tip
    angle = cloud.angle - cloud.height * twist
    high = radius > (root + 3 * tip) / 4
    centre = float(np.angle(np.exp(1j * teeth * angle[high]).mean())) / teeth
    tooth = np.rint((angle - centre) / pitch)
    off = angle - centre - tooth * pitch
    low, top = root + 0.45 * (tip - root), tip - 0.08 * (tip - root)
    edges = np.linspace(low, top, TRACE_ROWS + 1)
    at, places, sides = [], [], []
    for side, sign in enumerate((1.0, -1.0)):
        on = sign * off > 0
        for a, b in pairwise(edges):
            inside = on & (radius >= a) & (radius < b)
            if np.count_nonzero(inside) >= LEAST_IN_ROW:
                at.append(float(np.median(radius[inside])))
                places.append(float(np.median(sign * off[inside])))
                sides.append(side)
    if len(at) < LEAST_ROWS:
        return None
    between = (radius >= low) & (radius < top)
    number = tooth[between].astype(np.intp) % teeth
    return _Folded(
        off[between], number, radius[between], cloud.height[between], teeth,
        np.array(at), np.array(places), np.array(sides, dtype=np.intp),
    )  # fmt: skip


def _involute_through(folded: _Folded, root: float, tip: float) -> tuple[float, Array, float]:
    """Base radius (mm), half the angle of a tooth on the base circle by side (2,), NaN: not seen; rms (mm)."""
    from scipy.optimize import least_squares

    at, places, sides = folded.at, folded.places, folded.sides

    def off(p: Array) -> Array:
        alpha = np.arccos(np.minimum(p[0] / at, 1.0))
        return np.asarray(p[0] * (places - (p[1 + sides] - (np.tan(alpha) - alpha))))

    start = np.array([0.94 * (root + tip) / 2, 0.1, 0.1])
    found = least_squares(off, start, loss="soft_l1", f_scale=0.01)
    half = np.where(np.isin([0, 1], sides), found.x[1:], np.nan)
    return float(found.x[0]), half, float(np.sqrt(np.mean(np.square(off(found.x)))))


def _standard(base: float, base_helix: float, teeth: int) -> list[tuple[float, float, float]]:
    """Normal pressure angle, normal module, helix angle: every standard pair that fits, else that of 20 degrees."""
    pairs = []
    for alpha in (radians(a) for a in PRESSURE_ANGLES):
        if abs(sin(base_helix)) < cos(alpha):
            beta = asin(sin(base_helix) / cos(alpha))
            pairs.append((alpha, 2 * base * cos(beta) / (teeth * cos(atan(tan(alpha) / cos(beta)))), beta))
    return [pair for pair in pairs if is_standard(pair[1])] or pairs[:1]
