"""Where the positioner goes for the scans of a stand, and by which way."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from truestand.core.errors import BadRecipe
from truestand.core.stand import Stand
from truestand.devices.positioner import Positioner
from truestand.planning.corridor import Corridors
from truestand.planning.kinematics import Position
from truestand.planning.obstacles import Round
from truestand.planning.optics import HOUSING
from truestand.station.recipe import DevicesRecipe, Stop, position_of, sensor_of


@dataclass(frozen=True, slots=True)
class Route:
    """Where a positioner goes."""

    corridors: Corridors
    places: tuple[tuple[Position, str], ...]
    """For this scan and for those after it, and what each is called."""
    known: frozenset[Position] = frozenset()
    """Places of all views: a positioner that stands where a move to one of them left it is taken to stand there. Where
    the housing is just as near as it may be, a hundredth of a millimetre would bar the way from it."""

    def way(self, positioner: Positioner) -> tuple[Position, ...]:
        """From where the positioner stands, or will once it is homed, to the first place.

        Those to the places after it are looked for as well, so that nothing moves where one of them is barred.

        Raises:
            BadRecipe: one of them is.
        """
        start = self._start(positioner)
        first, *_ = [
            self.corridors.way(before, place, called)
            for (before, _), (place, called) in pairwise([(start, ""), *self.places])
        ]
        return first

    def _start(self, positioner: Positioner) -> Position:
        if not positioner.homed:
            return (0.0,) * len(positioner.axes)
        return next((place for place in self.known if positioner.stands_at(place)), positioner.position)

    @property
    def after(self) -> "Route":
        """The same for the next scan."""
        return replace(self, places=self.places[1:])


def route_of(recipe: Path, stand: Stand, devices: DevicesRecipe, stops: Sequence[Stop]) -> Route | None:
    """The route of a stand of ``recipe`` (stand.toml) for some scans; None where no view needs the positioner.

    Raises:
        BadRecipe: a wrong ``[plan]``, or nothing said of what turns.
    """
    placed = [(stop.position, f"the place of {', '.join(stop.views)}") for stop in stops]
    places = tuple((position, called) for position, called in placed if position is not None)
    if devices.positioner is None or not places:
        return None
    from truestand.files.recipes.plan import read_task  # it brings in the search for places

    room, turning = read_task(recipe).room, devices.positioner.bodies
    if not turning:
        raise BadRecipe(
            f"{recipe}: [devices.positioner] has no swept, need what turns, to keep clear of it; `truestand plan "
            "--stand-out` writes it"
        )
    face = min(body.bottom for body in turning) if room.table_face is None else room.table_face
    carried = [sensor_of(stand, view) for stop in stops for view in stop.views]
    sizes = [sensor.housing or HOUSING for sensor in carried if sensor.position]
    x, y, z = (max(size[k] for size in sizes) for k in range(3))
    bodies = (*turning, Round(room.table_radius, -1e9, face))
    known = frozenset(place for s in stand.sensors if (place := position_of(s, devices)) is not None)
    return Route(Corridors(devices.positioner.kinematics, (x, y, z), bodies, room), places, known)
