"""``[devices]`` of stand.toml: which table and sensors the stand has, and how a scan is taken with them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees, radians, tau
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor, Stand
from truestand.devices.positioner import AxisRecipe, PositionerRecipe
from truestand.devices.sensors.recipe import SensorRecipe
from truestand.devices.tables.recipe import TableRecipe
from truestand.files.checking import Recipe, checked
from truestand.files.recipes.recipes import read_devices_table, read_stand
from truestand.planning.kinematics import Position


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
    positioner: PositionerRecipe | None = None
    acquire: AcquireRecipe = AcquireRecipe()

    @property
    def names(self) -> list[str]:
        """Of the sensors."""
        return [s.name for s in self.sensor]

    @property
    def axes(self) -> list[AxisRecipe]:
        """Of the positioner; none where there is none."""
        return [] if self.positioner is None else self.positioner.axis

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


@dataclass(frozen=True, slots=True)
class Stop:
    """What scans at once: views whose devices stand there, and those that the positioner brings to one place."""

    devices: DevicesRecipe
    """Its sensors bear the names of their views."""
    position: Position | None
    """Of the positioner, mm and rad; None: nobody needs it."""

    @property
    def views(self) -> list[str]:
        """Their names."""
        return self.devices.names


def stops_of(stand: Stand, devices: DevicesRecipe, views: Sequence[str] | None = None) -> tuple[Stop, ...]:
    """Where and with which devices to scan all views of a stand, or some of them: views that are in the same place of
    the positioner at once, with those that need none.

    Raises:
        BadRecipe: a view that isn't there, or several of one device in one place or without a place.
    """
    names = {s.name for s in stand.sensors}
    for view in views or ():
        if view not in names:
            raise BadRecipe(f"found --view {view}, need one of the [[sensor]]s: {', '.join(sorted(names))}")
    at: dict[Position | None, list[SensorRecipe]] = {}
    for device in devices.sensor:
        for sensor in _views_of(stand, device.name):
            if views is None or sensor.name in views:
                place = position_of(sensor, devices)
                at.setdefault(place, []).append(device.model_copy(update={"name": sensor.name}))
    standing = at.pop(None, [])
    for together in (standing, *at.values()):
        _demand_one_each(stand, together)
    if not at:
        return (_stop(devices, standing, None),)
    first, *others = (_stop(devices, together, place) for place, together in at.items())
    return (replace(first, devices=_stop(devices, [*standing, *first.devices.sensor], None).devices), *others)


def _stop(devices: DevicesRecipe, sensors: list[SensorRecipe], position: Position | None) -> Stop:
    return Stop(devices.model_copy(update={"sensor": sensors}), position)


def _views_of(stand: Stand, device: str) -> list[Sensor]:
    """The views that a device takes.

    Raises:
        BadRecipe: none.
    """
    found = [s for s in stand.sensors if device in (s.device, s.name)]
    if not found:
        names = ", ".join(dict.fromkeys(s.device or s.name for s in stand.sensors))
        raise BadRecipe(f"[[devices.sensor]] found name {device!r}, need one of the [[sensor]]s: {names}")
    return found


def position_of(sensor: Sensor, devices: DevicesRecipe) -> Position | None:
    """Where the positioner brings a view, its axes in their order; None: nowhere.

    Raises:
        BadRecipe: a positioner that isn't there, or not the axes that it has.
    """
    if not sensor.position:
        return None
    stated = {(p.axis, p.linear): p.value for p in sensor.position}
    wanted = [(axis.name, axis.linear) for axis in devices.axes]
    if set(stated) != set(wanted):
        found = ", ".join(f"{name}_{'mm' if linear else 'deg'}" for name, linear in stated)
        needed = ", ".join(axis.key for axis in devices.axes) or "none, for there is no [devices.positioner]"
        raise BadRecipe(f"[sensor.position] of {sensor.name!r}: found {found}, need {needed}")
    return tuple(stated[axis] for axis in wanted)


def _demand_one_each(stand: Stand, sensors: list[SensorRecipe]) -> None:
    """Refuse two views of one device at once."""
    devices: dict[str, str] = {}
    for recipe in sensors:
        device = sensor_of(stand, recipe.name).device or recipe.name
        if device in devices:
            raise BadRecipe(
                f"found views {devices[device]!r} and {recipe.name!r} of device {device!r} in one place, need a "
                "[sensor.position] of each; moved by hand, scan each by itself (--view)"
            )
        devices[device] = recipe.name


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
        for sensor in _views_of(stand, device.name):
            position_of(sensor, devices)
        if device.driver == "scancontrol" and device.encoder and not stand.counts_per_turn:
            raise BadRecipe(
                f"{path}: sensor {device.name!r} has encoder = true, and [scan] counts_per_turn is 0; state the "
                "counts of one turn of the table, or set encoder = false"
            )
    return stand, devices


def sensor_of(stand: Stand, name: str) -> Sensor:
    """The sensor of that name, or the first one that a device of that name is.

    Raises:
        BadRecipe: there is none.
    """
    return next((s for s in stand.sensors if s.name == name), None) or _views_of(stand, name)[0]


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
