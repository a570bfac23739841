"""The virtual sensor's streaming thread: exposures by the stand's clock, frames for the stream channel."""

import threading
from math import inf

import numpy as np

from truestand.sim.live.clock import Clock
from truestand.sim.live.profile_source import SimulatedSource
from truestand.sim.live.registers import (
    ENCODER_ACTIVE,
    EXTERNAL,
    LASER_OFF,
    TICKS_PER_S,
    TRIGGER_BY_ENCODER,
    TRIGGER_MODE,
    DeviceRegister,
    Registers,
)
from truestand.sim.live.scancontrol_frames import FrameFormat, frame_bytes
from truestand.sim.live.stream_channel import StreamChannel
from truestand.sim.poses import Array

CLOCK_LEAD_S = 0.05
"""Real time by which the stand's clock may run ahead of the next exposure that is due."""
STOP_POLL_INTERVAL_S = 0.02
"""Real time: longest wait without a look at whether to stop."""
MAX_BLOCK = 32
"""Profiles computed at once, where the computation is late."""
MAX_BLOCK_S = 0.05
"""Of the stand's clock: longest wait before a part of a frame is computed, if that is more than one profile."""
TRIGGER_RESOLUTION_S = 2e-5
"""Of the begin of a triggered exposure."""
TRIGGER_POLL_INTERVAL_S = 5e-3
"""Of the stand's clock, between two looks for triggers."""


class Exposures:
    """One exposure after the other, or one at every step of the encoder that finds the sensor ready."""

    def __init__(self, ready: float, registers: Registers, source: SimulatedSource) -> None:
        self.ready = ready
        """s of the stand's clock: the earliest begin of the next exposure."""
        self._registers, self._source = registers, source

    def next_poll(self, height: int) -> float:
        """When to call ``begun`` next, s: a frame of ``height`` profiles, or a part of one, may be there."""
        exposure, idle = self._registers.timing
        if self._triggered:
            return self.ready + max(exposure + idle, TRIGGER_POLL_INTERVAL_S)
        needed = min(height, max(int(MAX_BLOCK_S / (exposure + idle)), 1))
        return self.ready + (needed - 1) * (exposure + idle) + exposure

    def begun(self, now: float) -> Array:
        """Begins (n,) of the next exposures that have ended at ``now``, ``MAX_BLOCK`` of them at most."""
        exposure, idle = self._registers.timing
        if self._triggered:
            return self._at_steps(now - exposure, exposure + idle)
        due = int((now - self.ready - exposure) / (exposure + idle) + 1e-6) + 1
        begins: Array = self.ready + np.arange(min(due, MAX_BLOCK), dtype=np.float64) * (exposure + idle)
        self.ready += begins.size * (exposure + idle)
        return begins

    @property
    def _triggered(self) -> bool:
        return bool(self._registers.value(DeviceRegister.TRIGGER) & EXTERNAL)

    def _at_steps(self, until: float, period: float) -> Array:
        """Steps of the encoder before ``until`` that find the sensor ready; other triggers never come."""
        if until - self.ready < TRIGGER_RESOLUTION_S:
            return np.empty(0)
        times = np.arange(self.ready - TRIGGER_RESOLUTION_S, until, TRIGGER_RESOLUTION_S)
        steps = np.empty(0)
        if self._registers.value(DeviceRegister.TRIGGER) & TRIGGER_MODE == TRIGGER_BY_ENCODER:
            steps = times[1:][np.diff(self._source.counts(times)) != 0]
        begins: list[float] = []
        ready = self.ready
        while len(begins) < MAX_BLOCK and (at := int(np.searchsorted(steps, ready))) < steps.size:
            begins.append(float(steps[at]))
            ready = begins[-1] + period
        self.ready = ready if len(begins) == MAX_BLOCK else max(ready, float(times[-1]))
        return np.array(begins)


class Streamer:
    """Streams from ``start`` until ``stop``; ``counter`` goes on from stream to stream as that of a real sensor."""

    def __init__(
        self,
        name: str,
        clock: Clock,
        source: SimulatedSource,
        registers: Registers,
        channel: StreamChannel,
        power_on: float,
    ) -> None:
        self.counter = 0
        self._name, self._clock, self._source = name, clock, source
        self._registers, self._channel, self._power_on = registers, channel, power_on
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin: the first exposure is now."""
        self.stop()
        self._stop.clear()
        self._channel.restart()
        begin = self._clock.now()
        self._thread = threading.Thread(target=self._run, args=(begin, self._registers.format), name=self._name)
        self._thread.start()

    def stop(self) -> None:
        """End; a frame not yet full is lost."""
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = None

    def _run(self, start: float, frame: FrameFormat) -> None:
        exposures = Exposures(start, self._registers, self._source)
        data, begins = bytearray(), np.empty(0)
        try:
            while self._await(exposures.next_poll(frame.height)):
                new = exposures.begun(self._clock.now())
                if not new.size:
                    continue
                data += self._profiles(new, frame)
                begins = np.concatenate([begins, new])
                while len(data) >= frame.frame_bytes:
                    ticks = int((begins[frame.height - 1] + self._power_on) * TICKS_PER_S)
                    self._channel.queue(bytes(data[: frame.frame_bytes]), frame, ticks)
                    del data[: frame.frame_bytes]
                    begins = begins[frame.height :]
        finally:
            self._clock.allow(self._name, inf)

    def _await(self, moment: float) -> bool:
        """Wait until the stand's clock shows ``moment``; False where the stream is to end."""
        self._clock.allow(self._name, moment + CLOCK_LEAD_S * max(self._clock.pace, 1.0))
        while wait := self._clock.real_until(moment):
            if self._stop.wait(min(wait, STOP_POLL_INTERVAL_S)):
                return False
            self._channel.flush()
        return not self._stop.is_set()

    def _profiles(self, begins: Array, frame: FrameFormat) -> bytes:
        """The bytes of the profiles whose exposure began at ``begins`` (n,)."""
        exposure, _ = self._registers.timing
        lit = self._registers.value(DeviceRegister.LASER) != LASER_OFF
        raw, encoder = self._source.profiles(begins + exposure / 2, frame, lit)
        if not self._registers.value(DeviceRegister.MAINTENANCE) & ENCODER_ACTIVE:
            encoder = np.zeros_like(encoder)
        counter = self.counter + np.arange(begins.size)
        self.counter += begins.size
        opened = begins + self._power_on
        return frame_bytes(raw, frame, counter, opened, opened + exposure, encoder)
