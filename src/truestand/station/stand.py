"""The devices of one stand, opened, behind the stand's state; and how all of it is stopped."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import ceil, tau
from types import TracebackType
from typing import Self

from truestand.core.errors import DeviceError, TruestandError
from truestand.core.stand import Stand
from truestand.devices.axis import RotaryTable
from truestand.devices.sensor import Laser, LineSensor
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.tables.opening import open_table
from truestand.station.interlock import GatedDrive, GatedSensor
from truestand.station.recipe import DevicesRecipe, sensor_of
from truestand.station.stand_lock import in_words
from truestand.station.state_machine import TRANSITIONS, Event, Machine

RETURN_SPEED = 0.5
"""Share of the table's highest speed at which it goes back to its start."""


@dataclass(slots=True)
class Station:
    """Table and sensors of a stand. Motion and lasers pass the gates of ``machine`` only."""

    stand: Stand
    table: RotaryTable
    sensors: Sequence[LineSensor]
    machine: Machine = field(default_factory=Machine)
    left: dict[str, str] = field(default_factory=dict)
    """What could not be stopped when that was last tried, and why, in plain words; empty = all of it was."""

    def __post_init__(self) -> None:
        self.table = replace(self.table, drive=GatedDrive(self.table.drive, self.machine))
        self.sensors = [GatedSensor(sensor, self.machine) for sensor in self.sensors]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, wrong: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def check(self) -> list[dict[str, str]]:
        """Ask every device who it is; the table first.

        Raises:
            DeviceError: one that doesn't answer, or says that it is in a fault of its own.
        """
        self.machine.fire(Event.CHECK)
        state = self.table.state()
        if state.fault:
            raise DeviceError(f"{self.table.drive.name}: {state.fault}; mend the cause, then `truestand stand reset`")
        told = [{"device": "table", "name": self.table.drive.name}]
        told += [{"device": "sensor", "name": s.name, **s.identity()} for s in self.sensors]
        self.machine.fire(Event.PASSED)
        return told

    def home(self) -> float:
        """Bring the table to the start of a scan: home, or a whole number of turns from it. rad, where it stands."""
        self.machine.fire(Event.HOME)
        if not self.table.state().homed:
            self.table.home()
        start = self._start()
        self.table.move_to(start, RETURN_SPEED * self.table.limits.speed)
        self.machine.fire(Event.HOMED)
        return start

    def _start(self) -> float:
        """The nearest whole turn onward from where the table is; a table with stops starts at 0."""
        if self.table.limits.highest < float("inf"):
            return 0.0
        return ceil(self.table.state().position / tau - 1e-4) * tau

    def lasers(self, power_of: Callable[[str], Laser]) -> None:
        """Switch every laser to the power of its sensor's recipe."""
        for sensor in self.sensors:
            sensor.set_laser(power_of(sensor.name))

    def make_safe(self) -> list[str]:
        """Halt the table and switch off all lasers, all at once; what could not be told to, in plain words."""
        self.left = {"Laser may be ON, table may be turning": "stopping was broken off"}
        jobs = {f"Laser may be ON: sensor {s.name}": _dark(s) for s in self.sensors}
        jobs["Table may be turning"] = self.table.drive.halt
        with ThreadPoolExecutor(len(jobs)) as together:
            running = {what: together.submit(job) for what, job in jobs.items()}
        failed = {what: job.exception() for what, job in running.items()}
        for wrong in failed.values():
            if wrong is not None and not isinstance(wrong, TruestandError):
                raise wrong
        self.left = {what: str(wrong) for what, wrong in failed.items() if wrong is not None}
        return in_words(self.left)

    def close(self) -> None:
        """Leave all devices: lasers off, streams ended, connections closed. No motion is commanded."""
        for sensor in self.sensors:
            sensor.close()
        self.table.close()

    @contextmanager
    def guarded(self) -> Iterator[None]:
        """Whatever goes wrong inside, an interruption too, ends with the table halted and the lasers off.

        An error latches a fault with its reason; an interruption only stops.
        """
        done = False
        try:
            yield
            done = True
        except TruestandError as wrong:
            self.machine.fire(Event.FAIL, str(wrong))
            raise
        finally:
            if not done:
                self._stop_now()

    def _stop_now(self) -> None:
        failed = self.make_safe()
        if failed:
            self.machine.fire(Event.FAIL, "; ".join(failed))
        elif (self.machine.state, Event.STOP) in TRANSITIONS:
            self.machine.fire(Event.STOP)
            self.machine.fire(Event.STOPPED)


def _dark(sensor: LineSensor) -> Callable[[], None]:
    return lambda: sensor.set_laser("off")


def open_station(stand: Stand, devices: DevicesRecipe, machine: Machine | None = None) -> Station:
    """Connect to all devices of a stand; to none where one fails.

    Raises:
        DeviceLost: one doesn't answer.
    """
    table = open_table(devices.table)
    sensors: list[LineSensor] = []
    try:
        for recipe in devices.sensor:
            sensors.append(open_sensor(recipe, sensor_of(stand, recipe.name)))
    except BaseException:
        for sensor in sensors:
            sensor.close()
        table.close()
        raise
    return Station(stand, table, sensors, machine or Machine())
