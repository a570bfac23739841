"""What a virtual sensor sees: the virtual stand at this moment."""

from collections.abc import Callable

import numpy as np

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.errors import BadRecipe
from truestand.core.stand import Stand
from truestand.sim.live.scancontrol_frames import Counts, FrameFormat, Raw, raw_profiles
from truestand.sim.live.table import VirtualTable
from truestand.sim.parts import VirtualPart
from truestand.sim.sensor_model import SensorModel
from truestand.sim.simulation import DEFAULT_COUNTS_PER_TURN, Mounting, Simulation, speed_and_rate
from truestand.sim.truth import Truth


class SimulatedSource:
    """Profiles computed at the angle where the table stands at that time, and from where the sensor does.

    Called by the streaming thread, in the order of time. ``stands``: where the sensor stands now that a positioner
    carries; None while it moves, which it does with its laser off.

    Raises:
        BadRecipe: a part that can't be, or not on this shaft.
    """

    def __init__(
        self,
        stand: Stand,
        simulation: Simulation,
        artefact: Artefact,
        table: VirtualTable,
        scale: tuple[float, float],
        part: VirtualPart | None = None,
        seed: int = 0,
        stands: Callable[[], Mounting | None] = lambda: None,
    ) -> None:
        self._table, self._scale, self._stands = table, scale, stands
        self._stand, self._simulation, self._artefact, self._part = stand, simulation, artefact, part
        self._rng = np.random.default_rng(seed)
        self._models: dict[bool, SensorModel] = {}
        """Of the shaft alone, and with the part."""
        for with_part in (False, True):
            self._model(with_part)

    def _model(self, with_part: bool) -> SensorModel:
        """What the sensor sees from where it stands now; computed where it has moved, or the part is another one."""
        mounting = self._stands()
        if mounting is not None and mounting != self._simulation.mounting:
            self._simulation, self._models = self._simulation.mounted(mounting), {}
        if with_part not in self._models:
            part = self._part if with_part else None
            self._models[with_part] = SensorModel(self._stand, self._simulation, self._artefact, part, self._rng)
        return self._models[with_part]

    @property
    def part_mounted(self) -> bool:
        """Whether the part is on the shaft."""
        return self._table.part_mounted

    def mount(self, part: bool) -> None:
        """Put the shaft alone, or with the part, on the table: the same for all sensors.

        Raises:
            BadRecipe: there is no part.
        """
        if part and self._part is None:
            raise BadRecipe("there is no part to put on the virtual stand; give it one with --part")
        self._table.part_mounted = part

    def replace_part(self, part: VirtualPart) -> None:
        """Give the stand another part; it is on the shaft where the one before was.

        Raises:
            BadRecipe: a part that can't be, or not on this shaft.
        """
        self._part = part
        self._models.pop(True, None)
        self._model(with_part=True)

    def readings(self, times: Array) -> tuple[Array, Array, Counts]:
        """x, z (n, M) mm as the sensor reports them, and encoder counts (n,), at times (n,) s."""
        model = self._model(self.part_mounted)
        x, z = model.profiles(self._stand.table.sign * self._table.angle_at(times))
        return -x if model.mirrored else x, z, self.counts(times)

    def profiles(self, times: Array, frame: FrameFormat, lit: bool) -> tuple[Raw, Counts]:
        """Profiles (n, fields, points), not yet stamped, and encoder counts (n,) at times (n,) s; unlit = nothing seen.

        ``frame.points`` rays of the fan, or every second, fourth, ... of the sensor's own.
        """
        if not lit:
            self._model(self.part_mounted)  # in time for when it is
            return np.zeros((times.size, frame.lines, frame.points), np.uint16), self.counts(times)
        x, z, counts = self.readings(times)
        every = max(x.shape[1] // frame.points, 1)
        chosen = slice(0, every * frame.points, every)
        return raw_profiles(_padded(x[:, chosen], frame), _padded(z[:, chosen], frame), self._scale, frame), counts

    def counts(self, times: Array) -> Counts:
        """Encoder counts (n,) at times (n,) s."""
        return self._table.counts_at(times, self._stand.counts_per_turn or DEFAULT_COUNTS_PER_TURN)

    def truth(self, part: bool) -> Truth:
        """What is true of the stand, of the shaft alone or with the part on it; without angles of profiles."""
        speed, rate = speed_and_rate(self._stand)
        model = self._model(with_part=False)
        return Truth(
            self._stand, self._simulation, model.table_from_sensor, model.shaft_from_rotor, speed / rate, np.empty(0),
            self._artefact, self._part if part else None,
        )  # fmt: skip


def _padded(values: Array, frame: FrameFormat) -> Array:
    """Values (n, m) with NaN beyond the fan's rays where more points are asked for."""
    missing = frame.points - values.shape[1]
    return np.pad(values, ((0, 0), (0, missing)), constant_values=np.nan) if missing > 0 else values
