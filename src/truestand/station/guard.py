"""A second process that stops the stand when the first one dies: ``python -m truestand.station.guard STAND.toml``.

Its standard input is a pipe from the recording process. ``done`` on it, and the guard ends; the end of the pipe without
it means that the process was killed: the guard halts table and positioner over connections of its own, and switches the
lasers off as soon as the sensors have noticed the loss and give control free. Not a safety function.
"""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from functools import partial
from pathlib import Path

from truestand.core.errors import DeviceLost, TruestandError
from truestand.core.stand import Stand
from truestand.devices.positioner import AxisRecipe
from truestand.devices.sensors.opening import open_sensor
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.line import Lines
from truestand.devices.tables.opening import open_axis
from truestand.devices.tables.recipe import TableRecipe
from truestand.station.recipe import DevicesRecipe, read_devices, sensor_of

READY, DONE = b"ready\n", b"done\n"
START_TIMEOUT_S = 20.0
"""For the guard to be ready; a Python with numpy on a loaded machine."""
ATTEMPTS, RETRY_INTERVAL_S = 20, 0.25
"""A sensor keeps control for the dead process until its heartbeat is over."""


@contextmanager
def guard(stand: Path) -> Iterator[Callable[[], None]]:
    """Have a guard stand by while the block runs. Yields a function that hands over to the guard at the block's end.

    To be called where the stand can't be stopped: the guard goes on trying, and nobody waits for it.

    Raises:
        DeviceLost: the guard isn't ready within ``START_TIMEOUT_S``; it was ended.
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
                f"{stand}: found no guard within {START_TIMEOUT_S:g} s, need one before anything moves; see the lines "
                "above, or end other programs"
            )
        yield handed_over.set
    finally:
        if not handed_over.is_set():
            with suppress(OSError):  # a guard that died reads nothing
                process.stdin.write(DONE)
        process.stdin.close()
        process.stdout.close()
        ending = threading.Thread(target=_reap, args=(process,), name="end of the guard", daemon=True)
        ending.start()
        if not handed_over.is_set():
            ending.join()


def _first_line(process: subprocess.Popen[bytes]) -> bytes:
    """The first line of a guard's output; empty where none comes within ``START_TIMEOUT_S``: it is killed then."""
    assert process.stdout is not None
    timeout = threading.Timer(START_TIMEOUT_S, process.kill)  # the end of its output then ends the reading
    timeout.start()
    try:
        with ExitStack() as on_failure:  # the operator may break it off
            on_failure.callback(process.kill)
            line = process.stdout.readline()
            on_failure.pop_all()
        return line
    finally:
        timeout.cancel()


def _reap(process: subprocess.Popen[bytes]) -> None:
    """Wait for a guard's end, and end one that hangs."""
    try:
        process.wait(START_TIMEOUT_S)
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
    """Halt all that moves and switch the lasers off, each tried until it obeys; how many did not."""
    lines: Lines = {}
    commands = [
        partial(_halt, devices.table, lines),
        *(partial(_halt, axis, lines) for axis in devices.axes),
        *(partial(_switch_laser_off, stand, s) for s in devices.sensor),
    ]
    with ThreadPoolExecutor(len(commands)) as together:
        results = [together.submit(_until_done, command) for command in commands]
    return sum(not result.result() for result in results)


def _until_done(command: Callable[[], None]) -> bool:
    for _ in range(ATTEMPTS):
        try:
            command()
        except TruestandError:
            time.sleep(RETRY_INTERVAL_S)
        else:
            return True
    return False


def _halt(recipe: TableRecipe | AxisRecipe, lines: Lines) -> None:
    with closing(open_axis(recipe, recipe.limits, lines=lines)) as axis:
        axis.drive.halt()


def _switch_laser_off(stand: Stand, recipe: SensorRecipe) -> None:
    with closing(open_sensor(recipe, sensor_of(stand, recipe.name))) as sensor:
        sensor.set_laser("off")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
