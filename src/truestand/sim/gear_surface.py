"""The surface of a real gear in its own frame, axis up: involute helicoids with all errors.

Worked out here apart from ``gear.geometry``, to check each other. With sigma = +1 on left flanks and -1 on right ones,
tooth k (from 0) has its flank at

    theta = first + 2 pi k / z + sigma (psi_b - inv alpha_y + delta / rb) + (h - middle) twist,   cos alpha_y = rb / r,

where delta(k, sigma, L, h) is the excess material along the base tangent, L = sqrt(r² - rb²) the roll length.
"""

from dataclasses import dataclass
from math import acos, cos, hypot, pi, sin, sqrt, tan

import numpy as np
from numpy.random import default_rng

from truestand.core.arrays import Array, Ints
from truestand.core.errors import BadRecipe
from truestand.gear.drawing import Gear
from truestand.sim.gear_errors import Dent, GearErrors, Scratch, Worn

LEFT, RIGHT = 1, -1
FILLET_MODULES = 0.3
"""How far above the root circle flanks must end, for the fillet."""
MIN_ROLL_MODULES = 0.05
"""Roll length where profiles of undercut teeth begin."""


@dataclass(frozen=True, slots=True)
class Circles:
    """Radii and angles of a drawing's involute; mm, rad."""

    base: float
    """Radius, as the next five."""
    reference: float
    tip: float
    root: float
    form: float
    """Where the profile begins: flanks have errors and are evaluated from here on."""
    start: float
    """Where the involute surface begins; below, a radial line and the fillet."""
    half_tooth: float
    """psi_b: half the angle of a tooth at the base circle."""
    twist: float
    """rad per mm of height, + right hand."""

    def roll(self, radius: float) -> float:
        """Roll length at a radius."""
        return sqrt(max(radius**2 - self.base**2, 0.0))


def circles_of(gear: Gear) -> Circles:
    """The circles of a drawing.

    Raises:
        BadRecipe: teeth that come to a point below the tip circle, or no space between them at the root.
    """
    m, beta = gear.module, gear.helix_angle
    reference = gear.teeth * m / cos(beta) / 2
    alpha = np.arctan(tan(gear.pressure_angle) / cos(beta))
    base = reference * cos(alpha)
    thickness = m / cos(beta) * (pi / 2 + 2 * gear.profile_shift * tan(gear.pressure_angle))
    half_tooth = thickness / (2 * reference) + tan(alpha) - float(alpha)
    tip, root = gear.tip_diameter / 2, gear.root_diameter / 2
    start = max(hypot(base, 0.01 * m), root + FILLET_MODULES * m)
    circles = Circles(
        base, reference, tip, root, _form_radius(gear, base, reference, float(alpha), start), start, half_tooth,
        2 * tan(beta) / (2 * reference),
    )  # fmt: skip
    at_tip = half_tooth - inv(base, tip)
    if at_tip <= 0:
        raise BadRecipe(f"the teeth come to a point below tip_diameter_mm {gear.tip_diameter:g}; need a smaller tip")
    if pi / gear.teeth - half_tooth + inv(base, start) <= 0:
        raise BadRecipe("the teeth leave no space between them at the root; check profile_shift and root_diameter_mm")
    return circles


def inv(base: float, radius: float) -> float:
    """The involute function at a radius: tan alpha - alpha, cos alpha = base / radius."""
    a = acos(min(base / radius, 1.0))
    return tan(a) - a


def _form_radius(gear: Gear, base: float, reference: float, alpha: float, start: float) -> float:
    """The drawing's control diameter, otherwise where a rack without protrusion starts to cut the involute."""
    if gear.evaluation.control_diameter is not None:
        return max(gear.evaluation.control_diameter / 2, start)
    roll = reference * sin(alpha) - (1.0 - gear.profile_shift) * gear.module / sin(alpha)
    return max(hypot(base, max(roll, MIN_ROLL_MODULES * gear.module)), start)


def _worn_depth(worn: Worn, tooth: Ints, roll: Array, height: Array) -> Array:
    """Material missing in a worn area (mm, along the base tangent)."""
    on_tooth = 1.0 if worn.tooth is None else np.asarray(tooth == worn.tooth - 1, dtype=np.float64)
    return np.asarray(
        worn.depth * on_tooth * _plateau(roll, worn.rolls, worn.edge) * _plateau(height, worn.heights, worn.edge)
    )


def _dent_depth(dent: Dent, tooth: Ints, roll: Array, height: Array) -> Array:
    """Material missing in a dent (mm, along the base tangent)."""
    away = ((roll - dent.roll_length) ** 2 + (height - dent.height) ** 2) / dent.radius**2
    inside = (away < 1.0) & (tooth == dent.tooth - 1)
    return np.where(inside, dent.depth * (1.0 - np.minimum(away, 1.0)) ** 2, 0.0)


def _scratch_depth(scratch: Scratch, tooth: Ints, roll: Array, height: Array) -> Array:
    """Material missing in a scratch (mm, along the base tangent)."""
    (roll_0, height_0), (roll_1, height_1) = scratch.start, scratch.end
    along = roll_1 - roll_0, height_1 - height_0
    share = ((roll - roll_0) * along[0] + (height - height_0) * along[1]) / max(along[0] ** 2 + along[1] ** 2, 1e-12)
    share = np.clip(share, 0.0, 1.0)
    away = np.hypot(roll - roll_0 - share * along[0], height - height_0 - share * along[1]) / scratch.width
    inside = (away < 0.5) & (tooth == scratch.tooth - 1)
    return np.where(inside, scratch.depth * np.cos(np.pi * np.minimum(away, 0.5)) ** 2, 0.0)


def _plateau(at: Array, ends: tuple[float, float], edge: float) -> Array:
    """1 between the ends, falling smoothly to 0 at them over ``edge`` mm."""
    share = np.clip(np.minimum(at - ends[0], ends[1] - at) / edge, 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share))


class GearSurface:
    """Surface of a gear with its errors, in the frame of its bore: axis Z, heights as in C.

    Teeth have indices from 0 here; ``first`` (rad) is the centre of tooth 0 at mid-face.
    """

    def __init__(self, gear: Gear, errors: GearErrors) -> None:
        self.gear, self.errors, self.circles = gear, errors, circles_of(gear)
        self.first = errors.phase % gear.pitch
        self.middle = gear.face_from + gear.face_width / 2
        self.offsets = self._offsets()
        self.dents = [d for d in errors.dents if not self.is_missing(d.tooth - 1)]

    def _offsets(self) -> dict[int, Array]:
        """The constant part of delta (z,) of every flank: its position and the thickness of its tooth."""
        e, c = self.errors, self.circles
        rng = default_rng(e.seed)
        offsets = {}
        for side, listed in ((LEFT, e.pitch_left), (RIGHT, e.pitch_right)):
            position = rng.normal(0.0, e.pitch, self.gear.teeth) if e.pitch else np.zeros(self.gear.teeth)
            if listed:
                position = position + np.array(listed)
            offsets[side] = (side * position + e.thickness / 2) * c.base / c.reference
        return offsets

    def is_missing(self, tooth: int) -> bool:
        """Whether the tooth of this index is not there."""
        return tooth + 1 in self.errors.missing

    def delta(self, tooth: Ints, side: int, radius: Array, height: Array) -> Array:
        """Excess material over the unmodified involute helicoid, along the base tangent, mm."""
        roll = np.sqrt(np.maximum(radius**2 - self.circles.base**2, 0.0))
        excess = self.offsets[side][tooth] + self._profile(side, roll) + self._helix(side, height)
        if self.errors.feed_marks:
            excess = excess + self._feed_marks(roll, height)
        for dent in self.dents:
            if (dent.flank == "left") == (side == LEFT):
                excess = excess - _dent_depth(dent, tooth, roll, height)
        for worn in self.errors.worn:
            if (worn.flank == "left") == (side == LEFT):
                excess = excess - _worn_depth(worn, tooth, roll, height)
        for scratch in self.errors.scratches:
            if (scratch.flank == "left") == (side == LEFT):
                excess = excess - _scratch_depth(scratch, tooth, roll, height)
        return np.asarray(excess)

    def _profile(self, side: int, roll: Array) -> Array:
        e, m, c = self.errors, self.gear.modification, self.circles
        first, last = c.roll(c.form), c.roll(c.tip)
        along = np.clip((roll - first) / (last - first), 0.0, 1.0)
        form = (e.left if side == LEFT else e.right).profile_slope * (along - 0.5)
        form = form - (e.profile_crowning + m.profile_crowning) * (2 * along - 1) ** 2
        if e.profile_wave:
            form = form + e.profile_wave * np.sin(2 * np.pi * e.profile_waves * along)
        if m.tip_relief:
            begins = c.roll((m.tip_relief_from or 2 * c.reference) / 2)
            form = form - m.tip_relief * np.clip((roll - begins) / (last - begins), 0.0, 1.0)
        return np.asarray(form)

    def _helix(self, side: int, height: Array) -> Array:
        e, m = self.errors, self.gear.modification
        along = (height - self.middle) / self.gear.face_width
        rise = (e.left if side == LEFT else e.right).helix_slope + m.helix_slope
        return np.asarray(rise * along - (e.helix_crowning + m.helix_crowning) * (2 * along) ** 2)

    def _feed_marks(self, roll: Array, height: Array) -> Array:
        e = self.errors
        return np.asarray(e.feed_marks * np.cos(2 * np.pi * (height + e.feed_mark_slant * roll) / e.feed_mark_spacing))

    def flank_angle(self, tooth: Ints, side: int, radius: Array, height: Array) -> Array:
        """Polar angle (not wrapped) of a flank at radius and height."""
        c = self.circles
        alpha = np.arccos(np.minimum(c.base / radius, 1.0))
        centre = self.first + 2 * np.pi / self.gear.teeth * tooth
        half = c.half_tooth - np.tan(alpha) + alpha + self.delta(tooth, side, radius, height) / c.base
        return np.asarray(centre + side * half + (height - self.middle) * c.twist)

    def distance(self, x: Array, y: Array, height: Array, tooth: Ints, side: int) -> Array:
        """Distance of points from one flank's surface, along the base tangent, mm; negative: in the material."""
        c = self.circles
        radius = np.maximum(np.hypot(x, y), c.base)
        off = np.arctan2(y, x) - self.flank_angle(tooth, side, radius, height)
        return np.asarray(side * c.base * ((off + np.pi) % (2 * np.pi) - np.pi))

    def tip_radius(self, tooth: Ints, height: Array) -> Array:
        """Radius (mm) of a tooth's tip, reduced where it is chipped."""
        radius = np.full(np.broadcast(tooth, height).shape, self.circles.tip)
        for chip in self.errors.chips:
            chipped = (tooth == chip.tooth - 1) & (height > chip.bottom) & (height < chip.top)
            radius = np.where(chipped, self.circles.tip - chip.depth, radius)
        return radius
