"""A GigE Vision camera as the sensor drivers use it: control, features and one stream under one roof."""

from contextlib import suppress

from truestand.core.errors import DeviceError
from truestand.devices.gige.assembly import SILENCE, Assembler
from truestand.devices.gige.control import DEFAULT_HEARTBEAT, Control
from truestand.devices.gige.nodes import Nodes
from truestand.devices.gige.stream import Stream
from truestand.devices.sensor import Frame, StreamStatistics
from truestand.devices.wire.gvcp import RESEND_SUPPORTED, Register


class Camera:
    """A camera that we control. Not started; ``close`` in any case."""

    def __init__(self, name: str, address: str, heartbeat_ms: int = DEFAULT_HEARTBEAT) -> None:
        """Takes control.

        Raises:
            DeviceLost: nobody answers.
            DeviceError: another program controls it.
        """
        self.control = Control(name, address)
        self._nodes: Nodes | None = None
        self._stream: Stream | None = None
        try:
            self.control.take(heartbeat_ms)
        except DeviceError:
            self.control.close()
            raise

    @property
    def nodes(self) -> Nodes:
        """The camera's own features; its description is read at the first use. Errors as ``Nodes``."""
        if self._nodes is None:
            self._nodes = Nodes(self.control)
        return self._nodes

    def start(
        self,
        payload: int,
        row: int,
        packet_size: int = 0,
        delay: int = 0,
        resend: bool = True,
        silence: float = SILENCE,
    ) -> None:
        """Begin to receive frames of ``payload`` bytes in rows of ``row``, and tell the camera to send them.

        ``packet_size`` 0 = the largest that arrives; ``resend`` counts where the camera can; ``silence`` (s) as
        ``Assembler``. Errors as ``Control.read``.
        """
        self.end()
        self._stream = Stream(self.control)
        try:
            size = self._stream.open(packet_size, delay)
            resend = resend and bool(self.control.read(Register.CAPABILITY) & RESEND_SUPPORTED)
            self._stream.start(Assembler(payload, size, row, resend, silence))
            self.nodes.execute("AcquisitionStart")
        except DeviceError:
            self.end()
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
        """How the stream went so far."""
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
            self.end()

    def end(self) -> None:
        """End our side of the stream."""
        if self._stream is not None:
            self._stream.stop()

    def close(self) -> None:
        """End the stream, give control back; never raises for a camera that is gone."""
        with suppress(DeviceError):
            if self._stream is not None and not self.control.gone:
                self.stop()
        self.end()
        self.control.close()
