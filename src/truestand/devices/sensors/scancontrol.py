"""Micro-Epsilon scanCONTROL sensors over GigE Vision, in container mode: some profiles a frame, each with its stamp.

Registers from the vendor's open SDK (facts only). Tested on the virtual stand and, for the transport, on libaravis'
camera; not on a real sensor.
"""

from contextlib import suppress
from math import log2

from truestand.core.errors import BadRecipe, DeviceError
from truestand.core.stand import Sensor
from truestand.devices.gige.assembly import FRAME_END_TIMEOUT_S
from truestand.devices.gige.camera import Camera
from truestand.devices.sensor import Laser, Layout
from truestand.devices.sensors.recipe import SensorRecipe, profiles_per_frame
from truestand.files.scans import scancontrol

IDLE, EXPOSURE = 0xF0F00800, 0xF0F0081C
"""Both in 10 us; together the time from profile to profile."""
REARRANGEMENT = 0xF0F0080C
LASER = 0xF0F00824
TRIGGER = 0xF0F00830
MAINTENANCE = 0xF0F0088C
DIGITAL_IO = 0xF0F008C0
SIZE = 0xF0E0070C
"""Width in u16 << 16 | profiles in a container."""

TIME_UNITS_PER_S = 1e5
"""Units of 10 us."""
MAX_IDLE = 4095
"""In units of 10 us."""
POWER: dict[Laser, int] = {"off": 0, "reduced": 1, "full": 2}
ENCODER_ACTIVE = 1 << 3
"""Of MAINTENANCE: stamps carry the encoder's count."""
EXTERNAL, HIGH, DIGITAL, BY_ENCODER = 1 << 25, 1 << 24, 1 << 21, 3 << 16
"""Of TRIGGER; without DIGITAL the RS422 inputs count, without BY_ENCODER an edge."""
ENCODER_AND_TRIGGER, LEVEL_24V = 1 << 4, 1 << 11
"""Of DIGITAL_IO."""
FIELDS = 1 << 20 | 1 << 11 | 1 << 10 | 1 << 1 | 1 << 0
"""Of REARRANGEMENT: first reflection, stamp, an empty field for it, X, Z."""
LOW_BYTE_FIRST, POINTS_SHIFT = 1 << 17, 12


class ScanControl(Camera):
    """A scanCONTROL as ``LineSensor``."""

    def __init__(self, recipe: SensorRecipe, sensor: Sensor) -> None:
        """Connects and takes control; nothing is switched yet. Errors as ``open_sensor``."""
        self._recipe = recipe
        self._points, rate = recipe.shape(sensor)
        scancontrol.profile_bytes(self._points)
        self._exposure, self._idle = times(rate, recipe.exposure_us)
        super().__init__(recipe.name, recipe.address, recipe.heartbeat_ms)

    def start(self) -> Layout:
        """Configure and stream; the laser is not switched.

        Raises:
            DeviceLost: no answer.
            DeviceError: a setting was refused.
        """
        rate = TIME_UNITS_PER_S / (self._exposure + self._idle)
        profiles = profiles_per_frame(rate)
        layout = Layout(
            "scancontrol",
            self._recipe.model,
            self._points,
            profiles,
            rate,
            scancontrol.COUNTER_MODULUS,
            scancontrol.TIME_MODULUS,
            scancontrol.ENCODER_MODULUS if self._recipe.encoder else 0,
        )
        self.stop()
        self._configure(profiles)
        slowdown = 1.0 if self._recipe.trigger == "internal" else 10.0  # a trigger may come more slowly than the rate
        self.start_stream(
            layout.frame_bytes,
            scancontrol.profile_bytes(self._points),
            self._recipe.packet_size,
            self._recipe.packet_delay,
            self._recipe.resend,
            frame_end_timeout=max(FRAME_END_TIMEOUT_S, 3 * slowdown * profiles / rate),
        )
        return layout

    def _configure(self, profiles: int) -> None:
        write = self.control.write
        write(EXPOSURE, self._exposure)
        write(IDLE, self._idle)
        write(TRIGGER, trigger_value(self._recipe))
        if self._recipe.encoder or self._recipe.trigger != "internal":
            self._configure_inputs()
        width = scancontrol.FIELDS * self._points
        write(REARRANGEMENT, FIELDS | LOW_BYTE_FIRST | round(log2(self._points)) << POINTS_SHIFT)
        write(SIZE, width << 16 | profiles)
        self.nodes.set("TransmissionType", "TypeContainer")
        self.nodes.set("PixelFormat", "Mono16")
        found = self.control.read(SIZE)
        if found != width << 16 | profiles:
            raise DeviceError(
                f"{self.name}: the sensor gives {(found >> 16) // scancontrol.FIELDS} points and {found & 0xFFFF} "
                f"profiles a frame, need {self._points} and {profiles}; state points that this type has"
            )

    def _configure_inputs(self) -> None:
        """Let the stamps carry the encoder's count; sensors without these registers count by themselves."""
        with suppress(DeviceError):
            self.control.write(MAINTENANCE, self.control.read(MAINTENANCE) | ENCODER_ACTIVE)
            if self._recipe.trigger_input == "digital":
                self.control.write(DIGITAL_IO, ENCODER_AND_TRIGGER | LEVEL_24V)
        self.control.check()

    def set_laser(self, power: Laser) -> None:
        """Switch the laser. Not a safety function. Errors as ``Control.read``."""
        self.control.write(LASER, POWER[power])

    def close(self) -> None:
        """Laser off, stream ended, control given back; never raises for a sensor that is gone."""
        if not self.control.lost_reason:
            with suppress(DeviceError):
                self.set_laser("off")
        super().close()


def times(rate: float, exposure_us: float | None = None) -> tuple[int, int]:
    """Exposure and idle time in 10 us that come nearest to ``rate`` (profiles/s); by default half of it, 1 ms at most.

    Raises:
        BadRecipe: no time left between two exposures, or slower than the sensor can wait.
    """
    period = round(TIME_UNITS_PER_S / rate)
    exposure = max(1, min(period // 2, 100)) if exposure_us is None else max(1, round(exposure_us / 10))
    idle = period - exposure
    if idle < 1:
        raise BadRecipe(
            f"found exposure_us = {10 * exposure} at {rate:g} profiles/s ({10 * period} us each), need 10 us between "
            "two exposures; expose shorter or measure slower"
        )
    if idle > MAX_IDLE:
        raise BadRecipe(
            f"found {rate:g} profiles/s, the sensor can't go below {TIME_UNITS_PER_S / (MAX_IDLE + exposure):.1f}"
        )
    return exposure, idle


def trigger_value(recipe: SensorRecipe) -> int:
    """The trigger register."""
    if recipe.trigger == "internal":
        return 0
    source = DIGITAL if recipe.trigger_input == "digital" else 0
    return EXTERNAL | HIGH | source | (BY_ENCODER if recipe.trigger == "encoder" else 0)
