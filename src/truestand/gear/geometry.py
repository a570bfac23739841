"""The nominal involute helicoid: everything that follows from a drawing's numbers in closed form.

External gears, transverse section. Left flank = the flank of a tooth at the larger polar angle, sigma = +1; right: -1.

    theta = 2 pi k / z + sigma (psi_b - inv alpha_y) + height dtheta/dz,    cos alpha_y = rb / r,    L = rb tan alpha_y

(ISO 21771; DIN 3960). delta is a deviation along the base tangent in the transverse section, positive outwards.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import acos, ceil, cos, pi, sin, sqrt, tan

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.inspection import Flank
from truestand.gear.drawing import Gear
from truestand.gear.undercut import undercut_roll

SIGMA = np.array([1.0, -1.0])
"""Of the left and the right flank, in the order of every array with flanks."""
FLANKS: tuple[Flank, Flank] = ("left", "right")
TIP_SHARE = 0.05
"""Share of the control length at the tip that the profile's evaluation leaves out (ISO 1328-1:2013)."""
FACE_SHARE = 0.05
"""Share of the face at either end that the helix' evaluation leaves out, at most one module (ISO 1328-1)."""
LEAST_ROLL = 0.1
"""Share of the base radius at which a control length starts at least, unless the drawing says otherwise: nearer to the
base circle 5 um of the flank move where a ray meets it by half a millimetre and more."""
DEEPEST_RACK = 1.4
"""Modules that the tip of a standard rack reaches below its reference line at most (ISO 53, profile D)."""
ROUND_BALL = 0.05
"""mm to which the ball's diameter is rounded."""


def inv(angle: float) -> float:
    """Involute function, tan a - a."""
    return tan(angle) - angle


@lru_cache(maxsize=64)
def angle_from_inv(value: float) -> float:
    """The angle (rad) whose involute function is ``value`` >= 0."""
    return _root(lambda a: inv(a) - value, 0.0, 1.5)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(function, low, high, xtol=1e-15))


@dataclass(frozen=True)
class Involute:
    """What the drawing means. mm and rad."""

    gear: Gear
    base_radius: float
    transverse_pressure: float
    base_helix: float
    twist: float
    """dtheta/dz, rad/mm: positive for right hand."""
    base_half_angle: float
    """psi_b: half the angle of a tooth on the base circle."""
    measuring_radius: float
    control_roll: float
    """Roll length at which the profile's control length starts,"""
    tip_roll: float
    """and ends."""

    @property
    def middle(self) -> float:
        """Height (C) of the middle of the face: where tooth positions are taken."""
        return self.gear.face_from + self.gear.face_width / 2

    @property
    def control_length(self) -> float:
        """Of the profile, along the roll length."""
        return self.tip_roll - self.control_roll

    @property
    def profile_range(self) -> tuple[float, float]:
        """Roll lengths between which the profile is evaluated."""
        return self.control_roll, self.tip_roll - TIP_SHARE * self.control_length

    @property
    def helix_range(self) -> tuple[float, float]:
        """Heights (C) between which the helix is evaluated."""
        g = self.gear
        end = min(FACE_SHARE * g.face_width, g.module)
        return g.face_from + end, g.face_to - end

    @property
    def full_slopes(self) -> bool:
        """Whether slope deviations count over the whole control length and face (2013), not the evaluation ranges."""
        ends = self.gear.evaluation.slope_ends
        return ends == "full" if ends is not None else self.gear.standard.endswith("2013")

    @property
    def measuring_roll(self) -> float:
        """Roll length on the measuring circle."""
        return sqrt(self.measuring_radius**2 - self.base_radius**2)

    @property
    def arc_per_delta(self) -> float:
        """By how much a point of the measuring circle moves along it when its flank moves by delta."""
        return self.measuring_radius / self.base_radius

    @property
    def normal_per_delta(self) -> float:
        """Deviation along the surface normal for a delta of 1."""
        return cos(self.base_helix)

    @property
    def thickness(self) -> float:
        """Nominal transverse tooth thickness, an arc on the measuring circle."""
        alpha = acos(self.base_radius / self.measuring_radius)
        return 2 * self.measuring_radius * (self.base_half_angle - inv(alpha))

    @property
    def span_teeth(self) -> int:
        """Over how many teeth the span goes: so many that the gauge touches near the measuring circle."""
        if self.gear.evaluation.span_teeth is not None:
            return self.gear.evaluation.span_teeth
        alpha = acos(min(self.base_radius / self.measuring_radius, 1.0))
        touching = self.gear.teeth * (tan(alpha) / cos(self.base_helix) ** 2 - self._shift_angle()) / pi + 0.5
        return max(1, round(touching))

    def _shift_angle(self) -> float:
        g = self.gear
        return inv(self.transverse_pressure) + 2 * g.profile_shift * tan(g.pressure_angle) / g.teeth

    @property
    def span(self) -> float:
        """Nominal base tangent length W_k."""
        g = self.gear
        arc = (self.span_teeth - 0.5) * pi + g.teeth * self._shift_angle()
        return g.module * cos(g.pressure_angle) * arc

    @cached_property
    def ball_diameter(self) -> float:
        """Of the ball that touches both flanks of a space near the measuring circle; as the drawing has it, if so."""
        if self.gear.evaluation.ball_diameter is not None:
            return self.gear.evaluation.ball_diameter
        rb, length = self.base_radius, self.measuring_roll

        def gap(d: float) -> float:
            """How far from the measuring circle a ball of diameter d touches, as a roll length."""
            return rb * tan(self.ball_angle(d)) - d / 2 * cos(self.base_helix) - length

        low, high = 0.2 * self.gear.module, 4.0 * self.gear.module
        found = _root(gap, low, high) if gap(low) * gap(high) < 0 else 1.7 * self.gear.module
        return max(round(found / ROUND_BALL) * ROUND_BALL, ROUND_BALL)

    def ball_angle(self, diameter: float) -> float:
        """Transverse pressure angle (rad) at the centre of a ball that touches both flanks of a space."""
        half_space = pi / self.gear.teeth - self.base_half_angle
        value = diameter / (2 * self.base_radius * cos(self.base_helix)) - half_space
        return angle_from_inv(max(value, 0.0))

    def over_balls(self, diameter: float) -> float:
        """Nominal dimension M_d over two balls."""
        centre = self.base_radius / cos(self.ball_angle(diameter))
        across = 2 * centre * (1.0 if self.gear.teeth % 2 == 0 else cos(pi / (2 * self.gear.teeth)))
        return across + diameter

    @property
    def ball_roll(self) -> float:
        """Roll length (mm) at which the ball touches the flanks."""
        alpha = self.ball_angle(self.ball_diameter)
        return self.base_radius * tan(alpha) - self.ball_diameter / 2 * cos(self.base_helix)

    @property
    def runout_per_delta(self) -> float:
        """By how much the ball moves outward when one flank of its space grows by 1."""
        return 1 / (2 * sin(self.ball_angle(self.ball_diameter)))

    def radius(self, roll: Array) -> Array:
        """Radius (mm) at a roll length."""
        return np.asarray(np.hypot(self.base_radius, roll))

    def half_angle(self, radius: Array) -> Array:
        """Half the angle (rad) of a nominal tooth at a radius of at least the base circle's."""
        cosine = np.minimum(self.base_radius / radius, 1.0)
        alpha = np.arccos(cosine)
        return np.asarray(self.base_half_angle - (np.sqrt(1.0 - cosine * cosine) / cosine - alpha))

    def flank_angle(self, tooth: Ints, flank: Ints, roll: Array, height: Array, turned: float) -> Array:
        """Polar angle (rad, C) of the nominal flank; ``tooth`` from 0, ``flank`` 0 left and 1 right, ``turned``: angle
        of the first tooth's centre at the middle of the face."""
        side = SIGMA[flank]
        centre = turned + tooth * self.gear.pitch + (height - self.middle) * self.twist
        return np.asarray(centre + side * self.half_angle(self.radius(roll)))

    def modification(self, roll: Array, height: Array) -> Array:
        """delta (mm) of the design flank against the involute helicoid: reliefs and crownings take material away, a
        helix slope rises with the height, as f_Hbeta does.
        """
        m, g = self.gear.modification, self.gear
        design = np.zeros(np.broadcast(roll, height).shape)
        if m.tip_relief:
            start = self.roll_at(m.tip_relief_from or 0.0)
            design = design - m.tip_relief * np.clip((roll - start) / (self.tip_roll - start), 0.0, None)
        if m.profile_crowning:
            middle = (self.control_roll + self.tip_roll) / 2
            design = design - m.profile_crowning * ((roll - middle) / (self.control_length / 2)) ** 2
        along = (height - self.middle) / (g.face_width / 2)
        return np.asarray(design - m.helix_crowning * along**2 + m.helix_slope * along / 2)

    def roll_at(self, diameter: float) -> float:
        """Roll length at a diameter; 0 inside the base circle."""
        return sqrt(max((diameter / 2) ** 2 - self.base_radius**2, 0.0))


def involute(gear: Gear) -> Involute:
    """What follows from the drawing."""
    g, e = gear, gear.evaluation
    reference = g.teeth * g.module / (2 * cos(g.helix_angle))
    transverse = np.arctan(tan(g.pressure_angle) / cos(g.helix_angle))
    base = reference * cos(transverse)
    thickness = g.module / cos(g.helix_angle) * (pi / 2 + 2 * g.profile_shift * tan(g.pressure_angle))
    measuring = reference + g.profile_shift * g.module if e.measuring_diameter is None else e.measuring_diameter / 2
    tip = (g.tip_diameter if e.tip_form_diameter is None else e.tip_form_diameter) / 2
    return Involute(
        gear=g,
        base_radius=float(base),
        transverse_pressure=float(transverse),
        base_helix=float(np.arctan(tan(abs(g.helix_angle)) * cos(transverse))),
        twist=tan(g.helix_angle) / reference,
        base_half_angle=thickness / (2 * reference) + inv(float(transverse)),
        measuring_radius=max(measuring, float(base) * 1.002),
        control_roll=_control_roll(g, float(base), float(transverse), reference),
        tip_roll=sqrt(max(tip**2 - base**2, 0.0)),
    )


def _control_roll(g: Gear, base: float, transverse: float, reference: float) -> float:
    """Where a profile's control length starts: as drawn, or where a rack of one module's addendum leaves the flank, or
    undercuts it.
    """
    e = g.evaluation
    if e.control_diameter is not None:
        return sqrt(max((e.control_diameter / 2) ** 2 - base**2, 0.0))
    generated = reference * sin(transverse) - g.module * (1.0 - g.profile_shift) / sin(transverse)
    if generated < 0:
        deep = min(reference - g.root_diameter / 2, (DEEPEST_RACK - g.profile_shift) * g.module)
        generated = undercut_roll(reference, transverse, deep, g.module)
    rooted = sqrt(max((g.root_diameter / 2 + 0.1 * g.module) ** 2 - base**2, 0.0))
    return max(generated, rooted, LEAST_ROLL * base)


def pitch_span(gear: Gear) -> int:
    """k of F_pk: how many pitches it spans, an eighth of the teeth by default (ISO 1328-1)."""
    return gear.evaluation.pitch_span or max(2, ceil(gear.teeth / 8))
