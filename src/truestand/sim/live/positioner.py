"""The virtual positioner: axes behind their controllers, and where they really bring the sensor."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, degrees, inf, radians, sin

import numpy as np

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.devices.tables.recipe import ControllerRecipe
from truestand.sim.live.clock import Clock
from truestand.sim.live.table import Motion, VirtualTable
from truestand.sim.poses import mounting_of, rigid, sensor_pose, turned
from truestand.sim.simulation import Mounting

MOTION = Motion(
    acceleration=radians(200.0), deceleration=radians(400.0), top_speed=radians(100.0), power_on=radians(4.0),
    home_speed=radians(40.0), mark_every=inf,
)  # fmt: skip
"""Of an axis; mm of a linear one where a table has degrees."""
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class AxisEndpoint:
    """Address, protocol and kinematics of a virtual axis. ``AxisRecipe`` would bring in the geometry of the station,
    which sim must not share.
    """

    name: str
    recipe: ControllerRecipe
    linear: bool
    direction: Vector
    """Unit vector."""
    through: Vector

    def moved(self, value: float) -> Array:
        """(4, 4): how what it carries moves from zero to ``value`` (mm or rad)."""
        along = np.array(self.direction)
        if self.linear:
            return rigid(np.eye(3), value * along)
        x, y, z = along
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotation = cos(value) * np.eye(3) + sin(value) * cross + (1.0 - cos(value)) * np.outer(along, along)
        return rigid(rotation, np.array(self.through) - rotation @ self.through)


class VirtualPositioner:
    """Axes, the first one on the ground, and by how much (mm, rad, standard deviations) each arrival is off."""

    def __init__(
        self, clock: Clock, axes: Sequence[AxisEndpoint], repeats_within: tuple[float, float], seed: int
    ) -> None:
        self.endpoints = tuple(axes)
        self.axes = tuple(VirtualTable(clock, MOTION) for _ in axes)
        self._repeats_within = repeats_within
        self._rng = np.random.default_rng(seed)
        self._arrived: tuple[float, ...] | None = None
        self._off = np.eye(4)

    @property
    def position(self) -> tuple[float, ...]:
        """Of each axis, mm or rad."""
        found = [axis.status().position for axis in self.axes]
        return tuple(degrees(p) if e.linear else p for p, e in zip(found, self.endpoints, strict=True))

    def carried(self, standing: Mounting, at: tuple[float, ...], artefact: Artefact) -> Mounting | None:
        """Where a sensor stands now that was mounted so as to be ``standing`` there when the axes are ``at`` (mm or
        rad); None while they move.
        """
        position = self.position
        if any(axis.status().moving for axis in self.axes):
            return None
        if position != self._arrived:
            self._arrived, self._off = position, self._missed()
        there = turned(standing.azimuth) @ sensor_pose(standing, artefact)
        return mounting_of(self._moved(position) @ np.linalg.inv(self._moved(at)) @ there @ self._off, artefact)

    def _moved(self, position: tuple[float, ...]) -> Array:
        pose = np.eye(4)
        for endpoint, value in zip(self.endpoints, position, strict=True):
            pose = pose @ endpoint.moved(value)
        return pose

    def _missed(self) -> Array:
        """(4, 4): by how much the sensor is off its place this time, along and about its own axes."""
        shift, turn = self._repeats_within
        x, y, z = self._rng.normal(0.0, turn, 3)
        rotation = np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        u, _, v = np.linalg.svd(rotation)
        return rigid(u @ v, self._rng.normal(0.0, shift, 3))
