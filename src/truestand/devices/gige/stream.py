"""A GigE Vision stream: a thread that receives packets, and a bounded queue of frames for the recorder.

The thread does as little as it can, so that one core carries 10,000 profiles/s beside the recorder. A reader that is
too slow loses frames, which frame numbers and statistics report; it never stops the stream.
"""

import socket
import struct
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import replace

from truestand.core.errors import DeviceError
from truestand.devices.gige.assembly import Assembler
from truestand.devices.gige.control import Control
from truestand.devices.sensor import Frame, StreamStatistics
from truestand.devices.wire import gvcp, gvsp
from truestand.devices.wire.gvcp import Register

TICK_S = 0.004
"""Between two checks for missing packets; also the longest wait for a packet."""
RECEIVE_BYTES = 32 << 20
"""Requested from the system for packets that wait to be received; Linux grants net.core.rmem_max of it."""
FORCE_BUFFER = 33
"""SO_RCVBUFFORCE of Linux: beyond the limit, for privileged processes."""
QUEUE_FRAMES = 256
"""That may wait for the reader: half a second at 500 frames/s."""
ETHERNET_PACKET = 1500
"""The packet size of a network without jumbo packets."""
JUMBO_PACKETS = (16_000, 9000, 8000, 6000, 4000, 3000, 2000)
"""Packet sizes to try; no device exceeds the largest."""
TEST_TIMEOUT_S = 0.05
"""For a test packet; each is requested twice."""


class Stream:
    """Stream channel 0 of the device behind ``control``. One reader, any thread."""

    def __init__(self, control: Control) -> None:
        self.control = control
        self._waiting: deque[Frame] = deque()
        self._changed = threading.Condition()
        self._overrun = 0
        self._running = False
        self._thread: threading.Thread | None = None
        self._assembler: Assembler | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((control.host, 0))
            self._enlarge()
        except OSError as wrong:
            self._socket.close()
            raise DeviceError(f"{control.name}: found no port to receive at {control.host} ({wrong})") from wrong
        control.on_lost = self._wake

    def _enlarge(self) -> None:
        """The largest receive buffer that the system grants, and the longest wait for a packet."""
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
        if sys.platform == "linux":
            with suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, FORCE_BUFFER, RECEIVE_BYTES)
        milliseconds = round(TICK_S * 1e3)
        windows = sys.platform == "win32"
        wait = struct.pack("L", milliseconds) if windows else struct.pack("ll", 0, 1000 * milliseconds)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)

    def open(self, packet_size: int = 0, delay: int = 0) -> int:
        """Set the address and the packet size of the stream; 0 = the largest that arrives. Returns the size in use.

        Raises:
            DeviceLost: no answer.
            DeviceError: refused.
        """
        self.control.write(Register.STREAM_ADDRESS, int.from_bytes(socket.inet_aton(self.control.host), "big"))
        self.control.write(Register.STREAM_PORT, self._socket.getsockname()[1])
        if delay:
            self.control.write(Register.STREAM_DELAY, delay)
        self.control.write(Register.STREAM_PACKET_SIZE, packet_size or self._largest())
        return self.control.read(Register.STREAM_PACKET_SIZE) & 0xFFFF

    def _largest(self) -> int:
        """The largest packet that arrives; that of Ethernet where the device sends no test packets."""
        if not self._arrives(ETHERNET_PACKET):
            return ETHERNET_PACKET
        return next((size for size in JUMBO_PACKETS if self._arrives(size)), ETHERNET_PACKET)

    def _arrives(self, size: int) -> bool:
        packet = bytearray(1 << 16)
        for _ in range(2):
            self.control.write(Register.STREAM_PACKET_SIZE, gvcp.FIRE_TEST | gvcp.DO_NOT_FRAGMENT | size)
            end = time.monotonic() + TEST_TIMEOUT_S
            while time.monotonic() < end:
                with suppress(BlockingIOError, TimeoutError, ConnectionResetError):
                    received, source = self._socket.recvfrom_into(packet)
                    if received == size - gvsp.IP_UDP_HEADERS and source[0] == self.control.address:
                        return True
        return False

    def start(self, assembler: Assembler) -> None:
        """Begin to receive frames."""
        self._assembler = assembler
        self._running = True
        self._thread = threading.Thread(
            target=self._receive, args=(assembler,), name=f"stream {self.control.name}", daemon=True
        )
        self._thread.start()

    def _receive(self, assembler: Assembler) -> None:
        receive, packet, take = self._socket.recvfrom_into, assembler.packet, assembler.take
        device, clock, frames = self.control.address, time.monotonic, assembler.frames
        due = 0.0
        while self._running:
            try:
                size, source = receive(packet)
            except (BlockingIOError, TimeoutError):
                now = clock()
            except OSError:  # e.g. the network port went down: the heartbeat tells
                time.sleep(TICK_S)
                now = clock()
            else:
                now = clock()
                if source[0] == device:
                    take(size, now)
                else:
                    assembler.foreign += 1
            if now >= due:
                due = now + TICK_S
                for request in assembler.tick(now):
                    self.control.resend(request)
            if frames:
                self._enqueue(frames)
        assembler.flush(clock())
        self._enqueue(frames)

    def _enqueue(self, frames: list[Frame]) -> None:
        with self._changed:
            room = QUEUE_FRAMES - len(self._waiting)
            self._waiting.extend(frames[:room])
            self._overrun += max(0, len(frames) - room)
            self._changed.notify()
        frames.clear()

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def next_frame(self, timeout: float) -> Frame | None:
        """The next frame in order, or None where none came within ``timeout`` s, or the stream has ended.

        Raises:
            DeviceLost: none is waiting and the heartbeat is not answered.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or not self._running or self.control.lost_reason, timeout)
            if self._waiting:
                return self._waiting.popleft()
        self.control.check()
        return None

    def statistics(self) -> StreamStatistics:
        """Counts of the stream so far."""
        if self._assembler is None:
            return StreamStatistics()
        found, overrun = self._assembler.statistics(), self._overrun
        return replace(found, frames=found.frames - overrun, lost=found.lost + overrun, overrun=overrun)

    def stop(self) -> None:
        """End the stream; frames that wait can still be taken."""
        self._running = False
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._socket.close()
        self._wake()
