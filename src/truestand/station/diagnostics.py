"""Diagnostics of a stand's devices: which answer, what a sensor sends, which device is which; and the fault's reset."""

import time
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from math import degrees, radians, tau
from pathlib import Path

import numpy as np

from truestand.core.errors import BadRecipe, DeviceError, TruestandError
from truestand.core.stand import Stand
from truestand.devices.axis import Axis
from truestand.devices.layout import decode
from truestand.devices.positioner import AxisRecipe
from truestand.devices.sensor import Layout, LineSensor, StreamStatistics
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.opening import open_axis
from truestand.devices.tables.recipe import TableRecipe
from truestand.station.recipe import DevicesRecipe, read_devices, sensor_of
from truestand.station.stand import Station, open_station
from truestand.station.stand_lock import require_unused, reset_latched_fault
from truestand.station.state_machine import Event
from truestand.station.watch import SensorWatch

TEST_TURN, ENCODER_TOLERANCE = radians(10.0), 0.01
"""Angle that a table is turned by in a test, in a second; and the share by which an encoder's counts may be off."""
REST_S = 0.4
"""At rest before and after that."""
UPDATE_INTERVAL_S = 0.2
"""Between two updates of the live values."""
BLINKS, BLINK_S = 3, 0.4
IDENTIFY_TURN, IDENTIFY_SPEED = radians(2.0), radians(5.0)
"""Of a table that is moved to and fro to be recognised."""


@dataclass(frozen=True, slots=True)
class DeviceAnswer:
    """The answer of one device to the question for its identity or state."""

    device: str
    """table, axis or sensor."""
    name: str
    address: str
    answers: bool
    details: Mapping[str, str] = field(default_factory=dict)
    """Identity of a sensor, state of a table; as text."""
    problem: str = ""
    """Why it doesn't answer, or what fault it reports; empty = none."""


@dataclass(frozen=True, slots=True)
class StreamReport:
    """How a sensor streamed for a while."""

    seconds: float
    profiles: int
    seen: float
    """Share of the readings of the last frame, 0..1."""
    statistics: StreamStatistics
    lost_profiles: int
    encoder: int
    """Counts from the first profile to the last."""
    problem: str = ""

    @property
    def profiles_per_s(self) -> float:
        """As counted by this computer's clock."""
        return self.profiles / self.seconds


def ask_devices(stand: Stand, devices: DevicesRecipe) -> list[DeviceAnswer]:
    """Ask the table, the positioner and each sensor; one that doesn't answer is an answer too.

    Raises:
        BadRecipe: a device for a sensor that the stand doesn't have.
    """
    return [
        _ask_axis("table", devices.table.protocol, devices.table),
        *(_ask_axis("axis", axis.name, axis) for axis in devices.axes),
        *(_ask_sensor(stand, s) for s in devices.sensor),
    ]


def _ask_axis(device: str, name: str, recipe: TableRecipe | AxisRecipe) -> DeviceAnswer:
    try:
        with closing(open_axis(recipe, recipe.limits)) as axis:
            state = axis.state()
    except TruestandError as error:
        return DeviceAnswer(device, name, recipe.address, answers=False, problem=str(error))
    details = {
        f"position_{recipe.unit}": f"{degrees(state.position):.3f}",
        "homed": "yes" if state.homed else "no",
        "moving": "yes" if state.moving else "no",
    }
    return DeviceAnswer(device, name, recipe.address, answers=True, details=details, problem=state.fault)


def _ask_sensor(stand: Stand, recipe: SensorRecipe) -> DeviceAnswer:
    try:
        with closing(open_sensor(recipe, sensor_of(stand, recipe.name))) as sensor:
            return DeviceAnswer("sensor", recipe.name, recipe.address, answers=True, details=sensor.identity())
    except TruestandError as error:
        return DeviceAnswer("sensor", recipe.name, recipe.address, answers=False, problem=str(error))


def _stream(sensor: LineSensor, while_running: Iterator[None]) -> StreamReport:
    """Let a sensor stream until the iterator ends; one step is taken before each frame. The laser stays as it is."""
    layout = sensor.start()
    began = time.monotonic()
    watch, problem, last = SensorWatch(sensor.name, layout, began), "", b""
    for _ in while_running:
        frame = sensor.next_frame(0.1)
        problem = watch.overdue(time.monotonic()) if frame is None else watch.see(frame)
        last = last if frame is None else frame.payload
        if problem:
            break
    seconds = time.monotonic() - began
    sensor.stop()
    seen = _share_seen(layout, last)
    return StreamReport(seconds, watch.profiles, seen, sensor.statistics(), watch.lost, watch.encoder, problem)


def _for_seconds(seconds: float) -> Iterator[None]:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        yield


def _share_seen(layout: Layout, payload: bytes) -> float:
    """Share 0..1 of a payload's readings that carry a point; 0 where there is no whole payload."""
    if len(payload) != layout.frame_bytes:
        return 0.0
    return float(np.isfinite(decode(layout, payload).z).mean())


@contextmanager
def _checked_station(stand: Stand, devices: DevicesRecipe) -> Iterator[Station]:
    """A station whose devices all answer; halted and its lasers off afterwards, whatever happens.

    Raises:
        DeviceError: one doesn't answer, or could not be stopped.
    """
    with open_station(stand, devices) as station, station.stopped_on_error():
        station.check()
        yield station
        failures = station.make_safe()
        if failures:
            raise DeviceError("; ".join(failures))


def _lasers_on(station: Station, devices: DevicesRecipe) -> None:
    station.machine.fire(Event.WATCH)
    station.set_lasers({s.name: s.power for s in devices.sensor})


@dataclass(frozen=True, slots=True)
class DeviceTest:
    """What a test of all devices found."""

    streams: Mapping[str, StreamReport]
    """By the sensor's name."""
    table: Mapping[str, str]
    """As text."""

    @property
    def passed(self) -> bool:
        """Whether nothing was lost or wrong."""
        return not any(r.problem or r.lost_profiles for r in self.streams.values()) and "problem" not in self.table


def check_devices(stand: Stand, devices: DevicesRecipe, seconds: float, laser: bool, move: bool) -> DeviceTest:
    """Let every sensor stream; ``laser``: with its laser on; ``move``: home and turn the table by 10 degrees too.

    Raises:
        DeviceError: a device that doesn't answer or obey.
    """
    with _checked_station(stand, devices) as station:
        if move:
            table = _turn_table(station, devices)
        else:
            table = {"position_deg": f"{degrees(station.table.state().position):.3f}"}
        if laser:
            _lasers_on(station, devices)
        streams = {s.name: _stream(s, _for_seconds(seconds)) for s in station.sensors}
    return DeviceTest(streams, table)


def _turn_table(station: Station, devices: DevicesRecipe) -> dict[str, str]:
    """Home, turn by 10 degrees with each sensor that has an encoder, and back at the end; the report, as text."""
    station.home()
    station.machine.fire(Event.START)
    table, start = station.table, station.table.state().position
    report, expected = {}, TEST_TURN / tau * station.stand.counts_per_turn
    for sensor, recipe in zip(station.sensors, devices.sensor, strict=True):
        if recipe.encoder and expected:
            counts = _stream(sensor, _rest_turn_rest(table, start + TEST_TURN)).encoder
            table.move_to(start, TEST_TURN)
            report[f"encoder_at_{sensor.name}"] = f"{counts} counts in 10 degrees, {expected:.0f} expected"
            if abs(counts - expected) > ENCODER_TOLERANCE * expected:
                report["problem"] = f"the encoder at {sensor.name} does not count what the table turns"
    table.move_to(start + TEST_TURN, TEST_TURN)
    table.move_to(start, TEST_TURN)
    station.machine.fire(Event.STOP)
    station.machine.fire(Event.STOPPED)
    station.check()
    return {"moved": "10 degrees and back", **report}


def _rest_turn_rest(table: Axis, target: float) -> Iterator[None]:
    """Goes on as long as a turn to ``target``, with rest before and after, so that the encoder counts all of it."""
    yield from _for_seconds(REST_S)
    table.start_move(target, TEST_TURN)
    while table.state().moving:
        yield
    yield from _for_seconds(REST_S)


def live_values(
    stand: Stand, devices: DevicesRecipe, seconds: float, laser: bool
) -> Generator[dict[str, dict[str, str]], None, None]:
    """Live values of all devices, five times a second, by the device's name. Nothing moves.

    Raises:
        DeviceError: a device that doesn't answer.
    """
    with _checked_station(stand, devices) as station:
        if laser:
            _lasers_on(station, devices)
        began = time.monotonic()
        watches = [SensorWatch(s.name, s.start(), began) for s in station.sensors]
        updated = dict.fromkeys((w.name for w in watches), began)
        while time.monotonic() - began < seconds:
            rows = {axis.what: _axis_row(axis) for axis in station.axes}
            for sensor, watch in zip(station.sensors, watches, strict=True):
                rows[sensor.name] = _sensor_row(sensor, watch, updated[sensor.name])
                updated[sensor.name] = time.monotonic()
            yield rows


def _axis_row(axis: Axis) -> dict[str, str]:
    state = axis.state()
    motion = state.fault or ("moving" if state.moving else "at rest" if state.homed else "at rest, not homed")
    return {"position": f"{degrees(state.position):.3f} {axis.unit}", "state": motion}


def _sensor_row(sensor: LineSensor, watch: SensorWatch, updated: float) -> dict[str, str]:
    """Frames of the next fifth of a second, as rates since the last update (s)."""
    profiles_before, problem, payload, frames = watch.profiles, "", b"", 0
    until = time.monotonic() + UPDATE_INTERVAL_S
    while time.monotonic() < until:
        frame = sensor.next_frame(UPDATE_INTERVAL_S / 4)
        if frame is not None:
            problem, payload, frames = problem or watch.see(frame), frame.payload, frames + 1
    seconds = time.monotonic() - updated
    return {
        "frames/s": f"{frames / seconds:.0f}",
        "profiles/s": f"{(watch.profiles - profiles_before) / seconds:.0f}",
        "lost": str(watch.lost),
        "seen": f"{100 * _share_seen(watch.layout, payload):.0f} %",
        "encoder": str(watch.encoder),
        "state": problem or watch.overdue(time.monotonic()) or "well",
    }


def reset_fault(path: Path) -> str:
    """Clear the controllers' own faults, and forget the latched one; its reason, empty where there was none.

    Raises:
        BadRecipe: a stand.toml without devices, or with wrong ones.
        DeviceError: the stand is in use, or a controller doesn't answer.
    """
    _, devices = read_devices(path)
    require_unused(path)
    axes: list[tuple[TableRecipe | AxisRecipe, str]] = [(devices.table, "table")]
    axes += [(axis, f"axis {axis.name}") for axis in devices.axes]
    for recipe, what in axes:
        with closing(open_axis(recipe, recipe.limits, what)) as axis:
            axis.reset()
            fault = axis.state().fault
        if fault:
            raise DeviceError(f"{axis.drive.name}: {fault}; it stays after a reset: mend the cause at the controller")
    return reset_latched_fault(path)


def identify_device(stand: Stand, devices: DevicesRecipe, name: str) -> None:
    """Have one device show itself: a sensor blinks its laser (reduced), the table turns by 2 degrees to and fro.

    Raises:
        BadRecipe: there is no such device.
        DeviceError: it doesn't answer or obey.
    """
    names = ["table", *devices.names]
    if name not in names:
        raise BadRecipe(f"found device {name!r}, need one of {', '.join(names)}")
    with _checked_station(stand, devices) as station:
        station.home()
        station.machine.fire(Event.START)
        if name == "table":
            start = station.table.state().position
            station.table.move_to(start + IDENTIFY_TURN, IDENTIFY_SPEED)
            station.table.move_to(start, IDENTIFY_SPEED)
            return
        sensor = next(s for s in station.sensors if s.name == name)
        for _ in range(BLINKS):
            sensor.set_laser("reduced")
            time.sleep(BLINK_S)
            sensor.set_laser("off")
            time.sleep(BLINK_S)
