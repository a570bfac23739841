"""A GigE Vision camera as the sensor drivers use it: control, features and one stream."""

from contextlib import suppress
from functools import cached_property

from truestand.core.errors import DeviceError
from truestand.devices.gige.assembly import FRAME_END_TIMEOUT_S, Assembler
from truestand.devices.gige.control import DEFAULT_HEARTBEAT_MS, Control
from truestand.devices.gige.nodes import Nodes
from truestand.devices.gige.stream import Stream
from truestand.devices.sensor import Frame, StreamStatistics
from truestand.devices.wire.gvcp import RESEND_SUPPORTED, Register


class Camera:
    """A camera under our control, not started; ``close`` in any case. Drivers of sensors derive from it."""

    def __init__(self, name: str, address: str, heartbeat_ms: int = DEFAULT_HEARTBEAT_MS) -> None:
        """Takes control.

        Raises:
            DeviceLost: nobody answers.
            DeviceError: another program controls it.
        """
        self.name = name
        self.control = Control(name, address)
        self._stream: Stream | None = None
        try:
            self.control.take(heartbeat_ms)
        except DeviceError:
            self.control.close()
            raise

    def identity(self) -> dict[str, str]:
        """Maker, model, serial, firmware, as the camera says. Errors as ``Control.read``."""
        return self.control.identity()

    @cached_property
    def nodes(self) -> Nodes:
        """The camera's own features; its description is read at the first use. Errors as ``Nodes``."""
        return Nodes(self.control)

    def start_stream(
        self,
        payload: int,
        row: int,
        packet_size: int = 0,
        delay: int = 0,
        resend: bool = True,
        frame_end_timeout: float = FRAME_END_TIMEOUT_S,
    ) -> None:
        """Begin to receive frames of ``payload`` bytes in rows of ``row``, and start the camera.

        ``packet_size`` 0 = the largest that arrives; ``resend`` counts where the camera can; ``frame_end_timeout`` (s)
        as ``Assembler``. Errors as ``Control.read``.
        """
        self._end_stream()
        self._stream = Stream(self.control)
        try:
            size = self._stream.open(packet_size, delay)
            resend = resend and bool(self.control.read(Register.CAPABILITY) & RESEND_SUPPORTED)
            self._stream.start(Assembler(payload, size, row, resend, frame_end_timeout))
            self.nodes.execute("AcquisitionStart")
        except DeviceError:
            self._end_stream()
            raise

    def next_frame(self, timeout: float) -> Frame | None:
        """The next frame in order, or None where none came within ``timeout`` s.

        Raises:
            DeviceLost: none is waiting, and the camera is gone.
        """
        if self._stream is None:
            self.control.check()
            return None
        return self._stream.next_frame(timeout)

    def statistics(self) -> StreamStatistics:
        """Counts of the stream so far."""
        return StreamStatistics() if self._stream is None else self._stream.statistics()

    def stop(self) -> None:
        """End the stream; frames that wait can still be taken.

        Raises:
            DeviceLost: no answer; the stream has ended all the same.
        """
        try:
            self.nodes.execute("AcquisitionStop")
            self.control.write(Register.STREAM_PORT, 0)
        finally:
            self._end_stream()

    def _end_stream(self) -> None:
        """End the receiving side of the stream."""
        if self._stream is not None:
            self._stream.stop()

    def close(self) -> None:
        """End the stream, give control back; never raises for a camera that is gone."""
        with suppress(DeviceError):
            if self._stream is not None and not self.control.lost_reason:
                self.stop()
        self._end_stream()
        self.control.close()
