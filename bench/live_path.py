"""`acquire` at full rate: every frame received, looked at, checksummed and logged, on one core, the table turning.

    python bench/live_path.py [--seconds 10] [--rate 10000] [--points 640] [--packet 0] [--check]

The virtual stand (scanCONTROL over GigE Vision, table over Modbus TCP) is a process of its own on another core and
sends profiles made before. What is measured is the station's own path: client, watch, log. ``--check`` ends with 1 if
a profile was lost or the 99th percentile from a frame's last packet to its write is beyond 50 ms, with 2 where the
machine was too busy to send at full rate.
"""

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from recorded import RecordedSource
from truestand.core.stand import Sensor, Stand, Table
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.recipe import TableRecipe
from truestand.files.scans.scan_log import Kind, LogWriter, read_log
from truestand.sim.live.clock import Clock
from truestand.sim.live.faults import Faults
from truestand.sim.live.gige_device import GigeDevice
from truestand.sim.live.modbus_server import ModbusServer
from truestand.sim.live.registers import Identity
from truestand.sim.live.scancontrol_frames import default_format, raw_profiles
from truestand.sim.live.table import VirtualTable
from truestand.station import acquire as station
from truestand.station.log import LogBuilder
from truestand.station.recipe import DevicesRecipe, ScanSettings
from truestand.station.stand import open_station

ADDRESS = "127.0.39.1"
SPEED = np.pi / 10
LATE = 0.05
GOOD, BAD, SLOW = 0, 1, 2


def stand(core, points, told):
    """The virtual stand, until it is killed."""
    os.sched_setaffinity(0, {core})
    clock = Clock()
    table = VirtualTable(clock)
    server = ModbusServer(table, TableRecipe(protocol="modbus", address="127.0.0.1:0"))
    rng = np.random.default_rng(1)
    z = rng.uniform(80, 110, (200, points))
    raw = raw_profiles(rng.uniform(-10, 10, z.shape), z, (0.002, 95.0), default_format(points, 20))
    server.start()
    device = GigeDevice(Identity(ADDRESS), RecordedSource(raw, table, 360_000), clock, Faults(table), points=points)
    device.start()
    told.put(server.address)
    time.sleep(3600)


class TimedLog(LogWriter):
    """The log, with how late each frame is when it is written."""

    late: list[float] = []  # noqa: RUF012

    def append(self, kind, payload, time_, *more, **options):
        super().append(kind, payload, time_, *more, **options)
        if kind is Kind.FRAME:
            self.late.append(time.monotonic() - time_)


def main():
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    given.add_argument("--seconds", type=float, default=10.0)
    given.add_argument("--rate", type=float, default=10_000.0)
    given.add_argument("--points", type=int, default=640)
    given.add_argument("--packet", type=int, default=0, help="0: the largest that arrives")
    given.add_argument("--check", action="store_true")
    options = given.parse_args()
    cores, told = sorted(os.sched_getaffinity(0)), multiprocessing.Queue()
    process = multiprocessing.Process(target=stand, args=(cores[-1], options.points, told), daemon=True)
    process.start()
    address = told.get(timeout=30)
    os.sched_setaffinity(0, {cores[0]})
    try:
        return run(options, address)
    finally:
        process.kill()


def run(options, address):
    described = Stand(Table(SPEED), (Sensor("front", options.rate, options.points),), counts_per_turn=360_000)
    devices = DevicesRecipe(
        table=TableRecipe(protocol="modbus", address=address),
        sensor=[SensorRecipe(name="front", driver="scancontrol", address=ADDRESS, model="29xx-50",
                             packet_size=options.packet)],
    )  # fmt: skip
    settings = ScanSettings(options.seconds * SPEED / (2 * np.pi), SPEED, 0.1, 0.001)
    station.LogWriter = TimedLog
    with tempfile.TemporaryDirectory() as folder, open_station(described, devices) as opened:
        log = Path(folder) / "k1.log"
        wall, cpu = time.monotonic(), time.process_time()
        builder = LogBuilder(log)
        station.acquire(opened, settings, devices.sensor, log, "now", written=builder.add)
        wall, cpu = time.monotonic() - wall, time.process_time() - cpu
        statistics = opened.sensors[0].statistics()
        records = [(r.number, r.time) for r in read_log(log) if r.kind is Kind.FRAME]
        size = log.stat().st_size
    numbers = [number for number, _ in records]
    missing = numbers[-1] - numbers[0] + 1 - len(numbers)
    span = records[-1][1] - records[0][1]
    rate = 20 * (len(records) - 1) / span
    p50, p99, most = (1e3 * v for v in (*np.percentile(TimedLog.late, [50, 99]), max(TimedLog.late)))
    print(f"{len(records)} frames, {rate:.0f} profiles/s, {size / span / 1e6:.1f} MB/s; lost {missing}, resent "
          f"{statistics.resent}; CPU {100 * cpu / wall:.0f} % of one core; last packet to disk p50 {p50:.2f}, p99 "
          f"{p99:.2f}, max {most:.1f} ms")  # fmt: skip
    if missing or p99 > 1e3 * LATE:
        return BAD
    return GOOD if not options.check or rate > 0.98 * options.rate else SLOW


if __name__ == "__main__":
    sys.exit(main())
