"""Errors that a real sensor adds to the geometry: range errors, noise, steep incidence, lost and false readings."""

import numpy as np
from numpy.random import Generator

from truestand.core.arrays import Array
from truestand.sim.parts import Scene
from truestand.sim.raycast import FACE, MESH, STEP, Hits, Rays
from truestand.sim.simulation import Optics

GHOST_HEIGHT_MM = 3.0
"""On either side of the shoulder, where double reflections happen."""
REFLECTION_POSITION = 0.45
"""Share of the range from which a reflection that does not turn comes back."""
PATCH_PROFILES, PATCH_POINTS = 40, 30
"""Size of a patch of lost readings."""
MAX_GAIN = 20.0
"""Noise and bias grow no further: 1 / cos of about 87 degrees."""
EDGE_MM = 0.5
"""Range from one reading to its neighbour: an edge lies between them."""


def range_error(z: Array, optics: Optics, limits: tuple[float, float]) -> Array:
    """The sensor's smooth range error (mm), a function of range only."""
    low, high = limits
    error = optics.scale_error * (z - (low + high) / 2)
    for waves, amplitude, phase in ((1, optics.nonlinearity, optics.nonlinearity_phase), *optics.faster_nonlinearity):
        if amplitude:
            error = error + amplitude * np.sin(2 * np.pi * waves * (z - low) / (high - low) + phase)
    return np.asarray(error)


def noise(shape: tuple[int, int], optics: Optics, rng: Generator) -> Array:
    """White noise, and noise that neighbouring points of a line share; mm."""
    total = rng.normal(0.0, optics.noise, shape) if optics.noise else np.zeros(shape)
    if optics.correlated_noise:
        n = optics.correlation
        white = rng.normal(0.0, optics.correlated_noise, (shape[0], shape[1] + n - 1))
        sums = np.cumsum(np.pad(white, ((0, 0), (1, 0))), axis=1)
        total = total + (sums[:, n:] - sums[:, :-n]) / np.sqrt(n)
    return total


class Speckle:
    """A random field fixed to the surface: the same cell gives the same error on every turn."""

    def __init__(self, optics: Optics, rng: Generator) -> None:
        self.cell = optics.speckle_cell
        self.field = rng.normal(0.0, optics.speckle, (1009, 2003)) if optics.speckle else None

    def __call__(self, psi: Array, height: Array) -> Array | float:
        """The error (mm) at polar angle and height."""
        if self.field is None:
            return 0.0
        around = np.floor(psi * (10.0 / self.cell)).astype(np.intp)
        up = np.floor(height / self.cell).astype(np.intp)
        return np.asarray(self.field[(around + 7 * up) % 1009, (up + 31 * around) % 2003])


def incidence_cosines(rays: Rays, hits: Hits, scene: Scene) -> Array:
    """cos of the angle between ray and surface normal (B, M), 0..1; steps are taken as upright; 1 where nothing is."""
    direction = rays.direction / np.linalg.norm(rays.direction, axis=0)
    cosine = np.ones(hits.distance.shape)
    on = hits.surface == STEP
    cosine[on] = np.abs(np.cos(hits.psi[on]) * direction[0][on] + np.sin(hits.psi[on]) * direction[1][on])
    on = hits.surface == FACE
    cosine[on] = np.abs(direction[2][on])
    if scene.body is not None:
        on = hits.surface == MESH
        normal = scene.body.normals[hits.triangle[on]] @ scene.body.shaft_from_part[:3, :3].T
        cosine[on] = np.abs(np.einsum("ij,ji->i", normal, direction[:, on]))
    return cosine


def with_incidence_bias(true: Array, cosine: Array, optics: Optics) -> Array:
    """Range (B, M) with the biases of incidence, NaN beyond the greatest one."""
    biased = true + optics.incidence_bias * (_gain(cosine) - 1.0)
    if optics.flank_bias:
        angles, outward = np.transpose(optics.flank_bias)
        biased = biased - np.interp(np.arccos(np.clip(cosine, 0.0, 1.0)), angles, outward) * _gain(cosine)
    return np.where(cosine < np.cos(optics.most_incidence), np.nan, biased)


def incidence_noise(cosine: Array, optics: Optics, rng: Generator) -> Array | float:
    """The noise (B, M) mm that incidence adds: white noise of 1 is there already, this makes it 1 / cos."""
    if not (optics.incidence_noise and optics.noise):
        return 0.0
    return rng.normal(0.0, optics.noise, cosine.shape) * np.sqrt(_gain(cosine) ** 2 - 1.0)


def _gain(cosine: Array) -> Array:
    return np.minimum(1.0 / np.maximum(cosine, 1e-6), MAX_GAIN)


def with_mixed_pixels(true: Array, share: float, rng: Generator) -> Array:
    """Ranges (B, M), some of those at an edge, along the line or from line to line, from between both surfaces."""
    if not share:
        return true
    mixture = true.copy()
    for axis, step in ((1, 1), (1, -1), (0, 1), (0, -1)):
        neighbour = np.roll(true, step, axis=axis)
        border = [slice(None), slice(None)]
        border[axis] = slice(0, 1) if step > 0 else slice(-1, None)
        neighbour[tuple(border)] = np.nan
        with np.errstate(invalid="ignore"):
            at = (np.abs(neighbour - true) > EDGE_MM) & (rng.random(true.shape) < share)
        mixture = np.where(at, true + rng.random(true.shape) * (neighbour - true), mixture)
    return mixture


def with_false_readings(
    z: Array, height: Array, optics: Optics, limits: tuple[float, float], shoulder: float, rng: Generator
) -> Array:
    """Readings with ghosts, reflections, outliers and random losses put in."""
    low, high = limits
    if optics.ghosts:
        with np.errstate(invalid="ignore"):
            near = (np.abs(height - shoulder) < GHOST_HEIGHT_MM) & (rng.random(z.shape) < optics.ghosts)
        z = np.where(near, z + rng.uniform(-1.5, 1.5, z.shape), z)
    if optics.reflection:
        reflected = low + REFLECTION_POSITION * (high - low) + rng.normal(0.0, optics.noise, z.shape)
        z = np.where(rng.random(z.shape) < optics.reflection, reflected, z)
    if optics.outliers:
        z = np.where(rng.random(z.shape) < optics.outliers, rng.uniform(low, high, z.shape), z)
    if optics.dropouts:
        z = np.where(rng.random(z.shape) < optics.dropouts, np.nan, z)
    return z


def lose_patches(z: Array, optics: Optics, rng: Generator) -> None:
    """Whole patches of readings lost, in place."""
    for _ in range(optics.patches):
        row, column = rng.integers(0, z.shape[0]), rng.integers(0, z.shape[1])
        z[row : row + PATCH_PROFILES, column : column + PATCH_POINTS] = np.nan


def quantised(values: Array, step: float) -> Array:
    """Whole steps, as the decimal number that a sensor's file would hold."""
    if not step:
        return values
    per_mm = round(1.0 / step)
    if abs(per_mm * step - 1.0) > 1e-9:
        return np.asarray(np.rint(values / step) * step)
    return np.asarray(np.rint(values * per_mm) / per_mm)
