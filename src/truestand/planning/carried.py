"""Places that a positioner can bring its sensor to, instead of all that there are."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import degrees, radians

import numpy as np

from truestand.core.errors import BadRecipe
from truestand.planning.corridor import Corridors
from truestand.planning.kinematics import Kinematics, Motion, Position
from truestand.planning.place import Place

TRIED = (400, 50, 14, 8)
"""Positions of each axis that are tried, of so many axes."""
STEP_MM, STEP_RAD = 2.0, radians(2.0)
"""By which a position is made better."""


@dataclass(frozen=True, slots=True)
class Carrier:
    """A positioner, and the sensor that it carries."""

    kinematics: Kinematics
    device: str
    position_U: float
    """mm along any direction, k = 2: how well it takes a place again,"""
    position_tilt_U: float
    """and rad about any."""

    @property
    def home(self) -> Position:
        """Where it is once its axes have homed."""
        return (0.0,) * len(self.kinematics.axes)

    def places(self, base_radius: float) -> Iterator[tuple[Position, Place]]:
        """Positions over all axes, and the places that they are."""
        axes = self.kinematics.axes
        each = [np.linspace(*axis.reach, TRIED[len(axes) - 1]) for axis in axes]
        for values in np.stack(np.meshgrid(*each, indexing="ij"), axis=-1).reshape(-1, len(axes)).tolist():
            if (place := self.kinematics.place(values, base_radius)) is not None:
                yield tuple(values), place

    def beside(self, position: Position) -> Iterator[Position]:
        """Positions a step away."""
        for k, axis in enumerate(self.kinematics.axes):
            for step in (STEP_MM, -STEP_MM) if axis.linear else (STEP_RAD, -STEP_RAD):
                yield (*position[:k], float(np.clip(position[k] + step, *axis.reach)), *position[k + 1 :])

    def rounded(self, position: Position) -> Position:
        """To half a mm, or half a degree."""
        return tuple(_rounded(axis, value) for axis, value in zip(self.kinematics.axes, position, strict=True))

    def barred(self, corridors: Corridors, positions: Sequence[Position]) -> str:
        """Why it can't go from home to some positions, one after the other; empty: it can."""
        try:
            for before, after in pairwise([self.home, *positions]):
                corridors.way(before, after, "a place")
        except BadRecipe as error:
            return str(error)
        return ""


def _rounded(axis: Motion, value: float) -> float:
    found = round(2 * value) / 2 if axis.linear else radians(round(2 * degrees(value)) / 2)
    return float(np.clip(found, *axis.reach))
