"""When a sensor exposes: one exposure after the other, or one at every step of the encoder that finds it ready."""

import numpy as np
from numpy.typing import NDArray

from truestand.sim.live.profile_source import Source
from truestand.sim.live.registers import BY_ENCODER, EXTERNAL, TRIGGER_MODE, DeviceRegister, Registers

Array = NDArray[np.float64]

MOST_AT_ONCE = 32
"""Profiles drawn at once, where the drawing is behind."""
LONGEST_AT_ONCE = 0.05
"""s of the stand's clock to wait for before a part of a frame is drawn, if that is more than one profile."""
FINE = 2e-5
"""s: resolution of a triggered exposure's begin."""
LOOK = 5e-3
"""s of the stand's clock between two looks for triggers."""


class Exposures:
    """``ready`` (s of the stand's clock): the earliest begin of the next exposure."""

    def __init__(self, ready: float, registers: Registers, source: Source) -> None:
        self.ready = ready
        self._registers, self._source = registers, source

    def next_look(self, height: int) -> float:
        """When it pays to ask ``begun``: a frame of ``height``, or a part of one, may be there."""
        exposure, idle = self._registers.timing
        if self._triggered:
            return self.ready + max(exposure + idle, LOOK)
        needed = min(height, max(int(LONGEST_AT_ONCE / (exposure + idle)), 1))
        return self.ready + (needed - 1) * (exposure + idle) + exposure

    def begun(self, now: float) -> Array:
        """Begins (n,) of the next exposures that have ended at ``now``, ``MOST_AT_ONCE`` of them at most."""
        exposure, idle = self._registers.timing
        if self._triggered:
            return self._at_steps(now - exposure, exposure + idle)
        due = int((now - self.ready - exposure) / (exposure + idle) + 1e-6) + 1
        begins: Array = self.ready + np.arange(min(due, MOST_AT_ONCE), dtype=np.float64) * (exposure + idle)
        self.ready += begins.size * (exposure + idle)
        return begins

    @property
    def _triggered(self) -> bool:
        return bool(self._registers.value(DeviceRegister.TRIGGER) & EXTERNAL)

    def _at_steps(self, until: float, period: float) -> Array:
        """Steps of the encoder before ``until`` that find the sensor ready; other triggers never come."""
        if until - self.ready < FINE:
            return np.empty(0)
        times = np.arange(self.ready - FINE, until, FINE)
        steps = np.empty(0)
        if self._registers.value(DeviceRegister.TRIGGER) & TRIGGER_MODE == BY_ENCODER:
            steps = times[1:][np.diff(self._source.counts(times)) != 0]
        begins: list[float] = []
        ready = self.ready
        while len(begins) < MOST_AT_ONCE and (at := int(np.searchsorted(steps, ready))) < steps.size:
            begins.append(float(steps[at]))
            ready = begins[-1] + period
        self.ready = ready if len(begins) == MOST_AT_ONCE else max(ready, float(times[-1]))
        return np.array(begins)
