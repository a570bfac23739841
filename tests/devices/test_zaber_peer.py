"""Zaber's own library as client of our virtual stage. It works without a network: nothing is identified by its web."""

import time
from math import tau

import pytest

from tables import PACE, served, speed_of

pytest.importorskip("zaber_motion", reason="needs zaber-motion, which pip installs with the dev group")
from zaber_motion.ascii import Connection
from zaber_motion.exceptions import BadCommandException, BadDataException, CommandFailedException

COUNTS = 576000


@pytest.fixture(scope="module")
def stage():
    with served("zaber") as (virtual, server, _):
        host, port = server.address.split(":")
        with Connection.open_tcp(host, int(port)) as connection:
            yield virtual, connection, connection.get_device(1).get_axis(1)


def test_it_finds_the_device_and_its_settings(stage):
    _, connection, axis = stage
    (device,) = connection.detect_devices(identify_devices=False)
    assert device.device_address == 1
    assert device.settings.get("system.axiscount") == 1
    assert device.settings.get("system.serial") == 900001
    assert connection.generic_command("get deviceid").data == "30222"
    assert device.generic_command("get version").data == "7.45"
    axis.settings.set("maxspeed", 150000)
    assert axis.settings.get("maxspeed") == 150000
    assert device.generic_command("tools echo a b").data == "a b"


def test_it_homes_moves_turns_and_stops(stage):
    virtual, _, axis = stage
    axis.home()
    assert axis.is_homed() and axis.warnings.get_flags() == set() and virtual.status().homed
    axis.move_absolute(100000)
    assert axis.get_position() == 100000
    assert float(virtual.angle_at(virtual.clock.now())) == pytest.approx(100000 / COUNTS * tau)
    axis.move_relative(-3000)
    assert axis.get_position() == 97000
    axis.move_absolute(1000, velocity=300000)
    assert axis.get_position() == 1000
    axis.move_velocity(-0.5 * COUNTS / tau * 1.6384)
    time.sleep(1.0 / PACE)
    assert axis.is_busy()
    assert speed_of(virtual, 0.2) == pytest.approx(-0.5, rel=1e-3)
    axis.stop()
    assert not axis.is_busy() and not virtual.status().moving


def test_invalid_commands_are_rejected_with_the_reason(stage):
    _, connection, axis = stage
    with pytest.raises(BadDataException):
        axis.move_absolute(1e12)
    with pytest.raises(BadDataException):
        axis.move_velocity(1e9)
    with pytest.raises(CommandFailedException, match="BADAXIS"):
        connection.get_device(1).get_axis(3).home()
    with pytest.raises(BadCommandException):
        axis.generic_command("foo")
    with pytest.raises(BadCommandException):
        axis.settings.get("no.such.setting")


def test_a_fault_is_a_warning_flag_until_it_is_cleared(stage):
    virtual, _, axis = stage
    virtual.trip("stalled")
    assert "FS" in axis.warnings.get_flags()
    with pytest.raises(CommandFailedException):
        axis.move_absolute(0)
    axis.warnings.clear_flags()
    assert "FS" not in axis.warnings.get_flags()
