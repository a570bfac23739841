"""Height zero: the shoulder face between the first two cylinders, where the scan shows it; else the nearest edge."""

from dataclasses import dataclass, replace
from math import cos, hypot, pi, sin, sqrt, tau

import numpy as np

from truestand.calibration.refine import Refined
from truestand.core.arrays import Array, Ints
from truestand.core.artefact import Artefact
from truestand.core.frames import (
    ECCENTRICITY,
    ECCENTRICITY_X,
    ECCENTRICITY_Y,
    PLANE_OFFSET,
    PLANE_TILT,
    TILT,
    TILT_X,
    TILT_Y,
    UNKNOWNS,
)
from truestand.core.scan import Scan
from truestand.uncertainty.influence import points_of

SAMPLED_PROFILES = 1000
BLOCK = 64
"""Profiles worked on at once: fits the processor's cache."""
FACE_REACH_MM = 0.3
"""Half-height of the slab in which the face's points lie once the model is known."""
MOST_FACE_SLOPE_MM = 0.03
"""By which the inner and the outer half of a face may differ in height."""
EDGE_REACH_MM = 1.5
"""How far from its expected place the edge of a cylinder is searched for."""
EDGE_REACH_STEPS = 5
"""The same in steps between readings: of few points, the rough place is two or three steps off."""
LEAST_POINTS = 50
GROUPS = 16
"""Of successive profiles, by which a height's scatter is told."""
GRID_WAVES = 8
"""Of a sawtooth as long as a step; those beyond add 4 % to its size at most."""


@dataclass(frozen=True, slots=True)
class _Level:
    """A height above the drawing's shoulder, mm, and how well another scan repeats it: standard, mm."""

    value: float
    u: float


def with_height(scan: Scan, artefact: Artefact, fit: Refined) -> Refined:
    """The fit with the shoulder face at its height in the drawing.

    Where the face is hidden, the end of the larger cylinder stands in for it; a chamfer there is no edge, so the height
    stays among what is not identifiable.
    """
    if len(artefact.cylinders) < 2:
        return fit
    radius, height = _in_shaft(scan, fit)
    face = _face(artefact, radius, height) if fit.segments.shoulder_seen else None
    level = _edge(artefact, radius, height) if face is None else face
    if level is None:
        return replace(fit, segments=replace(fit.segments, shoulder_seen=False))
    return replace(_moved(fit, level.value, seen=face is not None), height_u=level.u)


def _in_shaft(scan: Scan, fit: Refined) -> tuple[Array, Array]:
    """Radius and height in C (n, M) mm of the readings of evenly spread profiles."""
    p = fit.solution.parameters
    rows = scan.spread(SAMPLED_PROFILES)
    angle = fit.model.angle(p, scan.angle[rows])[:, None]
    radius, height = np.empty((2, rows.size, scan.x.shape[1]))
    for first in range(0, rows.size, BLOCK):
        at = slice(first, first + BLOCK)
        points = points_of(p[:UNKNOWNS], fit.model.height, scan.x[rows[at]], scan.z[rows[at]], angle[at])
        radius[at], height[at] = np.hypot(points[..., 0], points[..., 1]), points[..., 2]
    return radius, height


def _face(artefact: Artefact, radius: Array, height: Array) -> _Level | None:
    """Height above the drawing's shoulder of the readings on its face, clear of its fillet and chamfer.

    None where there are too few, or where their height changes across the face: that is a fillet, no face.
    """
    inner, outer = sorted(c.radius for c in artefact.cylinders[:2])
    margin = min(0.5, 0.2 * (outer - inner))
    above = height - artefact.shoulder
    on = (radius > inner + margin) & (radius < outer - margin) & (np.abs(above) < FACE_REACH_MM)
    face, across = above[on], radius[on]
    if face.size < LEAST_POINTS:
        return None
    inside = across < np.median(across)
    if not inside.any():
        return None
    slope = float(np.median(face[~inside]) - np.median(face[inside]))
    if abs(slope) >= MOST_FACE_SLOPE_MM:
        return None
    return _Level(_middle(face), _scatter(face, np.nonzero(on)[0], len(radius)))


def _middle(heights: Array) -> float:
    """The median of a slab of readings, with the slab moved until it is centred on it."""
    middle = float(np.median(heights))
    for _ in range(5):
        middle = float(np.median(heights[np.abs(heights - middle) <= FACE_REACH_MM / 2]))
    return middle


def _scatter(heights: Array, row: Ints, profiles: int) -> float:
    """Standard uncertainty (mm) of the middle of heights (n,) read in profiles ``row`` (n,): by how much groups of
    successive profiles differ, the face's own waves among them.
    """
    group = row * GROUPS // profiles
    middles = [float(np.median(heights[group == g])) for g in np.unique(group)]
    return float(np.std(middles, ddof=1)) / sqrt(len(middles)) if len(middles) > 1 else FACE_REACH_MM


def _edge(artefact: Artefact, radius: Array, height: Array) -> _Level | None:
    """Height above the drawing's shoulder at which the larger cylinder ends; None where that end is not in view.

    Each profile ends with its last reading there; the edge lies on average mean(g^2) / (2 mean(g)) further, g being the
    gaps between readings, lost ones included (the waiting time of renewal theory).
    """
    lower, upper = artefact.cylinders[:2]
    larger, outwards = (lower, 1.0) if lower.radius > upper.radius else (upper, -1.0)
    beyond = outwards * (height - artefact.shoulder)
    reach = min(FACE_REACH_MM, abs(lower.radius - upper.radius) / 2)  # nearer to this cylinder than to the other
    beyond = np.where(np.abs(radius - larger.radius) < reach, beyond, np.nan)
    steps = np.abs(np.diff(beyond, axis=1))
    step = float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0
    row, column = np.nonzero(np.abs(beyond) < max(EDGE_REACH_MM, EDGE_REACH_STEPS * step))
    readings = beyond[row, column]
    order = np.lexsort((readings, row))
    row, readings = row[order], readings[order]
    same = row[1:] == row[:-1]
    gaps = np.diff(readings)[same]
    if gaps.size < LEAST_POINTS:
        return None
    last = np.append(~same, True)
    ends = readings[last]
    level = outwards * float(ends.mean() + np.mean(gaps**2) / (2 * gaps.mean()))
    return _Level(level, hypot(_scatter(ends, row[last], len(radius)), _within_a_step(ends, step)))


def _within_a_step(ends: Array, step: float) -> float:
    """Standard uncertainty (mm) of an edge that lies within a ``step`` (mm) beyond each of the ``ends`` (n,).

    A mean of ends errs as a sawtooth of where the edge lies between readings; where the shaft's eccentricity moves the
    readings over it by whole steps, its waves (of 1 / k, Fourier) cancel. step / sqrt(12) where nothing moves them.
    """
    waves = np.arange(1, GRID_WAVES + 1)
    left = np.abs(np.exp(1j * tau / step * np.outer(waves, ends)).mean(axis=1)) / waves
    return step / (pi * sqrt(2.0)) * float(np.linalg.norm(left))


def _moved(fit: Refined, shift: float, seen: bool) -> Refined:
    """The fit with every height counted from ``shift`` mm along the laser plane: the same surface, in other unknowns.

    What was known beforehand of the laser plane and the axis now holds at the new height.
    """
    old = fit.solution.parameters
    tilt, up = old[PLANE_TILT], cos(old[PLANE_TILT]) * shift
    p = old.copy()
    p[PLANE_OFFSET] += sin(tilt) * shift
    p[ECCENTRICITY] += old[TILT] * up
    # How the old unknowns follow the new ones.
    follow = np.eye(p.size)
    follow[PLANE_OFFSET, PLANE_TILT] = -up
    follow[ECCENTRICITY_X, TILT_X] = follow[ECCENTRICITY_Y, TILT_Y] = -up
    follow[ECCENTRICITY, PLANE_TILT] = old[TILT] * sin(tilt) * shift
    model = replace(fit.model, height=fit.model.height - shift, middles=tuple(m - up for m in fit.model.middles))
    bands = tuple(replace(b, low=b.low - shift, high=b.high - shift) for b in fit.segments.bands)
    solution = replace(
        fit.solution,
        parameters=p,
        gradient=follow.T @ fit.solution.gradient,
        information=follow.T @ fit.solution.information @ follow,
    )
    moved = replace(
        fit,
        model=model,
        segments=replace(fit.segments, bands=bands, height=model.height, shoulder_seen=seen),
        solution=solution,
        score_covariance=follow.T @ fit.score_covariance @ follow,
    )
    return moved.held_by(fit.priors)
