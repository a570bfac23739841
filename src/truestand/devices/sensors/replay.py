"""A recorded scan as a sensor: its profiles again, at their recorded pace or as fast as they are requested.

x, z, counter, time and encoder are as in the file; an angle column is not played, because no sensor sends one.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor
from truestand.devices.layout import encode_plain
from truestand.devices.sensor import Frame, Laser, Layout, Profiles, StreamStatistics
from truestand.devices.sensors.recipe import SensorRecipe, profiles_per_frame
from truestand.files.scans.read import read_recording


class Replay:
    """A file as ``LineSensor``; ``next_frame`` gives None after its end."""

    def __init__(
        self,
        recipe: SensorRecipe,
        sensor: Sensor,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Reads the file.

        Raises:
            UnreadableFile: no scan.
            BadRecipe: no profile rate.
        """
        self.name = recipe.name
        self._clock, self._sleep, self._pace = clock, sleep, recipe.pace
        self._recording = read_recording(Path(recipe.file))
        rate = recipe.profile_rate_hz or sensor.profile_rate
        if rate is None:
            raise BadRecipe(f"sensor {self.name!r}: key 'profile_rate_hz' is missing; state how fast to play the scan")
        n, points = self._recording.x.shape
        profiles = max(d for d in range(1, profiles_per_frame(rate) + 1) if n % d == 0)  # every frame is full
        self._layout = Layout("plain", "replay", points, profiles, rate)
        self._next = 0
        self._begun = 0.0
        self._running = False

    def identity(self) -> dict[str, str]:
        """The file's format and hash stand for model and serial."""
        return {"manufacturer": "truestand", "model": self._recording.format, "serial": self._recording.sha256[:12]}

    def start(self) -> Layout:
        """Play from the beginning."""
        self._next, self._begun, self._running = 0, self._clock(), True
        return self._layout

    def next_frame(self, timeout: float) -> Frame | None:
        """The next frame when it is due; None after the end of the file, or where none is due within ``timeout`` s."""
        start = self._next * self._layout.profiles
        if not self._running or start >= len(self._recording.x):
            if self._running:
                self._sleep(timeout)
            return None
        due = self._begun + (start + self._layout.profiles) / (self._layout.rate * self._pace) if self._pace else 0.0
        wait = due - self._clock()
        if wait > timeout:
            self._sleep(timeout)
            return None
        if wait > 0:
            self._sleep(wait)
        frame = Frame(self._next, self._clock(), encode_plain(self._profiles(start)))
        self._next += 1
        return frame

    def _profiles(self, start: int) -> Profiles:
        """Those of the frame that begins with profile ``start``."""
        r, rows = self._recording, slice(start, start + self._layout.profiles)
        return Profiles(
            r.x[rows],
            r.z[rows],
            None if r.counter is None else r.counter[rows],
            None if r.time is None else r.time[rows],
            None if r.encoder is None else np.rint(r.encoder[rows]).astype(np.int64),
        )

    def set_laser(self, power: Laser) -> None:
        """No effect: there is no laser."""

    def stop(self) -> None:
        """End the replay."""
        self._running = False

    def statistics(self) -> StreamStatistics:
        """Counts of the frames played; none is ever lost."""
        return StreamStatistics(frames=self._next)

    def close(self) -> None:
        """End the replay."""
        self._running = False
