"""Teeth, helix, base circle, module and shift of a gear from the points alone; and whether the drawing fits it."""

from dataclasses import dataclass
from itertools import pairwise
from math import asin, atan, cos, degrees, pi, radians, sin, tan

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.errors import NotEnoughData, WrongDrawing
from truestand.core.frames import Pose
from truestand.core.surface import Surface
from truestand.gear.flanks import Flanks
from truestand.gear.geometry import inv

LEAST_MATCHED = 0.55
"""Share of the points near the measuring circle that must lie on the drawing's flanks."""
MOST_SLOPE = 0.1
"""mm over the flank: a mean slope beyond it is another pressure angle, module or helix, and no deviation."""
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
TRACE_ROWS = 60
PRESSURE_ANGLES = (20.0, 14.5, 15.0, 17.5, 22.5, 25.0)
MODULES = (
    0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.125, 1.25, 1.375, 1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0, 3.25, 3.5, 3.75,
    4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0, 28.0, 32.0,
)  # fmt: skip
"""Normal modules of ISO 54, both series, and a few below."""
STANDARD_TOLERANCE = 0.004
"""Relative, by which a module may be off a standard one to be taken for it."""


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

    def __str__(self) -> str:
        shift = "" if self.profile_shift is None else f", profile shift {self.profile_shift:+.3f}"
        return (
            f"{self.teeth} teeth, module {self.module:.4g} mm at {degrees(self.pressure_angle):g} degrees, helix "
            f"{degrees(self.helix_angle):+.2f} degrees{shift}, tip diameter {self.tip_diameter:.2f} mm"
        )


def is_standard(module: float) -> bool:
    """Whether a module (mm) is a standard one, as near as a scan can tell."""
    return min(abs(module / m - 1) for m in MODULES) < STANDARD_TOLERANCE


def check_drawing(surface: Surface, flanks: Flanks) -> None:
    """Refuse a gear that is not the drawing's.

    Raises:
        WrongDrawing: with what was seen instead.
    """
    toothing = flanks.toothing
    g = toothing.nominal.gear
    sides = [o[np.isfinite(o)] for o in toothing.offsets.reshape(2, -1)]
    thick = sum(float(s.mean()) for s in sides) if all(s.size for s in sides) else 0.0
    fits = (
        toothing.matched >= LEAST_MATCHED and abs(thick) < MOST_THICKNESS * g.module and _steepest(flanks) < MOST_SLOPE
    )
    flanks_seen = max(s.size for s in sides) / g.teeth
    if fits and flanks_seen >= MOST_FLANKS and toothing.matched >= CERTAIN:
        return
    try:
        seen = identify(surface, toothing.datum.pose, g.face_from, g.face_to)
        instead = f"saw {seen}"
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


def _steepest(flanks: Flanks) -> float:
    """The largest mean slope of a side, over its control length or face, mm."""
    nominal, steepest = flanks.toothing.nominal, 0.0
    for side in range(2):
        on = (flanks.flank >= side * nominal.gear.teeth) & (flanks.flank < (side + 1) * nominal.gear.teeth)
        if np.count_nonzero(on) < 1000:
            continue
        few = np.flatnonzero(on)[:: max(1, int(on.sum() / 50_000))]
        roll, height = flanks.roll[few], flanks.height[few]
        design = np.stack([np.ones(few.size), roll - roll.mean(), height - height.mean()], axis=1)
        _, by_roll, by_height = np.linalg.lstsq(design, flanks.delta[few], rcond=None)[0]
        steepest = max(steepest, abs(by_roll) * nominal.control_length, abs(by_height) * nominal.gear.face_width)
    return steepest


def identify(surface: Surface, datum: Pose, bottom: float, top: float) -> IdentifiedGear:
    """The gear whose toothing lies between two heights (mm, C); ``datum``: from C to the axis of the gear.

    Source: involute by ISO 21771, standard modules by ISO 54.

    Raises:
        NotEnoughData: no toothing there that could be identified.
    """
    angle, radius, height = _points(surface, datum, bottom, top)
    root, tip = _root_and_tip(radius)
    teeth, twist = _teeth_and_twist(angle, radius, height, root, tip)
    free = angle - (height - (bottom + top) / 2) * twist
    base, half, rms = _involute_through(free, radius, teeth, root, tip)
    base_helix = atan(twist * base)
    alpha, module, beta = _standard(base, base_helix, teeth)
    shift = None
    if half is not None:
        transverse = atan(tan(alpha) / cos(beta))
        arc = (half - inv(transverse)) * 2 * (base / cos(transverse))
        shift = (arc / (module / cos(beta)) - pi / 2) / (2 * tan(alpha))
    return IdentifiedGear(teeth, base, beta, module, alpha, shift, 2 * tip, 2 * root, rms)


def toothed_heights(surface: Surface, datum: Pose) -> tuple[float, float]:
    """Heights (mm, C) between which the part reaches out to its largest radius.

    Raises:
        NotEnoughData: no such stretch.
    """
    _, radius, height = _points(surface, datum, -1e9, 1e9)
    _, tip = _root_and_tip(radius)
    out = height[radius > tip - 0.15]
    if out.size < 100:
        raise NotEnoughData("found no stretch of largest radius, need a toothing in view; pass --from-mm and --to-mm")
    low, high = np.quantile(out, [0.002, 0.998])
    return float(low), float(high)


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


def _root_and_tip(radius: Array) -> tuple[float, float]:
    """Radii of the root and of the tip: the outermost and the innermost radius at which many points lie."""
    bins = np.arange(0.0, float(np.quantile(radius, 0.999)) + 5.0, RADIUS_BIN)
    counts, _ = np.histogram(radius, bins)
    many = np.flatnonzero(counts > 0.1 * counts.max())
    low, high = bins[many[0]], bins[many[-1] + 1]
    near_tip = radius[(radius > high - 3 * RADIUS_BIN) & (radius < high + RADIUS_BIN)]
    near_root = radius[(radius < low + 3 * RADIUS_BIN) & (radius > low - RADIUS_BIN)]
    return float(np.median(near_root)), float(np.median(near_tip))


def _teeth_and_twist(angle: Array, radius: Array, height: Array, root: float, tip: float) -> tuple[int, float]:
    """How often the radius goes up and down a turn, and by how much (rad/mm) that pattern turns going up."""
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
    waves = np.fft.rfft(mean, axis=1)
    power = np.abs(waves).mean(axis=0)
    power[:3] = 0.0
    teeth = int(np.argmax(power[:MOST_TEETH]))
    if power[teeth] < 4 * np.median(power[3:MOST_TEETH]):
        raise NotEnoughData("found no regular toothing, need one in view over most of a turn")
    middle = (edges[1:] + edges[:-1]) / 2 - (edges[0] + edges[-1]) / 2
    steepest = tan(radians(50.0)) / tip
    twists = np.linspace(-steepest, steepest, 4001)
    agreement = np.abs(np.exp(1j * teeth * np.outer(twists, middle)) @ waves[:, teeth])
    best = twists[int(np.argmax(agreement))]
    rest = np.unwrap(np.angle(waves[:, teeth] * np.exp(1j * teeth * best * middle)))
    slope = float(np.polyfit(middle, rest, 1, w=np.abs(waves[:, teeth]))[0])
    return teeth, float(best - slope / teeth)


def _involute_through(
    angle: Array, radius: Array, teeth: int, root: float, tip: float
) -> tuple[float, float | None, float]:
    """Base radius (mm), half the angle of a tooth on the base circle (None with one side only), rms (mm)."""
    from scipy.optimize import least_squares

    at, places, sides = _traces(angle, radius, teeth, root, tip)

    def off(p: Array) -> Array:
        alpha = np.arccos(np.minimum(p[0] / at, 1.0))
        return np.asarray(p[0] * (places - (p[1 + sides] - (np.tan(alpha) - alpha))))

    start = np.array([0.94 * (root + tip) / 2, 0.1, 0.1])
    found = least_squares(off, start, loss="soft_l1", f_scale=0.01)
    rms = float(np.sqrt(np.mean(np.square(off(found.x)))))
    both = np.unique(sides).size == 2
    return float(found.x[0]), float(np.mean(found.x[1:])) if both else None, rms


def _traces(angle: Array, radius: Array, teeth: int, root: float, tip: float) -> tuple[Array, Array, Ints]:
    """Radii, angles from the tooth's centre and side (n,) along the folded tooth's two edges."""
    pitch = 2 * pi / teeth
    high = radius > (root + 3 * tip) / 4
    centre = float(np.angle(np.exp(1j * teeth * angle[high]).mean())) / teeth
    off = (angle - centre + pitch / 2) % pitch - pitch / 2
    low, top = root + 0.45 * (tip - root), tip - 0.08 * (tip - root)
    edges = np.linspace(low, top, TRACE_ROWS + 1)
    at, places, sides = [], [], []
    for side, sign in enumerate((1.0, -1.0)):
        on = sign * off > 0
        for a, b in pairwise(edges):
            inside = on & (radius >= a) & (radius < b)
            if np.count_nonzero(inside) >= 30:
                at.append(float(np.median(radius[inside])))
                places.append(float(np.median(sign * off[inside])))
                sides.append(side)
    if len(at) < 10:
        raise NotEnoughData("found too few points on the flanks, need both sides of the teeth or one of them in view")
    return np.array(at), np.array(places), np.array(sides, dtype=np.intp)


def _standard(base: float, base_helix: float, teeth: int) -> tuple[float, float, float]:
    """Normal pressure angle, normal module, helix angle: the standard pair if one fits, else 20 degrees."""
    pairs = []
    for alpha in (radians(a) for a in PRESSURE_ANGLES):
        beta = asin(sin(base_helix) / cos(alpha))
        module = 2 * base * cos(beta) / (teeth * cos(atan(tan(alpha) / cos(beta))))
        pairs.append((alpha, module, beta))
    return next((pair for pair in pairs if is_standard(pair[1])), pairs[0])
