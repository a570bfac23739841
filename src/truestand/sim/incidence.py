"""What grazing light and edges do to a reading."""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from truestand.sim.parts import Scene
from truestand.sim.raycast import FACE, MESH, STEP, Hits, Rays
from truestand.sim.simulation import Optics

Array = NDArray[np.float64]

MOST_GAIN = 20.0
"""Noise and bias grow no further: 1 / cos of about 87 degrees."""
EDGE = 0.5
"""mm of range from one reading to its neighbour: an edge lies between them."""


def cosines(rays: Rays, hits: Hits, scene: Scene) -> Array:
    """cos of the angle between ray and surface normal (B, M), 0..1; steps are taken as upright; 1 where nothing is."""
    way = rays.direction / np.linalg.norm(rays.direction, axis=0)
    cosine = np.ones(hits.distance.shape)
    on = hits.surface == STEP
    cosine[on] = np.abs(np.cos(hits.psi[on]) * way[0][on] + np.sin(hits.psi[on]) * way[1][on])
    on = hits.surface == FACE
    cosine[on] = np.abs(way[2][on])
    if scene.body is not None:
        on = hits.surface == MESH
        normal = scene.body.normals[hits.triangle[on]] @ scene.body.shaft_from_part[:3, :3].T
        cosine[on] = np.abs(np.einsum("ij,ji->i", normal, way[:, on]))
    return cosine


def grazing(true: Array, cosine: Array, optics: Optics, rng: Generator) -> tuple[Array, Array]:
    """Range (B, M) with the bias of incidence, NaN beyond the greatest one; and the noise that incidence adds, mm."""
    gain = np.minimum(1.0 / np.maximum(cosine, 1e-6), MOST_GAIN)
    biased = np.where(cosine < np.cos(optics.most_incidence), np.nan, true + optics.incidence_bias * (gain - 1.0))
    if not (optics.incidence_noise and optics.noise):
        return biased, np.zeros(true.shape)
    # White noise of 1 is there already: this makes it ``gain``.
    return biased, rng.normal(0.0, optics.noise, true.shape) * np.sqrt(gain**2 - 1.0)


def mixed(true: Array, share: float, rng: Generator) -> Array:
    """Ranges (B, M), some of those at an edge, along the line or from line to line, from between both surfaces."""
    if not share:
        return true
    mixture = true.copy()
    for axis, way in ((1, 1), (1, -1), (0, 1), (0, -1)):
        other = np.roll(true, way, axis=axis)
        border = [slice(None), slice(None)]
        border[axis] = slice(0, 1) if way > 0 else slice(-1, None)
        other[tuple(border)] = np.nan
        with np.errstate(invalid="ignore"):
            at = (np.abs(other - true) > EDGE) & (rng.random(true.shape) < share)
        mixture = np.where(at, true + rng.random(true.shape) * (other - true), mixture)
    return mixture
