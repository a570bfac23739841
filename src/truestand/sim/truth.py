"""What is true of a virtual scan, with the keys of calibration.json; of the part, with the words of inspection.json.

The figures of a gear come from its real surface where it stands in C, eccentricity and seat included: points on it are
compared with the nominal surface (the drawing with its intended modifications) about the axis of C. Dents, worn areas
and chips are listed by themselves and left out of everything else.
"""

from dataclasses import dataclass, replace
from math import atan2, degrees, hypot, pi, sin, sqrt, tan
from typing import Any

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.artefact import Artefact
from truestand.core.stand import Stand
from truestand.sim.gear_errors import GearErrors
from truestand.sim.gear_surface import LEFT, RIGHT, GearSurface
from truestand.sim.parts import VirtualGear, VirtualPart, VirtualTurned, shaft_from_cad, shaft_from_gear
from truestand.sim.simulation import FormWave, Simulation, Workpiece

UM = 1000.0
"""Per mm."""
FIXED_POINT_STEPS = 6
"""They bring a point of the surface to a wanted radius and height: each gains three digits."""
BALL_STEP = 0.05
"""mm: balls have diameters in such steps."""
LINE_POINTS = 81
"""Along a profile or helix line."""
FLANKS = ((LEFT, "left"), (RIGHT, "right"))


@dataclass(frozen=True, slots=True)
class Truth:
    """True poses and the values that they come from."""

    stand: Stand
    simulation: Simulation
    table_from_sensor: Array
    """(4, 4)."""
    shaft_from_rotor: Array
    """(4, 4)."""
    rad_per_profile: float
    angle: Array
    """(N,) rad: the true table angle of every profile that is in the scan."""
    artefact: Artefact
    part: VirtualPart | None = None
    """On the shaft."""


def truth_record(truth: Truth) -> dict[str, Any]:
    """truth.json; ``part`` is there where a part sat on the shaft."""
    record = _stand_record(truth)
    if truth.part is not None:
        record["part"] = _part_record(truth.part, truth.artefact, truth.simulation.workpiece)
    return record


def _stand_record(truth: Truth) -> dict[str, Any]:
    """The true values of what calibration.json holds."""
    s, stand = truth.simulation, truth.stand
    back = np.linalg.inv(truth.shaft_from_rotor)
    ex, ey = back[0, 3], back[1, 3]
    lean = back[:3, 2]
    return {
        "format": "truestand.truth",
        "version": 1,
        "table": {
            "direction": stand.table.direction,
            "angle_source": next((c for c in ("encoder", "angle", "time") if c in s.acquisition.columns), "index"),
            "rad_per_profile": truth.rad_per_profile,
        },
        "sensor": {
            "name": stand.sensor.name,
            "table_from_sensor": truth.table_from_sensor.tolist(),
            "phi_deg": degrees(s.mounting.phi),
            "laser_plane_tilt_deg": degrees(s.mounting.plane_tilt),
            "laser_plane_offset_mm": s.mounting.plane_offset,
        },
        "shaft": {
            "shaft_from_rotor": truth.shaft_from_rotor.tolist(),
            "eccentricity_um": 1e3 * hypot(ex, ey),
            "eccentricity_direction_deg": degrees(atan2(ey, ex)),
            "tilt_mrad": 1e3 * float(np.arctan2(hypot(lean[0], lean[1]), lean[2])),
            "tilt_direction_deg": degrees(atan2(lean[1], lean[0])),
        },
        "harmonics": _harmonics(s.workpiece.in_shaft_frame().form),
    }


def _harmonics(form: tuple[FormWave, ...]) -> list[dict[str, Any]]:
    return [
        {"surface": f.surface, "upr": f.upr, "amplitude_um": UM * f.amplitude, "phase_deg": degrees(f.phase)}
        for f in form
    ]


def _part_record(part: VirtualPart, artefact: Artefact, workpiece: Workpiece) -> dict[str, Any]:
    """``part`` of truth.json."""
    if isinstance(part, VirtualGear):
        return _gear_record(part, artefact, workpiece)
    if isinstance(part, VirtualTurned):
        return _turned_record(part, workpiece)
    return {"kind": "cad", "name": part.cad.name, "shaft_from_model": shaft_from_cad(part, workpiece).tolist()}


@dataclass(frozen=True, slots=True)
class StandingGear:
    """A gear where it stands in C: real and nominal surface, and by how many teeth the numbers are shifted."""

    real: GearSurface
    nominal: GearSurface
    shaft_from_gear: Array
    number_shift: int

    def number(self, tooth: int) -> int:
        """The number in C of a tooth that the recipe calls ``tooth``."""
        return (tooth - 1 + self.number_shift) % self.real.gear.teeth + 1

    def excess(self, side: int, radius: Array, height: Array) -> Array:
        """delta (z, n) mm of every tooth in C's order at radius and height (n,) in C; NaN where it is missing."""
        teeth = self.real.gear.teeth
        excess = np.full((teeth, radius.size), np.nan)
        for k in range(teeth):
            if not self.real.is_missing(k):
                tooth = np.full(radius.size, k)
                x, y, z = self._point(tooth, side, radius, height)
                at = self.number(k + 1) - 1
                excess[at] = self.nominal.distance(x, y, z, np.full(radius.size, at), side)
        return excess

    def _point(self, tooth: Ints, side: int, radius: Array, height: Array) -> Array:
        """The real surface's points (3, n) in C at radius and height in C."""
        gear_radius, gear_height = radius, height
        for _ in range(FIXED_POINT_STEPS):
            angle = self.real.flank_angle(tooth, side, gear_radius, gear_height)
            in_gear = np.stack([gear_radius * np.cos(angle), gear_radius * np.sin(angle), gear_height])
            point = self.shaft_from_gear[:3, :3] @ in_gear + self.shaft_from_gear[:3, 3:]
            gear_radius = gear_radius + radius - np.hypot(point[0], point[1])
            gear_height = gear_height + height - point[2]
        return np.asarray(point)


def standing_gear(part: VirtualGear, artefact: Artefact, workpiece: Workpiece) -> StandingGear:
    """The gear where it stood in C before it was clamped again, without its dents, worn areas and chips."""
    part = replace(part, turned=0.0, turned_over=False)
    real = GearSurface(part.gear, replace(part.errors, dents=(), worn=(), chips=()))
    phase = real.first + workpiece.clamped
    nominal = GearSurface(part.gear, GearErrors(phase=phase))
    number_shift = round((phase - nominal.first) / part.gear.pitch)
    return StandingGear(real, nominal, shaft_from_gear(part, artefact, workpiece), number_shift)


def _gear_record(part: VirtualGear, artefact: Artefact, workpiece: Workpiece) -> dict[str, Any]:
    gear, s = part.gear, standing_gear(part, artefact, workpiece)
    circles = s.nominal.circles
    measuring = gear.evaluation.measuring_diameter or 2 * circles.reference + 2 * gear.profile_shift * gear.module
    middle = np.array([s.nominal.middle])
    excess = {side: s.excess(side, np.array([measuring / 2]), middle)[:, 0] for side, _ in FLANKS}
    position = {side: side * excess[side] * (measuring / 2 / circles.base) for side, _ in FLANKS}
    record: dict[str, Any] = {
        "kind": "gear",
        "name": gear.name,
        "teeth": gear.teeth,
        "phase_deg": degrees(s.nominal.first),
        "shaft_from_part": shaft_from_gear(part, artefact, workpiece).tolist(),
        "measuring_diameter_mm": measuring,
        "thickness_um": _um(np.nanmean(position[LEFT] - position[RIGHT])),
        **_runout(s, measuring / 2),
    }
    for side, name in FLANKS:
        record |= _pitch(position[side], name)
    record["profile"], record["helix"] = _profile(s), _helix(s, measuring / 2)
    return record | _defects(part, s)


def _um(value: float | np.floating[Any]) -> float | None:
    """um; null where it is not known."""
    return UM * float(value) if np.isfinite(value) else None


def _pitch(position: Array, name: str) -> dict[str, Any]:
    """Positions of one flank's teeth, positive ccw, and pitches; single pitches only between teeth that are there.

    A pitch deviation grows with the tooth number, as on the drawing of a gear seen from above.
    """
    single = np.roll(position, -1) - position
    known = np.isfinite(position).any()
    return {
        f"position_{name}_um": [_um(p) for p in position],
        f"F_p_{name}_um": _um(np.nanmax(position) - np.nanmin(position)) if known else None,
        f"f_p_{name}_um": _um(np.nanmax(np.abs(single))) if np.isfinite(single).any() else None,
    }


def _runout(s: StandingGear, measuring: float) -> dict[str, Any]:
    """F_r by a ball in every space: excess of both flanks, where it touches them, moves it outwards."""
    gear, c = s.nominal.gear, s.nominal.circles
    cos_base = 1.0 / sqrt(1.0 + (c.twist * c.base) ** 2)

    def touching(ball: float) -> tuple[float, float]:
        """Transverse pressure angle at the ball's centre, and the roll length at which it touches."""
        angle = _involute_angle(c.half_tooth - pi / gear.teeth + ball / (2 * c.base * cos_base))
        return angle, c.base * tan(angle) - ball / 2 * cos_base

    ball = gear.evaluation.ball_diameter
    if ball is None:  # the one that touches nearest to the measuring circle
        sizes = BALL_STEP * np.arange(1, int(4 * gear.module / BALL_STEP))
        ball = float(min(sizes, key=lambda size: abs(touching(size)[1] - c.roll(measuring))))
    angle, roll = touching(ball)
    touched, middle = np.array([np.hypot(c.base, roll)]), np.array([s.nominal.middle])
    left, right = (s.excess(side, touched, middle)[:, 0] for side in (LEFT, RIGHT))
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


def _profile(s: StandingGear) -> dict[str, Any]:
    """f_Halpha of the mean tooth at mid-face: rise of the excess over the stated roll lengths."""
    gear, c = s.nominal.gear, s.nominal.circles
    last = c.roll((gear.evaluation.tip_form_diameter or gear.tip_diameter) / 2)
    roll = np.linspace(c.roll(c.form), last, LINE_POINTS)
    return _rises(s, "f_Halpha", roll, np.hypot(c.base, roll), np.full(LINE_POINTS, s.nominal.middle))


def _helix(s: StandingGear, measuring: float) -> dict[str, Any]:
    """f_Hbeta of the mean tooth on the measuring circle: rise of the excess over the stated heights."""
    height = np.linspace(s.nominal.gear.face_from, s.nominal.gear.face_to, LINE_POINTS)
    return _rises(s, "f_Hbeta", height, np.full(LINE_POINTS, measuring), height)


def _rises(s: StandingGear, name: str, at: Array, radius: Array, height: Array) -> dict[str, Any]:
    rises = {f"{name}_{flank}_um": _slope(at, s.excess(side, radius, height)) for side, flank in FLANKS}
    return {"from_mm": float(at[0]), "to_mm": float(at[-1]), **rises}


def _defects(part: VirtualGear, s: StandingGear) -> dict[str, Any]:
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
        "scratches": [
            {
                "tooth": s.number(scratch.tooth),
                "flank": scratch.flank,
                "from_roll_length_mm": scratch.start[0],
                "from_mm": scratch.start[1],
                "to_roll_length_mm": scratch.end[0],
                "to_mm": scratch.end[1],
                "width_mm": scratch.width,
                "depth_um": UM * scratch.depth,
            }
            for scratch in e.scratches
        ],
        "chips": [
            {"tooth": s.number(c.tooth), "from_mm": c.bottom, "to_mm": c.top, "depth_mm": c.depth} for c in e.chips
        ],
        "missing": sorted(s.number(n) for n in e.missing),
    }


def _turned_record(part: VirtualTurned, workpiece: Workpiece) -> dict[str, Any]:
    """Sections as they are: diameter, peak to valley of their form, and the offset of their own axis at mid-length."""
    real = replace(part.workpiece, clamped=workpiece.clamped).in_shaft_frame()
    errors, around = dict(real.diameter_errors), np.linspace(0.0, 2 * pi, 3601)
    sections = []
    for section in part.turned.sections:
        waves = [f for f in real.form if f.surface == section.name]
        form = sum((f.amplitude * np.cos(f.upr * around - f.phase) for f in waves), np.zeros(around.size))
        off = real.misalignment_of(section.name)
        sections.append(
            {
                "name": section.name,
                "diameter_mm": section.diameter + errors.get(section.name, 0.0),
                "roundness_um": UM * float(np.ptp(form)),
                "offset_x_um": UM * off.offset_x,
                "offset_y_um": UM * off.offset_y,
                "slope_x_mrad": 1e3 * off.slope_x,
                "slope_y_mrad": 1e3 * off.slope_y,
            }
        )
    return {"kind": "turned", "name": part.turned.name, "sections": sections, "harmonics": _harmonics(real.form)}
