"""The devices of one stand, opened, behind the stand's interlocks; and how all of it is stopped.

Interlocks: a motion or a laser needs a state of the stand that permits it; halt and laser off always pass.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, tau
from typing import Literal

from truestand.core.errors import DeviceError, Fault, TruestandError
from truestand.core.stand import Stand
from truestand.devices.axis import Axis, Drive, DriveState
from truestand.devices.positioner import Positioner, open_positioner
from truestand.devices.sensor import Frame, Laser, Layout, LineSensor, StreamStatistics
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.tables.line import Lines
from truestand.devices.tables.opening import open_axis
from truestand.planning.kinematics import Position
from truestand.station.recipe import DevicesRecipe, sensor_of
from truestand.station.stand_lock import failure_texts
from truestand.station.state_machine import TRANSITIONS, Event, StateMachine

RETURN_SPEED_SHARE = 0.5
"""Share of the table's highest speed at which it goes back to its start."""


@dataclass(frozen=True, slots=True)
class InterlockedDrive:
    """A drive that begins a motion only where the stand's state permits it."""

    inner: Drive
    machine: StateMachine
    action: Literal["motion", "positioning"] = "motion"

    @property
    def name(self) -> str:
        """Protocol and address."""
        return self.inner.name

    def start_home(self) -> None:
        """Begin to home.

        Raises:
            Fault: a state that permits no motion.
        """
        with self.machine.permit(self.action):
            self.inner.start_home()

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move to ``position`` (rad) at ``speed`` (rad/s).

        Raises:
            Fault: a state that permits no motion.
        """
        with self.machine.permit(self.action):
            self.inner.start_move(position, speed)

    def halt(self) -> None:
        """Always passes."""
        self.inner.halt()

    def reset(self) -> None:
        """Always passes: it moves nothing."""
        self.inner.reset()

    def state(self) -> DriveState:
        """Always passes."""
        return self.inner.state()

    def close(self) -> None:
        """Always passes."""
        self.inner.close()


@dataclass(frozen=True, slots=True)
class InterlockedSensor:
    """A sensor that switches its laser on only where the stand's state permits it."""

    inner: LineSensor
    machine: StateMachine

    @property
    def name(self) -> str:
        """As in stand.toml."""
        return self.inner.name

    def set_laser(self, power: Laser) -> None:
        """Switch the laser; off always passes.

        Raises:
            Fault: a state that permits no laser.
        """
        if power == "off":
            self.inner.set_laser(power)
            return
        with self.machine.permit("laser"):
            self.inner.set_laser(power)

    def identity(self) -> dict[str, str]:
        """Always passes, as all below."""
        return self.inner.identity()

    def start(self) -> Layout:
        """Begin to stream; the laser stays as it is."""
        return self.inner.start()

    def next_frame(self, timeout: float) -> Frame | None:
        """The next frame."""
        return self.inner.next_frame(timeout)

    def stop(self) -> None:
        """End the stream."""
        self.inner.stop()

    def statistics(self) -> StreamStatistics:
        """How the stream went so far."""
        return self.inner.statistics()

    def close(self) -> None:
        """Laser off, control given back."""
        self.inner.close()


@dataclass(slots=True)
class Station:
    """Table, sensors and positioner of a stand. Every motion and every laser needs a state of ``machine`` that permits
    it."""

    stand: Stand
    table: Axis
    sensors: Sequence[LineSensor]
    positioner: Positioner | None = None
    machine: StateMachine = field(default_factory=StateMachine)
    not_stopped: dict[str, str] = field(default_factory=dict)
    """Warning and reason of each device that did not obey the last ``make_safe``; empty = all did."""

    def __post_init__(self) -> None:
        self.table = replace(self.table, drive=InterlockedDrive(self.table.drive, self.machine))
        self.sensors = [InterlockedSensor(sensor, self.machine) for sensor in self.sensors]
        if self.positioner is not None:
            axes = (
                replace(axis, drive=InterlockedDrive(axis.drive, self.machine, "positioning"))
                for axis in self.positioner.axes
            )
            self.positioner = replace(self.positioner, axes=tuple(axes))

    def check(self) -> None:
        """Ask every device for an answer; what moves first.

        Raises:
            DeviceError: one that doesn't answer, or says that it is in a fault of its own.
        """
        self.machine.fire(Event.CHECK)
        for axis in self.axes:
            state = axis.state()
            if state.fault:
                raise DeviceError(f"{axis.drive.name}: {state.fault}; mend the cause, then `truestand stand reset`")
        for sensor in self.sensors:
            sensor.identity()
        self.machine.fire(Event.PASSED)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """All that moves: the table, and the axes of the positioner."""
        return (self.table, *(() if self.positioner is None else self.positioner.axes))

    def home(self, way: Sequence[Position] = ()) -> None:
        """Bring the positioner along its ``way``, homed before where it doesn't know where it is, and the table to the
        start of a scan: home, or a whole number of turns from it.

        Raises:
            DeviceError: the table doesn't answer, home or arrive.
            Fault: the positioner doesn't.
        """
        self.machine.fire(Event.HOME)
        if self.positioner is not None and way:
            self._bring(self.positioner, way)
        if not self.table.state().homed:
            self.table.home()
        self.table.move_to(self._start(), RETURN_SPEED_SHARE * self.table.limits.speed)
        self.machine.fire(Event.HOMED)

    def _bring(self, positioner: Positioner, way: Sequence[Position]) -> None:
        try:
            if not positioner.homed:
                positioner.home()
            positioner.move_along(way)
        except DeviceError as error:
            raise Fault(f"positioner: {error}") from error

    def _start(self) -> float:
        """The nearest whole turn (rad) onward from where the table is; a table with stops starts at 0."""
        if self.table.limits.highest < float("inf"):
            return 0.0
        return ceil(self.table.state().position / tau - 1e-4) * tau

    def set_lasers(self, powers: Mapping[str, Laser]) -> None:
        """Switch every laser to its power, by the sensor's name.

        Raises:
            Fault: a state that permits no laser.
            DeviceError: one that can't be switched.
        """
        for sensor in self.sensors:
            sensor.set_laser(powers[sensor.name])

    def make_safe(self) -> list[str]:
        """Halt table and positioner and switch off all lasers, all at once; a warning for each device that did not
        obey.
        """
        self.not_stopped = {"Laser may be ON, table may be turning": "stopping was broken off"}
        commands: dict[str, Callable[[], None]] = {
            f"Laser may be ON: sensor {s.name}": partial(s.set_laser, "off") for s in self.sensors
        }
        commands["Table may be turning"] = self.table.drive.halt
        for axis in self.axes[1:]:
            commands[f"Positioner may be moving: {axis.what}"] = axis.drive.halt
        with ThreadPoolExecutor(len(commands)) as together:
            sent = {hazard: together.submit(command) for hazard, command in commands.items()}
        errors = {hazard: command.exception() for hazard, command in sent.items()}
        for error in errors.values():
            if error is not None and not isinstance(error, TruestandError):
                raise error
        self.not_stopped = {hazard: str(error) for hazard, error in errors.items() if error is not None}
        return failure_texts(self.not_stopped)

    @contextmanager
    def stopped_on_error(self) -> Iterator[None]:
        """Whatever goes wrong inside, an interruption too, ends with the table halted and the lasers off.

        An error latches a fault with its reason; an interruption only stops.
        """
        try:
            yield
        except BaseException as error:
            if isinstance(error, TruestandError):
                self.machine.fire(Event.FAIL, str(error))
            self._stop_now()
            raise

    def _stop_now(self) -> None:
        failures = self.make_safe()
        if failures:
            self.machine.fire(Event.FAIL, "; ".join(failures))
        elif (self.machine.state, Event.STOP) in TRANSITIONS:
            self.machine.fire(Event.STOP)
            self.machine.fire(Event.STOPPED)


@contextmanager
def open_station(stand: Stand, devices: DevicesRecipe) -> Iterator[Station]:
    """A station connected to all devices of a stand; to none where one fails.

    All are left afterwards: lasers off, streams ended, connections closed. No motion is commanded.

    Raises:
        DeviceLost: one doesn't answer.
    """
    with ExitStack() as connections:
        lines: Lines = {}
        table = open_axis(devices.table, devices.table.limits, lines=lines)
        connections.callback(table.close)
        positioner = None if devices.positioner is None else open_positioner(devices.positioner, lines)
        if positioner is not None:
            connections.callback(positioner.close)
        sensors: list[LineSensor] = []
        for recipe in devices.sensor:
            sensors.append(open_sensor(recipe, sensor_of(stand, recipe.name)))
            connections.callback(sensors[-1].close)
        yield Station(stand, table, sensors, positioner)
