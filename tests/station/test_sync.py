"""The clocks of sensor and host, and the angles from them, on synthetic numbers."""

import numpy as np
import pytest

from truestand.station.sync import TableTrack, angle_by_clock, fit_clocks

SPEED = 0.3
"""rad/s."""


def test_a_late_last_frame_does_not_change_the_fit_of_the_clocks():
    """Twelve frames make three windows, enough for a line under their earliest arrivals."""
    device = np.arange(12.0)
    host = device + 0.002
    host[-1] += 0.5
    line = fit_clocks(device, host)
    assert line.rate == pytest.approx(1.0, abs=1e-9) and line.offset == pytest.approx(0.002, abs=1e-9)
    assert line.misfit == pytest.approx(0.0, abs=1e-9)


def track(until=10.0):
    """A table that stands for a second, turns at ``SPEED``, and reports a rounded position."""
    time = np.arange(0.0, until, 0.05)
    true = SPEED * np.maximum(time - 1.0, 0.0)
    rough = true + np.where(np.arange(time.size) % 2, 2e-4, -2e-4)
    return TableTrack(time, rough, np.full(time.size, 2e-3), time > 1.0)


def test_the_angle_of_a_steady_table_is_on_one_line_and_in_the_run_up_interpolated():
    within = (0.1, 2.5)
    moment = np.array([0.5, 2.0, 3.013, 5.5, 8.0])
    angle, steady = angle_by_clock(moment, track(), within)
    assert steady
    assert angle[1:] == pytest.approx(SPEED * (moment[1:] - 1.0), abs=2e-5)
    assert angle[0] == pytest.approx(0.0, abs=2.1e-4)


def test_the_angle_of_an_uneven_table_is_interpolated():
    uneven = track()
    position = uneven.position + 0.05 * np.sin(3 * uneven.time) * uneven.moving
    angle, steady = angle_by_clock(
        np.array([4.0]), TableTrack(uneven.time, position, uneven.half_width, uneven.moving), (0.1, 2.5)
    )
    assert not steady
    assert angle[0] == pytest.approx(SPEED * 3.0 + 0.05 * np.sin(12.0), abs=1e-3)
