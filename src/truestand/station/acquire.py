"""Taking a scan: check, go there, home, laser on, turn, record, laser off, stop. Safe whatever happens; frames are
kept.
"""

import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from math import inf, tau
from pathlib import Path

from truestand._version import __version__
from truestand.core.errors import DeviceLost, Fault, NoSpace
from truestand.devices.axis import DriveState
from truestand.devices.sensor import Layout, LineSensor
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.files.recipes.recipes import stand_recipe
from truestand.files.scans.scan_log import INCOMPLETE, SUSPECT, TABLE, Kind, LogWriter, Record
from truestand.station.log import SensorPlan, begin_record
from truestand.station.recipe import ScanSettings
from truestand.station.route import Route
from truestand.station.stand import Station
from truestand.station.state_machine import Event, State
from truestand.station.watch import SETTLING_S, EncoderWatch, SensorWatch, TableWatch

POLL_INTERVAL_S = 0.02
"""Of table and watches."""
FIRST_FRAME_TIMEOUT_S = 3.0
LAST_FRAMES_S = 0.5
"""For which recording goes on after the table has arrived: frames that are under way still come."""
SPARE_BYTES = 200e6
"""That must stay free on the disk."""
NATIVE_SHARE = 1.5
"""Room for the native file beside the log, over the log's own size: both are there for a moment."""
DISK_CHECK_INTERVAL_S = 1.0
POSITIONER_CHECK_INTERVAL_S = 0.2


@dataclass(frozen=True, slots=True)
class LiveSensor:
    """How far one sensor's recording is."""

    name: str
    frames_per_s: float
    profiles: int
    lost: int
    """Profiles."""
    layout: Layout
    latest: bytes
    """Payload of the newest frame; empty before the first."""


@dataclass(frozen=True, slots=True)
class Live:
    """How far a recording is, for displays."""

    state: State
    done: float
    """0..1."""
    position: float
    """rad of the table."""
    sensors: tuple[LiveSensor, ...]


Show = Callable[[Live], None]


def acquire(
    station: Station,
    settings: ScanSettings,
    sensors: Sequence[SensorRecipe],
    log: Path,
    created: str,
    show: Show = lambda live: None,
    written: Callable[[Record], None] = lambda record: None,
    route: Route | None = None,
) -> None:
    """Record one scan to ``log``, and hand each record to ``written`` once it is there.

    ``sensors``: the recipes of the station's sensors, in their order; ``route``: where the positioner brings them.

    Whatever goes wrong, an interruption too, ends with all that moves halted, the lasers off, and the frames on the
    disk.

    Raises:
        Fault, DeviceError, NoSpace: while the stand moved; then its machine is in FAULT. Or before anything moved.
        BadRecipe: no clear way for the positioner, to this place or to one after it; before anything moved.
        FileExistsError: the log is already there.
    """
    with station.stopped_on_error():
        station.check()
        station.table.demand(settings.travel, settings.speed)
        plans = tuple(
            SensorPlan(sensor.name, sensor.start(), recipe.encoder)
            for sensor, recipe in zip(station.sensors, sensors, strict=True)
        )
        _require_space(log, settings, plans)
        station.home(() if route is None or station.positioner is None else route.way(station.positioner))
        with LogWriter(log, written) as writer:
            begin = begin_record(stand_recipe(station.stand), settings, plans, created, f"truestand {__version__}")
            writer.append_json(Kind.BEGIN, begin, time.monotonic())
            now = time.monotonic()
            recorders = [
                _SensorRecorder(i, sensor, recipe, SensorWatch(plan.name, plan.layout, now))
                for i, (sensor, recipe, plan) in enumerate(zip(station.sensors, sensors, plans, strict=True))
            ]
            _Recording(station, settings, recorders, writer, show).record()


def _require_space(log: Path, settings: ScanSettings, plans: Sequence[SensorPlan]) -> None:
    """Refuse a scan for which the disk has no room, before anything moves."""
    bytes_per_s = sum(p.layout.rate / p.layout.profiles * p.layout.frame_bytes for p in plans)
    seconds = settings.duration + FIRST_FRAME_TIMEOUT_S
    needed = SPARE_BYTES + bytes_per_s * seconds * (1.0 + NATIVE_SHARE)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=log.parent):
            free = shutil.disk_usage(log.parent).free
    except OSError as error:
        raise NoSpace(f"{log.parent}: can't be written ({error.strerror or error}); give another folder") from error
    if free < needed:
        raise NoSpace(
            f"{log.parent}: found {free / 1e6:.0f} MB free, the scan needs {needed / 1e6:.0f}; free some space or give "
            "another folder"
        )


@dataclass(slots=True)
class _SensorRecorder:
    """One sensor's part of a recording."""

    index: int
    """Of the sensor in the log."""
    sensor: LineSensor
    recipe: SensorRecipe
    watch: SensorWatch
    encoder: EncoderWatch | None = None
    """Once the table turns; None where the sensor has none."""
    latest: bytes = b""

    def record(self, log: LogWriter, over: threading.Event) -> None:
        """In a thread: check and log every frame until ``over``, without those from before the recording."""
        while not over.is_set():
            frame = self.sensor.next_frame(POLL_INTERVAL_S * 5)
            if frame is None or frame.received < self.watch.began:
                continue
            problem = self.watch.see(frame)
            flags = INCOMPLETE if frame.missing else SUSPECT if problem else 0
            log.append(Kind.FRAME, frame.payload, frame.received, self.index, frame.number, flags)
            _raise_fault(problem)
            self.latest = frame.payload

    def live(self, now: float) -> LiveSensor:
        """How far the recording is at ``now`` (s)."""
        w = self.watch
        rate = w.profiles / w.layout.profiles / max(now - w.began, 1e-3)
        return LiveSensor(w.name, rate, w.profiles, w.lost, w.layout, self.latest)


@dataclass(slots=True)
class _Recording:
    """One recording while it goes on."""

    station: Station
    settings: ScanSettings
    sensors: Sequence[_SensorRecorder]
    log: LogWriter
    show: Show
    threads: list[Future[None]] = field(default_factory=list)
    over: threading.Event = field(default_factory=threading.Event)
    start: float = 0.0
    """rad of the table before it turns."""
    _disk_checked: float = 0.0
    _positioner_checked: float = 0.0

    def record(self) -> None:
        """Record from the first frame to rest; the END record tells whether the recording is complete."""
        self._expect_triggered(since=inf)
        with ThreadPoolExecutor(len(self.sensors), "recorder") as together:
            try:
                self.threads = [together.submit(sensor.record, self.log, self.over) for sensor in self.sensors]
                self._turn()
                self.over.set()
                for thread in self.threads:  # one may have failed since the last poll
                    thread.result()
            except BaseException as error:
                self._abort(error)
                raise
            finally:
                self.over.set()
        self.log.append_json(Kind.END, {"complete": True, "reasons": []}, time.monotonic())
        self._stop()

    def _stop(self) -> None:
        self.station.machine.fire(Event.STOP)
        failures = self.station.make_safe()
        self.station.table.stop()
        for sensor in self.station.sensors:
            sensor.stop()
        if failures:
            raise Fault("; ".join(failures))
        self.station.machine.fire(Event.STOPPED)

    def _abort(self, error: BaseException) -> None:
        """Stop first, then write why, as far as the disk still takes it."""
        interrupted = not isinstance(error, Exception)
        if not interrupted:
            self.station.machine.fire(Event.FAIL, str(error))
        self.station.make_safe()
        if not isinstance(error, NoSpace):
            reason = "it was interrupted by the operator" if interrupted else str(error)
            self.log.append_json(Kind.END, {"complete": False, "reasons": [reason]}, time.monotonic())

    def _turn(self) -> None:
        """Lasers on, the table from rest to rest, and the last frames."""
        machine, table, speed = self.station.machine, self.station.table, self.settings.speed
        machine.fire(Event.START)
        self.station.set_lasers({sensor.recipe.name: sensor.recipe.power for sensor in self.sensors})
        self._await_first_frames()
        self.start = self._table_state().position
        target = self.start + self.settings.travel
        table.start_move(target, speed)
        machine.fire(Event.TURNING)
        began = time.monotonic()
        watch = TableWatch(speed, target, table.limits.tolerance, began)
        for sensor in self.sensors:
            if sensor.recipe.encoder and sensor.watch.layout.encoder_modulus:
                sensor.encoder = EncoderWatch(sensor.recipe.name, self.station.stand.counts_per_turn, speed, began)
        self._expect_triggered(since=began + SETTLING_S)
        while not self._arrived(watch):
            time.sleep(POLL_INTERVAL_S)
        until = time.monotonic() + LAST_FRAMES_S
        while time.monotonic() < until:
            self._poll()
            time.sleep(POLL_INTERVAL_S)

    def _arrived(self, watch: TableWatch) -> bool:
        """Poll recorders, disk, sensors, table and encoders; whether the table has arrived."""
        self._poll()
        state = self._table_state()
        _raise_fault(state.fault)
        _raise_fault(watch.see(state.time, state.position, state.moving))
        if state.position > self.start + self.settings.run_up + self.settings.turns * tau:
            self._expect_triggered(since=inf)
        for sensor in self.sensors:
            if sensor.encoder is not None:
                fresh = sensor.watch.fresh(state.time)
                _raise_fault(sensor.encoder.see(state.time, state.position, sensor.watch.encoder, fresh))
        self._show(state.position)
        return watch.arrived(state.position, state.moving)

    def _expect_triggered(self, since: float) -> None:
        """Set from when on (s) sensors must send that the encoder triggers: at rest, they rightly send nothing."""
        for sensor in self.sensors:
            if sensor.recipe.trigger == "encoder":
                sensor.watch.quiet_until = since

    def _poll(self) -> None:
        """Poll recorders, sensors and disk."""
        now = time.monotonic()
        self._raise_failures()
        expected = int(self.settings.duration * max(sensor.watch.layout.rate for sensor in self.sensors))
        for sensor in self.sensors:
            _raise_fault(sensor.watch.overdue(now))
            _raise_fault(sensor.watch.too_lossy(self.settings.most_lost, expected))
        if now - self._positioner_checked > POSITIONER_CHECK_INTERVAL_S:
            self._positioner_checked = now
            _raise_fault(self._unsteady())
        if now - self._disk_checked > DISK_CHECK_INTERVAL_S:
            self._disk_checked = now
            if shutil.disk_usage(self.log.path.parent).free < SPARE_BYTES / 4:
                raise NoSpace(f"{self.log.path.parent}: the disk is all but full; what was recorded so far is kept")

    def _unsteady(self) -> str:
        """The problem of a positioner that should stand still; empty = none."""
        for axis in self.station.axes[1:]:
            state = axis.state()
            if state.fault or state.moving:
                return f"positioner: {axis.drive.name}: {state.fault or 'it moves while a scan is recorded'}"
        return ""

    def _raise_failures(self) -> None:
        """Raise the error of a thread that has failed."""
        for thread in self.threads:
            if thread.done():
                thread.result()

    def _table_state(self) -> DriveState:
        state = self.station.table.state()
        self.log.append(Kind.TABLE, TABLE.pack(state.position, state.time_half_width, state.moving), state.time)
        return state

    def _await_first_frames(self) -> None:
        until = time.monotonic() + FIRST_FRAME_TIMEOUT_S
        awaited = [sensor.watch for sensor in self.sensors if sensor.recipe.trigger != "encoder"]
        while any(watch.profiles == 0 for watch in awaited):
            self._raise_failures()
            if time.monotonic() > until:
                silent = ", ".join(w.name for w in awaited if w.profiles == 0)
                raise DeviceLost(
                    f"sensor {silent}: found no profile in {FIRST_FRAME_TIMEOUT_S:g} s, need the first before the "
                    "table turns; check trigger mode, cable and firewall"
                )
            time.sleep(POLL_INTERVAL_S)

    def _show(self, position: float) -> None:
        now = time.monotonic()
        done = min(max((position - self.start) / self.settings.travel, 0.0), 1.0)
        sensors = tuple(sensor.live(now) for sensor in self.sensors)
        self.show(Live(self.station.machine.state, done, position, sensors))


def _raise_fault(problem: str) -> None:
    """Raise a fault for what a watch or the table reports; nothing for an empty text."""
    if problem:
        raise Fault(problem)
