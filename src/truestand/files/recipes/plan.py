"""``[plan]`` of stand.toml, which only ``truestand plan`` reads; and the stand.toml that a plan comes to."""

import tomllib
from collections.abc import Mapping, Sequence
from math import atan, degrees, radians
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from truestand.files.checking import Recipe, checked
from truestand.files.recipes.recipes import Positive, read_plan_table, sensor_lines
from truestand.planning.obstacles import Round
from truestand.planning.plan import MOST_VIEWS, Plan, Task
from truestand.planning.room import KeepOut, Room
from truestand.planning.target import View

SWEPT = "[[devices.positioner.swept]]"
SENSOR_TABLES = ("[[sensor]]", "[sensor.", "[[simulation.view]]", SWEPT)
"""What a plan takes the place of in a stand.toml."""
PLACE_KEYS = ("phi_deg", "standoff_mm", "height_mm", "laser_plane_tilt_deg", "laser_plane_offset_mm", "azimuth_deg")
"""Of ``[simulation]``, which hold for a single sensor."""
SIMULATION = "[simulation]"
Pair = tuple[float, float]


class KeepOutRecipe(Recipe):
    """``[[plan.keep_out]]``: a stretch of a ring about the table."""

    azimuth_deg: Pair = (0.0, 360.0)
    radius_mm: Pair = (0.0, 1e9)
    height_mm: Pair = (-1e9, 1e9)

    @model_validator(mode="after")
    def _ordered(self) -> "KeepOutRecipe":
        for key in ("azimuth_deg", "radius_mm", "height_mm"):
            low, high = getattr(self, key)
            if not low < high:
                raise ValueError(f"{key}: found {[low, high]}, need [from, to]; beyond 360 deg where it goes through 0")
        return self


class PlanRecipe(Recipe):
    """``[plan]`` as a whole."""

    eccentricity_mm: Positive | None = None
    turns: Annotated[float, Field(ge=1.0, le=100.0)] | None = None
    table_disc_mm: Positive = 200.0
    """Diameter."""
    table_face_mm: float | None = None
    clearance_mm: Annotated[float, Field(ge=0)] = 5.0
    most_views: Annotated[int, Field(ge=1, le=6)] = MOST_VIEWS
    keep_out: tuple[KeepOutRecipe, ...] = ()


def read_task(path: Path | str) -> Task:
    """What a stand.toml says for a plan.

    Raises:
        BadRecipe: a wrong or unknown key.
    """
    r = checked(PlanRecipe, read_plan_table(path), f"{path}: [plan]")
    keep_out = tuple(
        KeepOut((radians(k.azimuth_deg[0]), radians(k.azimuth_deg[1])), k.radius_mm, k.height_mm) for k in r.keep_out
    )
    room = Room(r.table_disc_mm / 2, r.table_face_mm, keep_out, r.clearance_mm)
    return Task(room, None, r.eccentricity_mm, r.turns, r.most_views)


def planned_stand(text: str, plan: Plan) -> str:
    """The text of a stand.toml with the sensors of a plan for its own, and a virtual stand as it was planned."""
    sensors = "\n".join(_sensor_text(view) for view in plan.views)
    views = "\n".join(_virtual_view_text(view) for view in plan.views)
    swept = "\n".join(_swept_text(body) for body in plan.search.turning) if plan.setting.carrier else ""
    virtual = _virtual_keys(tomllib.loads(text), plan)
    kept = _without(text, {"[devices.positioner]": ("swept",), SIMULATION: (*PLACE_KEYS, *virtual)})
    return "\n".join(part for part in (_with_virtual(kept, virtual), sensors, swept, views) if part)


def _virtual_keys(recipe: Mapping[str, Any], plan: Plan) -> dict[str, float]:
    """Keys of ``[simulation]``: what the first view's data sheet and ``[plan]`` state, and what was assumed where
    nothing else is stated.
    """
    view, asked = plan.views[0], recipe.get("plan", {})
    sensor, optics = view.scan.stand.sensor, view.mount.sensor.optics
    fan = 2 * atan(float(optics.half_line(optics.middle)) / optics.middle)
    planned = {
        "fan_deg": (sensor.line, degrees(fan)),
        "triangulation_deg": (sensor.triangulation, degrees(optics.triangulation)),
        "most_incidence_deg": (sensor.incidence_limit, degrees(optics.incidence_limit)),
        "noise_um": (sensor.noise, 1000.0 * optics.noise),
        "eccentricity_um": (asked.get("eccentricity_mm"), 1000.0 * plan.setting.eccentricity),
        "profiles": (asked.get("turns"), plan.setting.profiles),
    }
    own = recipe.get("simulation", {})
    return {key: value for key, (stated, value) in planned.items() if stated is not None or key not in own}


def _without(text: str, keys: Mapping[str, Sequence[str]]) -> str:
    """The recipe without its sensors, and without some ``keys`` of tables."""
    kept, table, open_brackets = [], "", 0
    for line in text.splitlines():
        if open_brackets > 0:  # the rest of a value that is left out
            open_brackets += _brackets(line)
            continue
        if line.startswith("["):
            table = line.split("#")[0].strip()
        if line.split("=")[0].strip() in keys.get(table, ()):
            open_brackets = _brackets(line)
        elif not table.startswith(SENSOR_TABLES):
            kept.append(line)
    return "\n".join(kept).rstrip() + "\n"


def _with_virtual(text: str, keys: Mapping[str, float]) -> str:
    """The recipe with ``keys`` at the head of its ``[simulation]``, or with one of its own."""
    lines = text.splitlines()
    at = next((k for k, line in enumerate(lines) if line.split("#")[0].strip() == SIMULATION), len(lines))
    head = lines[at : at + 1] or ["", SIMULATION]
    return "\n".join([*lines[:at], *head, *_toml_lines(keys), *lines[at + 1 :]]) + "\n"


def _toml_lines(keys: Mapping[str, float]) -> list[str]:
    return [f"{key} = {round(value, 4) + 0!r}" for key, value in keys.items()]


def _brackets(line: str) -> int:
    """How many more brackets a line opens than it closes."""
    value = line.split("#")[0]
    return value.count("[") - value.count("]")


def _sensor_text(view: View) -> str:
    """A ``[[sensor]]``, with its place in words."""
    place = view.mount.place
    words = (
        f"# Planned: phi {degrees(place.phi):.1f} deg; the middle of its line meets the shaft's base at height "
        f"{place.height:.1f} mm,\n# {place.standoff:.1f} mm away; laser plane {place.plane_offset:+.2f} mm off the "
        f"axis; azimuth {degrees(place.azimuth):.0f} deg; {view.mount.clearance:.0f} mm clear."
    )
    return f"{words}\n[[sensor]]\n{sensor_lines(view.scan.stand.sensor)}\n"


def _swept_text(body: Round) -> str:
    """What the positioner keeps its sensor away from."""
    return f"{SWEPT}\nradius_mm = {body.radius:.3f}\nfrom_mm = {body.bottom:.3f}\nto_mm = {body.top:.3f}\n"


def _virtual_view_text(view: View) -> str:
    """The same place on the virtual stand."""
    place = view.mount.place
    lines = "\n".join(_toml_lines({
        "azimuth_deg": degrees(place.azimuth), "phi_deg": degrees(place.phi), "standoff_mm": place.standoff,
        "height_mm": place.height, "laser_plane_offset_mm": place.plane_offset,
    }))  # fmt: skip
    return f'[[simulation.view]]\nname = "{view.mount.sensor.name}"\n{lines}\n'
