"""The threads that record: an error in one is reported, however late."""

import threading
import time
from dataclasses import dataclass, field
from math import inf

import pytest

from station.doubles import LAYOUT, MemoryDrive, MemorySensor
from truestand.core.errors import DeviceLost
from truestand.core.stand import Stand
from truestand.devices.axis import Axis, DriveState
from truestand.devices.sensor import Frame
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.files.scans.scan_log import Kind, read_log
from truestand.station import acquire as acquire_module
from truestand.station import watch
from truestand.station.acquire import acquire
from truestand.station.recipe import ScanSettings
from truestand.station.stand import Station
from truestand.station.state_machine import State

SENSOR = SensorRecipe(name="front", driver="scancontrol", address="127.0.0.1", model="29xx-50", encoder=False)
SETTINGS = ScanSettings(turns=0.1, speed=1.0, run_up=0.0, most_lost=0.001)


@dataclass
class ArrivingDrive(MemoryDrive):
    """It sets ``arrived`` when the stand has seen it at the end of the scan."""

    arrived: threading.Event = field(default_factory=threading.Event)

    def state(self) -> DriveState:
        state = super().state()
        if self.begun.count("move") == 2 and not state.moving:  # the first was to the start
            self.arrived.set()
        return state


@dataclass
class StreamingSensor(MemorySensor):
    """It streams, and is lost as soon as ``lost`` is set."""

    lost: threading.Event = field(default_factory=threading.Event)
    _number: int = 0

    def next_frame(self, timeout: float) -> Frame | None:
        if self.lost.wait(0.005):
            raise DeviceLost("the cable came off")
        self._number += 1
        payload = self._number.to_bytes(2, "little") * (LAYOUT.frame_bytes // 2)
        return Frame(self._number, time.monotonic(), payload)


def test_a_recorder_that_fails_after_the_last_poll_makes_the_scan_incomplete(tmp_path, monkeypatch):
    monkeypatch.setattr(acquire_module, "LAST_FRAMES_S", 0.0)  # no more polls once the table has arrived
    monkeypatch.setattr(watch, "SILENCE_S", inf)  # a busy machine is no silent sensor
    drive = ArrivingDrive()
    station = Station(Stand(), Axis(drive), [StreamingSensor(lost=drive.arrived)])
    log = tmp_path / "k1.log"
    with pytest.raises(DeviceLost, match="the cable came off"):
        acquire(station, SETTINGS, [SENSOR], log, "now")
    (end,) = (record.json() for record in read_log(log) if record.kind is Kind.END)
    assert end == {"complete": False, "reasons": ["the cable came off"]}
    assert station.machine.state is State.FAULT
