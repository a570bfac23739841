"""``[devices.positioner]``: one to four axes that carry a sensor to the places of its views.

Each axis is one that a table could be: behind one of their protocols, homed, within its limits. They move one after the
other, along ways that ``planning.corridor`` has found clear.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from math import degrees, radians
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat, field_validator, model_validator

from truestand.core.frames import Pose, about_axis, table_from_sensor
from truestand.core.stand import Stand
from truestand.core.units import UM_PER_MM
from truestand.devices.axis import Axis, Limits
from truestand.devices.tables.line import Lines
from truestand.devices.tables.opening import open_axis
from truestand.devices.tables.recipe import ControllerRecipe, Reach
from truestand.files.checking import Recipe, checked
from truestand.files.recipes.recipes import read_devices_table
from truestand.planning.carried import Carrier
from truestand.planning.kinematics import Kinematics, Motion, Position
from truestand.planning.obstacles import Round

MOST_AXES = 4
Vector = tuple[float, float, float]


class AxisRecipe(ControllerRecipe):
    """``[[devices.positioner.axis]]``. Of a linear axis the controller's tables count mm where they say degrees:
    ``counts_per_turn`` are the counts of 360 mm.
    """

    name: Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")]
    kind: Literal["linear", "rotary"] = "linear"
    direction: Vector
    """Along which it moves the sensor, or about which it turns it, right-handed; x and y level, z up, from the table's
    axis."""
    through_mm: Vector = (0.0, 0.0, 0.0)
    """A point of a rotary axis."""
    range_mm: Reach | None = None
    range_deg: Reach | None = None
    max_speed_mm_per_s: PositiveFloat = 20.0
    max_speed_deg_per_s: PositiveFloat = 20.0
    tolerance_mm: PositiveFloat = 0.02
    tolerance_deg: PositiveFloat = 0.02

    @model_validator(mode="after")
    def _whole(self) -> "AxisRecipe":
        if self.reach is None:
            raise ValueError(f"range_{self.unit}: missing; an axis that carries a sensor has ends")
        if not np.linalg.norm(self.direction) > 0:
            raise ValueError(f"direction: found {list(self.direction)}, need one that points somewhere")
        return self

    @property
    def linear(self) -> bool:
        """Whether it moves along a line."""
        return self.kind == "linear"

    @property
    def unit(self) -> str:
        """Of its positions, in recipes and messages."""
        return "mm" if self.linear else "deg"

    @property
    def key(self) -> str:
        """Of ``[sensor.position]``."""
        return f"{self.name}_{self.unit}"

    @property
    def reach(self) -> tuple[float, float] | None:
        """mm, or degrees."""
        return self.range_mm if self.linear else self.range_deg

    @property
    def limits(self) -> Limits:
        """Limits and timeouts, as the controller counts."""
        speed = self.max_speed_mm_per_s if self.linear else self.max_speed_deg_per_s
        return self.within(speed, self.reach, self.tolerance_mm if self.linear else self.tolerance_deg)

    @property
    def motion(self) -> Motion:
        """How it moves what it carries."""
        low, high = self.reach or (0.0, 0.0)
        reach = (low, high) if self.linear else (radians(low), radians(high))
        along = np.array(self.direction) / np.linalg.norm(self.direction)
        return Motion(self.name, self.linear, along, np.array(self.through_mm), reach)


class AtZeroRecipe(Recipe):
    """``[devices.positioner.at_zero]``: where the sensor stands while all axes are at zero, as a calibration states
    it.
    """

    phi_deg: Annotated[float, Field(gt=-180, lt=180)]
    radial_mm: PositiveFloat
    height_mm: float
    laser_plane_offset_mm: float = 0.0
    laser_plane_tilt_deg: float = 0.0
    azimuth_deg: float = 0.0

    @field_validator("phi_deg")
    @classmethod
    def _looks_at_the_axis(cls, phi: float) -> float:
        if phi == 0:
            raise ValueError("need an angle between the table's axis and the sensor's z, e.g. -90")
        return phi

    @property
    def pose(self) -> Pose:
        """room_from_sensor."""
        tilt, azimuth = radians(self.laser_plane_tilt_deg), radians(self.azimuth_deg)
        own = table_from_sensor(
            radians(self.phi_deg), self.radial_mm, self.height_mm, tilt, self.laser_plane_offset_mm
        )  # fmt: skip
        return about_axis(azimuth, 0.0) @ own


class SweptRecipe(Recipe):
    """``[[devices.positioner.swept]]``: a cylinder about the table's axis that shaft or part may fill."""

    radius_mm: PositiveFloat
    from_mm: float
    to_mm: float

    @model_validator(mode="after")
    def _ordered(self) -> "SweptRecipe":
        if not self.from_mm < self.to_mm:
            raise ValueError(f"from_mm, to_mm: found {self.from_mm} and {self.to_mm}, need the lower end first")
        return self


class PositionerRecipe(Recipe):
    """``[devices.positioner]``."""

    axis: Annotated[list[AxisRecipe], Field(min_length=1, max_length=MOST_AXES)]
    """The first one carries the others. They home in this order."""
    at_zero: AtZeroRecipe
    swept: list[SweptRecipe] = Field(default_factory=list)
    """What turns; a plan writes it."""
    device: str | None = None
    """Which one it carries; default: the first one."""
    position_U_um: PositiveFloat
    """How well a place is taken again (k = 2), along and"""
    position_U_deg: PositiveFloat
    """about any direction; each view's ``[[sensor]]`` takes it from here."""

    @model_validator(mode="after")
    def _names_differ(self) -> "PositionerRecipe":
        names = [axis.name for axis in self.axis]
        if len(set(names)) < len(names):
            raise ValueError(f"axis: found the names {', '.join(names)}, need a different one for each")
        return self

    @property
    def kinematics(self) -> Kinematics:
        """How it carries its sensor."""
        return Kinematics(tuple(axis.motion for axis in self.axis), self.at_zero.pose)

    def carrier(self, stand: Stand) -> Carrier:
        """The positioner of a stand, for plans."""
        first = stand.sensors[0]
        device = self.device or first.device or first.name
        return Carrier(self.kinematics, device, self.position_U_um / UM_PER_MM, radians(self.position_U_deg))

    @property
    def bodies(self) -> tuple[Round, ...]:
        """What turns."""
        return tuple(Round(s.radius_mm, s.from_mm, s.to_mm) for s in self.swept)


@dataclass(frozen=True, slots=True)
class Positioner:
    """The axes of a positioner, connected."""

    axes: tuple[Axis, ...]
    linear: tuple[bool, ...]

    @property
    def homed(self) -> bool:
        """Whether every axis knows where it is."""
        return all(axis.state().homed for axis in self.axes)

    @property
    def position(self) -> Position:
        """Of each axis, mm or rad."""
        return tuple(
            degrees(axis.state().position) if linear else axis.state().position
            for axis, linear in zip(self.axes, self.linear, strict=True)
        )

    def stands_at(self, place: Position) -> bool:
        """Whether every axis is where a move to ``place`` (mm or rad) may have left it."""
        return all(
            abs(axis.state().position - (radians(value) if linear else value)) <= axis.limits.tolerance
            for axis, linear, value in zip(self.axes, self.linear, place, strict=True)
        )

    def home(self) -> None:
        """Find the home position of each axis, one after the other.

        Raises:
            MoveTimeout, DeviceError: as ``Axis.home``.
        """
        for axis in self.axes:
            axis.home()

    def move_along(self, way: Sequence[Position]) -> None:
        """Go from the first of some positions (mm or rad), where it stands, to the others; what differs from one to the
        next moves.

        Raises:
            LimitExceeded, MoveTimeout, DeviceError: as ``Axis.move_to``.
        """
        for before, after in pairwise(way):
            for axis, linear, old, new in zip(self.axes, self.linear, before, after, strict=True):
                if new != old:
                    axis.move_to(radians(new) if linear else new, axis.limits.speed)

    def close(self) -> None:
        """Close all connections."""
        for axis in self.axes:
            axis.close()


def read_carrier(path: Path | str, stand: Stand) -> Carrier | None:
    """The positioner of a stand.toml, for plans; None where there is none.

    Raises:
        BadRecipe: a wrong or missing key.
    """
    table = read_devices_table(path).get("positioner")
    if table is None:
        return None
    return checked(PositionerRecipe, table, f"{path}: [devices.positioner]").carrier(stand)


def open_positioner(recipe: PositionerRecipe, lines: Lines | None = None) -> Positioner:
    """The positioner, connected, its state read once; nothing moves. ``lines``: connections that it may share.

    Raises:
        DeviceLost: nobody answers at an address.
        DeviceError: what answers isn't such an axis.
    """
    lines = {} if lines is None else lines
    with ExitStack() as on_failure:
        axes = []
        for axis in recipe.axis:
            axes.append(open_axis(axis, axis.limits, f"axis {axis.name}", axis.unit, lines))
            on_failure.callback(axes[-1].close)
        on_failure.pop_all()
    return Positioner(tuple(axes), tuple(axis.linear for axis in recipe.axis))
