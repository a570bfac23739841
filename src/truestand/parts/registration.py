"""Where the model stands on the part: by robust Gauss-Newton from a search over all angles, or as the recipe says.

A part of many alike teeth has as many alike answers. Each candidate is refined and scored on the same readings; those
that differ by less than chance tie, the one nearest to the recipe's pose is taken, and the tie is reported.
"""

from dataclasses import dataclass
from math import cos, degrees, pi, sin, sqrt, tau

import numpy as np

from truestand.core.arrays import Array
from truestand.core.frames import Pose
from truestand.core.message import Message
from truestand.core.robust import MAD_TO_SD, TUKEY, tukey_weights
from truestand.parts.drawings import FitTo
from truestand.parts.rays import Rays, Solid, hits_near

MOTIONS = ("angle", "height", "x", "y", "tilt about x", "tilt about y")
ALLOWED: dict[FitTo, int] = {"none": 0, "angle": 1, "angle_and_height": 2, "all": 6}
"""The first so many of the motions."""
CANDIDATES = 1440
"""Angles tried: a quarter of a degree apart."""
BATCHES = 36
"""In which they are cast."""
SEARCH_READINGS, COMPARED_READINGS = 400, 2500
"""Readings that score every angle, and those that compare the best ones."""
MOST_REFINED = 48
COARSE_STEPS, STEPS = 6, 15
LEAST_SCALE = 2e-4
"""mm: scatter below which no reading is called an outlier."""
LEAST_EIGENVALUE = 3e-4
"""Of the scaled normal matrix: a motion below it is left open by the readings."""
TIE_SIGMA = 4.0
"""Standard errors by which one candidate must be better than another."""
CAP, LEAST_CAP = 10.0, 0.02
"""Robust standard deviations, and mm at least, from which a reading is as bad as one that hit nothing."""
LEAST_STEP = 1e-7
"""mm and rad: a motion that ends the fit."""


@dataclass(frozen=True, slots=True)
class Registration:
    """Where the model was found to stand."""

    pose: Pose
    """model_from_part: takes readings about the datum axis to where the recipe put the model."""
    angle: float
    """rad: by which the part stands turned against the recipe's pose, ccw from above."""
    other_angles: tuple[float, ...] = ()
    """rad: they fit as well."""
    free_motions: tuple[str, ...] = ()
    """Motions that the readings leave open; they were left as the recipe says."""


def register(solid: Solid, rays: Rays, fit: FitTo, reach: float) -> Registration:
    """The pose that ``fit`` allows in which the readings lie best on the model; tries all angles first."""
    if fit == "none" or len(rays.points) < 100:
        return Registration(Pose.from_matrix(np.eye(4)), 0.0)
    middle = np.median(rays.points, axis=0)
    few = rays.sample(COMPARED_READINGS)
    starts = [_refined(solid, few, _turn(a), fit, reach, middle, COARSE_STEPS)[0] for a in _starts(solid, few, reach)]
    losses = np.array([_loss(solid, few.moved(start), reach) for start in starts])
    best, ties = _best(starts, _capped(losses))
    pose, free = _refined(solid, rays, starts[best], fit, reach, middle, STEPS)
    return Registration(pose, -_angle(pose), tuple(-_angle(starts[i]) for i in ties), free)


def _turn(angle: float) -> Pose:
    c, s = cos(angle), sin(angle)
    return Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))


def _angle(pose: Pose) -> float:
    """By which a pose turns about Z, rad."""
    return float(np.arctan2(pose.rotation[1, 0] - pose.rotation[0, 1], pose.rotation[0, 0] + pose.rotation[1, 1]))


def _starts(solid: Solid, rays: Rays, reach: float) -> list[float]:
    """The angles at which the readings lie locally best on the model, the best first; the recipe's own among them."""
    rays = rays.sample(SEARCH_READINGS)
    angles = -pi + np.arange(CANDIDATES) * tau / CANDIDATES
    scores = np.concatenate([_scores(solid, rays, batch, reach) for batch in np.array_split(angles, BATCHES)])
    valley = (scores <= np.roll(scores, 1)) & (scores < np.roll(scores, -1))
    found = np.flatnonzero(valley)
    order = found[np.argsort(scores[found])][:MOST_REFINED]
    return [0.0, *(float(a) for a in angles[order] if abs(a) > tau / CANDIDATES / 2)]


def _scores(solid: Solid, rays: Rays, angles: Array, reach: float) -> Array:
    """Mean loss (a,) mm at some angles, all cast at once."""
    turned = [rays.moved(_turn(float(angle))) for angle in angles]
    together = Rays(np.concatenate([t.points for t in turned]), np.concatenate([t.directions for t in turned]))
    return np.asarray(_loss(solid, together, reach).reshape(angles.size, -1).mean(axis=1))


def _loss(solid: Solid, rays: Rays, reach: float) -> Array:
    """How far (n,) mm each reading lies from the model; ``reach`` where it hit nothing."""
    off = np.abs(hits_near(solid, rays, reach, tight=False).deviation)
    return np.asarray(np.where(np.isnan(off), reach, np.minimum(off, reach)))


def _capped(losses: Array) -> Array:
    """Losses (candidates, n) with outliers no worse than one another, by the best candidate's own scatter."""
    scale = MAD_TO_SD * float(np.median(losses, axis=1).min())
    return np.asarray(np.minimum(losses, max(CAP * scale, LEAST_CAP)))


def _best(starts: list[Pose], losses: Array) -> tuple[int, list[int]]:
    """The best candidate and the others that are not surely worse, each angle once; of equals the least turned."""
    turned = np.array([abs(_angle(s)) for s in starts])
    lead = int(np.argmin(losses.mean(axis=1)))
    worse = losses - losses[lead]
    error = worse.std(axis=1) / sqrt(losses.shape[1])
    ties = np.flatnonzero(worse.mean(axis=1) <= TIE_SIGMA * error + 1e-9)
    best = int(ties[np.argmin(turned[ties])])
    others: list[int] = []
    for i in ties:
        apart = [abs((_angle(starts[i]) - _angle(starts[j]) + pi) % tau - pi) for j in (best, *others)]
        if min(apart) > tau / CANDIDATES:
            others.append(int(i))
    return best, others


def motions(fit: FitTo, points: Array, normal: Array, middle: Array) -> tuple[Array, tuple[str, ...]]:
    """How the deviations (n,) jacobian the motions that ``fit`` allows: (n, m) mm per rad or mm, and their names.

    Turns are about the datum axis, and for ``all`` also about X and Y through the part's middle.
    """
    about_axis = points[:, 0] * normal[:, 1] - points[:, 1] * normal[:, 0]
    about = np.cross(points - middle, normal)
    allowed = ALLOWED[fit]
    return np.column_stack([about_axis, normal[:, 2], normal[:, :2], about[:, :2]])[:, :allowed], MOTIONS[:allowed]


def _refined(
    solid: Solid, rays: Rays, pose: Pose, fit: FitTo, reach: float, middle: Array, steps: int
) -> tuple[Pose, tuple[str, ...]]:
    """Gauss-Newton with Tukey's weights from ``pose``, and the motions that were left open."""
    free: tuple[str, ...] = ()
    for _ in range(steps):
        now = rays.moved(pose)
        hits = hits_near(solid, now, reach, tight=False)
        on = np.flatnonzero(hits.triangle >= 0)
        if on.size < 20:
            break
        off = hits.deviation[on]
        jacobian, names = motions(fit, now.points[on], solid.normal[hits.triangle[on]], middle)
        weight = tukey_weights(off / (TUKEY * _scale(jacobian, off)))
        step, free = _step(jacobian, weight, off, names, now.points[on] - middle)
        pose = _motion(step, middle) @ pose
        if np.abs(step).max() < LEAST_STEP:
            break
    return pose, free


def _scale(jacobian: Array, off: Array) -> float:
    """Robust standard deviation (mm) of the readings that hold a motion, of the motion that they hold worst.

    Most readings of a wheel (tips, roots, faces) don't turn with it: by them, flanks would be outliers until they fit.
    """
    order = np.argsort(np.abs(off))
    held = np.cumsum(np.square(jacobian[order]), axis=0)
    half = [int(np.searchsorted(column, column[-1] / 2)) for column in held.T]
    return max(MAD_TO_SD * float(np.abs(off[order[np.minimum(half, off.size - 1)]]).max()), LEAST_SCALE)


def _step(
    jacobian: Array, weight: Array, off: Array, names: tuple[str, ...], lever: Array
) -> tuple[Array, tuple[str, ...]]:
    """The motion (m,) that takes the deviations away, but for what the readings leave open."""
    size = max(float(np.sqrt(np.mean(np.square(lever)))), 1.0)
    unit = np.array([1.0 / size if name.startswith(("angle", "tilt")) else 1.0 for name in names])
    scaled = jacobian * unit
    matrix = scaled.T @ (weight[:, None] * scaled) / max(float(weight.sum()), 1e-12)
    values, vectors = np.linalg.eigh(matrix)
    held = values > LEAST_EIGENVALUE
    right = vectors.T @ (scaled.T @ (weight * off)) / max(float(weight.sum()), 1e-12)
    step = -unit * (vectors[:, held] @ (right[held] / values[held]))
    loose = np.square(vectors[:, ~held]).sum(axis=1)
    return step, tuple(name for name, share in zip(names, loose, strict=True) if share > 0.5)


def _motion(step: Array, middle: Array) -> Pose:
    """The pose of a motion (the first of ``MOTIONS``, no other)."""
    from scipy.spatial.transform import Rotation

    angle, height, x, y, about_x, about_y = np.append(step, np.zeros(len(MOTIONS) - step.size))
    tilt = Rotation.from_rotvec([about_x, about_y, 0.0]).as_matrix()
    return Pose(tilt, middle - tilt @ middle + np.array([x, y, height])) @ _turn(angle)


def registration_remarks(registration: Registration) -> list[Message]:
    """Ties and free motions, in words."""
    remarks = []
    if registration.other_angles and "angle" not in registration.free_motions:
        listed = ", ".join(f"{degrees(a):+.2f}" for a in registration.other_angles[:4])
        more = ", ..." if len(registration.other_angles) > 4 else ""
        text = (
            f"{len(registration.other_angles) + 1} angles of the model fit alike "
            f"({degrees(registration.angle):+.2f} deg was taken, nearest to the recipe's pose; also {listed}{more}): "
            "which side is which is not known; fit = 'none' if the pose is"
        )
        remarks.append(Message("angles_fit_alike", text))
    if registration.free_motions:
        text = f"the readings leave open: {', '.join(registration.free_motions)}; left as the recipe's pose says"
        remarks.append(Message("motions_left_open", text))
    return remarks
