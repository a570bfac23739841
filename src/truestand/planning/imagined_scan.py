"""Scans as they would be taken, of bodies on which rays can be cast: the shaft itself, turned parts, CAD models."""

from collections.abc import Sequence
from math import tau

import numpy as np

from truestand.core.arrays import Array
from truestand.core.frames import Pose, about_axis, in_rotor, shaft_from_rotor
from truestand.core.scan import AngleSource, Scan
from truestand.core.stand import Stand
from truestand.planning.obstacles import Cast
from truestand.planning.optics import Optics
from truestand.planning.place import Place

TILT = 3e-4
"""rad, at a right angle to the eccentricity: no shaft runs quite straight."""


def shaft_of_run_out(eccentricity: float) -> Pose:
    """The shaft_from_rotor of a shaft that runs out by so much, mm."""
    return shaft_from_rotor(eccentricity, 0.0, 0.0, TILT)


def imagined_scan(
    bodies: Sequence[Cast], place: Place, base_radius: float, optics: Optics, stand: Stand, eccentricity: float,
    turns: float, profiles: int,
) -> Scan:  # fmt: skip
    """What the sensor of a ``stand`` with one would read from a place of ``bodies`` that run out, mm, in so many
    profiles of ``turns`` turns.
    """
    pose = place.pose(base_radius)
    first, running = about_axis(place.azimuth, 0.0), shaft_of_run_out(eccentricity)
    angle = stand.table.sign * tau * turns * np.arange(profiles) / profiles
    across = optics.slopes
    directions = np.stack([across, np.zeros_like(across), np.ones_like(across)], axis=-1) @ pose.rotation.T
    origin = _in_shaft(pose.translation, angle, running @ first, moved=True)
    length = np.linalg.norm(directions, axis=1)
    ways = np.stack([_in_shaft(d, angle, running @ first, moved=False) for d in directions / length[:, None]], axis=1)
    distance = np.fmin.reduce([body.hit(origin[:, None], ways) for body in bodies]) / length
    z = np.where(np.isfinite(distance), distance, np.nan)
    z = z + optics.noise * np.random.default_rng(1).standard_normal(z.shape)
    with np.errstate(invalid="ignore"):
        x = across * z
        z = np.where(optics.in_view(x, z), z, np.nan)
    return Scan(x, z, angle, stand, angle_source(stand))


def angle_source(stand: Stand) -> AngleSource:
    """What the table's angle will rest on: an encoder, where the stand has one."""
    return (
        "encoder" if stand.counts_per_turn or stand.y == "encoder" else "angle" if stand.y == "angle_deg" else "index"
    )


def _in_shaft(vector: Array, angle: Array, pose: Pose, moved: bool) -> Array:
    """A point or direction (3,) of T, in C at table angles (n,): (n, 3)."""
    x, y, z = vector
    turned = np.stack([*in_rotor(x, y, angle), np.full(angle.size, z)], axis=-1)
    return pose(turned) if moved else turned @ pose.rotation.T
