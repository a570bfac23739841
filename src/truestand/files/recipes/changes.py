"""In what recipes differ today from what a calibration was made with, by its record.

A record that doesn't say what it was made with (an old one, one cut down by hand) differs in nothing.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any, TypeVar

from truestand.core.errors import BadRecipe
from truestand.core.stand import Stand
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


def differences(record: Record, stand: Path | None, artefact: Path | None) -> list[str]:
    """In what stand.toml and shaft.toml differ today from what a calibration was made with; None: not compared."""
    found = []
    made = as_made(record, "stand", stand_from_recipe), as_made(record, "artefact", shaft_from_recipe)
    try:
        if made[0] is not None and stand is not None:
            found += _differences(
                stand_recipe(made[0]), stand_recipe(_of_its_sensors(read_stand(stand), made[0])), stand.name
            )
        if made[1] is not None and artefact is not None:
            found += _differences(shaft_recipe(made[1]), shaft_recipe(read_shaft(artefact)), artefact.name)
    except BadRecipe as wrong:
        found.append(str(wrong))
    return found


def _of_its_sensors(here: Stand, made: Stand) -> Stand:
    """The stand with the sensors that a calibration is of: others say nothing about it."""
    names = {s.name for s in made.sensors}
    return replace(here, sensors=tuple(s for s in here.sensors if s.name in names) or here.sensors)


def as_made(record: Record, key: str, parse: Callable[[Record], Made]) -> Made | None:
    """The recipe that a calibration's record carries, of stand or artefact; None: it carries none."""
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
