"""What of a part must be seen, whatever the part is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.calibration import Calibration
from truestand.core.inspection import Characteristic, Status
from truestand.core.scan import Scan
from truestand.planning.kinematics import Position
from truestand.planning.obstacles import Body, Round
from truestand.planning.optics import Optics
from truestand.planning.place import Place


@dataclass(frozen=True, slots=True)
class Surfaces:
    """Points of the surfaces that must be seen, in C."""

    names: tuple[str, ...]
    points: Array
    """(n, 3) mm."""
    normals: Array
    """(n, 3), outwards."""
    of: Ints
    """(n,): which of the names."""

    def coverage(self, seen: Mask) -> dict[str, float]:
        """Share of the points of each surface that are ``seen`` (n,)."""
        count = np.bincount(self.of, minlength=len(self.names))
        shown = np.bincount(self.of[seen], minlength=len(self.names))
        return {name: float(share) for name, share in zip(self.names, shown / np.maximum(count, 1), strict=True)}


@dataclass(frozen=True, slots=True)
class PlannedSensor:
    """A view's sensor, before it has a place."""

    name: str
    """Of the view."""
    device: str
    optics: Optics
    carried: bool = False
    """By the positioner."""


@dataclass(frozen=True, slots=True)
class Mount:
    """A sensor in a place."""

    sensor: PlannedSensor
    place: Place
    clearance: float
    """mm: between its housing and the nearest thing."""
    position: Position | None = None
    """mm and rad: of the positioner's axes, where it carries it there."""


@dataclass(frozen=True, slots=True)
class View:
    """A sensor in a place, with the calibration that it would have there."""

    mount: Mount
    scan: Scan
    """Of the shaft."""
    calibration: Calibration
    """In the frames of the first view."""

    def by(self, sensor: PlannedSensor) -> "View":
        """The same by another sensor of its kind."""
        if sensor == self.mount.sensor:
            return self
        stand = self.scan.stand
        stand = replace(stand, sensors=(replace(stand.sensor, name=sensor.name, device=sensor.device),))
        return View(
            replace(self.mount, sensor=sensor), replace(self.scan, stand=stand), replace(self.calibration, stand=stand)
        )


ORDER: tuple[Status, ...] = ("measured", "partial", "not_measurable")
"""Of what views tell, the best first."""


class Target(Protocol):
    """A part for which sensors are placed."""

    @property
    def surfaces(self) -> Surfaces:
        """What must be seen."""

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The part, which nothing sees through."""

    @property
    def shaft(self) -> tuple[Round, ...]:
        """What there is of the shaft beside the part."""

    @property
    def swept(self) -> tuple[Round, ...]:
        """What it sweeps as it turns."""

    def lines(self, views: Sequence[View]) -> tuple[Characteristic, ...]:
        """The lines that an inspection by these views would have."""

    def rough_shares(self, views: Sequence[View]) -> dict[str, float]:
        """About how large U would be, as a share of what the limits leave, for the worst figure of each surface that
        views show.
        """


Limits = tuple[float | None, float | None]


def room_of(limits: Limits | None, from_zero: bool) -> float | None:
    """mm between two limits; None: there are none, or one is open. ``from_zero``: the least value is 0 where there is
    no lower limit.
    """
    low, high = limits or (None, None)
    low = 0.0 if low is None and from_zero else low
    return None if low is None or high is None else max(high - low, 1e-9)


def share_of_room(line: Characteristic) -> float | None:
    """U of a line as a share of the room between its limits; None: without limits, or not known."""
    room = room_of(line.limits, not line.size)
    return None if room is None or line.U is None else line.U / room
