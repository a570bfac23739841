"""One virtual scan: turn the table, cast the fan, add what sensor and table add."""

from collections.abc import Callable
from dataclasses import dataclass
from math import tan

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from truestand.core.artefact import Artefact
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.sim.cast import Hits, Rays, first_hits, hidden, rays_in_shaft
from truestand.sim.cast_mesh import hidden_by, meet_body
from truestand.sim.incidence import cosines, grazing, mixed
from truestand.sim.parts import Scene, VirtualPart, scene_of
from truestand.sim.simulation import Simulation
from truestand.sim.trouble import (
    Speckle,
    false_and_lost,
    lose_patches,
    noise,
    quantised,
    range_error,
    table_angles,
)
from truestand.sim.truth import Truth, rotor_from_shaft, sensor_pose

Array = NDArray[np.float64]

BLOCK = 128
"""Profiles cast at once."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """A virtual scan and its truth."""

    recording: Recording
    truth: Truth


def simulate(
    stand: Stand,
    simulation: Simulation,
    artefact: Artefact,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    part: VirtualPart | None = None,
) -> Simulated:
    """Scan ``artefact``, with ``part`` on it, on the virtual stand; the same seed gives the same scan.

    ``progress`` is called with (profiles done, profiles in all).

    Raises:
        BadRecipe: a part that can't be, or not on this shaft.
    """
    rng = default_rng(seed)
    truth, counter, time = _truth(stand, simulation, artefact, part, rng)
    x, z = _cast(truth, artefact, rng, progress)
    lose_patches(z, simulation.optics, rng)
    x[np.isnan(z)] = np.nan
    return Simulated(_recording(truth, x, z, counter, time), truth)


def _truth(
    stand: Stand, simulation: Simulation, artefact: Artefact, part: VirtualPart | None, rng: Generator
) -> tuple[Truth, NDArray[np.int64], Array]:
    angle, counter, time, step = table_angles(stand, simulation.acquisition, rng)
    back = rotor_from_shaft(simulation.running, simulation.mounting.azimuth)
    shaft_from_rotor = np.eye(4)
    shaft_from_rotor[:3, :3] = back[:3, :3].T
    shaft_from_rotor[:3, 3] = -back[:3, :3].T @ back[:3, 3]
    pose = sensor_pose(simulation.mounting, artefact)
    return Truth(stand, simulation, pose, shaft_from_rotor, step, angle, artefact, part), counter, time


def _cast(
    truth: Truth, artefact: Artefact, rng: Generator, progress: Callable[[int, int], None] | None
) -> tuple[Array, Array]:
    """x and z (N, M) mm as the sensor reports them, before x is mirrored."""
    optics = truth.simulation.optics
    sensor = truth.stand.sensor
    points = sensor.points or 640
    limits = sensor.range or (0.0, 1e6)
    slopes = np.linspace(-tan(optics.fan / 2), tan(optics.fan / 2), points)
    pose = truth.table_from_sensor
    directions = pose[:3, 0, None] * slopes + pose[:3, 2, None]  # one unit of range along each ray
    scene = scene_of(artefact, truth.simulation.workpiece, truth.part)
    speckle = Speckle(optics, rng)
    shoulder = artefact.base.top
    x, z = np.empty((truth.angle.size, points)), np.empty((truth.angle.size, points))
    for first in range(0, truth.angle.size, BLOCK):
        rows = slice(first, min(first + BLOCK, truth.angle.size))
        rays = rays_in_shaft(pose[:3, 3], directions, truth.angle[rows], truth.shaft_from_rotor)
        hits = _hits(rays, scene)
        true = _visible(hits, rays, truth, truth.angle[rows], scene)
        added: Array | float = 0.0
        if truth.part is not None or optics.incidence_noise or optics.incidence_bias:
            true, added = grazing(true, cosines(rays, hits, scene), optics, rng)
        true = mixed(true, optics.mixed_pixels, rng)
        seen = true + range_error(true, optics, limits) + noise(true.shape, optics, rng)
        seen = seen + speckle(hits.psi, hits.height) + added
        seen = false_and_lost(seen, hits.height, optics, limits, shoulder, rng)
        with np.errstate(invalid="ignore"):
            seen[(seen < limits[0]) | (seen > limits[1])] = np.nan
        x[rows] = quantised(np.where(np.isfinite(true), true, seen) * slopes, optics.step_x)
        z[rows] = quantised(seen, optics.step_z)
        if progress is not None:
            progress(rows.stop, truth.angle.size)
    return x, z


def _hits(rays: Rays, scene: Scene) -> Hits:
    """The first hits on shaft and part."""
    hits = first_hits(rays, scene.steps, scene.faces)
    if scene.body is not None:
        meet_body(rays, scene.body, hits)
    return hits


def _visible(hits: Hits, rays: Rays, truth: Truth, angle: Array, scene: Scene) -> Array:
    """Range of the hits, NaN where there is none or the camera does not see it."""
    distance = np.where(np.isfinite(hits.distance), hits.distance, np.nan)
    triangulation = truth.simulation.optics.triangulation
    if not triangulation:
        return distance
    pose = truth.table_from_sensor
    sideways = truth.simulation.mounting.standoff * tan(triangulation)
    eye = rays_in_shaft(pose[:3, 3] + sideways * pose[:3, 1], np.zeros((3, 1)), angle, truth.shaft_from_rotor).origin
    points = rays.origin + distance * rays.direction
    unseen = hidden(points, eye, scene.steps)
    if scene.body is not None:
        unseen |= hidden_by(points, eye, hits, scene.body)
    return np.where(unseen, np.nan, distance)


def _recording(truth: Truth, x: Array, z: Array, counter: NDArray[np.int64], time: Array) -> Recording:
    stand, columns = truth.stand, truth.simulation.acquisition.columns
    reported = stand.table.sign * truth.angle
    counts = stand.counts_per_turn or 36000
    return Recording(
        -x if stand.sensor.mirrored else x,
        z,
        "simulated",
        "",
        time=time if "time" in columns else None,
        angle=reported if "angle" in columns else None,
        encoder=np.rint(reported / (2 * np.pi) * counts) if "encoder" in columns else None,
        counter=counter if "counter" in columns else None,
    )
