"""One scan from order to file: the stand's mark, the guard, the recording, the native files."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from truestand.core.errors import BadRecipe, Fault, NoSpace, NotEnoughData, TruestandError
from truestand.core.stand import Stand
from truestand.files.recipes.recipes import stand_from_recipe, stand_recipe
from truestand.files.records.record import now
from truestand.files.scans.native import FORMAT
from truestand.files.scans.read import sha256_of
from truestand.files.scans.write_scan import write_recording
from truestand.station.acquire import Live, SensorJob, acquire
from truestand.station.convert import Converted, Log, LogSorter, convert
from truestand.station.guard import guard
from truestand.station.latch import Latch, in_words
from truestand.station.machine import Machine
from truestand.station.recipe import DevicesRecipe, Order
from truestand.station.stand import open_station


@dataclass(frozen=True, slots=True)
class Written:
    """One sensor's scan on the disk."""

    path: Path
    scan: Converted
    """Its recording is what reading the file would give."""


@dataclass(frozen=True, slots=True)
class Taken:
    """What came of an order."""

    written: tuple[Written, ...]
    fault: str = ""
    """Why the stand stopped itself; empty where it didn't."""
    interrupted: bool = False
    """Whether the operator broke it off."""
    left: tuple[str, ...] = ()
    """What could not be stopped, in plain words: the guard goes on trying."""

    @property
    def complete(self) -> bool:
        """Whether every scan is proven complete."""
        return bool(self.written) and all(w.scan.complete for w in self.written)


def log_path(output: Path) -> Path:
    """The log of a scan that goes to ``output``."""
    return output.with_suffix(".log")


def output_of(output: Path, sensor: str, sensors: int) -> Path:
    """Where a sensor's scan goes: with several sensors its name is added."""
    return output if sensors == 1 else output.with_name(f"{output.stem}-{sensor}{output.suffix}")


def take_scan(
    recipe: Path,
    stand: Stand,
    devices: DevicesRecipe,
    order: Order,
    output: Path,
    show: Callable[[Live], None] = lambda live: None,
    keep_log: bool = False,
) -> Taken:
    """Take the scan that ``order`` describes with the stand of ``recipe`` (stand.toml), into ``output`` (.h5).

    A fault while the stand moved is a result: what came is written, marked incomplete, and the stand stays in fault
    until it is reset. With several sensors, ``output`` gets their names.

    Raises:
        Fault: the stand is still in fault.
        DeviceError, NoSpace: before anything was recorded: a device that isn't there or isn't well, no room.
        NoSpace: no room for the scan beside the log, which stays.
        BadRecipe: there is a log from before.
        KeyboardInterrupt: before anything was recorded.
    """
    log = log_path(output)
    if log.exists():
        raise BadRecipe(f"{log} is there already, from a scan that was cut off: `truestand recover` it, or remove it")
    latch, sorter = Latch(recipe), LogSorter(log)
    try:
        latch.use(now(), log.absolute())
        taken = _record(recipe, stand, devices, order, sorter, show, latch)
    finally:
        latch.close()
    assert sorter.log is not None
    return replace(taken, written=_written(sorter.log, log, output, taken, keep_log))


def _written(content: Log, log: Path, output: Path, taken: Taken, keep_log: bool) -> tuple[Written, ...]:
    """The scans of a log that was just recorded; where nothing came, what ended it is told instead."""
    try:
        written = write_scans(convert(content), output, force=True)
    except NotEnoughData:
        if not keep_log:
            log.unlink()
        if taken.interrupted:
            raise KeyboardInterrupt from None
        if not taken.fault:
            raise
        raise Fault(f"{taken.fault}; the stand stays in fault: mend the cause, then `truestand stand reset`") from None
    except OSError as wrong:
        raise NoSpace(
            f"{output}: can't be written ({wrong.strerror or wrong}); what was recorded is in {log}: free some "
            "space, then `truestand recover` it"
        ) from wrong
    if not keep_log:
        log.unlink()
    return written


def _record(
    recipe: Path,
    stand: Stand,
    devices: DevicesRecipe,
    order: Order,
    sorter: LogSorter,
    show: Callable[[Live], None],
    latch: Latch,
) -> Taken:
    """Record, and say what ended it; an error before anything is in the log is passed on."""
    left: dict[str, str] = {}
    try:
        with guard(recipe) as hand_over, open_station(stand, devices, Machine()) as station:
            jobs = {s.name: SensorJob(s.power, s.encoder, s.trigger == "encoder") for s in devices.sensor}
            try:
                acquire(station, order, jobs, sorter.path, now(), show, sorter.add)
            finally:
                left = station.left
                if left:
                    hand_over()
    except KeyboardInterrupt:
        if left:
            latch.fault(now(), "it was interrupted by the operator", left)
        if sorter.log is None:
            raise
        return Taken((), interrupted=True, left=tuple(in_words(left)))
    except Exception as wrong:
        if isinstance(wrong, Fault) or left or sorter.path.exists():
            latch.fault(now(), str(wrong), left)
        if sorter.log is None or not isinstance(wrong, TruestandError | OSError):
            raise
        return Taken((), fault=str(wrong), left=tuple(in_words(left)))
    return Taken(())


def write_scans(scans: Iterable[Converted], output: Path, force: bool = False) -> tuple[Written, ...]:
    """The scans of a log as native files; their recordings then say what reading the files would say."""
    written = []
    for scan in scans:
        path = output_of(output, scan.sensor, scan.sensors)
        write_recording(scan.recording, path, scan.stand, force=force)
        stand = stand_from_recipe(stand_recipe(scan.stand))  # its um and degrees rounded as in the file
        recording = replace(scan.recording, format=FORMAT, sha256=sha256_of(path), stand=stand)
        written.append(Written(path, replace(scan, recording=recording)))
    return tuple(written)
