"""``[devices]`` of stand.toml: which table and sensors the stand has, and how a scan is taken with them."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees, radians, tau
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor, Stand
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.recipe import TableRecipe
from truestand.files.checking import Recipe, checked
from truestand.files.recipes.recipes import read_devices_table, read_stand


class AcquireRecipe(Recipe):
    """``[devices.acquire]``."""

    turns: Annotated[float, Field(gt=0)] = 2.75
    run_up_deg: Annotated[float, Field(ge=0)] | None = None
    """Turned before the scan counts, to get up to speed; default: what the table turns in one second."""
    most_lost_percent: Annotated[float, Field(ge=0, le=100)] = 0.1
    """Profiles that may be lost in a scan that is called complete."""


class DevicesRecipe(Recipe):
    """``[devices]``."""

    table: TableRecipe
    sensor: Annotated[list[SensorRecipe], Field(min_length=1)]
    acquire: AcquireRecipe = AcquireRecipe()

    @property
    def names(self) -> list[str]:
        """Of the sensors."""
        return [s.name for s in self.sensor]

    @model_validator(mode="after")
    def _names_differ(self) -> "DevicesRecipe":
        names = self.names
        if len(set(names)) < len(names):
            raise ValueError(f"sensor: found the names {', '.join(names)}, need a different one for each")
        return self


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """How one scan is taken."""

    turns: float
    speed: float
    """rad/s of the table while it is scanned."""
    run_up: float
    """rad turned before the scan counts; half of it after its end, so that slowing down lies outside of the scan."""
    most_lost: float
    """Share of the profiles that may be lost in a scan that is called complete."""

    @property
    def travel(self) -> float:
        """rad from start to rest."""
        return self.run_up + self.turns * tau + self.run_up / 2

    @property
    def duration(self) -> float:
        """s from start to rest."""
        return self.travel / self.speed

    def record(self) -> dict[str, float]:
        """As logs and scans keep it."""
        return {
            "turns": self.turns,
            "speed_deg_per_s": degrees(self.speed),
            "run_up_deg": degrees(self.run_up),
            "most_lost_percent": 100 * self.most_lost,
        }


def settings_from(record: Mapping[str, Any]) -> ScanSettings:
    """The settings that ``ScanSettings.record`` wrote.

    Raises:
        KeyError, TypeError, ValueError: another record.
    """
    return ScanSettings(
        float(record["turns"]), radians(record["speed_deg_per_s"]), radians(record["run_up_deg"]),
        float(record["most_lost_percent"]) / 100,
    )  # fmt: skip


def read_devices(path: Path | str) -> tuple[Stand, DevicesRecipe]:
    """Stand and devices of a stand.toml.

    Raises:
        BadRecipe: unreadable, a wrong or unknown key, no ``[devices]``, or a device for a sensor that isn't there.
    """
    stand, table = read_stand(path), read_devices_table(path)
    if not table:
        raise BadRecipe(
            f"{path}: found no [devices], need the table's and sensors' addresses; see docs/wire-a-stand.md"
        )
    devices = checked(DevicesRecipe, table, f"{path}: [devices]")
    for device in devices.sensor:
        sensor_of(stand, device.name)
        if device.driver == "scancontrol" and device.encoder and not stand.counts_per_turn:
            raise BadRecipe(
                f"{path}: sensor {device.name!r} has encoder = true, and [scan] counts_per_turn is 0; state the "
                "counts of one turn of the table, or set encoder = false"
            )
    return stand, devices


def sensor_of(stand: Stand, name: str) -> Sensor:
    """The sensor of that name.

    Raises:
        BadRecipe: there is none.
    """
    sensors = {s.name: s for s in stand.sensors}
    if name not in sensors:
        raise BadRecipe(f"[[devices.sensor]] found name {name!r}, need one of the [[sensor]]s: {', '.join(sensors)}")
    return sensors[name]


def scan_settings(stand: Stand, acquire: AcquireRecipe, turns: float | None = None) -> ScanSettings:
    """The settings that the recipe states; ``turns`` overrides.

    Raises:
        BadRecipe: the stand states no speed.
    """
    speed = stand.table.speed
    if speed is None:
        raise BadRecipe("found no [table] speed_rad_per_s in stand.toml; the table needs it to turn")
    run_up = speed * 1.0 if acquire.run_up_deg is None else radians(acquire.run_up_deg)
    return ScanSettings(acquire.turns if turns is None else turns, speed, run_up, acquire.most_lost_percent / 100)
