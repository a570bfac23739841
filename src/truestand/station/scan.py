"""From settings to scans on the disk: the stand's lock, the guard, the recording of each stop, the native files."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from truestand.core.errors import BadRecipe, Fault, NoSpace, NotEnoughData, TruestandError
from truestand.core.stand import Stand
from truestand.files.recipes.recipes import stand_from_recipe, stand_recipe
from truestand.files.records.record import now
from truestand.files.scans.native import FORMAT
from truestand.files.scans.read import sha256_of
from truestand.files.scans.write_scan import write_recording
from truestand.station.acquire import Live, acquire
from truestand.station.convert import SensorScan, convert
from truestand.station.guard import guard
from truestand.station.log import Log, LogBuilder
from truestand.station.recipe import DevicesRecipe, ScanSettings, Stop, stops_of
from truestand.station.route import Route, route_of
from truestand.station.stand import open_station
from truestand.station.stand_lock import REMEDY, StandLock, failure_texts


@dataclass(frozen=True, slots=True)
class WrittenScan:
    """One sensor's scan on the disk."""

    path: Path
    scan: SensorScan
    """Its recording is what reading the file would give."""


@dataclass(frozen=True, slots=True)
class ScanOutcome:
    """What came of taking a scan."""

    written: tuple[WrittenScan, ...]
    fault: str = ""
    """Why the stand stopped itself; empty where it didn't."""
    interrupted: bool = False
    """Whether the operator broke it off."""
    not_stopped: tuple[str, ...] = ()
    """What could not be stopped, and why: the guard goes on trying."""

    @property
    def complete(self) -> bool:
        """Whether every scan is proven complete."""
        return bool(self.written) and all(w.scan.complete for w in self.written)


def output_path(output: Path, view: str, views: int) -> Path:
    """Where a view's scan goes: with several views its name is added."""
    return output if views == 1 else output.with_name(f"{output.stem}-{view}{output.suffix}")


def output_paths(output: Path, stops: Sequence[Stop]) -> tuple[Path, ...]:
    """Where the scans of all views go, in the order in which they are taken."""
    views = [view for stop in stops for view in stop.views]
    return tuple(output_path(output, name, len(views)) for name in views)


def take_scan(
    recipe: Path,
    stand: Stand,
    devices: DevicesRecipe,
    settings: ScanSettings,
    output: Path,
    show: Callable[[Live], None] = lambda live: None,
    keep_log: bool = False,
    views: Sequence[str] | None = None,
) -> ScanOutcome:
    """Take a scan by each view, or by some, as ``settings`` say with the stand of ``recipe`` (stand.toml), into
    ``output`` (.h5): at once, or one after the other where the positioner goes from place to place.

    A fault while the stand moved is a result: what came is written, marked incomplete, and the stand stays in fault
    until it is reset. With several views, ``output`` gets their names.

    Raises:
        Fault: the stand is still in fault.
        DeviceError, NoSpace: before anything was recorded: a device that isn't there or isn't well, no room.
        NoSpace: no room for the scan beside the log, which stays.
        BadRecipe: there is a log from before.
        KeyboardInterrupt: before anything was recorded.
    """
    stops = stops_of(stand, devices, views)
    number, route = sum(len(stop.views) for stop in stops), route_of(recipe, stand, devices, stops)
    logs = [output_path(output, stop.views[0], len(stops)).with_suffix(".log") for stop in stops]
    whole = ScanOutcome(())
    with closing(StandLock(recipe)) as lock:
        _refuse_logs(logs)
        for k, (stop, log) in enumerate(zip(stops, logs, strict=True)):
            builder = LogBuilder(log)
            lock.set_in_use(now(), log.absolute())
            shown = show if len(stops) == 1 else _as_part_of(show, k, len(stops))
            outcome = _record(recipe, stand, stop, settings, builder, shown, lock, route)
            assert builder.log is not None
            written = _write(builder.log, log, output, outcome, keep_log, number)
            whole = replace(outcome, written=(*whole.written, *written))
            if not whole.complete or outcome.fault:
                break
            if route is not None and stop.position is not None:
                route = route.after
    return whole


def _refuse_logs(logs: Sequence[Path]) -> None:
    """Refuse to write over what a scan before left."""
    for log in logs:
        if log.exists():
            raise BadRecipe(
                f"{log} is there already, from a scan that was cut off: `truestand recover` it, or remove it"
            )


def _as_part_of(show: Callable[[Live], None], number: int, of: int) -> Callable[[Live], None]:
    """How far one scan of several is, shown as how far all are."""
    return lambda live: show(replace(live, done=(number + live.done) / of))


def _write(
    content: Log, log: Path, output: Path, outcome: ScanOutcome, keep_log: bool, views: int
) -> tuple[WrittenScan, ...]:
    """The scans of a log that was just recorded, of so many ``views`` in all; where nothing came, what ended the
    recording is raised instead.
    """
    try:
        written = write_scans(convert(content), output, force=True, views=views)
    except NotEnoughData:
        if not keep_log:
            log.unlink()
        if outcome.interrupted:
            raise KeyboardInterrupt from None
        if not outcome.fault:
            raise
        raise Fault(f"{outcome.fault}; the stand stays in fault: {REMEDY}") from None
    except OSError as error:
        raise NoSpace(
            f"{output}: can't be written ({error.strerror or error}); what was recorded is in {log}: free some "
            "space, then `truestand recover` it"
        ) from error
    if not keep_log:
        log.unlink()
    return written


def _record(
    recipe: Path,
    stand: Stand,
    stop: Stop,
    settings: ScanSettings,
    builder: LogBuilder,
    show: Callable[[Live], None],
    lock: StandLock,
    route: Route | None,
) -> ScanOutcome:
    """Record, and return what ended it; an error before anything is in the log is passed on."""
    not_stopped: dict[str, str] = {}
    try:
        with guard(recipe) as hand_over, open_station(stand, stop.devices) as station:
            try:
                goes = None if stop.position is None else route
                acquire(station, settings, stop.devices.sensor, builder.path, now(), show, builder.add, goes)
            finally:
                not_stopped = station.not_stopped
                if not_stopped:
                    hand_over()
    except KeyboardInterrupt:
        if not_stopped:
            lock.latch_fault(now(), "it was interrupted by the operator", not_stopped)
        if builder.log is None:
            raise
        return ScanOutcome((), interrupted=True, not_stopped=tuple(failure_texts(not_stopped)))
    except Exception as error:
        if isinstance(error, Fault) or not_stopped or builder.path.exists():
            lock.latch_fault(now(), str(error), not_stopped)
        if builder.log is None or not isinstance(error, TruestandError | OSError):
            raise
        return ScanOutcome((), fault=str(error), not_stopped=tuple(failure_texts(not_stopped)))
    return ScanOutcome(())


def write_scans(
    scans: Iterable[SensorScan], output: Path, force: bool = False, views: int | None = None
) -> tuple[WrittenScan, ...]:
    """The scans of a log as native files; their recordings are then as if read from the files. ``views``: how many
    there are in all; None: those of the log.
    """
    written = []
    for scan in scans:
        path = output_path(output, scan.sensor, views or scan.sensors)
        write_recording(scan.recording, path, scan.stand, force=force)
        stand = stand_from_recipe(stand_recipe(scan.stand))  # its um and degrees rounded as in the file
        recording = replace(scan.recording, format=FORMAT, sha256=sha256_of(path), stand=stand)
        written.append(WrittenScan(path, replace(scan, recording=recording)))
    return tuple(written)
