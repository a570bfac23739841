"""What the watches say, moment by moment."""

from math import radians

import pytest

from truestand.station.watch import TableWatch

SPEED = radians(18.0)
TARGET = radians(90.0)


def told(position, until=20.0):
    """The first complaint of a table that is at ``position(time)`` rad and says that it moves, and when (s)."""
    watch = TableWatch(SPEED, TARGET, radians(0.05), 0.0)
    for i in range(int(until / 0.02)):
        said = watch.see(0.02 * i, position(0.02 * i), moving=True)
        if said:
            return said, 0.02 * i
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
def test_a_table_that_does_not_go_where_it_was_told_is_said(position, words, at_most):
    said, at = told(position)
    assert words in said and bool(said) == bool(words)
    assert at <= at_most
