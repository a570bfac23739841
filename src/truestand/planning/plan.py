"""The plan: the fewest views that make what a drawing asks measurable and capable, and what no place can see."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import pi

import numpy as np

from truestand.core.arrays import Mask
from truestand.core.artefact import Artefact
from truestand.core.errors import BadRecipe
from truestand.core.inspection import Characteristic, Status
from truestand.core.stand import Sensor, Stand
from truestand.gear.drawing import Gear
from truestand.gear.evaluate import AREAL
from truestand.gear.geometry import FLANKS
from truestand.parts.drawings import Turned
from truestand.parts.inspect import Part
from truestand.planning.carried import Carrier
from truestand.planning.cast_target import cad_target, turned_target
from truestand.planning.gear_target import gear_target
from truestand.planning.optics import optics_of
from truestand.planning.place import Place
from truestand.planning.room import Room
from truestand.planning.search import (
    ENOUGH,
    RUNNING_TRUE,
    ComparedPlaces,
    KnownViews,
    Search,
    Step,
    best_views,
    search_of,
)
from truestand.planning.sight import CAUSES
from truestand.planning.target import ORDER, PlannedSensor, Target, View, share_of_room
from truestand.planning.views import Setting, uncalibrated

ECCENTRICITY, TURNS = 1.0, 2.0
"""mm by which a shaft is best clamped off the axis; turns of a scan."""
PROFILES_PER_TURN = 4000.0
"""Of a stand that states no speed or no profile rate."""
MOST_VIEWS = 3
HIDDEN = 0.005
"""Share of a surface that counts as unseen."""


@dataclass(frozen=True, slots=True)
class Task:
    """What a plan is made for, beside part, stand and shaft; None: it is assumed."""

    room: Room = field(default_factory=Room)
    carrier: Carrier | None = None
    """The positioner, where there is one."""
    eccentricity: float | None = None
    """mm: by which the shaft will run out."""
    turns: float | None = None
    """Of a scan."""
    most_views: int = MOST_VIEWS


@dataclass(frozen=True, slots=True)
class Expected:
    """A characteristic as it would be measured; of all teeth, where there are several."""

    name: str
    flank: str | None
    section: str | None
    U: float | None
    """mm, k = 2, of several teeth the root mean square; None: it can't be measured."""
    largest: float | None
    """mm: the largest of the teeth, where there are several."""
    limits: tuple[float | None, float | None] | None
    size: bool
    share: float | None
    """The largest U over the room between the limits."""
    status: Status
    capable: bool
    """Whether any value of any tooth could be shown to conform; without limits, whether it is measured."""
    mostly: str | None
    """The input that makes most of U."""

    @property
    def where(self) -> str:
        """Which flank, or section."""
        return self.flank or self.section or ""


@dataclass(frozen=True)
class Plan:
    """Where to put the sensors, and what comes of it."""

    part: Part
    setting: Setting
    search: Search
    views: tuple[View, ...]
    coverage: dict[str, float]
    """Share 0..1 of each surface that the views see together."""
    unseen: tuple[str, ...]
    """What no place can see, and what these views don't."""
    fewer: "Plan | None"
    """With one view less."""
    assumed: tuple[str, ...]
    """What the recipes don't state."""
    tried: tuple[ComparedPlaces, ...]
    """Sets of places that were compared."""

    @cached_property
    def expected(self) -> tuple[Expected, ...]:
        """What an inspection by these views would say; costly."""
        return _expected(self.search.target.lines(self.views), self.coverage) if self.views else ()

    @property
    def asked(self) -> tuple[Expected, ...]:
        """Characteristics that the drawing limits; all of them where it limits none."""
        limited = tuple(e for e in self.expected if e.limits is not None)
        return limited or self.expected

    @property
    def complete(self) -> bool:
        """Whether all that the drawing asks is measurable and capable."""
        if not self.views or self.hidden_flanks:
            return False
        return all(e.status == "measured" and e.capable for e in self.asked)

    @property
    def hidden_flanks(self) -> int:
        """Sides of a gear of which too little is seen: nothing that reads them is measured whole."""
        return sum(share < ENOUGH for name, share in self.coverage.items() if name in FLANKS)

    @property
    def worst(self) -> Expected | None:
        """What has the largest U against its limits."""
        return max((e for e in self.asked if e.share is not None), key=lambda e: e.share or 0.0, default=None)

    @property
    def rank(self) -> tuple[int, int, int]:
        """How many of the asked are measured, at least in part, and capable."""
        measured = [e for e in self.asked if e.status == "measured"]
        in_part = sum(e.status != "not_measurable" for e in self.asked)
        return len(measured), in_part, sum(e.capable for e in measured)

    def better_than(self, other: "Plan") -> bool:
        """Whether it shows a flank more, or measures more of what is asked."""
        return self.hidden_flanks < other.hidden_flanks or self.rank > other.rank


def plan(
    part: Part, stand: Stand, artefact: Artefact, task: Task | None = None, views: int | None = None,
    step: Step = lambda share: None,
) -> Plan:  # fmt: skip
    """Where to put the sensors of a stand to inspect a part on a shaft.

    ``views``: so many; None: the fewest that do. Places are tried over angle, stand-off, height, plane offset and
    azimuth, or over the positions of a positioner; each is calibrated on an imagined scan of the shaft, and the part is
    assessed as an inspection does it. The first sensor of the stand takes the views for which there is no other: one
    device in several places.

    Raises:
        BadRecipe: a sensor without its range or with a wrong one, a number of views below one, or a table above the
            part's lower face.
    """
    task = task or Task()
    if views is not None and views < 1:
        raise BadRecipe(f"found --views {views}, need one or more")
    most = task.most_views if views is None else views
    sensors, assumed = _planned_sensors(stand, most, task.carrier)
    turns, eccentricity = task.turns or TURNS, task.eccentricity or ECCENTRICITY
    stand_of_views = replace(stand, sensors=_sensors(stand, sensors, task.carrier))
    per_turn = _profiles_per_turn(stand)
    setting = Setting(stand_of_views, artefact, eccentricity, task.carrier, round(turns * per_turn))
    target = _target(part, setting, turns, per_turn)
    _check_table_face(task.room.table_face, target)
    search = search_of(setting, target, task.room, sensors, lambda share: step(share / 3))
    texts = (*assumed, *_assumed(stand, task))
    found: Plan | None = None
    known: KnownViews = {}
    for number in range(1 if views is None else max(views - 1, 1), most + 1):
        further = _with(part, search, sensors[:number], known, texts, found, lambda share: step((1 + share) / 3))
        if views is None and found is not None and not further.better_than(found):
            break
        found = further
        if views is None and (found.complete or not found.views):
            break
    assert found is not None
    step(1.0)
    return found


def _with(
    part: Part, search: Search, sensors: Sequence[PlannedSensor], known: KnownViews, assumed: tuple[str, ...],
    fewer: Plan | None, step: Step,
) -> Plan:  # fmt: skip
    """The best plan with these sensors."""
    choice = best_views(search, sensors, known, step)
    views = choice.views
    seen = np.zeros(len(search.target.surfaces.points), dtype=bool)
    for view in views:
        seen |= search.seen_from(view.mount)[RUNNING_TRUE]
    coverage = search.target.surfaces.coverage(seen)
    unseen = _unseen(search, seen, None if views else choice.why_not)
    return Plan(part, search.setting, search, views, coverage, unseen, fewer, assumed, choice.tried)


def _planned_sensors(
    stand: Stand, most: int, carrier: Carrier | None
) -> tuple[tuple[PlannedSensor, ...], tuple[str, ...]]:
    """A sensor for each view: those of the stand, then the one that is carried, or the first one, again; and what is
    assumed of them.
    """
    sensors, assumed = [], []
    for sensor in stand.sensors:
        optics, texts = optics_of(sensor)
        device = sensor.device or sensor.name
        carried = carrier is not None and device == carrier.device
        sensors.append(PlannedSensor(sensor.name, device, optics, carried))
        assumed += [f"[[sensor]] {sensor.name!r} {text}" for text in texts]
    again = next((sensor for sensor in sensors if sensor.carried), sensors[0])
    for k in range(len(sensors) + 1, most + 1):
        sensors.append(replace(again, name=f"{again.name}-{k}"))
    return tuple(sensors[:most]), tuple(assumed)


def _sensors(stand: Stand, sensors: Sequence[PlannedSensor], carrier: Carrier | None) -> tuple[Sensor, ...]:
    """The ``[[sensor]]`` of each view."""
    known = {sensor.name: sensor for sensor in stand.sensors}
    found = []
    for planned in sensors:
        alike = next(s for s in stand.sensors if (s.device or s.name) == planned.device)
        sensor = known.get(planned.name) or replace(alike, name=planned.name, device=planned.device)
        if carrier is not None and planned.carried:
            sensor = replace(sensor, position_U=carrier.position_U, position_tilt_U=carrier.position_tilt_U)
        found.append(replace(sensor, position=()))
    return tuple(found)


def _target(part: Part, setting: Setting, turns: float, per_turn: float) -> Target:
    if isinstance(part, Gear):
        anywhere = uncalibrated(Place(-pi / 2, 1.0, 0.0), setting)
        return gear_target(part, anywhere, setting.shaft, turns, per_turn)
    if isinstance(part, Turned):
        return turned_target(part, setting.shaft, setting.eccentricity, turns, per_turn)
    return cad_target(part, setting.shaft, setting.eccentricity, turns, per_turn)


def _check_table_face(face: float | None, target: Target) -> None:
    lowest = min(body.bottom for body in target.swept)
    if face is not None and face > lowest:
        raise BadRecipe(
            f"[plan]: found table_face_mm = {face:g}, need {lowest:g} or less, where the part begins; both are heights "
            "over the shaft's shoulder"
        )


def _profiles_per_turn(stand: Stand) -> float:
    speed, rate = stand.table.speed, stand.sensors[0].profile_rate
    return PROFILES_PER_TURN if speed is None or rate is None else 2 * pi * rate / speed


def _assumed(stand: Stand, task: Task) -> tuple[str, ...]:
    texts = []
    if task.eccentricity is None:
        texts.append(f"[plan] eccentricity_mm: {ECCENTRICITY:g}")
    if task.turns is None:
        texts.append(f"[plan] turns: {TURNS:g}")
    if stand.table.speed is None or stand.sensors[0].profile_rate is None:
        texts.append(f"[table] speed_rad_per_s or [[sensor]] profile_rate_hz: {PROFILES_PER_TURN:g} profiles a turn")
    return tuple(texts)


def _expected(lines: tuple[Characteristic, ...], coverage: dict[str, float]) -> tuple[Expected, ...]:
    """The lines of an inspection by name and place, those of teeth together; their means, and those over whole flanks,
    left out.

    What views leave out of a flank may be damaged: an inspection counts it, so nothing that reads it is promised.
    """
    by_place: dict[tuple[str, str | None, str | None], list[Characteristic]] = {}
    for line in lines:
        if not line.name.endswith(AREAL):
            by_place.setdefault((line.name, line.flank, line.section), []).append(line)
    return tuple(
        _as_far_as_seen(_of_teeth(*place, [line for line in of if line.tooth is not None] or of), coverage)
        for place, of in by_place.items()
    )


def _as_far_as_seen(e: Expected, coverage: dict[str, float]) -> Expected:
    of_flanks = [share for name, share in coverage.items() if name == e.flank or (e.flank is None and name in FLANKS)]
    if e.status != "measured" or min(of_flanks, default=1.0) >= ENOUGH:
        return e
    return replace(e, status="partial", capable=False)


def _of_teeth(name: str, flank: str | None, section: str | None, lines: list[Characteristic]) -> Expected:
    """What the lines of a characteristic, a tooth each, come to: U of one, and what the worst leaves to be decided."""
    status = max((line.status for line in lines), key=ORDER.index)
    seen = status != "not_measurable"
    shares = [share for line in lines if seen and (share := share_of_room(line)) is not None]
    known = [(line.U, line.budget) for line in lines if seen and line.U is not None]
    U = [of_line for of_line, _ in known]
    _, budget = max(known, key=lambda line: line[0], default=(None, ()))
    return Expected(
        name, flank, section, float(np.sqrt(np.mean(np.square(U)))) if U else None,
        max(U) if len(U) > 1 else None, lines[0].limits, lines[0].size, max(shares, default=None), status,
        seen and all(line.capable for line in lines), budget[0].name if budget else None,
    )  # fmt: skip


def _unseen(search: Search, seen: Mask, why_not: str | None) -> tuple[str, ...]:
    """What no place can see, and what the views don't; ``why_not``: why there are none."""
    if not search.candidates:
        return (_no_place(search),)
    surfaces, texts = search.target.surfaces, []
    by_any = np.logical_or.reduce([c.seen for c in search.candidates])
    for k, name in enumerate(surfaces.names):
        own = surfaces.of == k
        never = own & ~by_any
        if never.sum() > HIDDEN * own.sum():
            why = CAUSES[int(search.hidden[:, never].sum(axis=1).argmax())]
            texts.append(f"{_called(name)}: no place sees {100 * never.sum() / own.sum():.0f} % of it, {why}")
        elif why_not is None and (missed := own & ~seen).sum() > (1.0 - ENOUGH) * own.sum():
            texts.append(f"{_called(name)}: these views leave out {100 * missed.sum() / own.sum():.0f} % of it")
    if why_not is not None:
        texts.append(
            f"no place that sees the part lets the shaft be calibrated: {why_not or 'the housings would meet'}"
        )
    return tuple(texts)


def _called(name: str) -> str:
    return f"{name} flanks" if name in ("left", "right") else name


def _no_place(search: Search) -> str:
    """Why there is no place at all."""
    if search.hidden.any():
        why = CAUSES[int(search.hidden.sum(axis=1).argmax())]
        return f"no place sees anything of the part: {why}"
    if search.touching > search.blind:
        return (
            "no place: the sensor's housing would touch the part, the shaft or the table; check housing_mm, the range, "
            "and [plan] table_disc_mm, table_face_mm, clearance_mm and keep_out"
        )
    return (
        "no place shows enough of the shaft to calibrate; use a sensor with a longer range or a wider line, or a shaft "
        "that reaches farther beyond the part"
    )
