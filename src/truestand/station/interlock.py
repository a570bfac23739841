"""Devices behind the stand's state: nothing moves or shines unless it allows; off and halt always pass."""

from dataclasses import dataclass

from truestand.devices.axis import Drive, DriveState
from truestand.devices.sensor import Frame, Laser, Layout, LineSensor, StreamStatistics
from truestand.station.state_machine import Machine


@dataclass(frozen=True, slots=True)
class GatedDrive:
    """A drive behind the stand's state."""

    inner: Drive
    machine: Machine

    @property
    def name(self) -> str:
        """Protocol and address."""
        return self.inner.name

    def start_home(self) -> None:
        """Raises: Fault where the state allows no motion. The others likewise."""
        with self.machine.motion():
            self.inner.start_home()

    def start_move(self, position: float, speed: float) -> None:
        """Begin to move, where the state allows."""
        with self.machine.motion():
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
class GatedSensor:
    """A sensor behind the stand's state."""

    inner: LineSensor
    machine: Machine

    @property
    def name(self) -> str:
        """As in stand.toml."""
        return self.inner.name

    def set_laser(self, power: Laser) -> None:
        """On only where the state allows; off always passes.

        Raises:
            Fault: a state that allows no laser.
        """
        if power == "off":
            self.inner.set_laser(power)
            return
        with self.machine.light():
            self.inner.set_laser(power)

    def identity(self) -> dict[str, str]:
        """Always passes, as all that follows."""
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
