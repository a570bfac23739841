"""The watches of sensor and table, one call after the other."""

from math import radians
from struct import pack

import pytest

from truestand.devices.sensor import Frame, Layout
from truestand.station.watch import SensorWatch, TableWatch

SPEED = radians(18.0)
TARGET = radians(90.0)


def first_problem(position, until=20.0):
    """Of a table that is at ``position(time)`` rad and reports that it moves; and when (s)."""
    watch = TableWatch(SPEED, TARGET, radians(0.05), 0.0)
    for i in range(int(until / 0.02)):
        problem = watch.see(0.02 * i, position(0.02 * i), moving=True)
        if problem:
            return problem, 0.02 * i
    return "", until


@pytest.mark.parametrize(
    "position, words, at_most",
    [
        (lambda t: min(SPEED * t, TARGET), "", 20.0),
        (lambda t: -SPEED * t, "turns backwards", 1.1),
        (lambda t: SPEED * t, "ran past the end of the scan", 5.6),
        (lambda t: SPEED * min(t, 3.0), "stands still", 3.6),
        (lambda t: 0.05 * SPEED * t, "stands still", 1.1),
    ],
    ids=["well", "backwards", "runaway", "stalled", "crawling"],
)
def test_a_table_that_does_not_follow_its_command_is_reported_within_a_second(position, words, at_most):
    problem, time = first_problem(position)
    assert words in problem and bool(problem) == bool(words)
    assert time <= at_most


def stamped(*counters):
    """A frame of profiles without points at 200 Hz, stamped with these counters; None = a profile that never came."""
    stamps = [bytes(16) if n is None else pack(">4I", n, 40 * n << 12, 0, 40 * n << 12 | 1) for n in counters]
    payload = b"".join(bytes(6 * 8 - 16) + stamp for stamp in stamps)
    return Frame(counters[0] // 4, 0.0, payload, missing=48 * counters.count(None))


def test_profiles_lost_within_frames_and_between_them_are_counted_together():
    watch = SensorWatch("front", Layout("scancontrol", "29xx-50", 8, 4, 200.0, 1 << 24, 128.0, 1 << 15), 0.0)
    for frame, lost in ((stamped(4, 5, 6, 7), 0), (stamped(8, None, None, 11), 2), (stamped(14, 15, None, 17), 5)):
        assert watch.see(frame) == ""
        assert watch.lost == lost
    assert watch.profiles == 9
