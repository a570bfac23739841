"""The virtual sensor's streaming thread: one exposure after the other by the stand's clock, frames filled and sent."""

import threading
from math import inf

import numpy as np

from truestand.sim.live.clock import Clock
from truestand.sim.live.container import Shape, frame_bytes
from truestand.sim.live.outlet import Outlet
from truestand.sim.live.registers import ENCODER_ACTIVE, LASER_OFF, TICKS, Own, Registers
from truestand.sim.live.source import Source

MOST_AT_ONCE = 32
"""Profiles drawn at once, where the drawing is behind."""
LONGEST_AT_ONCE = 0.05
"""s of the stand's clock to wait for before a part of a frame is drawn, if that is more than one profile."""
AHEAD = 0.05
"""Real s that the stand's clock may run ahead of what is due to be drawn next."""
NAP = 0.02
"""Real s: longest wait without a look at whether to stop."""


class Streamer:
    """Streams from ``start`` until ``stop``; ``counter`` goes on from stream to stream as the sensor's own does."""

    def __init__(
        self, name: str, clock: Clock, source: Source, registers: Registers, outlet: Outlet, power_on: float
    ) -> None:
        self.counter = 0
        self._name, self._clock, self._source = name, clock, source
        self._registers, self._outlet, self._power_on = registers, outlet, power_on
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def running(self) -> bool:
        """Whether it streams."""
        return self._thread is not None

    def start(self) -> None:
        """Begin: the first exposure is now."""
        self.stop()
        self._stop.clear()
        self._outlet.restart()
        begin = self._clock.now()
        self._thread = threading.Thread(target=self._run, args=(begin, self._registers.shape), name=self._name)
        self._thread.start()

    def stop(self) -> None:
        """End; a frame not yet full is lost."""
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None

    def _run(self, opened: float, shape: Shape) -> None:
        """``opened``: when the next exposure begins."""
        full = bytearray()
        try:
            while not self._stop.is_set():
                exposure, idle = self._registers.timing
                period = exposure + idle
                needed = min(shape.height, max(int(LONGEST_AT_ONCE / period), 1))
                if not self._await(opened + (needed - 1) * period + exposure):
                    return
                due = int((self._clock.now() - opened - exposure) / period) + 1
                some = min(max(due, needed), MOST_AT_ONCE)
                full += self._drawn(opened, some, exposure, idle, shape)
                opened += some * period
                while len(full) >= shape.frame_bytes:
                    ahead = (len(full) - shape.frame_bytes) // (2 * shape.width)
                    ended = opened - ahead * period - idle
                    self._outlet.offer(bytes(full[: shape.frame_bytes]), shape, int((ended + self._power_on) * TICKS))
                    del full[: shape.frame_bytes]
        finally:
            self._clock.allow(self._name, inf)

    def _await(self, moment: float) -> bool:
        """Wait until the stand's clock shows ``moment``; False where the stream is to end."""
        self._clock.allow(self._name, moment + AHEAD * max(self._clock.pace, 1.0))
        while True:
            wait = self._clock.real_until(moment)
            if not wait:
                return not self._stop.is_set()
            if self._stop.wait(min(wait, NAP)):
                return False
            self._outlet.flush()

    def _drawn(self, opened: float, some: int, exposure: float, idle: float, shape: Shape) -> bytes:
        """The bytes of the next ``some`` profiles."""
        begins = np.asarray(opened + np.arange(some) * (exposure + idle), np.float64)
        lit = self._registers.value(Own.LASER) != LASER_OFF
        raw, encoder = self._source.profiles(begins + exposure / 2, shape, lit)
        if not self._registers.value(Own.MAINTENANCE) & ENCODER_ACTIVE:
            encoder = np.zeros_like(encoder)
        counter = self.counter + np.arange(some)
        self.counter += some
        own = begins + self._power_on
        return frame_bytes(raw, shape, counter, own, own + exposure, encoder)
