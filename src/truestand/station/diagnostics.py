"""Looking at the devices of a stand one by one: who answers, what a sensor sends, which one it is."""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import degrees, radians, tau
from pathlib import Path

import numpy as np

from truestand.core.errors import BadRecipe, DeviceError, TruestandError
from truestand.core.stand import Stand
from truestand.devices.axis import RotaryTable
from truestand.devices.layout import decode
from truestand.devices.sensor import Layout, LineSensor, StreamStatistics
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.opening import open_table
from truestand.devices.tables.recipe import TableRecipe
from truestand.station.recipe import DevicesRecipe, read_devices, sensor_of
from truestand.station.stand import Station, open_station
from truestand.station.stand_lock import demand_free, reset_latch
from truestand.station.state_machine import Event, Machine
from truestand.station.watch import SensorWatch

TURN, MOST_OFF = radians(10.0), 0.01
"""Angle that a table is turned by in a test, in a second; and the share by which an encoder's counts may be off."""
REST = 0.4
"""s of rest before and after that."""
LOOK = 0.2
"""s between two looks of a person."""
BLINKS, BLINK = 3, 0.4
"""How often, and s each."""
NUDGE, NUDGE_SPEED = radians(2.0), radians(5.0)
"""By how much a table is moved to and fro to be told from others."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What one device says when it is asked."""

    device: str
    """table or sensor."""
    name: str
    address: str
    answers: bool
    told: dict[str, str] = field(default_factory=dict)
    problem: str = ""


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
        """As they came."""
        return self.profiles / self.seconds


def ask_all(stand: Stand, devices: DevicesRecipe) -> list[Answer]:
    """Ask the table and each sensor; one that doesn't answer is an answer too."""
    return [_ask_table(devices.table), *(_ask_sensor(stand, s) for s in devices.sensor)]


def _ask_table(recipe: TableRecipe) -> Answer:
    try:
        table = open_table(recipe)
        with _closing(table.close):
            state = table.state()
    except TruestandError as wrong:
        return Answer("table", recipe.protocol, recipe.address, answers=False, problem=str(wrong))
    told = {
        "position_deg": f"{degrees(state.position):.3f}",
        "homed": "yes" if state.homed else "no",
        "moving": "yes" if state.moving else "no",
    }
    return Answer("table", recipe.protocol, recipe.address, answers=True, told=told, problem=state.fault)


def _ask_sensor(stand: Stand, recipe: SensorRecipe) -> Answer:
    try:
        sensor = open_sensor(recipe, sensor_of(stand, recipe.name))
        with _closing(sensor.close):
            return Answer("sensor", recipe.name, recipe.address, answers=True, told=sensor.identity())
    except TruestandError as wrong:
        return Answer("sensor", recipe.name, recipe.address, answers=False, problem=str(wrong))


def stream_while(sensor: LineSensor, going_on: Callable[[], bool]) -> StreamReport:
    """Let a sensor stream for as long as ``going_on`` says, the laser as it is.

    Raises:
        DeviceLost: it went away meanwhile.
    """
    layout = sensor.start()
    began = time.monotonic()
    watch, problem, last = SensorWatch(sensor.name, layout, began), "", b""
    while not problem and going_on():
        frame = sensor.next_frame(0.1)
        problem = watch.overdue(time.monotonic()) if frame is None else watch.see(frame)
        last = last if frame is None else frame.payload
    passed = time.monotonic() - began
    sensor.stop()
    seen = share_seen(layout, last)
    return StreamReport(passed, watch.profiles, seen, sensor.statistics(), watch.lost, watch.encoder, problem)


def try_stream(sensor: LineSensor, seconds: float) -> StreamReport:
    """Let a sensor stream for some seconds. Errors as ``stream_while``."""
    until = time.monotonic() + seconds
    return stream_while(sensor, lambda: time.monotonic() < until)


def share_seen(layout: Layout, payload: bytes) -> float:
    """Share 0..1 of a payload's readings that carry a point; 0 where there is no whole payload."""
    if len(payload) != layout.frame_bytes:
        return 0.0
    return float(np.isfinite(decode(layout, payload).z).mean())


@contextmanager
def started(stand: Stand, devices: DevicesRecipe) -> Iterator[Station]:
    """A station in which motion and lasers are allowed; halted and dark afterwards, whatever happens."""
    with open_station(stand, devices, Machine()) as station, station.guarded():
        station.check()
        station.home()
        station.machine.fire(Event.START)
        yield station
        _make_safe(station)
        station.machine.fire(Event.STOP)
        station.machine.fire(Event.STOPPED)


def _make_safe(station: Station) -> None:
    """Halt and darken.

    Raises:
        DeviceError: something could not be stopped.
    """
    failed = station.make_safe()
    if failed:
        raise DeviceError("; ".join(failed))


@dataclass(frozen=True, slots=True)
class TestReport:
    """What a test of all devices found."""

    streams: dict[str, StreamReport]
    table: dict[str, str]

    @property
    def well(self) -> bool:
        """Whether nothing was lost or wrong."""
        return not any(r.problem or r.lost_profiles for r in self.streams.values()) and "problem" not in self.table


def try_all(stand: Stand, devices: DevicesRecipe, seconds: float, light: bool, move: bool) -> TestReport:
    """Let every sensor stream; ``light``: with its laser on; ``move``: home and turn the table by 10 degrees too.

    Raises:
        DeviceError: a device that doesn't answer or obey.
    """
    with open_station(stand, devices, Machine()) as station, station.guarded():
        station.check()
        told = _turned(station, devices) if move else {"position_deg": f"{degrees(station.table.state().position):.3f}"}
        if light:
            station.machine.fire(Event.WATCH)
            station.lasers({s.name: s.power for s in devices.sensor}.__getitem__)
        streams = {s.name: try_stream(s, seconds) for s in station.sensors}
        _make_safe(station)
    return TestReport(streams, told)


def _turned(station: Station, devices: DevicesRecipe) -> dict[str, str]:
    """Home, turn by 10 degrees with each sensor that has an encoder, and back at the end; what was found."""
    station.home()
    station.machine.fire(Event.START)
    table, here = station.table, station.table.state().position
    told, expected = {}, TURN / tau * station.stand.counts_per_turn
    for sensor, recipe in zip(station.sensors, devices.sensor, strict=True):
        if recipe.encoder and expected:
            steps = _rest_turn_rest(table, here + TURN)
            counts = stream_while(sensor, lambda steps=steps: next(steps, False)).encoder  # type: ignore[misc]
            table.move_to(here, TURN)
            told[f"encoder_at_{sensor.name}"] = f"{counts} counts in 10 degrees, {expected:.0f} expected"
            if abs(counts - expected) > MOST_OFF * expected:
                told["problem"] = f"the encoder at {sensor.name} does not count what the table turns"
    table.move_to(here + TURN, TURN)
    table.move_to(here, TURN)
    station.machine.fire(Event.STOP)
    station.machine.fire(Event.STOPPED)
    station.check()
    return {"moved": "10 degrees and back", **told}


def _rest_turn_rest(table: RotaryTable, target: float) -> Iterator[bool]:
    """True as long as a turn to ``target`` goes on, with rest before and after, so that all of it is seen."""
    yield from _for_a_while()
    table.start_move(target, TURN)
    while table.state().moving:
        yield True
    yield from _for_a_while()


def _for_a_while() -> Iterator[bool]:
    until = time.monotonic() + REST
    while time.monotonic() < until:
        yield True


def watching(
    stand: Stand, devices: DevicesRecipe, seconds: float, light: bool
) -> Generator[dict[str, dict[str, str]], None, None]:
    """Live numbers of all devices, five times a second, by the device's name. Nothing moves.

    Raises:
        DeviceError: a device that doesn't answer.
    """
    with open_station(stand, devices, Machine()) as station, station.guarded():
        station.check()
        if light:
            station.machine.fire(Event.WATCH)
            station.lasers({s.name: s.power for s in devices.sensor}.__getitem__)
        began = time.monotonic()
        watches = [SensorWatch(s.name, s.start(), began) for s in station.sensors]
        looked = dict.fromkeys((w.name for w in watches), began)
        while time.monotonic() - began < seconds:
            rows = {"table": _table_row(station)}
            for sensor, watch in zip(station.sensors, watches, strict=True):
                rows[sensor.name] = _sensor_row(sensor, watch, looked[sensor.name])
                looked[sensor.name] = time.monotonic()
            yield rows
        _make_safe(station)


def _table_row(station: Station) -> dict[str, str]:
    state = station.table.state()
    doing = state.fault or ("moving" if state.moving else "at rest" if state.homed else "at rest, not homed")
    return {"position": f"{degrees(state.position):.3f} deg", "state": doing}


def _sensor_row(sensor: LineSensor, watch: SensorWatch, before: float) -> dict[str, str]:
    """Take what comes in a fifth of a second, and what came since the last look ``before`` (s)."""
    had, problem, payload, frames = watch.profiles, "", b"", 0
    until = time.monotonic() + LOOK
    while time.monotonic() < until:
        frame = sensor.next_frame(LOOK / 4)
        if frame is not None:
            problem, payload, frames = problem or watch.see(frame), frame.payload, frames + 1
    seconds = time.monotonic() - before
    return {
        "frames/s": f"{frames / seconds:.0f}",
        "profiles/s": f"{(watch.profiles - had) / seconds:.0f}",
        "lost": str(watch.lost),
        "seen": f"{100 * share_seen(watch.layout, payload):.0f} %",
        "encoder": str(watch.encoder),
        "state": problem or watch.overdue(time.monotonic()) or "well",
    }


def reset(path: Path) -> str:
    """Forget the stand's latched fault, and clear the table controller's own; what the fault was, or nothing.

    Raises:
        DeviceError: the stand is in use, or the table doesn't answer.
    """
    _, devices = read_devices(path)
    demand_free(path)
    table = open_table(devices.table)
    with _closing(table.close):
        table.reset()
        fault = table.state().fault
    if fault:
        raise DeviceError(f"{table.drive.name}: {fault}; it stays after a reset: mend the cause at the controller")
    return reset_latch(path)


def identify(stand: Stand, devices: DevicesRecipe, name: str, sleep: Callable[[float], None] = time.sleep) -> None:
    """Have one device show itself: a sensor blinks its laser (reduced), the table turns by 2 degrees to and fro.

    Raises:
        BadRecipe: there is no such device.
        DeviceError: it doesn't answer or obey.
    """
    names = ["table", *(s.name for s in devices.sensor)]
    if name not in names:
        raise BadRecipe(f"found device {name!r}, need one of {', '.join(names)}")
    with started(stand, devices) as station:
        if name == "table":
            here = station.table.state().position
            station.table.move_to(here + NUDGE, NUDGE_SPEED)
            station.table.move_to(here, NUDGE_SPEED)
            return
        sensor = next(s for s in station.sensors if s.name == name)
        for _ in range(BLINKS):
            sensor.set_laser("reduced")
            sleep(BLINK)
            sensor.set_laser("off")
            sleep(BLINK)


@contextmanager
def _closing(close: Callable[[], None]) -> Iterator[None]:
    try:
        yield
    finally:
        with suppress(DeviceError):
            close()
