"""A second process that stops the stand when the first one dies: ``python -m truestand.station.guard STAND.toml``.

Its standard input is a pipe from the recording process. ``done`` on it, and the guard ends; the end of the pipe without
it means that the process was killed: the guard halts the table over a connection of its own, and switches the lasers
off as soon as the sensors have noticed the loss and give control free. Not a safety function.
"""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from truestand.core.errors import DeviceLost, TruestandError
from truestand.core.stand import Stand
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.opening import open_table
from truestand.devices.tables.recipe import TableRecipe
from truestand.station.recipe import DevicesRecipe, read_devices, sensor_of

READY, DONE = b"ready\n", b"done\n"
STARTS_WITHIN = 20.0
"""s for the guard to be ready; a Python with numpy on a loaded machine."""
TRIES, PAUSE = 20, 0.25
"""How often, and s between: a sensor keeps control for the dead process until its heartbeat is over."""


@contextmanager
def guard(stand: Path) -> Iterator[Callable[[], None]]:
    """Have a guard stand by while the block runs. It yields what hands over to the guard at the block's end.

    That is for who can't stop the stand: the guard goes on trying, without anyone waiting for it.

    Raises:
        DeviceLost: the guard isn't ready within ``STARTS_WITHIN``; it was ended.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "truestand.station.guard", str(stand)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        bufsize=0,
        start_new_session=True,  # Ctrl-C is for the recording process
    )
    assert process.stdin is not None and process.stdout is not None
    handed_over = threading.Event()
    try:
        if _first_line(process) != READY:
            raise DeviceLost(
                f"{stand}: found no guard within {STARTS_WITHIN:g} s, need one before anything moves; see the lines "
                "above, or end other programs"
            )
        yield handed_over.set
    finally:
        if not handed_over.is_set():
            with suppress(OSError):  # a guard that died has nothing to be told
                process.stdin.write(DONE)
        process.stdin.close()
        process.stdout.close()
        ending = threading.Thread(target=_reap, args=(process,), name="end of the guard", daemon=True)
        ending.start()
        if not handed_over.is_set():
            ending.join()


def _first_line(process: subprocess.Popen[bytes]) -> bytes:
    """What a guard says first; empty where it says nothing within ``STARTS_WITHIN``: it is killed then."""
    assert process.stdout is not None
    said: list[bytes] = []
    read_line = process.stdout.readline
    reading = threading.Thread(target=lambda: said.append(read_line()), name="start of the guard", daemon=True)
    reading.start()
    try:
        reading.join(STARTS_WITHIN)
    finally:
        if reading.is_alive():  # late, or broken off by the operator; the end of its output ends the reading
            process.kill()
            reading.join()
    return b"".join(said)


def _reap(process: subprocess.Popen[bytes]) -> None:
    """Wait for a guard's end, and end one that hangs."""
    try:
        process.wait(STARTS_WITHIN)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def main(arguments: list[str]) -> int:
    """Stand by, and stop the stand where the other process dies."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    stand, devices = read_devices(Path(arguments[0]))
    sys.stdout.buffer.write(READY)
    sys.stdout.buffer.flush()
    if sys.stdin.buffer.readline() == DONE:
        return 0
    return stop_all(stand, devices)


def stop_all(stand: Stand, devices: DevicesRecipe) -> int:
    """Table and lasers off, each tried until it obeys; how many did not."""
    jobs: list[Callable[[], None]] = [lambda: _halt(devices.table)]
    jobs += [_darkener(stand, sensor) for sensor in devices.sensor]
    with ThreadPoolExecutor(len(jobs)) as together:
        results = [together.submit(_until_done, job) for job in jobs]
    return sum(not result.result() for result in results)


def _darkener(stand: Stand, sensor: SensorRecipe) -> Callable[[], None]:
    return lambda: _darken(stand, sensor)


def _until_done(job: Callable[[], None]) -> bool:
    for _ in range(TRIES):
        try:
            job()
        except TruestandError:
            time.sleep(PAUSE)
        else:
            return True
    return False


def _halt(recipe: TableRecipe) -> None:
    table = open_table(recipe)
    try:
        table.drive.halt()
    finally:
        table.close()


def _darken(stand: Stand, recipe: SensorRecipe) -> None:
    sensor = open_sensor(recipe, sensor_of(stand, recipe.name))
    try:
        sensor.set_laser("off")
    finally:
        sensor.close()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
