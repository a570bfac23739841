"""Features by their zones: what moves, what is measured from it, and where the optimal feature lies.

A line's zone lies in the plane of its points; where they have none, it is the smallest cylinder that holds them
(ISO 12780). All others are as wide as their points' distances from the feature differ.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, tan

import numpy as np

from truestand.core.arrays import Array, Ints
from truestand.core.assumptions import K
from truestand.form.associate import FLATNESS, Feature, FittedFeature, Layout
from truestand.form.axes import about_axis, upright
from truestand.form.revolved import cone_at, cylinder_at
from truestand.form.zone import Kind, Zone, zone

Distances = Callable[[Array, Array], tuple[Array, Array]]
"""Parameters (m,) and points (n, 3) mm in the least-squares feature's frame: distances (n,) and their slopes (n, m)."""


@dataclass(frozen=True, slots=True)
class ZonedFeature:
    """The optimal feature, as ``FittedFeature`` has it, and its zone."""

    feature: Feature
    point: Array
    direction: Array | None
    radius: float | None
    half_angle: float | None
    width: float
    """mm, of the zone."""
    deviation: Array
    """(n,) mm."""
    zone: Zone
    U_per_noise: dict[str, float]
    """Expanded (k = 2), of 1 mm of noise on the points that hold the feature."""

    def expanded(self, noise: float) -> dict[str, float]:
        """U (k = 2) by key for a ``noise`` in mm."""
        return {key: value * noise for key, value in self.U_per_noise.items()}


@dataclass(frozen=True, slots=True)
class _Shape:
    """What moves in a feature's frame, and what that means."""

    distances: Distances
    layout: Layout
    """Of the parameters; ``radius`` aside, which is the middle of the zone. No position: the middle is one."""
    start: Array
    size: float
    """mm."""


def zoned(points: Array, fitted: FittedFeature, kind: Kind) -> ZonedFeature:
    """The feature of points (n, 3) mm by its zone (MZC), or held from outside (MCC) or inside (MIC).

    Raises:
        NotEnoughData: the points don't hold it.
    """
    local = (points - fitted.point) @ fitted.frame.T
    across = _across(local) if fitted.feature == "line" else None
    around = fitted.feature == "line" and across is None
    shape = _shape(local, fitted, across)

    def distance(q: Array, which: Ints) -> tuple[Array, Array]:
        return shape.distances(q, local[which])

    best = zone(distance, len(local), shape.start, "MCC" if around else kind, shape.size)
    middle = {"MZC": (best.outer + best.inner) / 2, "MCC": best.outer, "MIC": best.inner}[kind]
    distances, _ = distance(best.parameters, np.arange(len(local)))
    found = _placed(fitted, shape, best.parameters, middle, across, points.mean(axis=0))
    return ZonedFeature(
        fitted.feature, *found, 2 * best.outer if around else best.outer - best.inner,
        distances if around else distances - middle, best, _expanded(best, kind, shape, fitted, around),
    )  # fmt: skip


def _across(local: Array) -> Array | None:
    """Unit vector (3,) across a line's direction in the plane of its points; None where they lie in none."""
    _, extent, axes = np.linalg.svd(local[:, :2], full_matrices=False)
    flat = extent[1] <= FLATNESS * float(np.abs(local[:, 2]).max()) * np.sqrt(len(local))
    return np.array([*axes[0], 0.0]) if flat else None


def _shape(local: Array, fitted: FittedFeature, across: Array | None) -> _Shape:
    extent = float(np.abs(local).max())
    size = extent if fitted.radius is None else fitted.radius
    if across is not None:
        return _Shape(_beside(across), Layout(None, slice(0, 1)), np.zeros(1), extent)
    if fitted.feature in ("line", "cylinder"):
        return _Shape(_from_axis, Layout(slice(0, 2), slice(2, 4)), np.zeros(4), size)
    if fitted.feature == "cone":
        start = np.array([0.0, 0.0, 0.0, 0.0, fitted.half_angle or 0.0])
        return _Shape(_from_cone, Layout(slice(0, 2), slice(2, 4), None, 4), start, extent)
    if fitted.feature == "plane":
        return _Shape(_over, Layout(None, slice(0, 2)), np.zeros(2), extent)
    if fitted.feature == "circle":
        return _Shape(_from_axis, Layout(slice(0, 2)), np.zeros(2), size)
    return _Shape(_from_centre, Layout(slice(0, 3)), np.zeros(3), size)


def _from_axis(q: Array, local: Array) -> tuple[Array, Array]:
    """From an axis (x, y, slope x, slope y); that of a circle has no slopes."""
    length, slopes = cylinder_at(np.append(q, np.zeros(5 - q.size)), local)
    return length, slopes[:, : q.size]


def _from_cone(q: Array, local: Array) -> tuple[Array, Array]:
    """From the cone (x, y, slope x, slope y, half angle) whose radius is 0 there."""
    length, slopes = cone_at(np.insert(q, 4, 0.0), local)
    return length, np.delete(slopes, 4, axis=1)


def _from_centre(q: Array, local: Array) -> tuple[Array, Array]:
    away = local - q
    length = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
    return length, -away / length[:, None]


def _over(q: Array, local: Array) -> tuple[Array, Array]:
    """Over the plane through the origin whose normal is (q0, q1, 1)."""
    _, tilts, over, _, _ = about_axis(local, q[0], q[1])
    return over, local @ tilts.T


def _beside(across: Array) -> Distances:
    """Beside the line through the origin along q0 ``across`` + z."""

    def distances(q: Array, local: Array) -> tuple[Array, Array]:
        length, beside = np.sqrt(1.0 + q[0] ** 2), local @ across
        away = (beside - q[0] * local[:, 2]) / length
        return away, (-local[:, 2:] - (q[0] / length) * away[:, None]) / length

    return distances


def _placed(
    fitted: FittedFeature, shape: _Shape, q: Array, middle: float, across: Array | None, centroid: Array
) -> tuple[Array, Array | None, float | None, float | None]:
    """Point, direction, radius and half angle of the feature with parameters q (m,)."""
    frame, layout = fitted.frame, shape.layout
    moved = np.zeros(3)
    if layout.position is not None:
        moved[: q[layout.position].size] = q[layout.position]
    axis = frame[2]
    if layout.slopes is not None:
        sideways = frame[:2] if across is None else across[None] @ frame
        axis = axis + q[layout.slopes] @ sideways
        axis = axis / np.linalg.norm(axis)
    point = fitted.point + moved @ frame
    if fitted.feature == "sphere":
        return point, None, middle, None
    if fitted.feature == "circle":
        return point, fitted.direction, middle, None
    if fitted.feature == "plane":
        over = float((fitted.point - centroid) @ axis) + middle
        return centroid + over * axis, upright(axis), None, None
    if across is not None:
        normal = across @ frame
        normal = normal - (normal @ axis) * axis
        point = point + middle * normal / np.linalg.norm(normal)
    along = float((centroid - point) @ axis)
    point = point + along * axis
    direction = upright(axis)
    if fitted.feature == "line":
        return point, direction, None, None
    if layout.half_angle is None:
        return point, direction, middle, None
    angle = float(q[layout.half_angle])
    return point, direction, middle / cos(angle) + along * tan(angle), angle * float(np.sign(direction @ axis))


def _expanded(best: Zone, kind: Kind, shape: _Shape, fitted: FittedFeature, around: bool) -> dict[str, float]:
    """U (k = 2) by key from noise of 1 mm of the contacts alone, as they hold the feature."""
    layout, response = shape.layout, best.sensitivity * K
    m = best.parameters.size
    # A one-sided reference holds one border; the other is where the farthest point happens to lie.
    outer = response[m] if best.outside.any() else np.zeros(response.shape[1])
    inner = response[m + 1] if not best.outside.all() else np.zeros(response.shape[1])
    middle = {"MZC": (outer + inner) / 2, "MCC": outer, "MIC": inner}[kind]
    width = 2 * outer if around else outer - inner
    U = {
        "point": float(np.linalg.norm(middle if layout.position is None else response[layout.position], 2)),
        "form": float(np.hypot(np.linalg.norm(width), 0.0 if around or kind == "MZC" else K)),
    }
    if layout.slopes is not None:
        U["direction"] = float(np.linalg.norm(response[layout.slopes], 2))
    if layout.half_angle is not None:
        angle, turned = float(best.parameters[layout.half_angle]), response[layout.half_angle]
        U["half_angle"] = float(np.linalg.norm(turned))
        U["radius"] = float(np.linalg.norm((middle + (best.outer + best.inner) / 2 * tan(angle) * turned) / cos(angle)))
    elif fitted.radius is not None:
        U["radius"] = float(np.linalg.norm(middle))
    return U
