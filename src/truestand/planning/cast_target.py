"""Turned parts and parts with a CAD model, for which sensors are placed: imagined scans of them are inspected."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from truestand.core.errors import NotEnoughData
from truestand.core.inspection import Characteristic
from truestand.core.surface import apply_calibration
from truestand.parts.drawings import Cad, Turned
from truestand.parts.inspect import inspect
from truestand.parts.rays import solid_of
from truestand.parts.sections import MARGIN
from truestand.planning.imagined_scan import imagined_scan
from truestand.planning.obstacles import Body, Cast, Meshed, Round
from truestand.planning.optics import Optics
from truestand.planning.place import Place
from truestand.planning.target import ORDER, Surfaces, View, share_of_room

HEIGHTS = 15
"""Points of a section that must be seen."""
TRIANGLES = 800
"""Of a model that must be seen."""
MOST_PROFILES, FEW_PROFILES, FEW_POINTS = 1500, 300, 120
"""Profiles of an imagined scan a turn; profiles, and points of each, of one that only ranks places."""
MODEL = "model"
"""The name of a CAD part's surface."""


@dataclass(frozen=True)
class CastTarget:
    """A part on a shaft, and the bodies that its scan shows."""

    part: Turned | Cad
    part_bodies: tuple[Cast, ...]
    shaft: tuple[Round, ...]
    """What there is of the shaft beside the part."""
    base_radius: float
    """mm: of the shaft's base."""
    swept: tuple[Round, ...]
    eccentricity: float
    """mm: of the shaft."""
    turns: float
    """Of a scan."""
    profiles_per_turn: float
    known: dict[tuple[Place, Optics, int], tuple[Characteristic, ...]] = field(default_factory=dict, compare=False)
    """Lines of imagined scans, by place, sensor and profiles."""

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The part."""
        return self.part_bodies

    @cached_property
    def surfaces(self) -> Surfaces:
        """The sections of a turned part; triangles of a model."""
        return _sections(self.part) if isinstance(self.part, Turned) else _triangles(self.part_bodies[0])

    def lines(self, views: Sequence[View]) -> tuple[Characteristic, ...]:
        """The lines that an inspection would have: each by the view that tells it best."""
        per_turn = min(self.profiles_per_turn, MOST_PROFILES)
        return self._best(views, round(per_turn * self.turns))

    def rough_shares(self, views: Sequence[View]) -> dict[str, float]:
        """About how large U would be, as a share of what the limits leave, for the worst figure of each surface that
        views show.
        """
        worst: dict[str, float] = {}
        for line in self._best([_coarse(view) for view in views], FEW_PROFILES):
            if line.status != "not_measurable":
                name = line.section or MODEL
                worst[name] = max(worst.get(name, 0.0), share_of_room(line) or 0.0)
        return worst

    def _best(self, views: Sequence[View], profiles: int) -> tuple[Characteristic, ...]:
        best, *others = [self._inspected(view, profiles) for view in views]
        for other in others:
            best = tuple(min(pair, key=_rank) for pair in zip(best, other, strict=True))
        return best

    def _inspected(self, view: View, profiles: int) -> tuple[Characteristic, ...]:
        key = view.mount.place, view.mount.sensor.optics, profiles
        if key not in self.known:
            self.known[key] = self._lines_of(view, profiles)
        return self.known[key]

    def _lines_of(self, view: View, profiles: int) -> tuple[Characteristic, ...]:
        bodies, stand, base = (*self.part_bodies, *self.shaft), view.scan.stand, self.base_radius
        place, optics = view.mount.place, view.mount.sensor.optics
        scan = imagined_scan(bodies, place, base, optics, stand, self.eccentricity, self.turns, profiles)
        return inspect(apply_calibration(scan, view.calibration), self.part).characteristics


def turned_target(
    part: Turned, shaft: tuple[Round, ...], eccentricity: float, turns: float, profiles_per_turn: float
) -> CastTarget:
    """A turned part as drawn. Where it is the shaft itself that is inspected, its sections take the place of its
    cylinders.
    """
    bodies = tuple(Round(s.diameter / 2, s.bottom, s.top) for s in part.sections)
    return CastTarget(
        part, bodies, _beside(shaft, bodies), shaft[0].radius, bodies, eccentricity, turns, profiles_per_turn
    )


def cad_target(
    part: Cad, shaft: tuple[Round, ...], eccentricity: float, turns: float, profiles_per_turn: float
) -> CastTarget:
    """A part with a CAD model, where its recipe places it.

    Raises:
        NotEnoughData: a model without surface.
    """
    solid = solid_of(part.mesh, part.pose)
    swept = (Round(solid.outer, float(solid.low[2]), float(solid.high[2])),)
    return CastTarget(part, (Meshed(solid),), shaft, shaft[0].radius, swept, eccentricity, turns, profiles_per_turn)


def _beside(shaft: tuple[Round, ...], sections: tuple[Round, ...]) -> tuple[Round, ...]:
    """The stretches of a shaft's cylinders where there is no section."""
    left = list(shaft)
    for section in sections:
        cut = [(c, (c.bottom, min(c.top, section.bottom)), (max(c.bottom, section.top), c.top)) for c in left]
        left = [Round(c.radius, low, high) for c, *ends in cut for low, high in ends if high > low]
    return tuple(left)


def _coarse(view: View) -> View:
    """The view with a sensor of few points."""
    sensor = view.mount.sensor
    coarse = replace(sensor, optics=replace(sensor.optics, points=FEW_POINTS))
    return replace(view, mount=replace(view.mount, sensor=coarse))


def _rank(line: Characteristic) -> tuple[int, float]:
    return ORDER.index(line.status), line.U if line.U is not None else np.inf


def _sections(part: Turned) -> Surfaces:
    points, of = [], []
    for k, s in enumerate(part.sections):
        margin = min(MARGIN, (s.top - s.bottom) / 4)
        points += [(s.diameter / 2, 0.0, h) for h in np.linspace(s.bottom + margin, s.top - margin, HEIGHTS)]
        of += [k] * HEIGHTS
    normals = np.tile([1.0, 0.0, 0.0], (len(points), 1))
    return Surfaces(tuple(s.name for s in part.sections), np.array(points), normals, np.array(of))


def _triangles(body: Cast) -> Surfaces:
    """Triangles of a model, picked by their area."""
    if not isinstance(body, Meshed):
        raise NotEnoughData("found no model; a part with kind = cad needs one")
    solid = body.solid
    reach = np.cumsum(solid.area)
    picked = np.unique(np.searchsorted(reach, np.linspace(0.0, reach[-1], TRIANGLES, endpoint=False)))
    return Surfaces((MODEL,), solid.corners[picked].mean(axis=1), solid.normal[picked], np.zeros(picked.size, np.intp))
