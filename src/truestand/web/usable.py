"""Whether a calibration can be used on this stand: what it was made with, held against stand.toml and shaft.toml.

A record that doesn't say what it was made with (an old one, one cut down by hand) contradicts nothing.
"""

from collections.abc import Callable, Iterator, Mapping
from math import isclose
from pathlib import Path
from typing import Any, TypeVar

from truestand.core.errors import BadRecipe
from truestand.core.stand import Sensor, Stand
from truestand.files.recipes.recipes import (
    read_shaft,
    read_stand,
    shaft_from_recipe,
    shaft_recipe,
    stand_from_recipe,
    stand_recipe,
)

MAX_DIFFERENCES = 4
"""That are named, of each file."""
Record = Mapping[str, Any]
Made = TypeVar("Made")


def unusable_reason(record: Record, stand: Path) -> str | None:
    """Why nothing can be inspected with a calibration on the stand of a stand.toml; None: it can."""
    if record.get("method") == "paper":
        return "it is of the published method, which can inspect nothing"
    try:
        here = read_stand(stand)
    except BadRecipe:  # whoever starts a job is told
        return None
    name = (record.get("sensor") or {}).get("name")
    sensor = _sensor(here, name)
    if name and sensor is None:
        return f"it is of sensor {name!r}, {stand.name} has {', '.join(repr(s.name) for s in here.sensors)}"
    made = _parsed(record, "stand", stand_from_recipe)
    return None if made is None else _contradiction(made, here, _sensor(made, name), sensor, stand.name)


def differences(record: Record, stand: Path, artefact: Path) -> list[str]:
    """In what stand.toml and shaft.toml differ today from what a calibration was made with."""
    found = []
    made = _parsed(record, "stand", stand_from_recipe), _parsed(record, "artefact", shaft_from_recipe)
    try:
        if made[0] is not None:
            found += _differences(stand_recipe(made[0]), stand_recipe(read_stand(stand)), stand.name)
        if made[1] is not None:
            found += _differences(shaft_recipe(made[1]), shaft_recipe(read_shaft(artefact)), artefact.name)
    except BadRecipe as wrong:
        found.append(str(wrong))
    return found


def _contradiction(
    made: Stand, here: Stand, used: Sensor | None, sensor: Sensor | None, file: str
) -> str | None:  # fmt: skip
    """What the evaluation of a scan would refuse, and a sensor that is another one."""
    if made.table.direction != here.table.direction:
        return f"its table turns {made.table.direction}, that of {file} {here.table.direction}"
    if used is None or sensor is None:
        return None
    if used.mirrored != sensor.mirrored:
        was, now = ("mirrored", "is not") if used.mirrored else ("not mirrored", "is")
        return f"its sensor was {was}, that of {file} {now}"
    if used.serial and sensor.serial and used.serial != sensor.serial:
        return f"it is of the sensor with serial number {used.serial}, {file} has {sensor.serial}"
    return None


def _sensor(stand: Stand, name: str | None) -> Sensor | None:
    return next((s for s in stand.sensors if s.name == name), None)


def _parsed(record: Record, key: str, parse: Callable[[Record], Made]) -> Made | None:
    try:
        return parse(record[key]) if record.get(key) else None
    except BadRecipe:
        return None


def _differences(made: Record, here: Record, file: str) -> list[str]:
    then, now = dict(_flat(made)), dict(_flat(here))
    changed = [key for key in {**then, **now} if not _same(then.get(key), now.get(key))]
    found = [f"{file}: {key} is {_text(now.get(key))}, was {_text(then.get(key))}" for key in changed]
    more = len(found) - MAX_DIFFERENCES
    return found if more <= 0 else [*found[:MAX_DIFFERENCES], f"{file}: {more} more differences"]


def _flat(recipe: Record, path: str = "") -> Iterator[tuple[str, Any]]:
    """Each value by its place, such as *sensor front points*."""
    for key, value in recipe.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{path}{key} ")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for item in value:
                yield from _flat(item, f"{path}{key} {item['name']} ")
        else:
            yield f"{path}{key}", value


def _same(a: Any, b: Any) -> bool:
    """Numbers as far as the conversion of their units leaves them alone."""
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, float) and isinstance(b, float):
        return isclose(a, b, rel_tol=1e-9)
    return bool(a == b)


def _text(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    return "not stated" if value is None else f"{value:.9g}" if isinstance(value, float) else str(value)
