"""The axis interface by itself: waiting, limits and timeouts, with a drive and a clock of the test's own."""

from dataclasses import dataclass, field
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truestand.core.errors import DeviceError, DeviceLost, LimitExceeded, MoveTimeout
from truestand.devices.axis import MOVE_MARGIN_S, POLL_INTERVAL_S, STALL_S, Axis, DriveState, Limits


@dataclass
class Scripted:
    """A drive that goes through given states, and notes what it is told."""

    states: list = field(default_factory=list)
    told: list = field(default_factory=list)
    name: str = "scripted"

    def start_home(self):
        self.told.append("home")

    def start_move(self, position, speed):
        self.told.append(("move", position, speed))

    def halt(self):
        self.told.append("halt")

    def reset(self):
        self.told.append("reset")

    def state(self):
        state = self.states.pop(0) if len(self.states) > 1 else self.states[0]
        if isinstance(state, Exception):
            raise state
        return state

    def close(self):
        self.told.append("close")


def at(position=0.0, moving=False, homed=True, fault=""):
    return DriveState(position, moving, homed, 0.0, fault=fault)


def table_of(*states, **limits):
    now = [0.0]

    def sleep(seconds):
        now[0] += seconds

    drive = Scripted(list(states))
    return Axis(drive, Limits(**limits), lambda: now[0], sleep), drive, now


def test_homing_ends_homed_or_in_an_error():
    table, drive, _ = table_of(at(moving=True, homed=False), at(), at())
    table.home()
    assert drive.told == ["home"]
    table, _, _ = table_of(at(homed=False))
    with pytest.raises(DeviceError, match="home switch"):
        table.home()


def test_a_move_ends_where_it_should_or_in_an_error():
    table, drive, _ = table_of(at(), at(moving=True), at(1.0))
    table.move_to(1.0, 0.5)
    assert drive.told == [("move", 1.0, 0.5)]
    table, _, _ = table_of(at(), at(0.9))
    with pytest.raises(MoveTimeout, match="blocks the table"):
        table.move_to(1.0, 0.5)


def test_a_move_that_takes_twice_its_time_and_more_is_stopped():
    table, drive, now = table_of(at(), *(at(0.002 * k, moving=True) for k in range(400)))
    with pytest.raises(MoveTimeout, match=r"longer than 6\.0 s"):
        table.move_to(1.0, 0.5)
    assert drive.told[-1] == "halt"
    assert now[0] == pytest.approx(2 * 2.0 + MOVE_MARGIN_S, abs=3 * POLL_INTERVAL_S)


def test_a_move_without_progress_is_stopped_at_once():
    table, drive, now = table_of(at(), at(0.1, moving=True), at(0.3, moving=True))
    with pytest.raises(MoveTimeout, match=r"it stands still at 17\.189 deg while moving to 57\.296 deg"):
        table.move_to(1.0, 0.5)
    assert drive.told[-1] == "halt" and now[0] == pytest.approx(STALL_S, abs=4 * POLL_INTERVAL_S)


def test_settling_at_the_target_is_no_stall():
    table, drive, _ = table_of(at(), *[at(0.9999, moving=True)] * 100, at(1.0))
    table.move_to(1.0, 0.5)
    assert "halt" not in drive.told


def test_late_clock_does_not_time_out_a_table_that_has_arrived():
    table, drive, now = table_of(at(), at(moving=True), at(1.0))
    answer = drive.state

    def slowly():
        now[0] += 100.0
        return answer()

    drive.state = slowly
    table.move_to(1.0, 0.5)
    assert drive.told == [("move", 1.0, 0.5)]


def test_homing_and_stopping_have_their_own_timeouts():
    table, drive, now = table_of(at(moving=True), home_time=7.0, stop_time=1.5)
    with pytest.raises(MoveTimeout, match="homing"):
        table.home()
    assert drive.told == ["home", "halt"] and now[0] == pytest.approx(7.0, abs=3 * POLL_INTERVAL_S)
    with pytest.raises(MoveTimeout, match="stopping"):
        table.stop()
    assert drive.told == ["home", "halt", "halt"] and now[0] == pytest.approx(8.5, abs=6 * POLL_INTERVAL_S)


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(allow_nan=True, allow_infinity=True))
def test_nothing_beyond_the_limits_reaches_the_drive(position, speed):
    limits = {"speed": 1.0, "lowest": -2.0, "highest": 3.0}
    table, drive, _ = table_of(at(), **limits)
    try:
        table.start_move(position, speed)
    except LimitExceeded:
        assert not (-2.0 <= position <= 3.0 and 0 < speed <= 1.0)
        assert drive.told == []
    else:
        assert -2.0 <= position <= 3.0 and 0 < speed <= 1.0


@pytest.mark.parametrize("speed", [0.0, nan, inf, -inf, 1.01, -1.01])
def test_invalid_speed_moves_nothing(speed):
    table, drive, _ = table_of(at(), speed=1.0)
    with pytest.raises(LimitExceeded, match="max_speed_deg_per_s"):
        table.start_move(1.0, speed)
    assert drive.told == []


def test_a_table_without_a_home_moves_nowhere():
    table, drive, _ = table_of(at(homed=False))
    with pytest.raises(DeviceError, match="home it first"):
        table.start_move(1.0, 0.1)
    assert drive.told == []


def test_a_fault_of_the_controller_ends_the_wait():
    table, _, _ = table_of(at(), at(moving=True), at(moving=True, fault="following error"))
    with pytest.raises(DeviceError, match="following error while moving"):
        table.move_to(1.0, 0.5)


def test_a_lost_drive_ends_the_wait():
    table, _, _ = table_of(at(), at(moving=True), DeviceLost("gone"))
    with pytest.raises(DeviceLost):
        table.move_to(1.0, 0.5)


def test_reset_and_close_reach_the_drive():
    table, drive, _ = table_of(at())
    table.reset()
    table.close()
    assert drive.told == ["reset", "close"]
