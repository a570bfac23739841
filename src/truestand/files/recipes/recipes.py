"""stand.toml and shaft.toml (CONTRACT.md): mm, um, ppm and degrees in the files, mm and rad in memory.

Unknown keys are refused with the nearest right one: a typo in a recipe is an error, not a default.
"""

import base64
import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from itertools import product
from math import degrees, inf, radians
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, model_validator

from truestand.core.artefact import Artefact, Certificate, Cylinder
from truestand.core.errors import BadRecipe
from truestand.core.stand import AxisPosition, Sensor, Stand, Table
from truestand.files.atomic import write_text_atomic
from truestand.files.checking import R, Recipe, checked

Positive = Annotated[float, Field(gt=0)]
AxisKey = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*_(mm|deg)$")]
"""An axis of the positioner and its unit."""
STARTERS = ("stand.toml", "shaft.toml", "gear.toml")
HELICAL = (
    ("helix_angle_deg = 0.0 ", "helix_angle_deg = 15.0"),
    ("tip_diameter_mm = 52.0", "tip_diameter_mm = 53.69"),
    ("root_diameter_mm = 43.0", "root_diameter_mm = 44.69"),
)
"""What makes the starter's gear a helical one."""
MOST_LOGO_BYTES = 1_000_000
PNG_START = b"\x89PNG\r\n\x1a\n"
SVG_TAG = "{http://www.w3.org/2000/svg}svg"


class TableRecipe(Recipe):
    """``[table]``."""

    speed_rad_per_s: Positive | None = None
    direction: Literal["ccw", "cw"] = "ccw"
    start: Literal["home", "unknown"] = "unknown"
    angle_U_arcsec: Positive | None = None
    sideways_U_um: Positive | None = None


class SensorRecipe(Recipe):
    """``[[sensor]]``."""

    name: str = "sensor"
    profile_rate_hz: Positive | None = None
    points: Annotated[int, Field(gt=0)] | None = None
    range_mm: tuple[float, float] | None = None
    mirrored: bool = False
    serial: str | None = None
    linearity_U_um: Positive | None = None
    scale_U_ppm: Positive | None = None
    plane_offset_U_mm: Positive | None = None
    plane_tilt_U_deg: Positive | None = None
    incidence_U_um: Positive | None = None
    stability_U_um: Positive | None = None
    device: str | None = None
    noise_um: Positive | None = None
    line_mm: tuple[Positive, Positive] | None = None
    triangulation_deg: Annotated[float, Field(gt=-80, lt=80)] | None = None
    incidence_limit_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    housing_mm: tuple[Positive, Positive, Positive] | None = None
    position: dict[AxisKey, float] | None = None
    position_U_um: Positive | None = None
    position_U_deg: Positive | None = None

    @model_validator(mode="after")
    def _ordered(self) -> "SensorRecipe":
        if self.range_mm is not None and not self.range_mm[0] < self.range_mm[1]:
            raise ValueError(f"range_mm: found {list(self.range_mm)}, need [nearest, farthest]")
        return self


class ScanRecipe(Recipe):
    """``[scan]``."""

    y: Literal["index", "time_s", "angle_deg", "encoder"] = "index"
    counts_per_turn: Annotated[int, Field(ge=0)] = 0


class StoreRecipe(Recipe):
    """``[store]``: where results are kept."""

    folder: str = "results"
    """Beside the stand.toml, or a full path."""


class CompanyRecipe(Recipe):
    """``[company]``."""

    name: str = ""
    address: str = ""
    logo: str | None = None
    """PNG or SVG, beside the stand.toml, or a full path."""


class StandRecipe(Recipe):
    """stand.toml as a whole; ``[simulation]`` is checked by the virtual stand, ``[devices]`` by the station, ``[plan]``
    where it is read. How well the positioner takes a place again is a matter of each view that it carries."""

    table: TableRecipe = TableRecipe()
    sensor: Annotated[list[SensorRecipe], Field(min_length=1)]
    scan: ScanRecipe = ScanRecipe()
    simulation: dict[str, Any] = Field(default_factory=dict)
    devices: dict[str, Any] = Field(default_factory=dict)
    plan: dict[str, Any] = Field(default_factory=dict)
    store: StoreRecipe | None = None
    company: CompanyRecipe | None = None
    serial: str | None = None
    order: str | None = None
    operator: str | None = None

    @model_validator(mode="after")
    def _named(self) -> "StandRecipe":
        names = [sensor.name for sensor in self.sensor]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"found two [[sensor]]s named {twice!r}, need a name of its own for each")
        return self

    @model_validator(mode="after")
    def _carried(self) -> "StandRecipe":
        for sensor in self.sensor:
            if not sensor.position and (sensor.position_U_um or sensor.position_U_deg):
                raise ValueError(
                    f"sensor {sensor.name!r}: found position_U_um or position_U_deg and no position, need where the "
                    "positioner is for it; for a sensor that stands there, stability_U_um says how it moves"
                )
        positioner = self.devices.get("positioner")
        stated = positioner if isinstance(positioner, Mapping) else {}
        for sensor, key in product([s for s in self.sensor if s.position], ("position_U_um", "position_U_deg")):
            U = stated.get(key)
            if getattr(sensor, key) is None and isinstance(U, int | float):
                if not 0 < U < inf:
                    raise ValueError(f"devices.positioner.{key}: found {U}, need more than 0")
                setattr(sensor, key, float(U))
            if getattr(sensor, key) is None:
                raise ValueError(
                    f"sensor {sensor.name!r}: found a position and no {key}, need how well the positioner takes a "
                    "place again (k = 2); state it under [devices.positioner]"
                )
        return self


class CylinderRecipe(Recipe):
    """``[[cylinder]]``."""

    name: str
    diameter_mm: Positive
    from_mm: float
    to_mm: float
    diameter_U_mm: Positive | None = None
    coaxiality_U_mm: Positive | None = None


class CertificateRecipe(Recipe):
    """``[certificate]``."""

    id: str | None = None
    laboratory: str | None = None
    date: str | None = None
    valid_until: str | None = None
    temperature_C: float | None = None

    @model_validator(mode="before")
    @classmethod
    def _dates_as_text(cls, data: Any) -> Any:
        """TOML knows dates; the record keeps their ISO text."""
        if isinstance(data, Mapping):
            return {k: v.isoformat() if hasattr(v, "isoformat") else v for k, v in data.items()}
        return data


class ShaftRecipe(Recipe):
    """shaft.toml as a whole."""

    name: str = "shaft"
    cylinder: Annotated[list[CylinderRecipe], Field(min_length=1)]
    certificate: CertificateRecipe | None = None
    serial: str | None = None
    order: str | None = None
    operator: str | None = None


Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Company:
    """Whose name and logo stand at the head of the reports."""

    name: str = ""
    address: str = ""
    logo: str | None = None
    """A data URI, so that a report stays one file."""


def read_stand(path: Path | str) -> Stand:
    """The stand of a stand.toml.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong, missing or unknown key.
    """
    return build(_stand, _read_stand_recipe(path), path)


def read_shaft(path: Path | str) -> Artefact:
    """The reference shaft of a shaft.toml.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong, missing or unknown key.
    """
    return build(_artefact, checked(ShaftRecipe, read_toml(path), str(path)), path)


def read_simulation(path: Path | str) -> dict[str, Any]:
    """The ``[simulation]`` table of a stand.toml, as it stands; empty where there is none.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong, missing or unknown key.
    """
    return _read_stand_recipe(path).simulation


def read_devices_table(path: Path | str) -> dict[str, Any]:
    """The ``[devices]`` table of a stand.toml, as it stands; empty where there is none.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong, missing or unknown key.
    """
    return _read_stand_recipe(path).devices


def read_plan_table(path: Path | str) -> dict[str, Any]:
    """The ``[plan]`` table of a stand.toml, as it stands; empty where there is none.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong, missing or unknown key.
    """
    return _read_stand_recipe(path).plan


def read_store_folder(path: Path | str) -> Path | None:
    """The folder of ``[store]`` of a stand.toml; None where it keeps no results.

    Raises:
        BadRecipe: unreadable, no TOML, or a wrong, missing or unknown key.
    """
    recipe = _read_stand_recipe(path).store
    return None if recipe is None else Path(path).parent / recipe.folder


def read_company(path: Path | str) -> Company | None:
    """The company of a stand.toml; None where it has no ``[company]``.

    Raises:
        BadRecipe: a wrong or unknown key, or a logo that is missing, too large, or neither PNG nor SVG.
    """
    recipe = _read_stand_recipe(path).company
    if recipe is None:
        return None
    logo = None if recipe.logo is None else _data_uri(Path(path).parent / recipe.logo, f"{path}: [company] logo")
    return Company(recipe.name, recipe.address, logo)


def stand_from_recipe(recipe: Mapping[str, Any]) -> Stand:
    """The stand of a recipe embedded in a record or a native scan.

    Raises:
        BadRecipe: a wrong, missing or unknown key.
    """
    return _stand(checked(StandRecipe, recipe, "the embedded stand"))


def shaft_from_recipe(recipe: Mapping[str, Any]) -> Artefact:
    """The artefact of a recipe embedded in a record.

    Raises:
        BadRecipe: a wrong, missing or unknown key.
    """
    return _artefact(checked(ShaftRecipe, recipe, "the embedded artefact"))


def stand_recipe(stand: Stand) -> dict[str, Any]:
    """The stand with the keys of stand.toml; what was left open is left out."""
    recipe = StandRecipe(
        table=TableRecipe(
            speed_rad_per_s=stand.table.speed,
            direction=stand.table.direction,
            start=stand.table.start,
            angle_U_arcsec=None if stand.table.angle_U is None else 3600 * degrees(stand.table.angle_U),
            sideways_U_um=None if stand.table.sideways_U is None else 1000.0 * stand.table.sideways_U,
        ),
        sensor=[_sensor_recipe(s) for s in stand.sensors],
        scan=ScanRecipe(y=stand.y, counts_per_turn=stand.counts_per_turn),
    )
    return recipe.model_dump(mode="json", exclude_none=True, exclude={"simulation", "plan"})


def shaft_recipe(artefact: Artefact) -> dict[str, Any]:
    """The artefact with the keys of shaft.toml; what was left open is left out."""
    c = artefact.certificate
    recipe = ShaftRecipe(
        name=artefact.name,
        serial=artefact.serial,
        cylinder=[
            CylinderRecipe(
                name=k.name,
                diameter_mm=k.diameter,
                from_mm=k.bottom,
                to_mm=k.top,
                diameter_U_mm=k.diameter_U,
                coaxiality_U_mm=k.coaxiality_U,
            )
            for k in artefact.cylinders
        ],
        certificate=None
        if c is None
        else CertificateRecipe(
            id=c.id, laboratory=c.laboratory, date=c.date, valid_until=c.valid_until, temperature_C=c.temperature
        ),
    )
    return recipe.model_dump(mode="json", exclude_none=True)


def write_starters(directory: Path | str, force: bool = False, views: int = 1) -> list[Path]:
    """Write the commented starter recipes; returns their paths. With two ``views``, of a stand with two sensors and a
    helical gear.

    Raises:
        BadRecipe: one of them exists and ``force`` is not set; nothing is written then.
    """
    paths = [Path(directory) / name for name in STARTERS]
    existing = [str(p) for p in paths if p.exists()]
    if existing and not force:
        raise BadRecipe(f"found {', '.join(existing)} already there; choose another folder or pass --force")
    for path in paths:
        text = _starter(path.name)
        if views > 1:
            text = text + _starter("second-sensor.toml") if path.name == "stand.toml" else _helical(text)
        write_text_atomic(path, text)
    return paths


def _starter(name: str) -> str:
    return files("truestand.files").joinpath("starters", name).read_text(encoding="utf-8")


def _helical(text: str) -> str:
    """The starter's gear with a helix; the starter's shaft as it is."""
    for spur, helical in HELICAL:
        text = text.replace(spur, helical)
    return text


def read_toml(path: Path | str) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        BadRecipe: unreadable or no TOML.
    """
    try:
        return tomllib.loads(Path(path).read_bytes().decode("utf-8-sig"))
    except OSError as wrong:
        raise BadRecipe(f"{path}: can't be read ({wrong.strerror or wrong}); `truestand init` writes one") from wrong
    except UnicodeDecodeError as wrong:
        raise BadRecipe(f"{path}: no UTF-8 text at byte {wrong.start}; save it as UTF-8") from wrong
    except tomllib.TOMLDecodeError as wrong:
        raise BadRecipe(f"{path}: no valid TOML: {wrong}") from wrong
    except (ValueError, RecursionError) as wrong:  # numbers of thousands of digits, tables a thousand deep
        raise BadRecipe(f"{path}: no valid TOML: {wrong}; `truestand init` writes a recipe to start from") from wrong


def build(make: Callable[[R], Made], recipe: R, path: Path | str) -> Made:
    """What ``make`` makes of a recipe.

    Raises:
        BadRecipe: what ``make`` refuses, with the name of the recipe's file.
    """
    try:
        return make(recipe)
    except BadRecipe as wrong:
        raise BadRecipe(f"{path}: {wrong}") from wrong


def _read_stand_recipe(path: Path | str) -> StandRecipe:
    return checked(StandRecipe, read_toml(path), str(path))


def _data_uri(path: Path, where: str) -> str:
    """A picture as text; its content says of which kind it is."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_LOGO_BYTES + 1)
    except OSError as wrong:
        raise BadRecipe(f"{where}: {path} can't be read ({wrong.strerror or wrong}); give a PNG or SVG file") from wrong
    if len(content) > MOST_LOGO_BYTES:
        raise BadRecipe(f"{where}: {path} has more than {MOST_LOGO_BYTES // 1_000_000} MB; save it smaller")
    kind = "png" if content.startswith(PNG_START) else "svg+xml" if _is_svg(content) else None
    if kind is None:
        raise BadRecipe(f"{where}: {path} is neither PNG nor SVG; save it as one of them")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _is_svg(content: bytes) -> bool:
    """Whether it is an SVG document; entities are not followed, no address is opened."""
    from lxml import etree

    try:
        root = etree.fromstring(content, etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False))
    except (etree.XMLSyntaxError, ValueError):
        return False
    return bool(root.tag == SVG_TAG)


def _stand(recipe: StandRecipe) -> Stand:
    t = recipe.table
    return Stand(
        Table(
            t.speed_rad_per_s,
            t.direction,
            t.start,
            None if t.angle_U_arcsec is None else radians(t.angle_U_arcsec / 3600),
            None if t.sideways_U_um is None else t.sideways_U_um / 1000.0,
        ),
        tuple(_sensor(s) for s in recipe.sensor),
        recipe.scan.y,
        recipe.scan.counts_per_turn,
    )


def _sensor(s: SensorRecipe) -> Sensor:
    return Sensor(
        name=s.name,
        profile_rate=s.profile_rate_hz,
        points=s.points,
        range=s.range_mm,
        mirrored=s.mirrored,
        serial=s.serial,
        linearity_U=None if s.linearity_U_um is None else s.linearity_U_um / 1000.0,
        scale_U=None if s.scale_U_ppm is None else s.scale_U_ppm / 1e6,
        plane_offset_U=s.plane_offset_U_mm,
        plane_tilt_U=None if s.plane_tilt_U_deg is None else radians(s.plane_tilt_U_deg),
        incidence_U=None if s.incidence_U_um is None else s.incidence_U_um / 1000.0,
        stability_U=None if s.stability_U_um is None else s.stability_U_um / 1000.0,
        device=s.device,
        noise=None if s.noise_um is None else s.noise_um / 1000.0,
        line=s.line_mm,
        triangulation=None if s.triangulation_deg is None else radians(s.triangulation_deg),
        incidence_limit=None if s.incidence_limit_deg is None else radians(s.incidence_limit_deg),
        housing=s.housing_mm,
        position=tuple(_axis_position(key, value) for key, value in (s.position or {}).items()),
        position_U=None if s.position_U_um is None else s.position_U_um / 1000.0,
        position_tilt_U=None if s.position_U_deg is None else radians(s.position_U_deg),
    )


def _axis_position(key: str, value: float) -> AxisPosition:
    axis, _, unit = key.rpartition("_")
    return AxisPosition(axis, value if unit == "mm" else radians(value), unit == "mm")


def _sensor_recipe(s: Sensor) -> SensorRecipe:
    return SensorRecipe(
        name=s.name,
        profile_rate_hz=s.profile_rate,
        points=s.points,
        range_mm=s.range,
        mirrored=s.mirrored,
        serial=s.serial,
        linearity_U_um=None if s.linearity_U is None else s.linearity_U * 1000.0,
        scale_U_ppm=None if s.scale_U is None else s.scale_U * 1e6,
        plane_offset_U_mm=s.plane_offset_U,
        plane_tilt_U_deg=None if s.plane_tilt_U is None else degrees(s.plane_tilt_U),
        incidence_U_um=None if s.incidence_U is None else s.incidence_U * 1000.0,
        stability_U_um=None if s.stability_U is None else s.stability_U * 1000.0,
        device=s.device,
        noise_um=None if s.noise is None else s.noise * 1000.0,
        line_mm=s.line,
        triangulation_deg=None if s.triangulation is None else degrees(s.triangulation),
        incidence_limit_deg=None if s.incidence_limit is None else degrees(s.incidence_limit),
        housing_mm=s.housing,
        position=position_keys(s.position) or None,
        position_U_um=None if s.position_U is None else s.position_U * 1000.0,
        position_U_deg=None if s.position_tilt_U is None else degrees(s.position_tilt_U),
    )


def position_keys(position: tuple[AxisPosition, ...]) -> dict[str, float]:
    """A position of a positioner's axes as recipes and records state it: mm and degrees, by axis and unit."""
    return {
        f"{p.axis}_mm" if p.linear else f"{p.axis}_deg": p.value if p.linear else degrees(p.value) for p in position
    }


def sensor_lines(sensor: Sensor) -> str:
    """The lines (TOML) of a ``[[sensor]]``."""
    table = _sensor_recipe(sensor).model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    return "\n".join(f"{key} = {_toml_value(value)}" for key, value in {"name": sensor.name, **table}.items())


def _toml_value(value: Any) -> str:
    """A text, number, truth value, list of numbers or table of them as TOML: JSON is the same of most."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_toml_value(of)}' for key, of in value.items())} }}"
    return json.dumps(round(value, 9) if isinstance(value, float) else value, ensure_ascii=False)


def _artefact(recipe: ShaftRecipe) -> Artefact:
    c = recipe.certificate
    return Artefact(
        tuple(
            Cylinder(k.name, k.diameter_mm, k.from_mm, k.to_mm, k.diameter_U_mm, k.coaxiality_U_mm)
            for k in recipe.cylinder
        ),
        recipe.name,
        None if c is None else Certificate(c.id, c.laboratory, c.date, c.valid_until, c.temperature_C),
        recipe.serial,
    )
