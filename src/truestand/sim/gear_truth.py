"""What the standard's traces read of a virtual gear's real surface, damage included: the truth of its figures.

Worked out here apart from ``gear``, to check each other: profile at the middle of the face +- b / 20, helix on the
measuring circle, position where both meet; slopes by least squares, form and total after a Gaussian low-pass that
halves waves of a thirtieth of the evaluation length or of the face, 0.25 mm at least.
"""

from dataclasses import replace
from math import log, pi, sqrt

import numpy as np
from scipy.ndimage import gaussian_filter1d

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.sim.gear_surface import GearSurface
from truestand.sim.parts import VirtualGear
from truestand.sim.simulation import Workpiece
from truestand.sim.truth import FLANKS, standing_gear

Key = tuple[str, str, int | None]
"""Name, flank, and number of the tooth in C; None: the whole gear."""

STEP = 0.01
"""mm from point to point of a trace."""
SECTIONS = 21
"""Of the band at the middle of the face."""
TIP_SHARE, END_SHARE = 0.05, 0.05
"""Shares of profile (at the tip) and face (at either end, a module at most) that the evaluation leaves out."""
LEAST_CUTOFF, CUTOFF_SHARE = 0.25, 1 / 30
"""mm of wavelength, and share of the length, at which the low-pass lets half through."""


def gear_figures(part: VirtualGear, artefact: Artefact, workpiece: Workpiece) -> dict[Key, float]:
    """f_p and F_p, slope, form and total deviation of every flank, mm, of a gear that has all its teeth."""
    gear = part.gear
    standing = replace(standing_gear(part, artefact, workpiece), real=GearSurface(gear, part.errors))
    circles, middle = standing.nominal.circles, standing.nominal.middle
    measuring = (gear.evaluation.measuring_diameter or 2 * (circles.reference + gear.profile_shift * gear.module)) / 2
    start, tip = circles.roll(circles.form), circles.roll(circles.tip)
    rolls = np.arange(start, tip - TIP_SHARE * (tip - start), STEP)
    end = min(END_SHARE * gear.face_width, gear.module)
    heights = np.arange(gear.face_from + end, gear.face_to - end, STEP)
    band = middle + np.linspace(-1.0, 1.0, SECTIONS) * gear.face_width / 20
    found: dict[Key, float] = {}
    for side, flank in FLANKS:
        position = (
            side * standing.excess(side, np.full(SECTIONS, measuring), band).mean(axis=1) * measuring / circles.base
        )
        found["F_p", flank, None] = float(np.ptp(position))
        found["f_p", flank, None] = float(np.abs(position - np.roll(position, 1)).max())
        radius = np.hypot(circles.base, rolls)
        profiles = np.mean([standing.excess(side, radius, np.full(rolls.size, h)) for h in band], axis=0)
        helices = standing.excess(side, np.full(heights.size, measuring), heights)
        for tooth, (profile, helix) in enumerate(zip(profiles, helices, strict=True), 1):
            found |= _line("alpha", flank, tooth, rolls, profile, tip - start, float(np.ptp(rolls)))
            found |= _line("beta", flank, tooth, heights, helix, gear.face_width, gear.face_width)
    return found


def _line(
    name: str, flank: str, tooth: int, at: Array, trace: Array, slope_length: float, length: float
) -> dict[Key, float]:
    """Slope over ``slope_length``, form and total of one trace; ``length`` whose share the low-pass takes."""
    slope, _ = line = np.polyfit(at, trace, 1)
    cutoff = max(CUTOFF_SHARE * length, LEAST_CUTOFF)
    sigma = sqrt(log(2.0) / 2.0) / pi * cutoff  # exp(-2 (pi sigma / cutoff)^2) = 1/2
    form = gaussian_filter1d(trace - np.polyval(line, at), sigma / STEP, mode="nearest")
    return {
        (f"f_H{name}", flank, tooth): float(slope) * slope_length,
        (f"f_f{name}", flank, tooth): float(np.ptp(form)),
        (f"F_{name}", flank, tooth): float(np.ptp(form + np.polyval(line, at))),
    }
