"""Parts on the virtual stand's shaft: a gear, a turned part or one with a CAD model, with its deviations."""

from dataclasses import dataclass, field, replace
from math import cos, sin

import numpy as np

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.errors import BadRecipe
from truestand.gear.drawing import Gear
from truestand.parts.drawings import Cad, Turned
from truestand.sim.gear_errors import GearErrors
from truestand.sim.gear_mesh import gear_mesh
from truestand.sim.gear_surface import GearSurface
from truestand.sim.poses import rigid, shifted, turned
from truestand.sim.raycast_mesh import Body, body
from truestand.sim.shaft_surface import Face, Step, axis_of, faces_of, steps_of
from truestand.sim.simulation import Misalignment, Workpiece

DEFAULT_BORE = 0.6
"""Share of the root diameter, of a gear at whose height the shaft has no cylinder."""


@dataclass(frozen=True, slots=True)
class VirtualGear:
    """A gear and its errors.

    Raises:
        BadRecipe: errors of teeth that the gear hasn't got, with the number.
    """

    gear: Gear
    errors: GearErrors = field(default_factory=GearErrors)
    turned: float = 0.0
    """rad, ccw from above, by which it sits turned on the shaft,"""
    turned_over: bool = False
    """after it was turned over, about a level line through the middle of its face."""

    def __post_init__(self) -> None:
        teeth, e = self.gear.teeth, self.errors
        for name, listed in (("pitch_left_um", e.pitch_left), ("pitch_right_um", e.pitch_right)):
            if listed and len(listed) != teeth:
                raise BadRecipe(f"[simulation] {name}: found {len(listed)} values, need {teeth}, one a tooth")
        worn = (w.tooth for w in e.worn if w.tooth is not None)
        dented = (*(d.tooth for d in e.dents), *(s.tooth for s in e.scratches))
        for number in (*e.missing, *worn, *dented, *(c.tooth for c in e.chips)):
            if not 1 <= number <= teeth:
                raise BadRecipe(f"[simulation] found tooth {number}, need one of 1..{teeth}")


@dataclass(frozen=True, slots=True)
class VirtualTurned:
    """A turned part; ``workpiece`` names its sections where the shaft's one names cylinders."""

    turned: Turned
    workpiece: Workpiece = field(default_factory=Workpiece)


@dataclass(frozen=True, slots=True)
class VirtualCad:
    """A part that is exactly its model, on the shaft turned and lifted against the drawing's pose."""

    cad: Cad
    turned: float = 0.0
    """rad, ccw from above."""
    lifted: float = 0.0
    """mm."""


VirtualPart = VirtualGear | VirtualTurned | VirtualCad


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that rays can meet, in C."""

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
        surface = GearSurface(part.gear, part.errors)
        vertices, triangles, flanks = gear_mesh(surface, _bore(part.gear, artefact, surface.circles.root))
        pose = shaft_from_gear(part, artefact, workpiece)
        return Scene(steps, faces, body(vertices, triangles, pose, flanks))
    if isinstance(part, VirtualTurned):
        part_steps, part_faces = _sections(part, workpiece.clamped)
        return Scene(steps + part_steps, faces + part_faces)
    if isinstance(part, VirtualCad):
        model = part.cad.mesh
        return Scene(steps, faces, body(model.vertices, model.faces, shaft_from_cad(part, workpiece)))
    return Scene(steps, faces)


def shaft_from_gear(part: VirtualGear, artefact: Artefact, workpiece: Workpiece) -> Array:
    """Pose (4, 4) of the toothing in C: eccentric to the bore, on its seat, turned with the shaft."""
    gear, errors = part.gear, part.errors
    middle = gear.face_from + gear.face_width / 2
    e, direction = errors.eccentricity, errors.eccentricity_direction
    names = [c.name for c in artefact.cylinders if c.bottom <= middle <= c.top]
    off = next((m for m in workpiece.misalignments if m.surface in names), None)
    seat = np.eye(4) if off is None else _seat(off, artefact)
    sits = turned(part.turned) @ (
        rigid(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 2 * middle)) if part.turned_over else np.eye(4)
    )
    return turned(workpiece.clamped) @ seat @ sits @ shifted(e * cos(direction), e * sin(direction))


def shaft_from_cad(part: VirtualCad, workpiece: Workpiece) -> Array:
    """Pose (4, 4) of a CAD model in C."""
    return turned(workpiece.clamped + part.turned) @ shifted(z=part.lifted) @ part.cad.pose


def _seat(off: Misalignment, artefact: Artefact) -> Array:
    """Pose (4, 4) of the misaligned cylinder that carries the part; the seat's heights stay."""
    seat = next(c for c in artefact.cylinders if c.name == off.surface)
    up = axis_of(off)
    side = np.cross(up, [1.0, 0.0, 0.0])
    side = side / np.linalg.norm(side)
    rotation = np.column_stack([np.cross(side, up), side, up])
    middle = (seat.bottom + seat.top) / 2
    return rigid(rotation, np.array([off.offset_x, off.offset_y, middle]) - rotation @ [0.0, 0.0, middle])


def _bore(gear: Gear, artefact: Artefact, root: float) -> float:
    """Radius of the bore: that of the widest cylinder at the gear's height, and the clearance."""
    carried = [c.radius for c in artefact.cylinders if c.bottom < gear.face_to and c.top > gear.face_from]
    bore = max(carried) + gear.bore_clearance / 2 if carried else DEFAULT_BORE * root
    if bore >= root:
        raise BadRecipe(
            f"the gear's root diameter {2 * root:g} mm leaves nothing around its seat of {2 * bore:g} mm; "
            "check face_from_mm and root_diameter_mm against the shaft"
        )
    return bore


def _sections(part: VirtualTurned, clamped: float) -> tuple[tuple[Step, ...], tuple[Face, ...]]:
    """Sections as steps, each with both ends; an end inside another section is never met first."""
    sections = sorted(part.turned.sections, key=lambda s: s.bottom)
    as_shaft = Artefact(tuple(Cylinder(s.name, s.diameter, s.bottom, s.top) for s in sections), part.turned.name)
    steps = steps_of(as_shaft, replace(part.workpiece, clamped=clamped, chamfer=0.0, fillet=0.0))
    faces = [Face(height, 0.0, s.radius, up) for s in steps for height, up in ((s.bottom, False), (s.top, True))]
    return steps, tuple(faces)
