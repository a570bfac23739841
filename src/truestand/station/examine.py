"""Looking at the devices of a stand one by one: who answers, what a sensor sends, which one it is."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import degrees, radians

import numpy as np

from truestand.core.errors import BadRecipe, DeviceError, TruestandError
from truestand.core.stand import Stand
from truestand.devices.layout import decode
from truestand.devices.sensor import Layout, LineSensor, StreamStatistics
from truestand.devices.sensors.recipe import SensorRecipe, open_sensor
from truestand.devices.tables.opening import open_table
from truestand.devices.tables.recipe import TableRecipe
from truestand.station.machine import Event, Machine
from truestand.station.recipe import DevicesRecipe, sensor_of
from truestand.station.stand import Station, open_station
from truestand.station.watch import SensorWatch

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
    except TruestandError as wrong:
        return Answer("table", recipe.protocol, recipe.address, answers=False, problem=str(wrong))
    with _closing(table.close):
        state = table.state()
    told = {
        "position_deg": f"{degrees(state.position):.3f}",
        "homed": "yes" if state.homed else "no",
        "moving": "yes" if state.moving else "no",
    }
    return Answer("table", recipe.protocol, recipe.address, answers=True, told=told, problem=state.fault)


def _ask_sensor(stand: Stand, recipe: SensorRecipe) -> Answer:
    try:
        sensor = open_sensor(recipe, sensor_of(stand, recipe.name))
    except TruestandError as wrong:
        return Answer("sensor", recipe.name, recipe.address, answers=False, problem=str(wrong))
    with _closing(sensor.close):
        return Answer("sensor", recipe.name, recipe.address, answers=True, told=sensor.identity())


def try_stream(sensor: LineSensor, seconds: float) -> StreamReport:
    """Let a sensor stream for a while, the laser as it is.

    Raises:
        DeviceLost: it went away meanwhile.
    """
    layout = sensor.start()
    began = time.monotonic()
    watch, problem, last = SensorWatch(sensor.name, layout, began), "", b""
    while not problem and time.monotonic() - began < seconds:
        frame = sensor.next_frame(0.1)
        problem = watch.overdue(time.monotonic()) if frame is None else watch.see(frame)
        last = last if frame is None else frame.payload
    passed = time.monotonic() - began
    sensor.stop()
    return StreamReport(passed, watch.profiles, share_seen(layout, last), sensor.statistics(), watch.lost, problem)


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
        failed = station.make_safe()
        station.machine.fire(Event.STOP)
        if failed:
            raise DeviceError("; ".join(failed))
        station.machine.fire(Event.STOPPED)


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
