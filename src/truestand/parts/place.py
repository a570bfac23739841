"""Where the model stands on the part: by robust Gauss-Newton from a search over all angles, or as the recipe says.

A part of many alike teeth has as many alike answers. Each candidate is refined and scored on the same readings; those
that differ by less than chance tie, the one nearest to the recipe's pose is taken, and the tie is told.
"""

from dataclasses import dataclass
from math import cos, degrees, pi, sin, sqrt, tau

import numpy as np
from numpy.typing import NDArray

from truestand.core.frames import Pose
from truestand.core.robust import MAD_TO_SD, TUKEY, tukey_weights
from truestand.parts.cast import Solid, meet
from truestand.parts.drawings import FitTo

Array = NDArray[np.float64]

CANDIDATES = 1440
"""Angles tried: a quarter of a degree apart."""
BATCHES = 36
"""In which they are cast."""
SEARCHED, COMPARED = 400, 2500
"""Readings that score every angle, and those that compare the best ones."""
MOST_REFINED = 48
COARSE_STEPS, STEPS = 6, 15
LEAST_SCALE = 2e-4
"""mm: scatter below which no reading is called wild."""
OPEN = 3e-4
"""Share of the best-held motion's hold below which the readings leave one open."""
SURELY = 4.0
"""Standard errors by which one candidate must be better than another."""
CAP, LEAST_CAP = 10.0, 0.02
"""Robust standard deviations, and mm at least, from which a reading is as bad as one that met nothing."""
STILL = 1e-7
"""mm: a move that ends the fit."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Readings (n, 3) mm and unit ways (n, 3) from the sensor to them, about the datum axis."""

    points: Array
    ways: Array

    def some(self, count: int) -> "Rays":
        """Evenly picked ones."""
        pick = np.unique(np.linspace(0, len(self.points) - 1, count).astype(np.intp))
        return Rays(self.points[pick], self.ways[pick])

    def moved(self, pose: Pose) -> "Rays":
        """The same through a pose."""
        return Rays(pose(self.points), self.ways @ pose.rotation.T)


@dataclass(frozen=True, slots=True)
class Placing:
    """Where the model was found to stand."""

    pose: Pose
    """model_from_part: takes readings about the datum axis to where the recipe put the model."""
    angle: float
    """rad: by which the part stands turned against the recipe's pose, ccw from above."""
    alike: tuple[float, ...] = ()
    """rad: other angles that fit as well."""
    open: tuple[str, ...] = ()
    """Motions that the readings leave open; they were left as the recipe says."""


def place(solid: Solid, rays: Rays, fit: FitTo, reach: float) -> Placing:
    """The pose that ``fit`` allows in which the readings lie best on the model; tries all angles first."""
    still = Pose.from_matrix(np.eye(4))
    if fit == "none" or len(rays.points) < 100:
        return Placing(still, 0.0)
    middle = np.median(rays.points, axis=0)
    few = rays.some(COMPARED)
    starts = [_refined(solid, few, _turn(a), fit, reach, middle, COARSE_STEPS)[0] for a in _starts(solid, few, reach)]
    losses = np.array([_loss(solid, few.moved(start), reach) for start in starts])
    best, alike = _best(starts, _capped(losses))
    pose, left = _refined(solid, rays, starts[best], fit, reach, middle, STEPS)
    return Placing(pose, -_angle(pose), tuple(-_angle(starts[i]) for i in alike), left)


def _turn(angle: float) -> Pose:
    c, s = cos(angle), sin(angle)
    return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))


def _angle(pose: Pose) -> float:
    """By which a pose turns about Z, rad."""
    return float(np.arctan2(pose.rotation[1, 0] - pose.rotation[0, 1], pose.rotation[0, 0] + pose.rotation[1, 1]))


def _starts(solid: Solid, rays: Rays, reach: float) -> list[float]:
    """The angles at which the readings lie locally best on the model, the best first; the recipe's own among them."""
    rays = rays.some(SEARCHED)
    angles = -pi + np.arange(CANDIDATES) * tau / CANDIDATES
    scores = np.concatenate([_scores(solid, rays, some, reach) for some in np.array_split(angles, BATCHES)])
    valley = (scores <= np.roll(scores, 1)) & (scores < np.roll(scores, -1))
    found = np.flatnonzero(valley)
    order = found[np.argsort(scores[found])][:MOST_REFINED]
    return [0.0, *(float(a) for a in angles[order] if abs(a) > tau / CANDIDATES / 2)]


def _scores(solid: Solid, rays: Rays, angles: Array, reach: float) -> Array:
    """Mean loss (a,) mm at some angles, all cast at once."""
    turned = [rays.moved(_turn(float(angle))) for angle in angles]
    together = Rays(np.concatenate([t.points for t in turned]), np.concatenate([t.ways for t in turned]))
    return np.asarray(_loss(solid, together, reach).reshape(angles.size, -1).mean(axis=1))


def _loss(solid: Solid, rays: Rays, reach: float) -> Array:
    """How far (n,) mm each reading lies from the model; ``reach`` where it met nothing."""
    off = np.abs(meet(solid, rays.points, rays.ways, reach, tight=False).deviation)
    return np.asarray(np.where(np.isnan(off), reach, np.minimum(off, reach)))


def _capped(losses: Array) -> Array:
    """Losses (candidates, n) with everything wild as bad as the rest of it, by the best candidate's own scatter."""
    scale = MAD_TO_SD * float(np.median(losses, axis=1).min())
    return np.asarray(np.minimum(losses, max(CAP * scale, LEAST_CAP)))


def _best(starts: list[Pose], losses: Array) -> tuple[int, list[int]]:
    """The best candidate and the others that are not surely worse, each angle once; of equals the least turned."""
    turned = np.array([abs(_angle(s)) for s in starts])
    lead = int(np.argmin(losses.mean(axis=1)))
    worse = losses - losses[lead]
    error = worse.std(axis=1) / sqrt(losses.shape[1])
    ties = np.flatnonzero(worse.mean(axis=1) <= SURELY * error + 1e-9)
    best = int(ties[np.argmin(turned[ties])])
    alike: list[int] = []
    for i in ties:
        apart = [abs((_angle(starts[i]) - _angle(starts[j]) + pi) % tau - pi) for j in (best, *alike)]
        if min(apart) > tau / CANDIDATES:
            alike.append(int(i))
    return best, alike


def motions(fit: FitTo, points: Array, normal: Array, middle: Array) -> tuple[Array, tuple[str, ...]]:
    """How the deviations (n,) follow the motions that ``fit`` allows: (n, m) mm per rad or mm, and their names.

    Turns are about the datum axis, and for ``all`` also about X and Y through the part's middle.
    """
    about_axis = points[:, 0] * normal[:, 1] - points[:, 1] * normal[:, 0]
    if fit == "angle":
        return about_axis[:, None], ("angle",)
    if fit == "angle_and_height":
        return np.column_stack([about_axis, normal[:, 2]]), ("angle", "height")
    lever = points - middle
    about = np.cross(lever, normal)
    return np.column_stack([about_axis, normal[:, 2], normal[:, :2], about[:, :2]]), (
        "angle", "height", "x", "y", "tilt about x", "tilt about y",
    )  # fmt: skip


def _refined(
    solid: Solid, rays: Rays, pose: Pose, fit: FitTo, reach: float, middle: Array, steps: int
) -> tuple[Pose, tuple[str, ...]]:
    """Gauss-Newton with Tukey's weights from ``pose``, and the motions that were left open."""
    left: tuple[str, ...] = ()
    for _ in range(steps):
        now = rays.moved(pose)
        met = meet(solid, now.points, now.ways, reach, tight=False)
        on = np.flatnonzero(met.triangle >= 0)
        if on.size < 20:
            break
        off = met.deviation[on]
        follow, names = motions(fit, now.points[on], solid.normal[met.triangle[on]], middle)
        weight = tukey_weights(off / (TUKEY * _scale(follow, off)))
        step, left = _step(follow, weight, off, names, now.points[on] - middle)
        pose = _motion(step, middle) @ pose
        if np.abs(step).max() < STILL:
            break
    return pose, left


def _scale(follow: Array, off: Array) -> float:
    """Robust standard deviation (mm) of the readings that tell a motion, of the motion that they tell worst.

    Most readings of a wheel (tips, roots, faces) don't turn with it: by them, every flank would be wild until it fits.
    """
    order = np.argsort(np.abs(off))
    held = np.cumsum(np.square(follow[order]), axis=0)
    half = [int(np.searchsorted(column, column[-1] / 2)) for column in held.T]
    return max(MAD_TO_SD * float(np.abs(off[order[np.minimum(half, off.size - 1)]]).max()), LEAST_SCALE)


def _step(
    follow: Array, weight: Array, off: Array, names: tuple[str, ...], lever: Array
) -> tuple[Array, tuple[str, ...]]:
    """The motion (m,) that takes the deviations away, but for what the readings leave open."""
    size = max(float(np.sqrt(np.mean(np.square(lever)))), 1.0)
    unit = np.array([1.0 / size if name.startswith(("angle", "tilt")) else 1.0 for name in names])
    scaled = follow * unit
    matrix = scaled.T @ (weight[:, None] * scaled) / max(float(weight.sum()), 1e-12)
    values, vectors = np.linalg.eigh(matrix)
    held = values > OPEN
    right = vectors.T @ (scaled.T @ (weight * off)) / max(float(weight.sum()), 1e-12)
    step = -unit * (vectors[:, held] @ (right[held] / values[held]))
    loose = np.square(vectors[:, ~held]).sum(axis=1)
    return step, tuple(name for name, share in zip(names, loose, strict=True) if share > 0.5)


def _motion(step: Array, middle: Array) -> Pose:
    """The pose of a motion in the order of ``motions``."""
    pose = _turn(float(step[0]))
    if step.size == 1:
        return pose
    height = np.array([0.0, 0.0, step[1]])
    if step.size == 2:
        return Pose(pose.rotation, height)
    vector = np.array([step[4], step[5], 0.0])
    tilt = _rotation(vector)
    shift = height + np.array([step[2], step[3], 0.0])
    return Pose(tilt, middle - tilt @ middle + shift) @ pose


def _rotation(vector: Array) -> Array:
    """The rotation (3, 3) by a vector's length about its direction (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-300:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sin(angle) * cross + (1.0 - cos(angle)) * cross @ cross)


def told(placing: Placing, fit: FitTo) -> list[str]:
    """What the reader should know about the placing."""
    remarks = []
    if placing.alike and "angle" not in placing.open:
        listed = ", ".join(f"{degrees(a):+.2f}" for a in placing.alike[:4])
        more = ", ..." if len(placing.alike) > 4 else ""
        remarks.append(
            f"{len(placing.alike) + 1} angles of the model fit alike ({degrees(placing.angle):+.2f} deg was taken, "
            f"nearest to the recipe's pose; also {listed}{more}): which side is which is not known; fit = 'none' if "
            "the pose is"
        )
    if placing.open:
        remarks.append(f"the readings leave open: {', '.join(placing.open)}; left as the recipe's pose says")
    return remarks
