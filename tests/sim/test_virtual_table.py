"""The virtual table: where it is, how it moves, what it says; and the faults that it plays."""

from math import radians, tau

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from truestand.sim.live.clock import Clock
from truestand.sim.live.table import HISTORY_S, Motion, MotionProfile, VirtualTable


class Stepped:
    """A clock that goes where it is told."""

    def __init__(self):
        self.real = 0.0
        self.clock = Clock(1.0, lambda: self.real)

    def run(self, seconds):
        self.real += seconds


def at_home(motion=None):
    time = Stepped()
    table = VirtualTable(time.clock, motion)
    assert table.home()
    time.run(20.0)
    return time, table


def test_table_at_power_on_is_not_homed_and_counts_from_there():
    time = Stepped()
    table = VirtualTable(time.clock)
    status = table.status()
    assert (status.position, status.moving, status.homed, status.fault) == (0.0, False, False, "")
    assert table.angle_at(0.0) == pytest.approx(radians(70))
    assert table.move(radians(10), 1.0)
    time.run(5.0)
    assert table.status().position == pytest.approx(radians(10))
    assert table.angle_at(5.0) == pytest.approx(radians(80))


def test_homing_takes_some_seconds_and_ends_at_zero():
    time = Stepped()
    table = VirtualTable(time.clock)
    table.home()
    assert table.status().moving and not table.status().homed
    time.run(1.0)
    assert table.status().moving and not table.status().homed
    time.run(3.0)
    status = table.status()
    assert status.homed and not status.moving and status.position == 0.0
    assert table.angle_at(time.clock.now()) == 0.0
    assert table.counts_at(time.clock.now(), 36000) == 0


def test_homing_after_many_turns_takes_the_next_mark_and_leaves_the_past():
    time, table = at_home()
    table.move(5 * tau + 1.0, radians(180))
    time.run(15.0)
    there = time.clock.now()
    assert table.angle_at(there) == pytest.approx(5 * tau + 1.0)
    table.home()
    time.run(6.0)
    assert table.status().position == 0.0 and table.angle_at(time.clock.now()) == 0.0
    assert table.angle_at(there) == pytest.approx(5 * tau + 1.0)


@settings(max_examples=40, deadline=None)
@given(
    commands=st.lists(
        st.tuples(
            st.sampled_from(["move", "turn", "halt", "home"]),
            st.floats(-12, 12),
            st.floats(0.01, 4),
            st.floats(0.0, 3.0),
        ),
        min_size=1,
        max_size=8,
    )
)
def test_speed_and_acceleration_stay_within_limits_for_any_commands(commands):
    time = Stepped()
    motion = Motion()
    table = VirtualTable(time.clock, motion)
    for name, position, speed, pause in commands:
        getattr(table, name)(*{"move": (position, speed), "turn": (np.copysign(speed, position),)}.get(name, ()))
        time.run(pause)
    step = 1e-3
    times = np.arange(0.0, time.clock.now(), step)
    if len(times) < 4:
        return
    angle = np.unwrap(table.angle_at(times))  # homing takes whole turns off
    speed = np.diff(angle) / step
    assert np.abs(speed).max() <= motion.top_speed * (1 + 1e-6)
    assert np.abs(np.diff(speed)).max() / step <= motion.deceleration * (1 + 1e-4)


@settings(deadline=None)
@given(
    st.floats(-50, 50), st.floats(-3, 3), st.floats(-50, 50), st.floats(1e-3, 3), st.floats(0.1, 20), st.floats(0.1, 20)
)
@example(5e-324, 0.0, 0.0, 1.0, 0.5, 0.5)
def test_a_move_ends_at_its_target_from_any_state(position, speed, target, max_speed, acceleration, deceleration):
    profile = MotionProfile(position, speed, acceleration, deceleration)
    profile.reach_position(target, max_speed)
    for segment in profile.segments:
        assert (segment.position, segment.speed) == pytest.approx((position, speed), abs=1e-6)
        assert segment.seconds >= 0
        assert abs(segment.speed) <= max(max_speed, abs(speed)) * (1 + 1e-6)
        position += segment.speed * segment.seconds + segment.acceleration * segment.seconds**2 / 2
        speed = segment.speed + segment.acceleration * segment.seconds
    end = (profile.position, profile.speed)
    assert end == pytest.approx((position, speed), abs=1e-6)
    assert end == pytest.approx((target, 0.0), abs=1e-6)


def test_commands_do_not_change_the_past():
    time, table = at_home()
    table.turn(1.0)
    time.run(3.0)
    times = np.linspace(time.clock.now() - 2.0, time.clock.now(), 50)
    before = table.angle_at(times)
    for command in (table.halt, lambda: table.move(0.0, 2.0), lambda: table.turn(-1.0), table.home, table.stall):
        command()
        np.testing.assert_array_equal(table.angle_at(times), before)
    assert before[-1] - before[0] == pytest.approx(2.0)


def test_past_of_the_table_is_stored_for_a_limited_time():
    time, table = at_home()
    for _ in range(200):
        table.move(0.1, 1.0)
        time.run(1.0)
        table.move(0.0, 1.0)
        time.run(1.0)
    assert len(table._states) < 8 * HISTORY_S


def test_the_motor_follows_late_in_proportion_to_the_speed():
    time, table = at_home(Motion(lag=0.02))
    table.turn(1.0)
    time.run(5.0)
    now = time.clock.now()
    slow = table.angle_at(now)
    assert slow == pytest.approx(5.0 - 0.02 - 0.5 / radians(360), abs=1e-9)


def test_ripple_changes_true_speed_and_not_the_controllers_position():
    time, table = at_home(Motion(ripple=0.1, ripple_per_turn=3))
    table.turn(1.0)
    time.run(10.0)
    times = np.arange(time.clock.now() - 7.0, time.clock.now(), 1e-3)
    speed = np.diff(table.angle_at(times)) / 1e-3
    assert speed.max() == pytest.approx(1.1, abs=1e-3) and speed.min() == pytest.approx(0.9, abs=1e-3)
    table.move(tau, 2.0)
    time.run(10.0)
    assert table.status().position == pytest.approx(tau)
    assert table.angle_at(time.clock.now()) == pytest.approx(tau)


def test_eccentric_encoder_reads_a_sine_more():
    time, table = at_home(Motion(angle_error=radians(1.0)))
    table.move(radians(90), 2.0)
    time.run(5.0)
    now = time.clock.now()
    assert table.angle_at(now) == pytest.approx(radians(90))
    assert table.counts_at(now, 360) == 91


def test_a_stalled_table_says_that_it_moves_and_stands_still():
    time, table = at_home()
    table.move(3.0, 1.0)
    time.run(1.0)
    table.stall()
    stands = table.angle_at(time.clock.now())
    time.run(10.0)
    status = table.status()
    assert status.moving and status.position == pytest.approx(float(stands))
    assert table.angle_at(time.clock.now()) == stands
    table.halt()
    time.run(1.0)
    assert not table.status().moving
    table.move(3.0, 1.0)
    time.run(10.0)
    assert table.status().moving and table.angle_at(time.clock.now()) == stands
    table.release()
    assert not table.status().moving
    table.move(3.0, 1.0)
    time.run(10.0)
    assert table.status().position == pytest.approx(3.0)


def test_a_stuck_encoder_counts_on_when_it_is_released():
    time, table = at_home()
    table.turn(1.0)
    time.run(2.0)
    table.stick_encoder()
    since = time.clock.now()
    time.run(2.0)
    times = np.linspace(since, time.clock.now(), 20)
    assert len(set(table.counts_at(times, 3600))) == 1
    assert np.ptp(table.angle_at(times)) == pytest.approx(2.0)
    table.release()
    time.run(1.0)
    now = time.clock.now()
    assert table.counts_at(now, 3600) == round(float(table.angle_at(now)) / tau * 3600)
    assert len(set(table.counts_at(times[:-1], 3600))) == 1


def test_table_in_a_fault_stops_and_accepts_no_command_until_reset():
    time, table = at_home()
    table.turn(1.0)
    time.run(1.0)
    table.trip("following error")
    time.run(1.0)
    assert table.status().fault == "following error" and not table.status().moving
    assert not table.move(1.0, 1.0) and not table.turn(1.0) and not table.home()
    assert table.halt()
    table.reset()
    assert table.move(1.0, 1.0)


def test_table_reports_moving_at_once_after_a_command():
    _, table = at_home()
    for command in (lambda: table.move(1.0, 1.0), lambda: table.turn(1.0), table.home):
        command()
        assert table.status().moving
