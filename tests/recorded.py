"""Profiles made before as the source of a virtual sensor, and a table at constant speed: nothing is computed."""

import numpy as np


class Steady:
    """A table at constant speed, rad/s."""

    part_mounted = False

    def __init__(self, speed):
        self.speed = speed

    def angle_at(self, times):
        return self.speed * np.asarray(times)

    def counts_at(self, times, counts_per_turn):
        return np.rint(self.angle_at(times) / (2 * np.pi) * counts_per_turn).astype(np.int64)


class RecordedSource:
    """In the place of a ``SimulatedSource``: the profiles (n, fields, points) again and again."""

    part_mounted = False

    def __init__(self, raw, table, counts_per_turn=36000):
        self._raw, self._table, self._counts_per_turn = raw, table, counts_per_turn
        self._next = 0

    def mount(self, part):
        """No effect: the profiles are what they are."""

    def profiles(self, times, frame, lit):
        rows = np.arange(self._next, self._next + times.size) % self._raw.shape[0]
        self._next = (self._next + times.size) % self._raw.shape[0]
        return self._raw[rows], self.counts(times)

    def counts(self, times):
        return self._table.counts_at(times, self._counts_per_turn)
