"""The virtual sensor's streaming thread: one exposure after the other by the stand's clock, frames filled and sent."""

import threading
from math import inf

import numpy as np
from numpy.typing import NDArray

from truestand.sim.live.clock import Clock
from truestand.sim.live.exposures import Exposures
from truestand.sim.live.profile_source import Source
from truestand.sim.live.registers import ENCODER_ACTIVE, LASER_OFF, TICKS, DeviceRegister, Registers
from truestand.sim.live.scancontrol_frames import FrameFormat, frame_bytes
from truestand.sim.live.stream_channel import StreamChannel

Array = NDArray[np.float64]

AHEAD = 0.05
"""Real s that the stand's clock may run ahead of what is due to be drawn next."""
NAP = 0.02
"""Real s: longest wait without a look at whether to stop."""


class Streamer:
    """Streams from ``start`` until ``stop``; ``counter`` goes on from stream to stream as the sensor's own does."""

    def __init__(
        self, name: str, clock: Clock, source: Source, registers: Registers, outlet: StreamChannel, power_on: float
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

    def _run(self, start: float, shape: FrameFormat) -> None:
        exposures = Exposures(start, self._registers, self._source)
        full, begins = bytearray(), np.empty(0)
        try:
            while self._await(exposures.next_look(shape.height)):
                new = exposures.begun(self._clock.now())
                if not new.size:
                    continue
                full += self._drawn(new, shape)
                begins = np.concatenate([begins, new])
                while len(full) >= shape.frame_bytes:
                    ticks = int((begins[shape.height - 1] + self._power_on) * TICKS)
                    self._outlet.offer(bytes(full[: shape.frame_bytes]), shape, ticks)
                    del full[: shape.frame_bytes]
                    begins = begins[shape.height :]
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

    def _drawn(self, begins: Array, shape: FrameFormat) -> bytes:
        """The bytes of the profiles whose exposure began at ``begins`` (n,)."""
        exposure, _ = self._registers.timing
        lit = self._registers.value(DeviceRegister.LASER) != LASER_OFF
        raw, encoder = self._source.profiles(begins + exposure / 2, shape, lit)
        if not self._registers.value(DeviceRegister.MAINTENANCE) & ENCODER_ACTIVE:
            encoder = np.zeros_like(encoder)
        counter = self.counter + np.arange(begins.size)
        self.counter += begins.size
        own = begins + self._power_on
        return frame_bytes(raw, shape, counter, own, own + exposure, encoder)
