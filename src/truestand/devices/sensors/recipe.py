"""``[[devices.sensor]]`` of stand.toml."""

from ipaddress import IPv4Address
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, field_validator, model_validator

from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor
from truestand.devices.sensor import Laser
from truestand.files.checking import Recipe
from truestand.files.scans import scancontrol

Driver = Literal["scancontrol", "range-camera", "replay"]
MAX_PROFILES_PER_FRAME = 20
"""So many are lost at most where a recording is cut off."""
FRAMES_PER_S = 50
"""Enough for a live display, with little work for each."""


class SensorRecipe(Recipe):
    """One ``[[devices.sensor]]``: which device is the ``[[sensor]]`` of that name."""

    name: str
    driver: Driver
    address: str = ""
    """IPv4."""
    model: str = ""
    """scanCONTROL type, e.g. "29xx-50" or "LLT2950-50"."""
    points: Annotated[int, Field(ge=8, le=4096)] | None = None
    """Default: those of the [[sensor]]."""
    profile_rate_hz: Annotated[float, Field(gt=0, le=50_000)] | None = None
    """Default: that of the [[sensor]]."""
    exposure_us: Annotated[float, Field(ge=10, le=40_000)] | None = None
    trigger: Literal["internal", "encoder", "external"] = "internal"
    trigger_input: Literal["rs422", "digital"] = "rs422"
    """Input to which encoder or trigger are wired."""
    laser: Literal["full", "reduced", "none"] = "full"
    """Power during a scan; none: the sensor has no laser that a program may switch."""
    encoder: bool = True
    """The sensor counts the table's encoder and stamps each profile with it."""
    packet_size: Annotated[int, Field(ge=0, le=16_000)] = 0
    """Bytes with IP header; 0 = the largest that arrives."""
    packet_delay: Annotated[int, Field(ge=0)] = 0
    """Ticks of the device's time stamp between two packets."""
    heartbeat_ms: Annotated[int, Field(ge=500, le=10_000)] = 1000
    resend: bool = True
    """Request lost packets again."""
    x_first_mm: float = 0.0
    """Range camera: x of the first column."""
    x_step_mm: PositiveFloat | None = None
    z_zero_mm: float = 0.0
    """Range camera: z of the raw value 0 (which itself means no data)."""
    z_step_mm: float | None = None
    """Range camera: z of one raw count, negative where larger counts are nearer."""
    file: str = ""
    """Replay: a recorded scan."""
    pace: Annotated[float, Field(ge=0)] = 1.0
    """Replay: times the recorded speed; 0 = as fast as frames are requested."""

    @model_validator(mode="after")
    def _complete(self) -> "SensorRecipe":
        needed = {"scancontrol": ("address", "model"), "range-camera": ("address", "x_step_mm", "z_step_mm")}
        for key in needed.get(self.driver, ("file",)):
            if getattr(self, key) in ("", None):
                raise ValueError(f"driver {self.driver} needs the key {key}")
        if self.driver == "scancontrol":
            if self.laser == "none":
                raise ValueError('laser: found none, need "full" or "reduced": a scanCONTROL has a laser')
            try:
                scancontrol.scale_of(self.model)
            except BadRecipe as wrong:
                raise ValueError(f"model: {wrong}") from None
        return self

    @field_validator("address")
    @classmethod
    def _numeric(cls, address: str) -> str:
        return str(IPv4Address(address)) if address else address

    @property
    def power(self) -> Laser:
        """Power of the laser during a scan; off where there is none."""
        return "off" if self.laser == "none" else self.laser

    def shape(self, sensor: Sensor) -> tuple[int, float]:
        """Points of a profile, and profiles per second.

        Raises:
            BadRecipe: stated neither here nor in the [[sensor]].
        """
        points, rate = self.points or sensor.points, self.profile_rate_hz or sensor.profile_rate
        if points is None or rate is None:
            key = "points" if points is None else "profile_rate_hz"
            raise BadRecipe(
                f"sensor {self.name!r}: key {key!r} is missing; state it in [[sensor]] or [[devices.sensor]]"
            )
        return points, rate


def profiles_per_frame(rate: float) -> int:
    """Profiles of a frame at ``rate`` profiles/s: 50 frames/s, 20 profiles at most."""
    return round(min(max(rate / FRAMES_PER_S, 1), MAX_PROFILES_PER_FRAME))
