"""Drives and sensors in memory, for logic without sockets; the real protocols run in test_acquire and tests/devices."""

from dataclasses import dataclass, field

from truestand.core.errors import DeviceLost
from truestand.devices.axis import DriveState
from truestand.devices.sensor import Frame, Layout, StreamStatistics

LAYOUT = Layout("range-camera", "test", 8, 2, 100.0, scale=(0.0, 0.1, 50.0, 0.01))


@dataclass
class MemoryDrive:
    name: str = "memory"
    position: float = 0.0
    moving: bool = False
    homed: bool = False
    gone: bool = False
    begun: list[str] = field(default_factory=list)

    def _there(self) -> None:
        if self.gone:
            raise DeviceLost("memory: no answer")

    def start_home(self) -> None:
        self._there()
        self.begun.append("home")
        self.homed, self.position = True, 0.0

    def start_move(self, position: float, speed: float) -> None:
        self._there()
        self.begun.append("move")
        self.position, self.moving = position, True

    def halt(self) -> None:
        self._there()
        self.moving = False

    def reset(self) -> None:
        self._there()

    def state(self) -> DriveState:
        self._there()
        moving, self.moving = self.moving, False
        return DriveState(self.position, moving, self.homed, 0.0)

    def close(self) -> None:
        pass


@dataclass
class MemorySensor:
    name: str = "front"
    laser: str = "off"
    gone: bool = False

    def identity(self) -> dict[str, str]:
        return {"model": "memory"}

    def start(self) -> Layout:
        return LAYOUT

    def next_frame(self, timeout: float) -> Frame | None:
        return None

    def set_laser(self, power: str) -> None:
        if self.gone:
            raise DeviceLost("memory sensor: no answer")
        self.laser = power

    def stop(self) -> None:
        pass

    def statistics(self) -> StreamStatistics:
        return StreamStatistics()

    def close(self) -> None:
        pass
