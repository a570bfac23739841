"""Surface of the real shaft: each step a cylinder about its own axis, with form, chamfers, keyways; shoulders."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.sim.simulation import FormWave, Keyway, Misalignment, Patch, Workpiece

FILLET_CORNER = 0.02
"""Share of a fillet next to its corner, where it is all but a face."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the shaft about its own axis, in C."""

    radius: float
    bottom: float
    top: float
    origin: Array
    """(3,) mm: the point of its axis at height 0."""
    axis: Array
    """(3,) unit."""
    form: tuple[FormWave, ...]
    keyways: tuple[Keyway, ...]
    chamfer_bottom: float
    chamfer_top: float
    fillet_bottom: float = 0.0
    fillet_top: float = 0.0
    patches: tuple[Patch, ...] = ()

    @property
    def plain(self) -> bool:
        """Nothing but a round cylinder."""
        cut = self.chamfer_bottom or self.chamfer_top or self.fillet_bottom or self.fillet_top
        return not (self.form or self.patches or cut)

    def surface(self, psi: Array, height: Array) -> tuple[Array, Array]:
        """Radius (mm) of the surface and its slope over height, at polar angle psi and height."""
        radius = np.full(psi.shape, self.radius)
        for wave in self.form:
            radius += wave.amplitude * np.cos(wave.upr * psi - wave.phase)
        for patch in self.patches:
            radius = _patched(radius, psi, patch)
        slope = np.zeros(psi.shape)
        for chamfer, depth, sign in (
            (self.chamfer_bottom, (self.bottom + self.chamfer_bottom) - height, 1.0),
            (self.chamfer_top, height - (self.top - self.chamfer_top), -1.0),
        ):
            if chamfer:
                radius -= np.maximum(depth, 0.0)
                slope += sign * (depth > 0)
        for fillet, distance, sign in (
            (self.fillet_bottom, height - self.bottom, -1.0),
            (self.fillet_top, self.top - height, 1.0),
        ):
            if fillet:
                wider, steep = _fillet(fillet, distance)
                radius += wider
                slope += sign * steep
        return radius, slope

    def in_keyway(self, psi: Array, height: Array) -> Array:
        """Depth of the keyway at each place, 0 where there is none."""
        depth = np.zeros(psi.shape)
        for k in self.keyways:
            across = np.abs(np.angle(np.exp(1j * (psi - k.azimuth)))) * self.radius
            depth[(across < k.width / 2) & (height > k.bottom) & (height < k.top)] = k.depth
        return depth


def _patched(radius: Array, psi: Array, patch: Patch) -> Array:
    """The radius with dirt, or cut down to a chord."""
    off = np.abs(np.angle(np.exp(1j * (psi - patch.azimuth))))
    on = off < np.pi * patch.share
    if patch.height is not None:
        rise = (np.pi * patch.share - off) / patch.soft + 0.5 if patch.soft else on
        return np.asarray(radius + patch.height * np.clip(rise, 0.0, 1.0))
    chord = radius * np.cos(np.pi * patch.share) / np.maximum(np.cos(off), 0.1)
    return np.where(on, np.minimum(chord, radius), radius)


def _fillet(size: float, distance: Array) -> tuple[Array, Array]:
    """By how much a fillet widens the step at a distance (mm) from its corner, and how steeply."""
    x = np.clip(distance / size, FILLET_CORNER, 1.0)
    root = np.sqrt(x * (2.0 - x))
    steep = np.where((distance > 0) & (distance < size), (1.0 - x) / root, 0.0)
    return size * (1.0 - root), steep


@dataclass(frozen=True, slots=True)
class Face:
    """A flat ring square to the base's axis: the shoulder between two steps, or an end. ``up`` = it faces +Z."""

    height: float
    inner: float
    outer: float
    up: bool


def axis_of(misalignment: Misalignment) -> Array:
    """Direction (3,) of a misaligned step's axis in C, unit."""
    axis = np.array([misalignment.slope_x, misalignment.slope_y, 1.0])
    return np.asarray(axis / np.linalg.norm(axis))


def steps_of(artefact: Artefact, workpiece: Workpiece) -> tuple[Step, ...]:
    """The shaft's steps with the deviations of the workpiece."""
    workpiece = workpiece.in_shaft_frame()
    errors = dict(workpiece.diameter_errors)
    cylinders = artefact.cylinders
    steps = []
    for i, c in enumerate(cylinders):
        below = cylinders[i - 1].radius if i else 0.0
        above = cylinders[i + 1].radius if i + 1 < len(cylinders) else 0.0
        off, middle = workpiece.misalignment_of(c.name), (c.bottom + c.top) / 2
        steps.append(
            Step(
                c.radius + errors.get(c.name, 0.0) / 2,
                c.bottom,
                c.top,
                np.array([off.offset_x - off.slope_x * middle, off.offset_y - off.slope_y * middle, 0.0]),
                axis_of(off),
                tuple(f for f in workpiece.form if f.surface == c.name),
                tuple(k for k in workpiece.keyways if k.surface == c.name),
                workpiece.chamfer if i and c.radius > below else 0.0,
                workpiece.chamfer if c.radius > above else 0.0,
                workpiece.fillet if below > c.radius else 0.0,
                workpiece.fillet if above > c.radius else 0.0,
                tuple(p for p in workpiece.patches if p.surface == c.name),
            )
        )
    return tuple(steps)


def faces_of(artefact: Artefact, workpiece: Workpiece) -> tuple[Face, ...]:
    """Shoulders, both ends, and the table's face where it is in view."""
    c = artefact.cylinders
    chamfer = workpiece.chamfer
    faces = [Face(c[0].bottom, 0.0, c[0].radius, up=False), Face(c[-1].top, 0.0, c[-1].radius - chamfer, up=True)]
    for lower, upper in pairwise(c):
        inner, outer = sorted((lower.radius, upper.radius))
        inner += float(_fillet(workpiece.fillet, np.zeros(1))[0][0]) if workpiece.fillet else 0.0
        faces.append(Face(lower.top, inner, outer - chamfer, up=lower.radius > upper.radius))
    if workpiece.table_disc is not None:
        faces.append(Face(workpiece.table_disc, 0.0, 200.0, up=True))
    return tuple(faces)
