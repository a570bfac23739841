"""What is true of the part that sat on the shaft, with the words of inspection.json.

A gear's figures come from its real surface where it stands in C, shift, seat and all: points on it are set against the
nominal surface (the drawing with its intended modifications) about C's axis. Dents, worn stretches and chips are told
apart and left out of everything else.
"""

from dataclasses import dataclass, replace
from math import degrees, pi, sin, sqrt, tan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.artefact import Artefact
from truestand.sim.gear_errors import GearErrors
from truestand.sim.gear_surface import LEFT, RIGHT, GearSurface
from truestand.sim.parts import VirtualGear, VirtualPart, VirtualTurned, shaft_from_cad, shaft_from_gear
from truestand.sim.simulation import Workpiece

Array = NDArray[np.float64]

UM = 1000.0
SOLVING = 6
"""Fixed-point steps that bring a point of the surface to a wanted radius and height: each gains three digits."""
PLACES = 81
"""Points along a profile or helix line."""
NAMES = ((LEFT, "left"), (RIGHT, "right"))


def part_record(part: VirtualPart, artefact: Artefact, workpiece: Workpiece) -> dict[str, Any]:
    """``part`` of truth.json."""
    if isinstance(part, VirtualGear):
        return _gear_record(part, artefact, workpiece)
    if isinstance(part, VirtualTurned):
        return _turned_record(part, workpiece)
    return {"kind": "cad", "name": part.cad.name, "shaft_from_model": shaft_from_cad(part, workpiece).tolist()}


@dataclass(frozen=True, slots=True)
class _Standing:
    """A gear where it stands in C: real and nominal surface, and by how many teeth the numbers have moved on."""

    real: GearSurface
    nominal: GearSurface
    shaft_from_gear: Array
    moved_on: int

    def number(self, tooth: int) -> int:
        """The number in C of a tooth that the recipe calls ``tooth``."""
        return (tooth - 1 + self.moved_on) % self.real.gear.teeth + 1

    def excess(self, side: int, radius: Array, height: Array) -> Array:
        """delta (z, n) mm of every tooth in C's order at radius and height (n,) in C; NaN where it is missing."""
        teeth = self.real.gear.teeth
        excess = np.full((teeth, radius.size), np.nan)
        for k in range(teeth):
            if not self.real.is_missing(k):
                tooth = np.full(radius.size, k)
                x, y, z = self._point(tooth, side, radius, height)
                at = self.number(k + 1) - 1
                excess[at] = self.nominal.outside(x, y, z, np.full(radius.size, at), side)
        return excess

    def _point(self, tooth: NDArray[np.intp], side: int, radius: Array, height: Array) -> Array:
        """The real surface's points (3, n) in C at radius and height in C."""
        own_radius, own_height = radius.copy(), height.copy()
        for _ in range(SOLVING):
            angle = self.real.flank_angle(tooth, side, own_radius, own_height)
            own = np.stack([own_radius * np.cos(angle), own_radius * np.sin(angle), own_height])
            point = self.shaft_from_gear[:3, :3] @ own + self.shaft_from_gear[:3, 3:]
            own_radius = own_radius + radius - np.hypot(point[0], point[1])
            own_height = own_height + height - point[2]
        return np.asarray(point)


def _standing(part: VirtualGear, artefact: Artefact, workpiece: Workpiece) -> _Standing:
    real = GearSurface(part.gear, replace(part.errors, dents=(), worn=(), chips=()))
    phase = real.first + workpiece.clamped
    nominal = GearSurface(part.gear, GearErrors(phase=phase))
    moved_on = round((phase - nominal.first) / part.gear.pitch)
    return _Standing(real, nominal, shaft_from_gear(part, artefact, workpiece), moved_on)


def _gear_record(part: VirtualGear, artefact: Artefact, workpiece: Workpiece) -> dict[str, Any]:
    gear, s = part.gear, _standing(part, artefact, workpiece)
    circles = s.nominal.circles
    measuring = gear.evaluation.measuring_diameter or 2 * circles.reference + 2 * gear.profile_shift * gear.module
    middle = np.array([s.nominal.middle])
    excess = {side: s.excess(side, np.array([measuring / 2]), middle)[:, 0] for side, _ in NAMES}
    position = {side: side * excess[side] * (measuring / 2 / circles.base) for side, _ in NAMES}
    record: dict[str, Any] = {
        "kind": "gear",
        "name": gear.name,
        "teeth": gear.teeth,
        "phase_deg": degrees(s.nominal.first),
        "shaft_from_part": s.shaft_from_gear.tolist(),
        "measuring_diameter_mm": measuring,
        "thickness_um": _um(np.nanmean(position[LEFT] - position[RIGHT])),
        **_runout(s.nominal, excess[LEFT], excess[RIGHT], measuring / 2),
    }
    for side, name in NAMES:
        record |= _pitch(position[side], name)
    record["profile"], record["helix"] = _profile(s), _helix(s, measuring / 2)
    return record | _defects(part, s)


def _um(value: float | np.floating[Any]) -> float | None:
    """um, null where nothing is known."""
    return UM * float(value) if np.isfinite(value) else None


def _pitch(position: Array, name: str) -> dict[str, Any]:
    """Positions of one flank's teeth, positive ccw, and what follows; single pitches only between teeth that are there.

    A pitch deviation grows with the tooth number, as on the drawing of a gear seen from above.
    """
    single = np.roll(position, -1) - position
    known = np.isfinite(position).any()
    return {
        f"position_{name}_um": [_um(p) for p in position],
        f"F_p_{name}_um": _um(np.nanmax(position) - np.nanmin(position)) if known else None,
        f"f_p_{name}_um": _um(np.nanmax(np.abs(single))) if np.isfinite(single).any() else None,
    }


def _runout(nominal: GearSurface, left: Array, right: Array, measuring: float) -> dict[str, Any]:
    """F_r by a ball in every space: both flanks push it outwards."""
    gear, c = nominal.gear, nominal.circles
    cos_base = 1.0 / sqrt(1.0 + (c.twist * c.base) ** 2)
    ball = gear.evaluation.ball_diameter
    if ball is None:  # the ball that touches at the measuring circle
        angle = pi / gear.teeth - c.half_tooth + c.roll(measuring) / c.base
        ball = 2 * (c.base * tan(angle) - c.roll(measuring)) * cos_base
    else:
        angle = _involute_angle(c.half_tooth - pi / gear.teeth + ball / (2 * c.base * cos_base))
    outwards = (left + np.roll(right, -1)) / (2 * sin(angle))
    seen = np.isfinite(outwards).any()
    return {
        "F_r_um": _um(np.nanmax(outwards) - np.nanmin(outwards)) if seen else None,
        "ball_diameter_mm": ball,
    }


def _involute_angle(inv: float) -> float:
    """The angle whose involute function is ``inv``."""
    angle = float(max(3 * inv, 1e-9) ** (1 / 3))
    for _ in range(20):
        angle -= (tan(angle) - angle - inv) / max(tan(angle) ** 2, 1e-12)
    return float(angle)


def _slope(at: Array, excess: Array) -> float | None:
    """Rise (um) over the whole range of the mean tooth's straight line."""
    lines = excess[np.isfinite(excess).all(axis=1)]
    return _um(float(np.polyfit(at, lines.mean(axis=0), 1)[0]) * float(np.ptp(at))) if lines.size else None


def _profile(s: _Standing) -> dict[str, Any]:
    """f_Halpha of the mean tooth at mid-face: rise of the excess over the stated roll lengths."""
    gear, c = s.nominal.gear, s.nominal.circles
    last = c.roll((gear.evaluation.tip_form_diameter or gear.tip_diameter) / 2)
    roll = np.linspace(c.roll(c.form), last, PLACES)
    height = np.full(PLACES, s.nominal.middle)
    rises = {f"f_Halpha_{n}_um": _slope(roll, s.excess(side, np.hypot(c.base, roll), height)) for side, n in NAMES}
    return {"from_mm": float(roll[0]), "to_mm": float(roll[-1]), **rises}


def _helix(s: _Standing, measuring: float) -> dict[str, Any]:
    """f_Hbeta of the mean tooth on the measuring circle: rise of the excess over the stated heights."""
    height = np.linspace(s.nominal.gear.face_from, s.nominal.gear.face_to, PLACES)
    rises = {f"f_Hbeta_{n}_um": _slope(height, s.excess(side, np.full(PLACES, measuring), height)) for side, n in NAMES}
    return {"from_mm": float(height[0]), "to_mm": float(height[-1]), **rises}


def _defects(part: VirtualGear, s: _Standing) -> dict[str, Any]:
    e = part.errors
    return {
        "dents": [
            {
                "tooth": s.number(d.tooth),
                "flank": d.flank,
                "roll_length_mm": d.roll_length,
                "height_mm": d.height,
                "radius_mm": d.radius,
                "depth_um": UM * d.depth,
            }
            for d in e.dents
        ],
        "worn": [
            {
                "tooth": None if w.tooth is None else s.number(w.tooth),
                "flank": w.flank,
                "from_roll_length_mm": w.rolls[0],
                "to_roll_length_mm": w.rolls[1],
                "from_mm": w.heights[0],
                "to_mm": w.heights[1],
                "depth_um": UM * w.depth,
            }
            for w in e.worn
        ],
        "chips": [
            {"tooth": s.number(c.tooth), "from_mm": c.bottom, "to_mm": c.top, "depth_mm": c.depth} for c in e.chips
        ],
        "missing": sorted(s.number(n) for n in e.missing),
    }


def _turned_record(part: VirtualTurned, workpiece: Workpiece) -> dict[str, Any]:
    """Sections as they are: diameter, peak to valley of their form, and the offset of their own axis at mid-length."""
    own = replace(part.workpiece, clamped=workpiece.clamped).turned()
    errors, around = dict(own.diameter_errors), np.linspace(0.0, 2 * pi, 3601)
    sections = []
    for section in part.turned.sections:
        waves = [f for f in own.form if f.surface == section.name]
        form = sum((f.amplitude * np.cos(f.upr * around - f.phase) for f in waves), np.zeros(around.size))
        off = next((m for m in own.misalignments if m.surface == section.name), None)
        sections.append(
            {
                "name": section.name,
                "diameter_mm": section.diameter + errors.get(section.name, 0.0),
                "roundness_um": UM * float(np.ptp(form)),
                "offset_x_um": UM * off.offset_x if off else 0.0,
                "offset_y_um": UM * off.offset_y if off else 0.0,
                "slope_x_mrad": 1e3 * off.slope_x if off else 0.0,
                "slope_y_mrad": 1e3 * off.slope_y if off else 0.0,
            }
        )
    harmonics = [
        {"surface": f.surface, "upr": f.upr, "amplitude_um": UM * f.amplitude, "phase_deg": degrees(f.phase)}
        for f in own.form
    ]
    return {"kind": "turned", "name": part.turned.name, "sections": sections, "harmonics": harmonics}
