"""A watertight mesh of a real gear: it decides which surface a ray meets first; flanks are solved afterwards."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints
from truestand.sim.gear_surface import LEFT, RIGHT, GearSurface, inv

FLANK_POINTS = 40
"""Along an involute: chords stay within 0.3 um of a flank of module 2."""
FILLET_POINTS = 8
LAND_POINTS = 7
"""Inner points of a tip land or of the root between two teeth."""
ROW_MM = 0.5
"""From one row of vertices to the next over the height."""
CHIP_EDGE_MM = 1e-4
"""Height over which the end of a chip is steep."""
DENT_ROWS = 8
"""Over the radius of a dent, at most one in 0.1 mm."""
DENT_DIGITS = 1


@dataclass(frozen=True, slots=True)
class Flanks:
    """The analytic surface for which a mesh's triangles stand."""

    surface: GearSurface
    tooth: Ints
    """(F,) index from 0; -1 = none."""
    side: NDArray[np.int8]
    """(F,) +1 left, -1 right, 0 none."""


def gear_mesh(surface: GearSurface, bore: float) -> tuple[Array, NDArray[np.int64], Flanks]:
    """The mesh of a gear with a bore of radius ``bore`` (mm), in its own frame, and what its triangles stand for.

    Returns vertices (V, 3) mm, triangles (F, 3) counter-clockwise seen from outside, and the flank of each.
    """
    heights = _rows(surface)
    outline, tooth, side = _outline(surface, heights)
    rows, around = heights.size, tooth.size
    turned = np.arctan2(outline[:, :, 1], outline[:, :, 0])
    inner = np.stack(
        [bore * np.cos(turned[[0, -1]]), bore * np.sin(turned[[0, -1]]),
         np.broadcast_to(heights[[0, -1], None], turned[[0, -1]].shape)], axis=-1
    )  # fmt: skip
    rings = np.concatenate([inner[:1], outline, inner[1:]]).reshape(-1, 3)
    walls = _walls(rows + 2, around)
    of_tooth = np.full((rows + 2, around), -1, dtype=np.intp)
    of_side = np.zeros((rows + 2, around), dtype=np.int8)
    of_tooth[1:rows], of_side[1:rows] = tooth, side
    return rings, walls, Flanks(surface, np.repeat(of_tooth.ravel(), 2), np.repeat(of_side.ravel(), 2))


def _walls(rings: int, around: int) -> NDArray[np.int64]:
    """Triangles between each ring of vertices and the next one, and from the last ring back to the first (the bore)."""
    ring, i = np.meshgrid(np.arange(rings), np.arange(around), indexing="ij")
    a, b = ring * around + i, ring * around + (i + 1) % around
    above = (ring + 1) % rings * around
    c, d = above + (i + 1) % around, above + i
    quads = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2)
    return np.asarray(quads.reshape(-1, 3), dtype=np.int64)


def _rows(surface: GearSurface) -> Array:
    """Heights of the rows of vertices: even, denser over dents, with both sides of every chip's ends."""
    low, high = surface.gear.face_from, surface.gear.face_to
    heights = [np.linspace(low, high, max(2, round((high - low) / ROW_MM) + 1))]
    for d in surface.dents:
        even = d.height + d.radius * np.linspace(-1, 1, 2 * DENT_ROWS + 1)
        heights.append(np.round(even, DENT_DIGITS))  # so that rows of many dents fall together
    for w in surface.errors.worn:
        bottom, top = w.heights
        heights.append(np.array([bottom, bottom + w.edge, top - w.edge, top]))
    for c in surface.errors.chips:
        heights.append(np.array([c.bottom, c.bottom + CHIP_EDGE_MM, c.top - CHIP_EDGE_MM, c.top]))
    merged = np.unique(np.round(np.concatenate(heights), 6))
    return np.asarray(merged[(merged >= low) & (merged <= high)])


def _outline(surface: GearSurface, heights: Array) -> tuple[Array, Ints, NDArray[np.int8]]:
    """Vertices (rows, around, 3) of all teeth, and the flank to which the stretch after each one belongs."""
    pieces, teeth, sides = [], [], []
    for k in range(surface.gear.teeth):
        radius, angle, side = (
            _missing_tooth(surface, k, heights) if surface.is_missing(k) else _tooth(surface, k, heights)
        )
        pieces.append(np.stack([radius * np.cos(angle), radius * np.sin(angle),
                                np.broadcast_to(heights[:, None], radius.shape)], axis=-1))  # fmt: skip
        teeth.append(np.where(side == 0, -1, k))
        sides.append(side)
    return np.concatenate(pieces, axis=1), np.concatenate(teeth), np.concatenate(sides)


def _tooth(surface: GearSurface, k: int, heights: Array) -> tuple[Array, Array, NDArray[np.int8]]:
    """Radius and angle (rows, n) of one tooth's outline from its right fillet's foot ccw to the next root's end."""
    c, column = surface.circles, heights[:, None]
    tooth = np.full(1, k)
    roll = np.linspace(c.roll(c.start), c.roll(c.tip), FLANK_POINTS)
    grid = np.broadcast_to(np.hypot(c.base, roll), (heights.size, FLANK_POINTS))
    capped = np.minimum(grid, surface.tip_radius(tooth, column))
    flank = {s: surface.flank_angle(tooth, s, capped, column) for s in (LEFT, RIGHT)}
    below, beside = _fillet(surface)
    fillet_radius = np.broadcast_to(below, (heights.size, FILLET_POINTS))
    fillet = {s: flank[s][:, :1] + s * beside for s in (LEFT, RIGHT)}
    tip = capped[:, -1:]
    land, land_angle = _arc(tip, flank[RIGHT][:, -1:], flank[LEFT][:, -1:])
    root, root_angle = _arc(np.full_like(tip, c.root), fillet[LEFT][:, -1:], _next_foot(surface, k, heights))
    radius = [fillet_radius[:, ::-1], capped, land, capped[:, ::-1], fillet_radius, root]
    angle = [fillet[RIGHT][:, ::-1], flank[RIGHT], land_angle, flank[LEFT][:, ::-1], fillet[LEFT], root_angle]
    side = np.zeros(sum(r.shape[1] for r in radius), dtype=np.int8)
    side[FILLET_POINTS : FILLET_POINTS + FLANK_POINTS - 1] = RIGHT
    left = FILLET_POINTS + FLANK_POINTS + LAND_POINTS
    side[left : left + FLANK_POINTS - 1] = LEFT
    return np.concatenate(radius, axis=1), np.concatenate(angle, axis=1), side


def _missing_tooth(surface: GearSurface, k: int, heights: Array) -> tuple[Array, Array, NDArray[np.int8]]:
    """The root circle in a tooth's place, with as many points."""
    n = 2 * (FILLET_POINTS + FLANK_POINTS + LAND_POINTS)
    first, last = _foot(surface, k, RIGHT, heights), _next_foot(surface, k, heights)
    angle = first + (last - first) * np.arange(n) / n
    return np.full(angle.shape, surface.circles.root), angle, np.zeros(n, dtype=np.int8)


def _arc(radius: Array, first: Array, last: Array) -> tuple[Array, Array]:
    """Inner points (rows, LAND_POINTS) of an arc."""
    share = np.arange(1, LAND_POINTS + 1) / (LAND_POINTS + 1)
    angle = first + (last - first) * share
    return np.broadcast_to(radius, angle.shape), angle


def _fillet(surface: GearSurface) -> tuple[Array, Array]:
    """Radius (mm) and angle (rad, from the flank's end) of a fillet's points (n,): a parabola that leaves the flank in
    the flank's direction, as one that a rack cuts does, and meets the root circle in the circle's.
    """
    c, end = surface.circles, _fillet_angle(surface)
    slope = sqrt(c.start**2 - c.base**2) / c.base / c.start  # of the involute's angle over its radius
    corner = min(slope * (c.start - c.root), end)
    t = np.arange(1, FILLET_POINTS + 1) / FILLET_POINTS
    return c.root + (c.start - c.root) * (1 - t) ** 2, 2 * t * (1 - t) * corner + t**2 * end


def _fillet_angle(surface: GearSurface) -> float:
    """Angle that a fillet covers: 0.38 modules of the root circle, less where the space is narrow."""
    c = surface.circles
    space = np.pi / surface.gear.teeth - c.half_tooth + inv(c.base, c.start)
    return min(0.38 * surface.gear.module / c.root, 0.8 * space)


def _foot(surface: GearSurface, k: int, side: int, heights: Array) -> Array:
    """Angle (rows, 1) at which a tooth's fillet meets the root circle."""
    start = np.full((heights.size, 1), surface.circles.start)
    angle = surface.flank_angle(np.full(1, k), side, start, heights[:, None])
    return np.asarray(angle + side * _fillet_angle(surface))


def _next_foot(surface: GearSurface, k: int, heights: Array) -> Array:
    """Where the next tooth's outline begins, behind this one's."""
    following = (k + 1) % surface.gear.teeth
    wrapped = 2 * np.pi if following == 0 else 0.0
    return _foot(surface, following, RIGHT, heights) + wrapped
