"""A sensor at full rate to disk, on one core: packets -> frames -> checksum -> file. What is lost, how late, how busy.

    python bench/stream.py [--seconds 10] [--packet 1500 9000 16000] [--points 640] [--rate 10000] [--check]

The sender is a process of its own on another core, with frames encoded before. The receiver is what the drivers use
(``devices.gige``) beside a recording loop, held on one core. ``--check`` ends with 1 where a frame was lost or the
99th percentile of the way from the last packet to the file is beyond 50 ms, with 2 where the machine was too busy to
send at full rate.
"""

import argparse
import multiprocessing
import os
import socket
import struct
import sys
import tempfile
import threading
import time
import zlib
from pathlib import Path

import numpy as np

from truestand.devices.gige.assembly import Assembler
from truestand.devices.gige.control import Control
from truestand.devices.gige.stream import Stream
from truestand.devices.wire import gvcp, gvsp
from truestand.devices.wire.gvcp import Command, Register
from truestand.devices.wire.gvsp import Header, Leader, PacketFormat, PixelFormat

ADDRESS = "127.0.38.1"
GO = 0xA000
"""Register that starts (1) and stops (0) the sender."""
PROFILES = 20
LATE = 0.05
"""s from the last packet to the file."""
GOOD, BAD, SLOW = 0, 1, 2
"""What ``--check`` ends with; slow: the sender did not get to full rate, so that it says nothing."""


def encoded(block, payload, width, packet_size):
    """The packets of a frame."""
    chunk = gvsp.data_bytes(packet_size)
    pieces = [payload[i : i + chunk] for i in range(0, len(payload), chunk)]
    leader = Header(block, 0, PacketFormat.LEADER).encode() + Leader(0, PixelFormat.MONO16, width, PROFILES).encode()
    data = [Header(block, i, PacketFormat.PAYLOAD).encode() + piece for i, piece in enumerate(pieces, 1)]
    return [
        leader,
        *data,
        Header(block, len(pieces) + 1, PacketFormat.TRAILER).encode() + gvsp.encode_trailer(PROFILES),
    ]


def sender(core, width, rate, packet_size, ready):
    """The device: answers control, and streams when told."""
    os.sched_setaffinity(0, {core})
    rng = np.random.default_rng(1)
    payload = rng.integers(0, 1 << 16, width * PROFILES, np.uint16).tobytes()
    frames = [[bytearray(p) for p in encoded(block, payload, width, packet_size)] for block in range(1, 51)]
    registers = {}
    control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    control.bind((ADDRESS, gvcp.PORT))
    threading.Thread(target=answer, args=(control, registers), daemon=True).start()
    ready.set()
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.bind((ADDRESS, 0))
    while not registers.get(GO):
        time.sleep(0.001)
    target = (socket.inet_ntoa(struct.pack(">I", registers[Register.STREAM_ADDRESS])), registers[Register.STREAM_PORT])
    sent, due = 0, time.monotonic()
    while registers.get(GO):
        due += PROFILES / rate
        wire = struct.pack(">H", sent % gvsp.BLOCKS + 1)
        for packet in frames[sent % len(frames)]:
            packet[2:4] = wire
            out.sendto(packet, target)
        sent += 1
        time.sleep(max(0.0, due - time.monotonic()))
    registers[GO + 4] = sent
    threading.Event().wait()


def answer(control, registers):
    while True:
        data, source = control.recvfrom(2048)
        request = gvcp.decode_request(data)
        body = b""
        if request.command == Command.WRITE_REGISTER:
            address, value = gvcp.words(request.body)
            registers[address] = value
        elif request.command == Command.READ_REGISTER:
            body = struct.pack(">I", registers.get(gvcp.words(request.body)[0], 0))
        if request.flags & gvcp.ACK_REQUIRED:
            control.sendto(gvcp.Acknowledge(request.command, request.id, body).encode(), source)


def record(stream, file, seconds):
    """Frames to a file, each with its number and checksum: how late each one is, numbers, broken ones."""
    late, numbers, broken = [], [], 0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        frame = stream.next_frame(0.2)
        if frame is None:
            continue
        file.write(struct.pack("<QI", frame.number, zlib.crc32(frame.payload)) + frame.payload)
        late.append(time.monotonic() - frame.received)
        numbers.append(frame.number)
        broken += frame.missing > 0
    return np.array(late), numbers, broken


def run(packet_size, points, rate, seconds, folder):
    """One line of the table."""
    cores = sorted(os.sched_getaffinity(0))
    width, payload = 3 * points, 6 * points * PROFILES
    ready = multiprocessing.Event()
    process = multiprocessing.Process(target=sender, args=(cores[-1], width, rate, packet_size, ready), daemon=True)
    process.start()
    ready.wait()
    os.sched_setaffinity(0, {cores[0]})
    control = Control("bench", ADDRESS)
    try:
        control.take()
        stream = Stream(control)
        stream.open(packet_size)
        stream.start(Assembler(payload, packet_size, 6 * points))
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            control.write(GO, 1)
            wall, cpu = time.monotonic(), time.process_time()
            late, numbers, broken = record(stream, file, seconds)
            wall, cpu = time.monotonic() - wall, time.process_time() - cpu
        control.write(GO, 0)
        stream.stop()
    finally:
        control.close()
        os.sched_setaffinity(0, set(cores))
        process.kill()
        process.join()
    missing = numbers[-1] + 1 - len(numbers)
    p50, p99 = np.percentile(late, [50, 99]) * 1e3
    print(
        f"packets of {packet_size:5d}: {len(numbers) * PROFILES / wall:7.0f} profiles/s  "
        f"{len(numbers) * payload / wall / 1e6:5.1f} MB/s  lost {missing}, incomplete {broken}, resent "
        f"{stream.statistics().resent}  CPU {100 * cpu / wall:4.1f} %  to disk p50 {p50:.2f} ms, p99 {p99:.2f} ms, "
        f"max {late.max() * 1e3:.1f} ms",
        flush=True,
    )
    if missing or broken or p99 > LATE * 1e3:
        return BAD
    return GOOD if len(numbers) * PROFILES > 0.98 * rate * wall else SLOW


def main():
    given = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    given.add_argument("--seconds", type=float, default=10.0)
    given.add_argument("--packet", type=int, nargs="+", default=[1500, 9000, 16000])
    given.add_argument("--points", type=int, default=640)
    given.add_argument("--rate", type=float, default=10_000.0)
    given.add_argument("--folder", type=Path, default=None, help="where the file is written; default: the system's")
    given.add_argument("--check", action="store_true")
    options = given.parse_args()
    ended = [run(size, options.points, options.rate, options.seconds, options.folder) for size in options.packet]
    if not options.check:
        return GOOD
    return BAD if BAD in ended else max(ended)


if __name__ == "__main__":
    sys.exit(main())
