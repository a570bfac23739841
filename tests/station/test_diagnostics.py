"""Diagnostics end with all devices stopped, or name those that are not; a test compares the encoder with the table."""

from contextlib import nullcontext

import pytest

from station.doubles import MemoryDrive, MemorySensor
from truestand.core.errors import DeviceError
from truestand.core.stand import Stand
from truestand.devices.axis import Axis
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.recipe import TableRecipe
from truestand.station import diagnostics
from truestand.station.recipe import DevicesRecipe
from truestand.station.stand import Station

DIAGNOSTICS = {
    "test": lambda: diagnostics.check_devices(Stand(), None, 0.0, laser=False, move=False),
    "watch": lambda: list(diagnostics.live_values(Stand(), None, 0.0, laser=False)),
}


@pytest.mark.parametrize("name", DIAGNOSTICS)
def test_a_laser_that_stays_on_at_the_end_is_named(monkeypatch, name):
    station = Station(Stand(), Axis(MemoryDrive()), [MemorySensor(gone=True)])
    monkeypatch.setattr(diagnostics, "open_station", lambda *arguments: nullcontext(station))
    with pytest.raises(DeviceError, match="Laser may be ON: sensor front"):
        DIAGNOSTICS[name]()


def test_an_encoder_that_does_not_count_in_a_turn_of_10_degrees_is_reported_with_the_counts_expected(monkeypatch):
    station = Station(Stand(counts_per_turn=360_000), Axis(MemoryDrive()), [MemorySensor()])
    monkeypatch.setattr(diagnostics, "open_station", lambda *arguments: nullcontext(station))
    monkeypatch.setattr(diagnostics, "REST_S", 0.0)
    devices = DevicesRecipe(
        table=TableRecipe(protocol="modbus", address="127.0.0.1:0"),
        sensor=[SensorRecipe(name="front", driver="scancontrol", address="127.0.0.1", model="29xx-50")],
    )
    report = diagnostics.check_devices(station.stand, devices, 0.0, laser=False, move=True)
    assert not report.passed
    assert report.table == {
        "moved": "10 degrees and back",
        "encoder_at_front": "0 counts in 10 degrees, 10000 expected",
        "problem": "the encoder at front does not count what the table turns",
    }
