"""What a virtual sensor looks at: the stand as it is at this moment, or profiles made before."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from truestand.core.artefact import Artefact
from truestand.core.errors import BadRecipe
from truestand.core.stand import Stand
from truestand.sim.live.scancontrol_frames import FrameFormat, Raw, raw_profiles
from truestand.sim.parts import VirtualPart
from truestand.sim.sensor_model import SensorModel
from truestand.sim.simulation import Simulation
from truestand.sim.truth import Truth

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Turning(Protocol):
    """A virtual table, as the sensor's surroundings see it."""

    def angle_at(self, times: Array) -> Array:
        """rad (n,) as the table counts them, at times of the stand's clock (n,) s."""

    def counts_at(self, times: Array, counts_per_turn: int) -> Ints:
        """What its encoder has counted (n,) at those times."""


@dataclass(slots=True)
class TableTop:
    """What stands on the table, the same for all sensors."""

    part: bool = False
    """With the part on the shaft."""


class Source(Protocol):
    """What a sensor sees. Called by the streaming thread, in the order of time."""

    @property
    def mounted(self) -> bool:
        """Whether the part is on the shaft."""

    def profiles(self, times: Array, shape: FrameFormat, lit: bool) -> tuple[Raw, Ints]:
        """Profiles (n, fields, points), not yet stamped, and encoder counts (n,) at times (n,) s; unlit = nothing."""

    def counts(self, times: Array) -> Ints:
        """What the encoder has counted (n,) at those times."""

    def mount(self, part: bool) -> None:
        """Put the shaft alone, or with the part, on the table.

        Raises:
            BadRecipe: there is no part.
        """


class SimulatedSource:
    """The virtual stand as it is: rays cast at the angle where the table stands at that time.

    Raises:
        BadRecipe: a part that can't be, or not on this shaft.
    """

    def __init__(
        self,
        stand: Stand,
        simulation: Simulation,
        artefact: Artefact,
        table: Turning,
        scale: tuple[float, float],
        part: VirtualPart | None = None,
        seed: int = 0,
        latch: float = 0.0,
        top: TableTop | None = None,
    ) -> None:
        self._table, self._scale, self._latch = table, scale, latch
        self._stand, self._artefact, self._part = stand, artefact, part
        self._sign = stand.table.sign
        self._counts_per_turn = stand.counts_per_turn or 36000
        rng = np.random.default_rng(seed)
        self._casters = [
            SensorModel(stand, simulation, artefact, on, rng) for on in ((None,) if part is None else (None, part))
        ]
        self._top = top or TableTop()

    @property
    def mounted(self) -> bool:
        """Whether the part is on the shaft."""
        return self._top.part

    def mount(self, part: bool) -> None:
        """Put the shaft alone, or with the part, on the table.

        Raises:
            BadRecipe: there is no part.
        """
        if part and self._part is None:
            raise BadRecipe("there is no part to put on the virtual stand; give it one with --part")
        self._top.part = part

    def rows(self, times: Array) -> tuple[Array, Array, Ints]:
        """x, z (n, M) mm as the sensor reports them, and encoder counts (n,), latched ``latch`` s after ``times``."""
        caster = self._casters[self.mounted]
        x, z = caster.profiles(self._sign * self._table.angle_at(times))
        return -x if caster.mirrored else x, z, self.counts(times)

    def profiles(self, times: Array, shape: FrameFormat, lit: bool) -> tuple[Raw, Ints]:
        """Profiles and counts; the fan has ``shape.points`` rays or every second, fourth, ... of the sensor's own."""
        if not lit:
            return np.zeros((times.size, shape.lines, shape.points), np.uint16), self.counts(times)
        x, z, counts = self.rows(times)
        every = max(x.shape[1] // shape.points, 1)
        chosen = slice(0, every * shape.points, every)
        return raw_profiles(_wide(x[:, chosen], shape), _wide(z[:, chosen], shape), self._scale, shape), counts

    def truth(self, part: bool) -> Truth:
        """What is true of the stand, of the shaft alone or with the part on it; there is no angle of a profile yet."""
        caster = self._casters[0]
        speed, rate = self._stand.table.speed or np.pi / 10, self._stand.sensor.profile_rate or 200.0
        return Truth(
            self._stand, caster.simulation, caster.table_from_sensor, caster.shaft_from_rotor, speed / rate,
            np.empty(0), self._artefact, self._part if part else None,
        )  # fmt: skip

    def counts(self, times: Array) -> Ints:
        """What the encoder has counted (n,), latched ``latch`` s after ``times``."""
        return self._table.counts_at(times + self._latch, self._counts_per_turn)


class RecordedSource:
    """Profiles made before, again and again: no drawing, for tests of speed."""

    def __init__(self, raw: Raw, table: Turning | None = None, counts_per_turn: int = 36000) -> None:
        self._raw, self._table, self._counts_per_turn = raw, table, counts_per_turn
        self._next = 0

    @property
    def mounted(self) -> bool:
        """Nobody knows."""
        return False

    def mount(self, part: bool) -> None:
        """It shows what it shows."""

    def profiles(self, times: Array, shape: FrameFormat, lit: bool) -> tuple[Raw, Ints]:
        """The next ones."""
        rows = np.arange(self._next, self._next + times.size) % self._raw.shape[0]
        self._next = (self._next + times.size) % self._raw.shape[0]
        return self._raw[rows], self.counts(times)

    def counts(self, times: Array) -> Ints:
        """What the encoder has counted (n,); 0 where there is no table."""
        if self._table is None:
            return np.zeros(times.size, np.int64)
        return self._table.counts_at(times, self._counts_per_turn)


def _wide(values: Array, shape: FrameFormat) -> Array:
    """Values (n, m) with NaN beyond the fan's rays where more points are asked for."""
    missing = shape.points - values.shape[1]
    return np.pad(values, ((0, 0), (0, missing)), constant_values=np.nan) if missing > 0 else values
