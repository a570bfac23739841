"""A clear way for a positioner: one axis after the other, the housing nowhere near what stands or turns about."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np

from truestand.core.errors import BadRecipe
from truestand.planning.kinematics import Kinematics, Position
from truestand.planning.obstacles import Round
from truestand.planning.room import Room, Size, clearance, corners

FAR = 20.0
"""mm more than what is needed, from which it doesn't matter how much more."""
LEAST_ADVANCE = 0.25
"""mm of the housing between two looks at its clearance, at least."""


@dataclass(frozen=True, slots=True)
class Corridors:
    """Ways of one sensor on a positioner."""

    kinematics: Kinematics
    housing: Size
    bodies: tuple[Round, ...]
    """What turns, and the table."""
    room: Room

    def clearance(self, position: Position) -> float:
        """mm between the housing and all else, as ``room.clearance`` has it."""
        least = self.room.least_clearance
        pose = self.kinematics.pose(position)
        return clearance(pose, self.housing, self.bodies, self.room, least, least + FAR)

    def way(self, start: Position, end: Position, called: str) -> tuple[Position, ...]:
        """Positions from ``start`` to ``end``, both included, each reached from the one before by one axis alone;
        ``called``: the end, in messages.

        Raises:
            BadRecipe: the end is beyond an axis' range, or no way to it is clear.
        """
        self._demand_reach(end, called)
        if start == end:
            return (start,)
        for positions in self._ways(start, end):
            if all(self._is_clear(before, after) for before, after in pairwise(positions)):
                return positions
        least = f"{self.room.least_clearance:g} mm"
        at = next((name for name, p in (("where it is now", start), ("there", end)) if not self._is_clear(p, p)), "")
        why = (
            f": {at} the housing is nearer than {least} to part, table or what to keep out of"
            if at
            else f" on which the housing stays {least} away from part, table and what to keep out of"
        )
        raise BadRecipe(
            f"positioner: found no clear way to {called}{why}; move the sensor away by hand, home it, or change the "
            "place"
        )

    def _demand_reach(self, position: Position, called: str) -> None:
        for axis, value in zip(self.kinematics.axes, position, strict=True):
            low, high = axis.reach
            if not low <= value <= high:
                shown, unit = (value, "mm") if axis.linear else (float(np.degrees(value)), "deg")
                ends = [low, high] if axis.linear else np.degrees([low, high]).tolist()
                raise BadRecipe(
                    f"positioner: {called} needs axis {axis.name} at {shown:.3f} {unit}, it goes from {ends[0]:g} to "
                    f"{ends[1]:g}; change the place or its range in stand.toml"
                )

    def _ways(self, start: Position, end: Position) -> Iterator[tuple[Position, ...]]:
        """The axes in any order; then the same with one of them drawn back to either end of its range meanwhile."""
        for order in permutations(_moving(start, end)):
            yield (start, *_in_order(start, end, order))
        for k, axis in enumerate(self.kinematics.axes):
            for aside in axis.reach:
                back, after = _with(start, k, aside), _with(end, k, aside)
                for order in permutations(_moving(back, after)):
                    yield (start, back, *_in_order(back, after, order), end)

    def _is_clear(self, start: Position, end: Position) -> bool:
        """Whether all is clear on the way from one position to another by one axis.

        The next look is as far on as the housing is clear: in between it can't meet anything.
        """
        (axis,) = _moving(start, end) or (0,)
        length = abs(end[axis] - start[axis])
        rate, done = self.kinematics.farthest(axis, start, corners(self.housing)), 0.0
        while True:
            share = min(done / length, 1.0) if length else 1.0
            gap = self.clearance(_with(start, axis, start[axis] + share * (end[axis] - start[axis])))
            if gap < self.room.least_clearance or share == 1.0:
                return gap >= self.room.least_clearance
            done += max(gap - self.room.least_clearance, LEAST_ADVANCE) / rate


def _moving(start: Position, end: Position) -> tuple[int, ...]:
    """Axes that must move."""
    return tuple(k for k, (a, b) in enumerate(zip(start, end, strict=True)) if a != b)


def _with(position: Position, axis: int, value: float) -> Position:
    return (*position[:axis], value, *position[axis + 1 :])


def _in_order(start: Position, end: Position, order: Sequence[int]) -> tuple[Position, ...]:
    found, at = [], start
    for axis in order:
        at = _with(at, axis, end[axis])
        found.append(at)
    return tuple(found)
