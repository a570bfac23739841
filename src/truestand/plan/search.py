"""The search for places: what many show of a part, then how well it would be measured from the best of them.

Sight is cheap and decides first: a place from which a surface can't be seen is none. Among places that show as much
the uncertainty decides, told roughly: the sensors in those that are left are calibrated.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from math import radians

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.errors import NotEnoughData
from truestand.plan.obstacles import Round
from truestand.plan.optics import Optics
from truestand.plan.place import Place
from truestand.plan.room import Room, apart, clearance
from truestand.plan.sight import CAUSES, look
from truestand.plan.target import Post, Target, View
from truestand.plan.views import Setting, loosely_joined, shaft_in_view, uncalibrated, views_at

ANGLES = np.radians(np.arange(35.0, 146.0, 7.5))
"""Between axis and sensor, either way round about its z where the camera makes a difference."""
STANDOFFS, HEIGHTS, OFFSETS = 6, 6, (0.0, -0.15, 0.15, -0.3, 0.3)
"""Places tried along the range, and along the part; plane offsets, in radii of the thinnest cylinder of the shaft."""
RANGE_MARGIN = 2.0
"""mm of range at either end that places leave."""
BEYOND = 10.0
"""mm above and below the surfaces at which the laser's middle may meet the shaft."""
LEAST_SHAFT = 2.5
"""mm of each of two cylinders that must be seen to calibrate."""
ENOUGH = 0.97
"""Coverage of a surface from which more of it makes nothing better."""
AS_GOOD = 0.01
"""Of missing coverage, within which places count as equal."""
POOL, MOST_GROUPS = 36, 120
"""Places that are calibrated, and sets of them that are compared."""
AZIMUTHS = np.radians([120.0, 150.0, 90.0, 180.0, 60.0, 210.0, 240.0, 270.0, 300.0, 30.0, 330.0])
"""Of a further sensor against the first, in the order of preference."""
NEXT = ((radians(3.0), 0.0, 0.0, 0.0), (0.0, 4.0, 0.0, 0.0), (0.0, 0.0, 3.0, 0.0), (0.0, 0.0, 0.0, 0.3))
"""Steps by which a place is made better: angle, stand-off, height, plane offset."""

Step = Callable[[float], None]
"""Told the share 0..1 of the work that is done."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A place, and what it shows."""

    post: Post
    seen: Mask
    """(n,) of the surfaces' points."""
    facing: float
    """Mean cosine of the incidence on what is seen."""


@dataclass(frozen=True, slots=True)
class Field:
    """All places that a sensor can take, and what none of them shows."""

    setting: Setting
    target: Target
    room: Room
    candidates: tuple[Candidate, ...]
    why_not: tuple[Mask, ...]
    """(n,) each: points that are hidden from all places by this one of ``CAUSES`` at least."""

    def missing(self, seen: Mask) -> float:
        """How much of the surfaces is missing, up to what is enough of each."""
        return sum(max(ENOUGH - share, 0.0) for share in self.target.surfaces.coverage(seen).values())


def field_of(setting: Setting, target: Target, room: Room, optics: Optics, device: str, step: Step) -> Field:
    """The places of a device from which the shaft can be calibrated and nothing touches its housing."""
    swept = (*setting.shaft, *target.swept, *_table(setting, room))
    surfaces, bodies = target.surfaces, (*target.bodies, *setting.shaft)
    base, found = setting.artefact.base.radius, []
    causes = [np.ones(len(surfaces.points), dtype=bool) for _ in CAUSES]
    places = list(_places(setting, target, optics))
    for k, place in enumerate(places):
        step(k / len(places))
        gap = clearance(place, base, optics, swept, room)
        view = uncalibrated(place, setting)
        if gap < room.least_clearance or not _shows_shaft(shaft_in_view(view, optics, setting)):
            continue
        sight = look(surfaces.points, surfaces.normals, view, optics, bodies)
        causes = [all_so_far & hidden for all_so_far, hidden in zip(causes, sight.hidden, strict=True)]
        if sight.seen.any():
            facing = float(sight.facing[sight.seen].mean())
            found.append(Candidate(Post(device, device, optics, place, gap), sight.seen, facing))
    return Field(setting, target, room, tuple(found), tuple(causes))


def best_views(field: Field, number: int, names: Sequence[tuple[str, str]], step: Step) -> tuple[View, ...]:
    """The places of so many views of these names and devices that show most, and measure best among those that show as
    much; empty: there are none.
    """
    groups = _groups(field, number)
    calibrated, ranked = _Calibrated(field, {}), []
    for k, group in enumerate(groups):
        step(k / len(groups))
        posts = _arranged(field, [field.candidates[i].post for i in group], names)
        if posts is not None and (worst := calibrated.worst(posts)) is not None:
            ranked.append((worst, posts))
    if not ranked:
        return ()
    _, posts = min(ranked, key=lambda pair: pair[0])
    return views_at(_improved(field, posts, calibrated), field.setting, field.target)


@dataclass
class _Calibrated:
    """Single views, each calibrated once."""

    field: Field
    views: dict[Post, View | None]

    def worst(self, posts: Sequence[Post]) -> tuple[int, float] | None:
        """Surfaces that views don't measure, and about how large U is on the others; None: no calibration."""
        field, views = self.field, [self._view(post) for post in posts]
        known = [view for view in views if view is not None]
        if len(known) < len(views):
            return None
        shares = field.target.rough_shares(loosely_joined(known))
        return len(field.target.surfaces.names) - len(shares), max(shares.values(), default=0.0)

    def _view(self, post: Post) -> View | None:
        if post not in self.views:
            try:
                (self.views[post],) = views_at([post], self.field.setting, self.field.target)
            except NotEnoughData:
                self.views[post] = None
        return self.views[post]


def _seen_from(field: Field, post: Post) -> Mask:
    surfaces, bodies = field.target.surfaces, (*field.target.bodies, *field.setting.shaft)
    return look(surfaces.points, surfaces.normals, uncalibrated(post.place, field.setting), post.optics, bodies).seen


def _places(setting: Setting, target: Target, optics: Optics) -> Iterator[Place]:
    heights = target.surfaces.points[:, 2]
    thinnest = min(body.radius for body in setting.shaft[:2])
    (near, far), signs = optics.range, (-1.0, 1.0) if optics.triangulation else (-1.0,)
    along = np.linspace(heights.min() - BEYOND, heights.max() + BEYOND, HEIGHTS)
    for sign, angle, standoff, height, offset in product(
        signs, ANGLES, np.linspace(near + RANGE_MARGIN, far - RANGE_MARGIN, STANDOFFS), along, OFFSETS
    ):
        yield Place(float(sign * angle), float(standoff), float(height), float(offset * thinnest))


def _table(setting: Setting, room: Room) -> tuple[Round, ...]:
    face = setting.shaft[0].bottom if room.table_face is None else room.table_face
    return (Round(room.table_radius, -1e9, face),)


def _shows_shaft(seen: tuple[float, ...]) -> bool:
    """Whether as much of the shaft is in view as a calibration needs: of two cylinders, if it has two."""
    needed = min(2, len(seen))
    return sum(length >= LEAST_SHAFT for length in seen) >= needed


def _groups(field: Field, number: int) -> list[tuple[int, ...]]:
    """Sets of so many candidates that show as much together as any do."""
    if not field.candidates:
        return []
    seen = np.array([c.seen for c in field.candidates])
    groups = _grown(field, seen, _pool(field, seen), number)
    missing = np.array([field.missing(np.logical_or.reduce(seen[list(g)])) for g in groups])
    as_good = np.flatnonzero(missing <= missing.min() + AS_GOOD)
    return [groups[k] for k in as_good[:: max(1, as_good.size // MOST_GROUPS)]]


def _pool(field: Field, seen: Array) -> list[int]:
    """Candidates that show most of one surface, or of all together: some of each, seen squarely or not."""
    surfaces, facing = field.target.surfaces, np.array([c.facing for c in field.candidates])
    shown = np.minimum([list(surfaces.coverage(s).values()) for s in seen], ENOUGH)
    picked: list[int] = []
    for score in (shown.sum(axis=1), *shown.T):
        as_good = np.flatnonzero(score >= score.max() - AS_GOOD)
        order = as_good[np.argsort(-facing[as_good])]
        picked += order[np.linspace(0, order.size - 1, POOL // (len(surfaces.names) + 1)).astype(np.intp)].tolist()
    return list(dict.fromkeys(picked))


def _grown(field: Field, seen: Array, pool: Sequence[int], number: int) -> list[tuple[int, ...]]:
    """Sets of so many: all pairs, and those that show most with one more."""
    groups: list[tuple[int, ...]] = list(combinations(pool, min(number, 2)))
    for _ in range(number - 2):
        missing = [field.missing(np.logical_or.reduce(seen[list(g)])) for g in groups]
        best = np.argsort(missing)[:POOL]
        groups = list({tuple(sorted((*groups[k], i))) for k in best for i in pool if i not in groups[k]})
    return groups


def _arranged(field: Field, posts: Sequence[Post], names: Sequence[tuple[str, str]]) -> tuple[Post, ...] | None:
    """The views with their names and devices, about the table so that their housings don't meet; None: they do."""
    base, room = field.setting.artefact.base.radius, field.room
    swept = (*field.setting.shaft, *field.target.swept, *_table(field.setting, room))
    placed: list[Post] = []
    for post, (name, device) in zip(posts, names, strict=True):
        for azimuth in (0.0, *AZIMUTHS) if not placed else (*AZIMUTHS, 0.0):
            place = replace(post.place, azimuth=float(azimuth))
            gaps = [clearance(place, base, post.optics, swept, room)]
            gaps += [apart(place, p.place, base, (post.optics, p.optics)) for p in placed if p.device != device]
            if min(gaps) >= room.least_clearance:
                placed.append(Post(name, device, post.optics, place, min(gaps)))
                break
        else:
            return None
    return tuple(placed)


def _improved(field: Field, posts: tuple[Post, ...], calibrated: _Calibrated) -> tuple[Post, ...]:
    """The same views, each moved by a step where that measures better and shows as much."""
    worst, missing = calibrated.worst(posts), _missing_of(field, posts)
    for k, (by, sign) in product(range(len(posts)), product(NEXT, (1.0, -1.0))):
        place = posts[k].place
        moved = replace(
            place, phi=place.phi + sign * by[0], standoff=place.standoff + sign * by[1],
            height=place.height + sign * by[2], plane_offset=place.plane_offset + sign * by[3],
        )  # fmt: skip
        tried = _with_gap(field, (*posts[:k], replace(posts[k], place=moved), *posts[k + 1 :]))
        if tried is None or _missing_of(field, tried) > missing + AS_GOOD / 2:
            continue
        found = calibrated.worst(tried)
        if found is not None and worst is not None and found < worst:
            posts, worst = tried, found
    return posts


def _with_gap(field: Field, posts: tuple[Post, ...]) -> tuple[Post, ...] | None:
    """The views with their clearance; None where it is too small."""
    base, room = field.setting.artefact.base.radius, field.room
    swept = (*field.setting.shaft, *field.target.swept, *_table(field.setting, room))
    found = []
    for post in posts:
        gaps = [clearance(post.place, base, post.optics, swept, room)]
        gaps += [apart(post.place, p.place, base, (post.optics, p.optics)) for p in posts if p.device != post.device]
        found.append(replace(post, clearance=min(gaps)))
    return tuple(found) if all(p.clearance >= room.least_clearance for p in found) else None


def _missing_of(field: Field, posts: Sequence[Post]) -> float:
    return field.missing(np.logical_or.reduce([_seen_from(field, post) for post in posts]))
