"""The virtual stand's time: real time, or faster; it never runs ahead of what the sensors have drawn.

Everything that moves or measures on the virtual stand reads this one clock, so that what a sensor sees depends on where
the table really is, however loaded the machine. It never goes back.
"""

import threading
import time
from collections.abc import Callable
from math import inf


class Clock:
    """Virtual seconds since the start: ``pace`` times real time, less the time it had to wait for a sensor."""

    def __init__(self, pace: float = 1.0, real: Callable[[], float] = time.monotonic) -> None:
        self.pace = pace
        self._real = real
        self._lock = threading.Lock()
        self._start = real()
        self._waited = 0.0
        self._allowed: dict[str, float] = {}

    def now(self) -> float:
        """Virtual time, s."""
        with self._lock:
            moment = (self._real() - self._start) * self.pace - self._waited
            limit = min(self._allowed.values(), default=inf)
            if moment > limit:
                self._waited += moment - limit
                moment = limit
            return moment

    def allow(self, sensor: str, until: float) -> None:
        """Let the clock run up to ``until`` as far as ``sensor`` is concerned; inf where it streams nothing."""
        with self._lock:
            self._allowed[sensor] = until

    def real_until(self, moment: float) -> float:
        """Real seconds until the clock may show ``moment``; 0 where it is past."""
        return max(0.0, (moment - self.now()) / self.pace)
