"""Recipes checked key by key: an unknown key is refused with the nearest right one, a wrong value is named."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from types import UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from truestand.core.errors import BadRecipe

NEEDED = {
    "tuple_type": "need a list",
    "list_type": "need a list",
    "too_long": "need {max_length} values",
    "too_short": "need {min_length} or more",
    "dict_type": "need a table",
    "model_type": "need a table",
}
"""What pydantic says in Python's words, by its types of errors."""


class Recipe(BaseModel):
    """A table of a recipe: no unknown key, no infinity, no NaN."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_value_as_a_number(cls, value: Any, field: ValidationInfo) -> Any:
        if isinstance(value, bool) and cls.model_fields[str(field.field_name)].annotation is not bool:
            raise ValueError("need no truth value")
        return value


R = TypeVar("R", bound=Recipe)


def checked(model: type[R], data: Mapping[str, Any], where: str) -> R:
    """``data`` as a ``model``.

    Raises:
        BadRecipe: a wrong, missing or unknown key, in one line that starts with ``where``.
    """
    try:
        return model.model_validate(dict(data))
    except ValidationError as wrong:
        raise BadRecipe(f"{where}: {_plain(wrong, model)}") from wrong


def refuse_other_types(value: Any, hint: Any, where: str) -> None:
    """Refuse what is not, at any depth of a dataclass, as its annotations say.

    Null is what is not known, also where a number was NaN; a count is always known.

    Raises:
        TypeError: with the place.
    """
    inner = get_args(hint)
    if isinstance(hint, type) and is_dataclass(hint):
        for name, of in _annotations(hint).items():
            refuse_other_types(getattr(value, name), of, f"{where}.{name}")
    elif get_origin(hint) in (tuple, dict):
        for item in value.values() if isinstance(value, dict) else value:
            refuse_other_types(item, inner[get_origin(hint) is dict], where)
    elif get_origin(hint) is UnionType and value is not None:
        refuse_other_types(value, inner[0], where)
    elif (value is not None or hint is int) and not _is(value, hint):
        raise TypeError(f"{where}: found {str(value)[:40]!r}, need {hint}")


_annotations = cache(get_type_hints)


def _is(value: Any, hint: Any) -> bool:
    """Whether a single value is as annotated; a whole number may be written 3.0, and arrays are checked elsewhere."""
    if get_origin(hint) is Literal:
        return value in get_args(hint)
    if hint in (int, float):
        return isinstance(value, int | float) and not isinstance(value, bool)
    return hint not in (str, bool) or isinstance(value, hint)


def _plain(wrong: ValidationError, model: type[BaseModel]) -> str:
    """The first problem of a recipe in one plain line; unknown keys before everything else."""
    first = min(wrong.errors(), key=lambda e: e["type"] != "extra_forbidden")
    message = str(first["msg"]).removeprefix("Value error, ")
    if first["type"] == "value_error" and isinstance(first["input"], Mapping):  # about a table as a whole
        return f"{_inside(first['loc'])}{message}"
    *parents, key = first["loc"] or ("",)
    inside = _inside(parents)
    if first["type"] == "extra_forbidden":
        known = _keys(model, tuple(parents))
        near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.4)
        advice = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(known)}"
        return f"{inside}unknown key {key!r}; {advice}"
    if first["type"] == "missing":
        return f"{inside}value {key + 1} is missing" if isinstance(key, int) else f"{inside}key {key!r} is missing"
    wording = NEEDED.get(first["type"])
    needed = f"{message[0].lower()}{message[1:]}" if wording is None else wording.format(**first.get("ctx", {}))
    return f"{inside}{key}: found {first['input']!r}; {needed}"


def _inside(place: Sequence[int | str]) -> str:
    """Where in the recipe, e.g. ``[devices.sensor[1]] ``; tables of a list count from 1."""
    words = "".join(f"[{p + 1}]" if isinstance(p, int) else f".{p}" for p in place).lstrip(".")
    return f"[{words}] " if words else ""


def _keys(model: type[BaseModel], parents: tuple[int | str, ...]) -> list[str]:
    """The keys that a table knows, following ``parents`` down from ``model``."""
    for parent in parents:
        if isinstance(parent, str):
            model = _model_in(model.model_fields[parent].annotation) or model
    return list(model.model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The table that a field holds, be it alone, in a list or optional."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for inner in get_args(annotation) if (found := _model_in(inner)) is not None), None)
