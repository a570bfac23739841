"""The search for places: what many show of a part, then how well it would be measured from the best of them.

Sight is cheap and decides first: a place from which a surface can't be seen is none. Among places that show as much
the uncertainty decides, told roughly: the sensors in those that are left are calibrated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, islice
from math import ceil

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.calibration import Calibration
from truestand.core.errors import NotEnoughData
from truestand.planning.corridor import Corridors
from truestand.planning.kinematics import Position
from truestand.planning.obstacles import Round
from truestand.planning.optics import Optics
from truestand.planning.place import Place
from truestand.planning.places import beside, places_for, rounded
from truestand.planning.room import Room, apart, clearance, in_room
from truestand.planning.sight import CAUSES, Sight, centred, look
from truestand.planning.target import Mount, PlannedSensor, Target, View
from truestand.planning.views import Setting, loosely_joined, shaft_in_view, shows_shaft, uncalibrated, views_at

ENOUGH, ENOUGH_ASIDE = 0.97, 0.85
"""Coverage of a surface from which more of it makes nothing better; where run-out brings it aside, a line is measured
from 0.9 of its flank on, of whose points a row is a ninth.
"""
RUN_OUT, RUNNING_TRUE = (0.0, -1.0, 1.0), 0
"""Of the eccentricity, ways aside for which it is looked from a place, and which of them is none: a shaft that runs
true.
"""
AS_GOOD = 0.01
"""Of missing coverage, within which places count as equal."""
POOL, MOST_GROUPS, MOST_JOINT, MOST_ROUNDS = 36, 120, 4, 5
"""Places that are calibrated, sets of them that are compared, how many of the best are calibrated together, and how
often others are looked at where none can be.
"""
AZIMUTHS = np.radians([120.0, 150.0, 90.0, 180.0, 60.0, 210.0, 240.0, 270.0, 300.0, 30.0, 330.0])
"""Of a further sensor against the first, in the order of preference."""
KnownViews = dict[tuple[Place, PlannedSensor], View | str]
"""What places were found to be, by place and kind of sensor: views, or why the shaft can't be calibrated there."""
Step = Callable[[float], None]
"""Told the share 0..1 of the work that is done."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A place, and what it shows."""

    place: Place
    optics: Optics
    position: Position | None
    """Of the positioner that brings a sensor there; None: it stands there."""
    clearance: float
    """mm."""
    all_round: Mask
    """(``RUN_OUT``, n): the surfaces' points that are seen,"""
    facing: float
    """and the mean cosine of the incidence on them, of a shaft that runs true."""

    @property
    def seen(self) -> Mask:
        """(n,) of a shaft that runs true."""
        return np.asarray(self.all_round[RUNNING_TRUE])


@dataclass(frozen=True, slots=True)
class ComparedPlaces:
    """A set of places, and how well it would measure."""

    places: tuple[Place, ...]
    missing: int
    """Surfaces that it doesn't show."""
    share: float
    """About how large U is on the others, as a share of what the limits leave."""


@dataclass(frozen=True, slots=True)
class Search:
    """All places that sensors can take."""

    setting: Setting
    target: Target
    room: Room
    candidates: tuple[Candidate, ...]
    hidden: Array
    """(``CAUSES``, n): from how many of them each point of the surfaces is hidden by each."""
    touching: int
    """Places left out because the housing would touch something,"""
    blind: int
    """and because too little of the shaft is in view there."""

    def missing(self, seen: Mask) -> float:
        """How much of all surfaces is missing in what is ``seen`` (``RUN_OUT``, n)."""
        return float(self.missing_of_each(seen).sum())

    def missing_of_each(self, seen: Mask) -> Array:
        """How much (surfaces,) of each is missing in what is ``seen`` (``RUN_OUT``, n), up to what is enough of it."""
        enough = np.where(np.arange(len(RUN_OUT)) == RUNNING_TRUE, ENOUGH, ENOUGH_ASIDE)[:, None]
        shares = np.array([list(self.target.surfaces.coverage(s).values()) for s in seen])
        return np.asarray(np.maximum(enough - shares, 0.0).sum(axis=0))

    @property
    def turning(self) -> tuple[Round, ...]:
        """All that turns above the table."""
        bodies, travel = (*self.setting.shaft, *self.target.swept), self.setting.eccentricity
        return tuple(replace(body, radius=body.radius + travel) for body in bodies)

    @property
    def swept(self) -> tuple[Round, ...]:
        """The same, and the table."""
        setting, room = self.setting, self.room
        face = setting.shaft[0].bottom if room.table_face is None else room.table_face
        return (*self.turning, Round(room.table_radius, -1e9, face))

    def gap(self, mount: Mount, others: Sequence[Mount] = (), enough: float = np.inf) -> float:
        """mm (more than ``enough`` roughly) between a housing and all else: the other views' housings as well, be they
        of the same device, unless a positioner carries both.
        """
        base, size = self.setting.artefact.base.radius, mount.sensor.optics.housing
        pose = in_room(mount.place, base)
        gaps = [clearance(pose, size, self.swept, self.room, self.room.least_clearance, enough)]
        for other in others:
            if not (mount.sensor.carried and other.sensor.carried):
                gaps.append(apart(mount.place, other.place, base, (size, other.sensor.optics.housing)))
        return min(gaps)

    def barred(self, mounts: Sequence[Mount]) -> str:
        """Why the positioner can't go to all places of some views; empty: it can, or isn't needed."""
        carrier, carried = self.setting.carrier, [mount for mount in mounts if mount.position is not None]
        if carrier is None or not carried:
            return ""
        size, positions = carried[0].sensor.optics.housing, [m.position for m in carried if m.position is not None]
        return carrier.barred(Corridors(carrier.kinematics, size, self.swept, self.room), positions)

    def seen_from(self, mount: Mount) -> Mask:
        """The points (``RUN_OUT``, n) that a view shows."""
        return _seen(self.sights(uncalibrated(mount.place, self.setting), mount.sensor.optics))

    def sights(self, view: Calibration, optics: Optics) -> list[Sight]:
        """What a view surely sees of the surfaces, at each of ``RUN_OUT``."""
        surfaces, bodies, optics = self.target.surfaces, (*self.target.bodies, *self.target.shaft), optics.tightened
        views = [centred(view, share * self.setting.eccentricity) for share in RUN_OUT]
        return [look(surfaces.points, surfaces.normals, aside, optics, bodies) for aside in views]


def search_of(setting: Setting, target: Target, room: Room, sensors: Sequence[PlannedSensor], step: Step) -> Search:
    """The places from which the shaft can be calibrated and nothing touches the housing of a sensor; of those that a
    positioner carries, the places that it reaches.
    """
    search = Search(setting, target, room, (), np.zeros((len(CAUSES), len(target.surfaces.points))), 0, 0)
    found, hidden, touching, blind = [], search.hidden.copy(), 0, 0
    kinds = dict.fromkeys((sensor.optics, sensor.carried) for sensor in sensors)
    places = [(own, *where) for own, carried in kinds for where in places_for(own, carried, setting, target)]
    for k, (own, place, position) in enumerate(places):
        step(k / len(places))
        view, mount = uncalibrated(place, setting), Mount(PlannedSensor("", "", own), place, 0.0)
        gap = search.gap(mount, enough=room.least_clearance)
        if gap < room.least_clearance:
            touching += 1
        elif not shows_shaft(shaft_in_view(view, own.tightened, setting.shaft), setting.shaft):
            blind += 1
        else:
            sights = search.sights(view, own)
            true = sights[RUNNING_TRUE]
            hidden += true.hidden
            if true.seen.any():
                facing = float(true.facing[true.seen].mean())
                found.append(Candidate(place, own, position, gap, _seen(sights), facing))
    return replace(search, candidates=tuple(found), hidden=hidden, touching=touching, blind=blind)


def _seen(sights: Sequence[Sight]) -> Mask:
    return np.stack([sight.seen for sight in sights])


@dataclass(frozen=True, slots=True)
class Choice:
    """The places of some sensors."""

    views: tuple[View, ...]
    """Empty: there are none."""
    tried: tuple[ComparedPlaces, ...]
    """Sets of places that were compared."""
    why_not: str
    """Why there is none; empty where it is not known."""


def best_views(search: Search, sensors: Sequence[PlannedSensor], known: KnownViews, step: Step) -> Choice:
    """The places of these sensors that show most, and measure best among those that show as much; ``known`` grows by
    what is calibrated.
    """
    calibrated, rounds = _Calibrated(search, known), 0
    ranked: list[tuple[tuple[int, float], tuple[Mount, ...]]] = []
    tried: list[ComparedPlaces] = []
    while not ranked and rounds < MOST_ROUNDS and (groups := _groups(search, len(sensors))):
        rounds += 1
        for k, group in enumerate(groups):
            step(k / len(groups))
            mounts = _arranged(search, [search.candidates[i] for i in group], sensors)
            if mounts is not None and (worst := calibrated.worst(mounts)) is not None:
                ranked.append((worst, mounts))
                tried.append(ComparedPlaces(tuple(mount.place for mount in mounts), *worst))
        search = _without(search, {i for group in groups for i in group})
    best = sorted(ranked, key=lambda pair: pair[0])
    for mounts in islice((mounts for _, mounts in best if not calibrated.barred(mounts)), MOST_JOINT):
        improved = _improved(search, mounts, calibrated)
        as_people_would = tuple(rounded(mount, search.setting) for mount in improved)
        for candidate in (_with_gaps(search, as_people_would) or improved, mounts):
            if calibrated.barred(candidate):
                continue
            try:
                return Choice(views_at(candidate, search.setting, search.target), tuple(tried), "")
            except NotEnoughData as error:
                calibrated.why_not.append(str(error))
    return Choice((), tuple(tried), max(calibrated.why_not, key=calibrated.why_not.count, default=""))


def _without(search: Search, places: set[int]) -> Search:
    """The search without some of its candidates."""
    return replace(search, candidates=tuple(c for k, c in enumerate(search.candidates) if k not in places))


@dataclass
class _Calibrated:
    """Single views, each calibrated once, whichever of some like sensors is there."""

    search: Search
    known: KnownViews
    why_not: list[str] = field(default_factory=list)
    """Why the shaft can't be calibrated in some places."""

    def barred(self, mounts: Sequence[Mount]) -> bool:
        """Whether the positioner can't go to all of some places."""
        if why := self.search.barred(mounts):
            self.why_not.append(why)
        return bool(why)

    def worst(self, mounts: Sequence[Mount]) -> tuple[int, float] | None:
        """Surfaces that views don't measure, and about how large U is on the others; None: no calibration."""
        search, views = self.search, [self._view(mount) for mount in mounts]
        known = [view for view in views if view is not None]
        if len(known) < len(views):
            return None
        shares = search.target.rough_shares(loosely_joined(known))
        return len(search.target.surfaces.names) - len(shares), max(shares.values(), default=0.0)

    def _view(self, mount: Mount) -> View | None:
        search, place = self.search, replace(mount.place, azimuth=0.0)
        key = place, replace(mount.sensor, name="", device="")
        if key not in self.known:
            try:
                (self.known[key],) = views_at([replace(mount, place=place)], search.setting, search.target)
            except NotEnoughData as error:
                self.known[key] = str(error)
        view = self.known[key]
        if isinstance(view, View):
            return view.by(mount.sensor)
        self.why_not.append(view)
        return None


def _groups(search: Search, number: int) -> list[tuple[int, ...]]:
    """Sets of so many candidates that show as much together as any do."""
    if not search.candidates:
        return []
    seen = np.array([c.all_round for c in search.candidates])
    groups = _grown(search, seen, _pool(search, seen), number)
    if not groups:
        return []
    missing = np.array([search.missing(np.logical_or.reduce(seen[list(g)])) for g in groups])
    as_good = np.flatnonzero(missing <= missing.min() + AS_GOOD)
    return [groups[k] for k in as_good[:: ceil(as_good.size / MOST_GROUPS)]]


def _pool(search: Search, seen: Array) -> list[int]:
    """Candidates that show most of one surface, or of all together: some of each, seen squarely or not."""
    surfaces, facing = search.target.surfaces, np.array([c.facing for c in search.candidates])
    shown = -np.array([search.missing_of_each(s) for s in seen])
    picked: list[int] = []
    for score in (shown.sum(axis=1), *shown.T):
        as_good = np.flatnonzero(score >= score.max() - AS_GOOD)
        order = as_good[np.argsort(-facing[as_good])]
        picked += order[np.linspace(0, order.size - 1, POOL // (len(surfaces.names) + 1)).astype(np.intp)].tolist()
    return list(dict.fromkeys(picked))


def _grown(search: Search, seen: Array, pool: Sequence[int], number: int) -> list[tuple[int, ...]]:
    """Sets of so many: all pairs, and those that show most with one more."""
    groups: list[tuple[int, ...]] = list(combinations(pool, min(number, 2)))
    for _ in range(number - 2):
        missing = [search.missing(np.logical_or.reduce(seen[list(g)])) for g in groups]
        best = np.argsort(missing)[:POOL]
        groups = sorted({tuple(sorted((*groups[k], i))) for k in best for i in pool if i not in groups[k]})
    return groups


def _arranged(
    search: Search, candidates: Sequence[Candidate], sensors: Sequence[PlannedSensor]
) -> tuple[Mount, ...] | None:
    """The sensors in these places, about the table so that their housings don't meet; None: they do, or the places are
    not for these sensors.
    """
    placed: list[Mount] = []
    left = list(candidates)
    for sensor in sensors:
        own = next((c for c in left if c.optics == sensor.optics and (c.position is not None) == sensor.carried), None)
        if own is None:
            return None
        left.remove(own)
        free = (*AZIMUTHS, 0.0) if placed else (0.0, *AZIMUTHS)
        for azimuth in free if own.position is None else (own.place.azimuth,):
            mount = Mount(sensor, replace(own.place, azimuth=float(azimuth)), 0.0, own.position)
            if (gap := search.gap(mount, placed)) >= search.room.least_clearance:
                placed.append(replace(mount, clearance=gap))
                break
        else:
            return None
    return tuple(placed)


def _improved(search: Search, mounts: tuple[Mount, ...], calibrated: _Calibrated) -> tuple[Mount, ...]:
    """The same views, each moved by a step where that measures better and shows as much."""
    worst, missing = calibrated.worst(mounts), _missing_of(search, mounts)
    for k, moved in ((k, moved) for k, mount in enumerate(mounts) for moved in beside(mount, search.setting)):
        tried = _with_gaps(search, (*mounts[:k], moved, *mounts[k + 1 :]))
        if tried is None or _missing_of(search, tried) > missing + AS_GOOD / 2:
            continue
        found = calibrated.worst(tried)
        if found is not None and worst is not None and found < worst:
            mounts, worst = tried, found
    return mounts


def _with_gaps(search: Search, mounts: tuple[Mount, ...]) -> tuple[Mount, ...] | None:
    """The views with their clearance; None where it is too small."""
    found = tuple(replace(p, clearance=search.gap(p, [q for q in mounts if q is not p])) for p in mounts)
    return found if all(p.clearance >= search.room.least_clearance for p in found) else None


def _missing_of(search: Search, mounts: Sequence[Mount]) -> float:
    return search.missing(np.logical_or.reduce([search.seen_from(mount) for mount in mounts]))
