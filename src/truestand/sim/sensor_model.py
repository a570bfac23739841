"""Profiles of one sensor of the virtual stand at given table angles: hits of its rays with the errors of its optics."""

from math import tan

import numpy as np
from numpy.random import Generator

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.stand import Stand
from truestand.sim.parts import VirtualPart, scene_of
from truestand.sim.poses import sensor_pose, shaft_from_rotor
from truestand.sim.raycast import Hits, Rays, first_hits, occluded_by_steps, rays_in_shaft
from truestand.sim.raycast_mesh import meet_body, occluded_by_body
from truestand.sim.sensor_errors import (
    Speckle,
    incidence_cosines,
    incidence_noise,
    noise,
    quantised,
    range_error,
    with_false_readings,
    with_incidence_bias,
    with_mixed_pixels,
)
from truestand.sim.simulation import Simulation

DEFAULT_POINTS = 640


class SensorModel:
    """Computes profiles on demand; ``rng`` gives the noise, in the order of the calls.

    Raises:
        BadRecipe: a part that can't be, or not on this shaft.
    """

    def __init__(
        self, stand: Stand, simulation: Simulation, artefact: Artefact, part: VirtualPart | None, rng: Generator
    ) -> None:
        self.simulation = simulation
        self.table_from_sensor = sensor_pose(simulation.mounting, artefact)
        """(4, 4)."""
        self.shaft_from_rotor = shaft_from_rotor(simulation.running, simulation.mounting.azimuth)
        """(4, 4)."""
        self.points = stand.sensor.points or DEFAULT_POINTS
        self.mirrored = stand.sensor.mirrored
        """The sensor reports -x."""
        self._limits = stand.sensor.range or (0.0, 1e6)
        self._rng = rng
        self._scene = scene_of(artefact, simulation.workpiece, part)
        self._has_part = part is not None
        self._shoulder = artefact.base.top
        half_width = tan(simulation.optics.fan / 2)
        self._slopes = np.linspace(-half_width, half_width, self.points)
        pose = self.table_from_sensor
        self._directions = pose[:3, 0, None] * self._slopes + pose[:3, 2, None]
        """(3, M) in T: one unit of range along each ray."""
        self._speckle = Speckle(simulation.optics, rng)

    def profiles(self, angle: Array) -> tuple[Array, Array]:
        """x, not yet mirrored, and z (n, M) mm at true table angles (n,) rad; NaN in z = not seen."""
        optics, rng, limits = self.simulation.optics, self._rng, self._limits
        rays = rays_in_shaft(self.table_from_sensor[:3, 3], self._directions, angle, self.shaft_from_rotor)
        hits = self._hits(rays)
        true = self._visible(hits, rays, angle)
        added: Array | float = 0.0
        if self._has_part or optics.incidence_noise or optics.incidence_bias or optics.flank_bias:
            cosine = incidence_cosines(rays, hits, self._scene)
            true, added = with_incidence_bias(true, cosine, optics), incidence_noise(cosine, optics, rng)
        true = with_mixed_pixels(true, optics.mixed_pixels, rng)
        seen = true + range_error(true, optics, limits) + noise(true.shape, optics, rng)
        seen = seen + self._speckle(hits.psi, hits.height) + added
        seen = with_false_readings(seen, hits.height, optics, limits, self._shoulder, rng)
        with np.errstate(invalid="ignore"):
            seen[(seen < limits[0]) | (seen > limits[1])] = np.nan
        x = quantised(np.where(np.isfinite(true), true, seen) * self._slopes, optics.step_x)
        return x, quantised(seen, optics.step_z)

    def _hits(self, rays: Rays) -> Hits:
        """The first hits on shaft and part."""
        hits = first_hits(rays, self._scene.steps, self._scene.faces)
        if self._scene.body is not None:
            meet_body(rays, self._scene.body, hits)
        return hits

    def _visible(self, hits: Hits, rays: Rays, angle: Array) -> Array:
        """Range of the hits, NaN where there is none or the camera does not see it."""
        distance = np.where(np.isfinite(hits.distance), hits.distance, np.nan)
        triangulation = self.simulation.optics.triangulation
        if not triangulation:
            return distance
        pose = self.table_from_sensor
        sideways = self.simulation.mounting.standoff * tan(triangulation)
        camera_in_table = pose[:3, 3] + sideways * pose[:3, 1]
        camera = rays_in_shaft(camera_in_table, np.zeros((3, 1)), angle, self.shaft_from_rotor).origin
        points = rays.origin + distance * rays.direction
        occluded = occluded_by_steps(points, camera, self._scene.steps)
        if self._scene.body is not None:
            occluded |= occluded_by_body(points, camera, hits, self._scene.body)
        return np.where(occluded, np.nan, distance)
