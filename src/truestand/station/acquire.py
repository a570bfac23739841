"""Taking a scan: check, home, laser on, turn, record, laser off, stop. Safe whatever happens; what came is kept."""

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
from truestand.devices.sensor import Laser, Layout
from truestand.files.recipes.recipes import stand_recipe
from truestand.files.scans.scan_log import INCOMPLETE, SUSPECT, TABLE, Kind, LogWriter, Record
from truestand.station.convert import SensorPlan, begin_record
from truestand.station.machine import Event, State
from truestand.station.recipe import Order
from truestand.station.stand import Station
from truestand.station.watch import SETTLING, EncoderWatch, SensorWatch, TableWatch

TICK = 0.02
"""s between two looks at the table and the watches."""
FIRST_FRAME = 3.0
"""s a sensor has for its first frame."""
LAST_FRAMES = 0.5
"""s that recording goes on after the table has arrived: what is under way still comes."""
SPARE = 200e6
"""Bytes that must stay free on the disk."""
NATIVE_SHARE = 1.5
"""Room for the native file beside the log, over the log's own size: both are there for a moment."""
SPACE_EVERY = 1.0
"""s between two looks at the disk."""


@dataclass(frozen=True, slots=True)
class SensorJob:
    """How one sensor takes part."""

    power: Laser
    encoder: bool
    by_table: bool = False
    """The encoder triggers it: while the table stands, it rightly sends nothing."""


@dataclass(frozen=True, slots=True)
class Live:
    """Where a recording is; for people."""

    state: State
    done: float
    """0..1."""
    position: float
    """rad of the table."""
    names: tuple[str, ...]
    """Of the sensors; the rest likewise."""
    frames_per_s: tuple[float, ...]
    profiles: tuple[int, ...]
    lost: tuple[int, ...]
    layouts: tuple[Layout, ...]
    latest: tuple[bytes, ...]
    """Payload of each sensor's newest frame; empty before the first."""


Show = Callable[[Live], None]


def acquire(
    station: Station,
    order: Order,
    jobs: dict[str, SensorJob],
    log: Path,
    created: str,
    show: Show = lambda live: None,
    written: Callable[[Record], None] = lambda record: None,
) -> None:
    """Record one scan to ``log``, each record to ``written`` once it is there. ``jobs`` by the sensors' names.

    Whatever goes wrong, an interruption too, ends with the table halted, the lasers off, and what came on the disk.

    Raises:
        Fault: something went wrong while the stand moved; latched in the station's machine.
        DeviceError, NoSpace: something is wrong before anything moved.
        FileExistsError: the log is already there.
    """
    with station.guarded():
        station.check()
        station.table.demand(order.travel, order.speed)
        layouts = [sensor.start() for sensor in station.sensors]
        plans = tuple(
            SensorPlan(s.name, layout, jobs[s.name].encoder) for s, layout in zip(station.sensors, layouts, strict=True)
        )
        demand_space(log, order, plans)
        station.home()
        with LogWriter(log, written) as writer:
            begin = begin_record(stand_recipe(station.stand), order, plans, created, f"truestand {__version__}")
            writer.append_json(Kind.BEGIN, begin, time.monotonic())
            _Run(station, order, jobs, plans, writer, show).record()


def demand_space(log: Path, order: Order, plans: Sequence[SensorPlan]) -> None:
    """Refuse a scan for which the disk has no room, before anything moves.

    Raises:
        NoSpace: too little free, or a folder that can't be written.
    """
    a_second = sum(p.layout.rate / p.layout.profiles * p.layout.frame_bytes for p in plans)
    needed = SPARE + a_second * (order.seconds + FIRST_FRAME) * (1.0 + NATIVE_SHARE)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=log.parent):
            free = shutil.disk_usage(log.parent).free
    except OSError as wrong:
        raise NoSpace(f"{log.parent}: can't be written ({wrong.strerror or wrong}); give another folder") from wrong
    if free < needed:
        raise NoSpace(
            f"{log.parent}: found {free / 1e6:.0f} MB free, the scan needs {needed / 1e6:.0f}; free some space or give "
            "another folder"
        )


@dataclass(slots=True)
class _Run:
    """One recording while it goes on."""

    station: Station
    order: Order
    jobs: dict[str, SensorJob]
    plans: tuple[SensorPlan, ...]
    log: LogWriter
    show: Show
    watches: list[SensorWatch] = field(default_factory=list)
    encoders: list[EncoderWatch | None] = field(default_factory=list)
    latest: list[bytes] = field(default_factory=list)
    over: threading.Event = field(default_factory=threading.Event)
    start: float = 0.0
    _looked_at_disk: float = 0.0

    def record(self) -> None:
        """From the first frame to rest; the END record says how it went."""
        machine, table = self.station.machine, self.station.table
        now = time.monotonic()
        self.latest = [b"" for _ in self.plans]
        self.watches = [
            SensorWatch(p.name, p.layout, now, quiet_until=inf if self.jobs[p.name].by_table else 0.0)
            for p in self.plans
        ]
        with ThreadPoolExecutor(len(self.plans), "recorder") as together:
            try:
                recorders = [together.submit(self._record_sensor, i) for i in range(len(self.plans))]
                self._turn(recorders)
                self.over.set()
                for recorder in recorders:  # one may have failed since the last look
                    recorder.result()
            except BaseException as wrong:
                self._end_badly(wrong)
                raise
            finally:
                self.over.set()
        self.log.append_json(Kind.END, {"complete": True, "reasons": []}, time.monotonic())
        machine.fire(Event.STOP)
        failed = self.station.make_safe()
        table.stop()
        for sensor in self.station.sensors:
            sensor.stop()
        if failed:
            raise Fault("; ".join(failed))
        machine.fire(Event.STOPPED)

    def _end_badly(self, wrong: BaseException) -> None:
        """Stop first, then write why, as far as the disk still takes it."""
        expected = isinstance(wrong, Exception)
        if expected:
            self.station.machine.fire(Event.FAIL, str(wrong))
        self.station.make_safe()
        if not isinstance(wrong, NoSpace):
            reason = str(wrong) if expected else "it was interrupted by the operator"
            self.log.append_json(Kind.END, {"complete": False, "reasons": [reason]}, time.monotonic())

    def _turn(self, recorders: list[Future[None]]) -> None:
        """The scan proper."""
        machine, table = self.station.machine, self.station.table
        machine.fire(Event.START)
        self.station.lasers(lambda name: self.jobs[name].power)
        self._await_first_frames(recorders)
        at_rest = self._ask_table()
        self.start = at_rest.position
        target = self.start + self.order.travel
        table.start_move(target, self.order.speed)
        machine.fire(Event.TURNING)
        began = time.monotonic()
        watch = TableWatch(self.order.speed, target, table.limits.tolerance, began)
        self.encoders = [
            EncoderWatch(p.name, self.station.stand.counts_per_turn, self.order.speed, began)
            if p.encoder and p.layout.encoder_modulus
            else None
            for p in self.plans
        ]
        self._expect(began + SETTLING)
        while not self._arrived(watch, recorders):
            time.sleep(TICK)
        until = time.monotonic() + LAST_FRAMES
        while time.monotonic() < until:
            self._look(recorders)
            time.sleep(TICK)

    def _arrived(self, watch: TableWatch, recorders: list[Future[None]]) -> bool:
        """One look at everything; whether the table has arrived."""
        self._look(recorders)
        state = self._ask_table()
        _demand(state.fault)
        _demand(watch.see(state.time, state.position, state.moving))
        if state.position > self.start + self.order.run_up + self.order.turns * tau:
            self._expect(inf)
        for sensor, encoder in zip(self.watches, self.encoders, strict=True):
            if encoder is not None:
                _demand(encoder.see(state.time, state.position, sensor.encoder, sensor.fresh(state.time)))
        self._show(state.position)
        return watch.arrived(state.position, state.moving)

    def _expect(self, since: float) -> None:
        """From when on (s) the sensors must send which the table triggers."""
        for watch in self.watches:
            if self.jobs[watch.name].by_table:
                watch.quiet_until = since

    def _look(self, recorders: list[Future[None]]) -> None:
        """Recorders, sensors, disk."""
        now = time.monotonic()
        for recorder in recorders:
            if recorder.done():
                recorder.result()
        ordered = int(self.order.seconds * max(p.layout.rate for p in self.plans))
        for watch in self.watches:
            _demand(watch.overdue(now))
            _demand(watch.wasteful(self.order.most_lost, ordered))
        if now - self._looked_at_disk > SPACE_EVERY:
            self._looked_at_disk = now
            if shutil.disk_usage(self.log.path.parent).free < SPARE / 4:
                raise NoSpace(f"{self.log.path.parent}: the disk is all but full; what was recorded so far is kept")

    def _ask_table(self) -> DriveState:
        state = self.station.table.state()
        self.log.append(Kind.TABLE, TABLE.pack(state.position, state.time_half_width, state.moving), state.time)
        return state

    def _await_first_frames(self, recorders: list[Future[None]]) -> None:
        until = time.monotonic() + FIRST_FRAME
        awaited = [watch for watch in self.watches if not self.jobs[watch.name].by_table]
        while any(watch.profiles == 0 for watch in awaited):
            for recorder in recorders:
                if recorder.done():
                    recorder.result()
            if time.monotonic() > until:
                silent = ", ".join(w.name for w in awaited if w.profiles == 0)
                raise DeviceLost(
                    f"sensor {silent}: found no profile in {FIRST_FRAME:g} s, need the first before the table turns; "
                    "check trigger mode, cable and firewall"
                )
            time.sleep(TICK)

    def _record_sensor(self, i: int) -> None:
        """A thread's job: every frame of one sensor to the log, looked at on the way; not those from before."""
        sensor, watch = self.station.sensors[i], self.watches[i]
        while not self.over.is_set():
            frame = sensor.next_frame(TICK * 5)
            if frame is None or frame.received < watch.began:
                continue
            problem = watch.see(frame)
            flags = INCOMPLETE if frame.missing else SUSPECT if problem else 0
            self.log.append(Kind.FRAME, frame.payload, frame.received, i, frame.number, flags)
            _demand(problem)
            self.latest[i] = frame.payload

    def _show(self, position: float) -> None:
        seconds = max(time.monotonic() - self.watches[0].began, 1e-3)
        self.show(
            Live(
                self.station.machine.state,
                min(max((position - self.start) / self.order.travel, 0.0), 1.0),
                position,
                tuple(p.name for p in self.plans),
                tuple(w.profiles / w.layout.profiles / seconds for w in self.watches),
                tuple(w.profiles for w in self.watches),
                tuple(w.lost for w in self.watches),
                tuple(p.layout for p in self.plans),
                tuple(self.latest),
            )
        )


def _demand(nothing: str) -> None:
    """Turn a complaint into a fault.

    Raises:
        Fault: there is one.
    """
    if nothing:
        raise Fault(nothing)
