"""The table of states: no motion and no laser in FAULT, by any sequence of commands."""

from contextlib import suppress

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from station.doubles import MemoryDrive, MemorySensor
from truestand.core.errors import DeviceError, Fault, TruestandError
from truestand.core.stand import Sensor, Stand
from truestand.devices.axis import Axis
from truestand.devices.sensors import range_camera
from truestand.devices.sensors.range_camera import RangeCamera
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.station.stand import Station
from truestand.station.state_machine import PERMITTED, TRANSITIONS, Event, State, StateMachine


def test_devices_that_can_not_be_stopped_are_named_lasers_first():
    table = Axis(MemoryDrive(gone=True), clock=lambda: 0.0, sleep=lambda s: None)
    station = Station(Stand(), table, [MemorySensor("back"), MemorySensor("front", gone=True)])
    assert station.make_safe() == [
        "Laser may be ON: sensor front: memory sensor: no answer",
        "Table may be turning: memory: no answer",
    ]


@pytest.mark.parametrize(
    "laser, words", [("full", "Laser may be ON: sensor front: a range camera can't"), ("none", "")]
)
def test_a_laser_that_its_sensor_can_not_switch_is_named(monkeypatch, laser, words):
    monkeypatch.setattr(range_camera.Camera, "__init__", lambda self, name, *_: setattr(self, "name", name))
    recipe = SensorRecipe(
        name="front", driver="range-camera", address="127.0.0.1", x_step_mm=0.1, z_step_mm=0.1, laser=laser
    )
    camera = RangeCamera(recipe, Sensor("front", 100.0, 8))
    station = Station(Stand(), Axis(MemoryDrive()), [camera])
    station.machine.state = State.WATCHING
    station.set_lasers({"front": recipe.power})
    assert "".join(station.make_safe()).startswith(words)
    assert bool(station.not_stopped) == bool(words)


class StandUnderAnySequence(RuleBasedStateMachine):
    """Any event and command in any order, devices lost and back; the rules hold after every step."""

    def __init__(self) -> None:
        super().__init__()
        self.drive, self.sensor = MemoryDrive(), MemorySensor()
        table = Axis(self.drive, clock=lambda: 0.0, sleep=lambda s: None)
        self.station = Station(Stand(), table, [self.sensor])

    @property
    def machine(self) -> StateMachine:
        return self.station.machine

    def attempt(self, what) -> None:
        before, begun, laser = self.machine.state, len(self.drive.begun), self.sensor.laser
        with suppress(TruestandError):
            what()
        if before is State.FAULT:
            assert len(self.drive.begun) == begun
            assert self.sensor.laser in (laser, "off")

    @rule(event=st.sampled_from(sorted(Event, key=str)))
    def fire(self, event) -> None:
        self.attempt(lambda: self.machine.fire(event, "for a reason"))

    @rule()
    def check(self) -> None:
        self.attempt(self.station.check)

    @rule()
    def home(self) -> None:
        self.attempt(self.station.home)

    @rule(position=st.floats(-10, 10), speed=st.floats(0.1, 1.0))
    def move(self, position, speed) -> None:
        allowed = self.machine.state in PERMITTED["motion"]
        begun = len(self.drive.begun)
        self.attempt(lambda: self.station.table.start_move(position, speed))
        assert allowed or len(self.drive.begun) == begun

    @rule(power=st.sampled_from(["off", "reduced", "full"]))
    def light(self, power) -> None:
        allowed = self.machine.state in PERMITTED["laser"] or power == "off"
        before = self.sensor.laser
        self.attempt(lambda: self.station.sensors[0].set_laser(power))
        assert allowed or self.sensor.laser == before

    @rule()
    def broken_off(self) -> None:
        """Something fails within a guarded stretch: halted and dark afterwards, or in fault."""

        def fail() -> None:
            with self.station.stopped_on_error():
                raise DeviceError("the test says so")

        self.attempt(fail)
        assert self.machine.state is State.FAULT
        assert self.drive.gone or not self.drive.moving
        assert self.sensor.gone or self.sensor.laser == "off"

    @rule(gone=st.booleans())
    def table_comes_and_goes(self, gone) -> None:
        self.drive.gone = gone

    @rule(gone=st.booleans())
    def sensor_comes_and_goes(self, gone) -> None:
        self.sensor.gone = gone

    @invariant()
    def a_fault_has_a_reason_and_nothing_else_has(self) -> None:
        assert (self.machine.state is State.FAULT) == bool(self.machine.reason)


TestStandUnderAnySequence = StandUnderAnySequence.TestCase
TestStandUnderAnySequence.settings = settings(max_examples=40, stateful_step_count=50, deadline=None)


@pytest.mark.slow
class TestFiftyThousandSteps(StandUnderAnySequence.TestCase):
    settings = settings(max_examples=200, stateful_step_count=250, deadline=None)


def test_only_a_reset_leads_out_of_fault():
    assert {event for state, event in TRANSITIONS if state is State.FAULT} == {Event.FAIL, Event.RESET}
    assert TRANSITIONS[State.FAULT, Event.FAIL] is State.FAULT


def test_the_first_reason_of_a_fault_is_kept():
    machine = StateMachine()
    machine.fire(Event.FAIL, "cable")
    machine.fire(Event.FAIL, "everything else, then")
    with pytest.raises(Fault, match=r"cable.*stand reset"), machine.permit("motion"):
        pass
    machine.fire(Event.RESET)
    assert machine.state is State.IDLE


def test_an_event_without_a_transition_is_refused_and_the_state_kept():
    machine = StateMachine()
    with pytest.raises(Fault, match="'start' is not possible while the stand is idle"):
        machine.fire(Event.START)
    assert machine.state is State.IDLE
