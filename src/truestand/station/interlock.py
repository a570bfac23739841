"""Interlocks: a motion or a laser needs a state of the stand that permits it; halt and laser off always pass."""

from dataclasses import dataclass

from truestand.devices.axis import Drive, DriveState
from truestand.devices.sensor import Frame, Laser, Layout, LineSensor, StreamStatistics
from truestand.station.state_machine import StateMachine


@dataclass(frozen=True, slots=True)
class InterlockedDrive:
    """A drive that begins a motion only where the stand's state permits it."""

    inner: Drive
    machine: StateMachine

    @property
    def name(self) -> str:
        """Protocol and address."""
        return self.inner.name

    def start_home(self) -> None:
        """Begin to home.

        Raises:
            Fault: a state that permits no motion.
        """
        with self.machine.permit("motion"):
            self.inner.start_home()

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move to ``position`` (rad) at ``speed`` (rad/s).

        Raises:
            Fault: a state that permits no motion.
        """
        with self.machine.permit("motion"):
            self.inner.start_move(position, speed)

    def halt(self) -> None:
        """Always passes."""
        self.inner.halt()

    def reset(self) -> None:
        """Always passes: it moves nothing."""
        self.inner.reset()

    def state(self) -> DriveState:
        """Always passes."""
        return self.inner.state()

    def close(self) -> None:
        """Always passes."""
        self.inner.close()


@dataclass(frozen=True, slots=True)
class InterlockedSensor:
    """A sensor that switches its laser on only where the stand's state permits it."""

    inner: LineSensor
    machine: StateMachine

    @property
    def name(self) -> str:
        """As in stand.toml."""
        return self.inner.name

    def set_laser(self, power: Laser) -> None:
        """Switch the laser; off always passes.

        Raises:
            Fault: a state that permits no laser.
        """
        if power == "off":
            self.inner.set_laser(power)
            return
        with self.machine.permit("laser"):
            self.inner.set_laser(power)

    def identity(self) -> dict[str, str]:
        """Always passes, as all below."""
        return self.inner.identity()

    def start(self) -> Layout:
        """Begin to stream; the laser stays as it is."""
        return self.inner.start()

    def next_frame(self, timeout: float) -> Frame | None:
        """The next frame."""
        return self.inner.next_frame(timeout)

    def stop(self) -> None:
        """End the stream."""
        self.inner.stop()

    def statistics(self) -> StreamStatistics:
        """How the stream went so far."""
        return self.inner.statistics()

    def close(self) -> None:
        """Laser off, control given back."""
        self.inner.close()
