"""How far up a flank the rack that makes it undercuts it.

Few teeth: the tip of the generating rack, moving on beyond the foot of the base tangent, takes away the lower end of
the involute (Litvin and Fuentes, Gear Geometry and Applied Theory). Transverse section. The rack has the sharpest tip
of the standard ones (ISO 53, profile C): nobody says which one made a gear, and a rounder one undercuts less.
"""

from math import cos, pi, sin, tan

import numpy as np

from truestand.core.arrays import Array

TIP_ROUNDING = 0.25
"""Modules: radius of the rack's tip."""
LEAST_CUT = 1e-4
"""mm of the flank that must be gone to be undercut."""
POSITIONS, POINTS = 2000, 60
"""Of the rack as it rolls, and on the rounding of its tip."""


def undercut_roll(reference: float, pressure_angle: float, depth: float, module: float) -> float:
    """Roll length (mm) up to which a flank is undercut; 0: nowhere.

    ``reference``: radius (mm) of the reference circle, on which the rack rolls; its tip reaches ``depth`` mm below.
    """
    if depth <= 0.0:
        return 0.0
    base = reference * cos(pressure_angle)
    rounding = min(TIP_ROUNDING * module, depth / (1.0 - sin(pressure_angle)))
    along, below = _tip_of_rack(pressure_angle, depth, rounding)
    reach = 2.0 * depth / sin(2.0 * pressure_angle)  # where the line of action has a point so deep
    moved = np.linspace(-2.0 * reach, 2.0 * reach, POSITIONS)[:, None]
    across, up = along + moved, reference - below
    radius, angle = np.hypot(across, up), np.arctan2(across, up) - moved / reference
    roll = np.sqrt(np.maximum(radius**2 - base**2, 0.0))
    flank = roll / base - np.arctan2(roll, base) - (tan(pressure_angle) - pressure_angle)
    return float(roll[base * (angle - flank) > LEAST_CUT].max(initial=0.0))


def _tip_of_rack(pressure_angle: float, depth: float, rounding: float) -> tuple[Array, Array]:
    """Points (n,) mm of the rounding of a rack's tip: along the reference line, from its flank there towards the tooth
    that it makes, and below.
    """
    turned = np.linspace(0.0, pi / 2 - pressure_angle, POINTS)
    centre = -(depth - rounding) * tan(pressure_angle) - rounding / cos(pressure_angle)
    return centre + rounding * np.sin(turned), depth - rounding + rounding * np.cos(turned)
