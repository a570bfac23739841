"""Looking at devices one by one ends with all of them stopped, or says which are not."""

import pytest

from station.doubles import MemoryDrive, MemorySensor
from truestand.core.errors import DeviceError
from truestand.core.stand import Stand
from truestand.devices.axis import RotaryTable
from truestand.station import diagnostics
from truestand.station.stand import Station

LOOKS = {
    "test": lambda: diagnostics.try_all(Stand(), None, 0.0, light=False, move=False),
    "watch": lambda: list(diagnostics.watching(Stand(), None, 0.0, light=False)),
}


@pytest.mark.parametrize("look", LOOKS)
def test_a_laser_that_stays_on_at_the_end_is_told(monkeypatch, look):
    def open_station(*arguments) -> Station:
        return Station(Stand(), RotaryTable(MemoryDrive()), [MemorySensor(gone=True)])

    monkeypatch.setattr(diagnostics, "open_station", open_station)
    with pytest.raises(DeviceError, match="Laser may be ON: sensor front"):
        LOOKS[look]()
