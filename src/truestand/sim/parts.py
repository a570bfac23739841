"""What can sit on the virtual stand's shaft: a gear, a turned part or one with a CAD model, each as it really is."""

from dataclasses import dataclass, field
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from truestand.core.artefact import Artefact, Cylinder
from truestand.core.errors import BadRecipe
from truestand.gear.drawing import Gear
from truestand.parts.drawings import Cad, Turned
from truestand.sim.gear_errors import GearErrors
from truestand.sim.gear_mesh import gear_mesh
from truestand.sim.gear_surface import GearSurface
from truestand.sim.raycast_mesh import Body, body, gear_body
from truestand.sim.shaft_surface import Face, Step, faces_of, steps_of
from truestand.sim.simulation import Misalignment, Workpiece

Array = NDArray[np.float64]

NO_SEAT = 0.6
"""Bore over root diameter of a gear at whose height the shaft has no cylinder."""


@dataclass(frozen=True, slots=True)
class VirtualGear:
    """A gear and what is wrong with it."""

    gear: Gear
    errors: GearErrors = field(default_factory=GearErrors)


@dataclass(frozen=True, slots=True)
class VirtualTurned:
    """A turned part; ``workpiece`` names its sections where the shaft's one names cylinders."""

    turned: Turned
    workpiece: Workpiece = field(default_factory=Workpiece)


@dataclass(frozen=True, slots=True)
class VirtualCad:
    """A part that is exactly its model, put on the shaft turned and lifted against the drawing's pose."""

    cad: Cad
    turned: float = 0.0
    """rad, ccw from above."""
    lifted: float = 0.0
    """mm."""


VirtualPart = VirtualGear | VirtualTurned | VirtualCad


@dataclass(frozen=True, slots=True)
class Scene:
    """All that rays can meet."""

    steps: tuple[Step, ...]
    faces: tuple[Face, ...]
    body: Body | None = None


def scene_of(artefact: Artefact, workpiece: Workpiece, part: VirtualPart | None = None) -> Scene:
    """The shaft with a part on it, in C.

    Raises:
        BadRecipe: a part that can't be.
    """
    steps, faces = steps_of(artefact, workpiece), faces_of(artefact, workpiece)
    if isinstance(part, VirtualGear):
        check_gear(part)
        real = GearSurface(part.gear, part.errors)
        mesh = gear_mesh(real, _bore(part.gear, artefact, real.circles.root))
        return Scene(steps, faces, gear_body(real, mesh, shaft_from_gear(part, artefact, workpiece)))
    if isinstance(part, VirtualTurned):
        more_steps, more_faces = _turned(part, workpiece.clamped)
        return Scene(steps + more_steps, faces + more_faces)
    if isinstance(part, VirtualCad):
        mesh_of = part.cad.mesh
        return Scene(steps, faces, body(mesh_of.vertices, mesh_of.faces, shaft_from_cad(part, workpiece)))
    return Scene(steps, faces)


def check_gear(part: VirtualGear) -> None:
    """Refuse errors of teeth that the gear hasn't got.

    Raises:
        BadRecipe: with the number.
    """
    teeth, e = part.gear.teeth, part.errors
    for name, listed in (("pitch_left_um", e.pitch_left), ("pitch_right_um", e.pitch_right)):
        if listed and len(listed) != teeth:
            raise BadRecipe(f"[simulation] {name}: found {len(listed)} values, need {teeth}, one a tooth")
    worn = (w.tooth for w in e.worn if w.tooth is not None)
    for number in (*e.missing, *worn, *(d.tooth for d in e.dents), *(c.tooth for c in e.chips)):
        if not 1 <= number <= teeth:
            raise BadRecipe(f"[simulation] found tooth {number}, need one of 1..{teeth}")


def shaft_from_gear(part: VirtualGear, artefact: Artefact, workpiece: Workpiece) -> Array:
    """Where the toothing's own frame stands in C (4, 4): off the bore's axis, on its seat, turned with the shaft."""
    gear, errors = part.gear, part.errors
    middle = gear.face_from + gear.face_width / 2
    shifted = np.eye(4)
    shifted[:2, 3] = (
        errors.eccentricity * cos(errors.eccentricity_direction),
        errors.eccentricity * sin(errors.eccentricity_direction),
    )
    names = [c.name for c in artefact.cylinders if c.bottom <= middle <= c.top]
    off = next((m for m in workpiece.misalignments if m.surface in names), None)
    return _turn(workpiece.clamped) @ _seated(off, artefact) @ shifted


def shaft_from_cad(part: VirtualCad, workpiece: Workpiece) -> Array:
    """Where a CAD model's frame stands in C (4, 4)."""
    lift = np.eye(4)
    lift[2, 3] = part.lifted
    return _turn(workpiece.clamped + part.turned) @ lift @ part.cad.pose


def _seated(off: Misalignment | None, artefact: Artefact) -> Array:
    """The axis of the cylinder that carries the part, as a rigid motion (4, 4); the seat's heights stay."""
    pose = np.eye(4)
    if off is None:
        return pose
    seat = next(c for c in artefact.cylinders if c.name == off.surface)
    up = np.array([off.slope_x, off.slope_y, 1.0])
    up = up / np.linalg.norm(up)
    side = np.cross(up, [1.0, 0.0, 0.0])
    side = side / np.linalg.norm(side)
    pose[:3, :3] = np.column_stack([np.cross(side, up), side, up])
    middle = (seat.bottom + seat.top) / 2
    pose[:3, 3] = np.array([off.offset_x, off.offset_y, middle]) - pose[:3, :3] @ np.array([0.0, 0.0, middle])
    return pose


def _turn(angle: float) -> Array:
    pose = np.eye(4)
    pose[:2, :2] = [[cos(angle), -sin(angle)], [sin(angle), cos(angle)]]
    return pose


def _bore(gear: Gear, artefact: Artefact, root: float) -> float:
    """Radius of the bore: the widest cylinder that it sits on, with its clearance."""
    carried = [c.radius for c in artefact.cylinders if c.bottom < gear.face_to and c.top > gear.face_from]
    bore = max(carried) + gear.bore_clearance / 2 if carried else NO_SEAT * root
    if bore >= root:
        raise BadRecipe(
            f"the gear's root diameter {2 * root:g} mm leaves nothing around its seat of {2 * bore:g} mm; "
            "check face_from_mm and root_diameter_mm against the shaft"
        )
    return bore


def _turned(part: VirtualTurned, clamped: float) -> tuple[tuple[Step, ...], tuple[Face, ...]]:
    """Sections as steps, each with both its ends; what of them lies within others is never met first."""
    sections = sorted(part.turned.sections, key=lambda s: s.bottom)
    as_shaft = Artefact(tuple(Cylinder(s.name, s.diameter, s.bottom, s.top) for s in sections), part.turned.name)
    workpiece = Workpiece(
        part.workpiece.form, part.workpiece.keyways, part.workpiece.misalignments, part.workpiece.diameter_errors,
        part.workpiece.patches, clamped=clamped,
    )  # fmt: skip
    steps = steps_of(as_shaft, workpiece)
    faces = [Face(height, 0.0, s.radius, up) for s in steps for height, up in ((s.bottom, False), (s.top, True))]
    return steps, tuple(faces)
