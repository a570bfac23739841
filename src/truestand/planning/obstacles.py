"""What stands between sensor and surface: the part itself, the shaft, the table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.frames import Pose
from truestand.gear.geometry import Involute
from truestand.parts.rays import Solid, clear_view, first_hits

NEAREST, STEPS = 0.05, 48
"""mm from a surface point at which its path is first looked at, and how many times up to the sensor."""


class Body(Protocol):
    """Something that nothing sees through."""

    def hides(self, path: Array) -> Mask:
        """Whether it stands in the ways (n,) from surface points to eyes.

        ``path`` (``STEPS``, n, 3): points of theirs, mm in C.
        """


class Cast(Body, Protocol):
    """A body on which rays can be cast."""

    def hit(self, origin: Array, ways: Array) -> Array:
        """Distances (N, M) mm along unit ``ways`` (N, M, 3) from ``origin`` (N, 1, 3), in C; inf: none."""


@dataclass(frozen=True, slots=True)
class Round:
    """A cylinder about C's axis; mm."""

    radius: float
    bottom: float
    top: float

    def hides(self, path: Array) -> Mask:
        """As ``Body`` says."""
        height = path[..., 2]
        on = (height > self.bottom) & (height < self.top)
        return np.asarray((on & (np.square(path[..., :2]).sum(axis=-1) < self.radius**2)).any(axis=0))

    def hit(self, origin: Array, ways: Array) -> Array:
        """As ``Cast`` says: the side, or a face."""
        a, b = np.square(ways[..., :2]).sum(axis=-1), (origin[..., :2] * ways[..., :2]).sum(axis=-1)
        c = np.square(origin[..., :2]).sum(axis=-1) - self.radius**2
        with np.errstate(invalid="ignore", divide="ignore"):
            side = (-b - np.sqrt(b * b - a * c)) / a
            height = origin[..., 2] + side * ways[..., 2]
            on_side = (side > 0) & (height > self.bottom) & (height < self.top)
            level = np.where(ways[..., 2] < 0, self.top, self.bottom)
            face = (level - origin[..., 2]) / ways[..., 2]
            radius2 = np.square(origin[..., :2] + face[..., None] * ways[..., :2]).sum(axis=-1)
            on_face = (face > 0) & (radius2 < self.radius**2)
        return np.fmin(np.where(on_side, side, np.inf), np.where(on_face, face, np.inf))


@dataclass(frozen=True, slots=True)
class Toothed:
    """A gear as drawn, its first tooth at polar angle ``turned`` about the datum axis."""

    nominal: Involute
    datum: Pose
    turned: float

    def hides(self, path: Array) -> Mask:
        """As ``Body`` says."""
        g, p = self.nominal.gear, self.datum(path)
        radius = np.hypot(p[..., 0], p[..., 1])
        centre = self.turned + (p[..., 2] - self.nominal.middle) * self.nominal.twist
        off = (np.arctan2(p[..., 1], p[..., 0]) - centre + g.pitch / 2) % g.pitch - g.pitch / 2
        half = self.nominal.half_angle(np.maximum(radius, self.nominal.base_radius))
        in_tooth = (radius < g.tip_diameter / 2) & (np.abs(off) < half)
        on_face = (p[..., 2] > g.face_from) & (p[..., 2] < g.face_to)
        return np.asarray((on_face & (in_tooth | (radius < g.root_diameter / 2))).any(axis=0))


@dataclass(frozen=True, slots=True)
class Meshed:
    """A model of triangles, where it stands in C."""

    solid: Solid

    def hides(self, path: Array) -> Mask:
        """As ``Body`` says."""
        return ~clear_view(self.solid, path[-1], path[0], 0.0)

    def hit(self, origin: Array, ways: Array) -> Array:
        """As ``Cast`` says."""
        start = np.broadcast_to(origin, ways.shape).reshape(-1, 3)
        _, distance = first_hits(self.solid, start, ways.reshape(-1, 3))
        return np.where(np.isnan(distance), np.inf, distance).reshape(ways.shape[:-1])


def clear(points: Array, eyes: Array, bodies: Sequence[Body]) -> Mask:
    """Whether no body stands between surface points (n, 3) and eyes (n, 3), mm in C."""
    towards = eyes - points
    length = np.linalg.norm(towards, axis=1)
    shares = np.geomspace(1.0, np.maximum(length / NEAREST, 1.0), STEPS) * (NEAREST / length)
    path = points + shares[:, :, None] * towards
    hidden = np.zeros(len(points), dtype=bool)
    for body in bodies:
        hidden |= body.hides(path)
    return ~hidden
