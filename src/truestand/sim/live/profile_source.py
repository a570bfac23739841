"""What a virtual sensor sees: the virtual stand at this moment."""

import numpy as np

from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.errors import BadRecipe
from truestand.core.stand import Stand
from truestand.sim.live.scancontrol_frames import Counts, FrameFormat, Raw, raw_profiles
from truestand.sim.live.table import VirtualTable
from truestand.sim.parts import VirtualPart
from truestand.sim.sensor_model import SensorModel
from truestand.sim.simulation import DEFAULT_COUNTS_PER_TURN, Simulation, speed_and_rate
from truestand.sim.truth import Truth


class SimulatedSource:
    """Profiles computed at the angle where the table stands at that time.

    Called by the streaming thread, in the order of time.

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
    ) -> None:
        self._table, self._scale = table, scale
        self._stand, self._simulation, self._artefact, self._part = stand, simulation, artefact, part
        self._rng = np.random.default_rng(seed)
        self._shaft = self._model(None)
        self._shaft_with_part = None if part is None else self._model(part)

    def _model(self, part: VirtualPart | None) -> SensorModel:
        return SensorModel(self._stand, self._simulation, self._artefact, part, self._rng)

    @property
    def part_mounted(self) -> bool:
        """Whether the part is on the shaft."""
        return self._table.part_mounted

    def mount(self, part: bool) -> None:
        """Put the shaft alone, or with the part, on the table: the same for all sensors.

        Raises:
            BadRecipe: there is no part.
        """
        if part and self._shaft_with_part is None:
            raise BadRecipe("there is no part to put on the virtual stand; give it one with --part")
        self._table.part_mounted = part

    def replace_part(self, part: VirtualPart) -> None:
        """Give the stand another part; it is on the shaft where the one before was.

        Raises:
            BadRecipe: a part that can't be, or not on this shaft.
        """
        self._part, self._shaft_with_part = part, self._model(part)

    def readings(self, times: Array) -> tuple[Array, Array, Counts]:
        """x, z (n, M) mm as the sensor reports them, and encoder counts (n,), at times (n,) s."""
        model = self._shaft_with_part if self.part_mounted and self._shaft_with_part else self._shaft
        x, z = model.profiles(self._stand.table.sign * self._table.angle_at(times))
        return -x if model.mirrored else x, z, self.counts(times)

    def profiles(self, times: Array, frame: FrameFormat, lit: bool) -> tuple[Raw, Counts]:
        """Profiles (n, fields, points), not yet stamped, and encoder counts (n,) at times (n,) s; unlit = nothing seen.

        ``frame.points`` rays of the fan, or every second, fourth, ... of the sensor's own.
        """
        if not lit:
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
        return Truth(
            self._stand, self._simulation, self._shaft.table_from_sensor, self._shaft.shaft_from_rotor, speed / rate,
            np.empty(0), self._artefact, self._part if part else None,
        )  # fmt: skip


def _padded(values: Array, frame: FrameFormat) -> Array:
    """Values (n, m) with NaN beyond the fan's rays where more points are asked for."""
    missing = frame.points - values.shape[1]
    return np.pad(values, ((0, 0), (0, missing)), constant_values=np.nan) if missing > 0 else values
