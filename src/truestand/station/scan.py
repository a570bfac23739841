"""One scan from order to file: the stand's mark, the guard, the recording, the native files."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from truestand.core.errors import BadRecipe, Fault, TruestandError
from truestand.core.stand import Stand
from truestand.files.read import read_recording
from truestand.files.write_scan import write_recording
from truestand.station.acquire import Live, SensorJob, acquire
from truestand.station.convert import Converted, convert
from truestand.station.guard import guard
from truestand.station.latch import Latch
from truestand.station.machine import Machine
from truestand.station.recipe import DevicesRecipe, Order
from truestand.station.stand import open_station


@dataclass(frozen=True, slots=True)
class Written:
    """One sensor's scan on the disk."""

    path: Path
    scan: Converted


@dataclass(frozen=True, slots=True)
class Taken:
    """What came of an order."""

    written: tuple[Written, ...]
    fault: str = ""
    """Why the stand stopped itself; empty where it didn't."""
    interrupted: bool = False
    """Whether the operator broke it off."""

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
        BadRecipe: there is a log from before.
        KeyboardInterrupt: before anything was recorded.
    """
    log = log_path(output)
    if log.exists():
        raise BadRecipe(f"{log} is there already, from a scan that was cut off: `truestand recover` it, or remove it")
    latch = Latch(recipe)
    try:
        latch.use(_now(), log)
        taken = _record(recipe, stand, devices, order, log, show, latch)
    finally:
        latch.close()
    written = write_scans(log, output, force=True)
    if not keep_log:
        log.unlink()
    return replace(taken, written=written)


def _record(
    recipe: Path,
    stand: Stand,
    devices: DevicesRecipe,
    order: Order,
    log: Path,
    show: Callable[[Live], None],
    latch: Latch,
) -> Taken:
    """Record, and say what ended it; an error before there is a log is passed on."""
    try:
        with guard(recipe), open_station(stand, devices, Machine()) as station:
            jobs = {s.name: SensorJob(s.laser, s.encoder) for s in devices.sensor}
            acquire(station, order, jobs, log, _now(), show)
    except TruestandError as wrong:
        if isinstance(wrong, Fault) or log.exists():
            latch.fault(_now(), str(wrong))
        if not log.exists():
            raise
        return Taken((), fault=str(wrong))
    except KeyboardInterrupt:
        if not log.exists():
            raise
        return Taken((), interrupted=True)
    return Taken(())


def write_scans(log: Path, output: Path, force: bool = False) -> tuple[Written, ...]:
    """The scans of a log as native files, read back before they count.

    Raises:
        UnreadableFile, NotEnoughData: nothing to be made of the log.
    """
    written = []
    for scan in convert(log):
        path = output_of(output, scan.sensor, scan.sensors)
        write_recording(scan.recording, path, scan.stand, force=force)
        read_recording(path)
        written.append(Written(path, scan))
    return tuple(written)


def _now() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
