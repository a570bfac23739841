"""Failed logins slow down further ones: from the same address after a few, under the same name after more.

A name is throttled less and for a shorter time, so that nobody can lock another one out for long.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

FORGET = 900.0
"""s after the last failure that it is forgotten."""
MOST = 10_000
"""Keys that are remembered; the oldest gives way."""


@dataclass(frozen=True, slots=True)
class Rule:
    """How many failures are free, and the longest wait after more, s; it doubles from 1 s."""

    free: int
    longest: float


RULES = {"address": Rule(5, 300.0), "user": Rule(20, 30.0)}


class Throttle:
    """Failures by (what, which), as in ("user", "anna")."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._failures: dict[tuple[str, str], tuple[int, float]] = {}

    def attempt(self, *keys: tuple[str, str]) -> float:
        """s until the next try is allowed; 0: now, and it counts as a failure until it ``succeeded``."""
        with self._lock:
            wait = max((self._wait(key) for key in keys), default=0.0)
            for key in keys if wait == 0.0 else ():
                count, last = self._failures.pop(key, (0, 0.0))
                self._failures[key] = (1 if self._clock() - last > FORGET else count + 1, self._clock())
            while len(self._failures) > MOST:
                del self._failures[next(iter(self._failures))]
            return wait

    def succeeded(self, *keys: tuple[str, str]) -> None:
        """Take the last attempt back; a user's earlier ones too, an address's not: others may be guessing there."""
        with self._lock:
            for key in keys:
                count, last = self._failures.pop(key, (0, 0.0))
                if count > 1 and key[0] == "address":
                    self._failures[key] = (count - 1, last)

    def _wait(self, key: tuple[str, str]) -> float:
        count, last = self._failures.get(key, (0, 0.0))
        rule, passed = RULES[key[0]], self._clock() - last
        if count < rule.free or passed > FORGET:
            return 0.0
        return max(0.0, min(rule.longest, 2.0 ** min(count - rule.free, 30)) - passed)
