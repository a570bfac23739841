"""The virtual stand's time: real time, or faster; it never runs ahead of the profiles that sensors have computed.

Everything that moves or measures on the virtual stand reads this one clock, so that what a sensor sees depends on the
true angle of the table, however loaded the machine. It never goes back.
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
        self._limits: dict[str, float] = {}

    def now(self) -> float:
        """Virtual time, s."""
        with self._lock:
            moment = (self._real() - self._start) * self.pace - self._waited
            limit = min(self._limits.values(), default=inf)
            if moment > limit:
                self._waited += moment - limit
                moment = limit
            return moment

    def allow(self, sensor: str, until: float) -> None:
        """Limit the clock to ``until`` (s) for ``sensor``; inf where it does not stream."""
        with self._lock:
            self._limits[sensor] = until

    def real_until(self, moment: float) -> float:
        """Real time (s) until the clock may show ``moment``; 0 where it is past."""
        return max(0.0, (moment - self.now()) / self.pace)
