"""The views by which a gear is inspected: what each sensor saw of it, in one frame, and all of them as one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import numpy as np

from truestand.core.arrays import Array, Ints, Mask
from truestand.core.calibration import Calibration
from truestand.core.inspection import Characteristic
from truestand.core.scan import Scan
from truestand.core.surface import Surface, surface_of, table_angle
from truestand.gear.flanks import FlankPoints, Flanks, Toothing, find_flanks, lone_readings_on, without_readings
from truestand.gear.geometry import FLANKS

Points = TypeVar("Points", bound=FlankPoints)

LEAST_SHARE = 0.1
"""Of the points of a flank, from which a view counts as one that saw it: outliers are everywhere."""
MOST_LEFT = 2e-3
"""mm, rms: by so much passes may disagree without a word."""


@dataclass(frozen=True, slots=True)
class GearView:
    """A gear as one scan shows it, and what the scan says of the table's angle."""

    surface: Surface
    flanks: Flanks
    scan: Scan
    calibration: Calibration
    before_rms: float | None = None
    """mm: by how much the passes of a flank disagreed; None: the angle was measured, or nothing passed twice."""
    apart_rms: float | None = None
    """mm: the same of a scan whose angle was measured."""
    unrepeated: bool = False
    """Whether flanks that passed twice were mostly not found again where they passed before."""
    after_rms: float | None = None
    """mm: the same with the corrected angle."""
    explained: bool = True
    """Whether a drift and a few waves explained it: a free curve only says what differs from turn to turn."""
    side: int | None = None
    """The only side whose flanks count; None: both."""
    level: Array | None = None
    """(2, 5) mm: by how much it reads flanks more than the mean of all views does (``levelled``), which its delta is
    freed of.
    """
    steeper: Mask | None = None
    """(2,): sides whose root another view sees less steeply: near it, this one's rays need not show the flank."""
    fillet_reach: Array | None = None
    """(2,) mm: roll length up to which this one of several views may read the fillet on left and right flanks."""
    lone: Mask | None = None
    """(profiles * points,): readings of the scan on flanks that nothing bears out; None: not told yet."""

    @property
    def name(self) -> str:
        """Of the view."""
        return self.calibration.name

    @property
    def teeth(self) -> int:
        """Of the gear."""
        return self.flanks.toothing.nominal.gear.teeth

    @property
    def angle(self) -> Array:
        """Table angle (N,) rad in the sense in which it turns the part."""
        return self.calibration.sense * table_angle(self.scan, self.calibration)

    @property
    def uneven_rms(self) -> float | None:
        """By how much (mm) pitch may be wrong for it; None where that is too little to be named."""
        rms = self.after_rms if self.explained else self.before_rms
        return rms if rms is not None and rms > MOST_LEFT else None

    def rolled_up(self, surface: Surface, toothing: Toothing) -> Self:
        """The same scan, rolled up otherwise."""
        scan, calibration = surface.origin
        flanks = _of_side(find_flanks(surface, toothing), self.side)
        return replace(self, surface=surface, flanks=flanks, scan=scan, calibration=calibration)

    def with_lone_readings(self) -> Self:
        """The same, knowing which of its readings stand alone, wherever its flanks are moved from here on."""
        return replace(self, lone=self._lone_readings())

    def borne_out(self) -> Flanks:
        """Its flanks without readings that stand alone."""
        return without_readings(self.flanks, self._lone_readings() if self.lone is None else self.lone)

    def _lone_readings(self) -> Mask:
        return lone_readings_on(self.flanks, self.scan.live, self.angle)


def views_of(surfaces: Sequence[Surface], toothing: Toothing) -> tuple[GearView, ...]:
    """The flanks that each of several surfaces in one frame shows of a toothing."""
    return tuple(GearView(s, find_flanks(s, toothing), *s.origin) for s in surfaces)


def each_by_one_side(views: Sequence[GearView]) -> tuple[GearView, ...]:
    """The views with only the side of which they show most, before and after a part was turned over: nothing says how
    far the flanks of the other side, seen at a grazing angle, lie off those that the other scans show.
    """
    sides = {}
    for sense in {view.calibration.sense for view in views}:
        left = np.concatenate([v.flanks.flank < v.teeth for v in views if v.calibration.sense == sense])
        sides[sense] = int(np.mean(left) < 0.5) if left.size else None
    return tuple(
        replace(view, flanks=_of_side(view.flanks, side), side=side)
        for view, side in ((view, sides[view.calibration.sense]) for view in views)
    )


def _of_side(flanks: Flanks, side: int | None) -> Flanks:
    """The points on flanks of one side only; None: all of them."""
    if side is None:
        return flanks
    teeth = flanks.toothing.nominal.gear.teeth
    on, outside = ((points.flank >= teeth) == bool(side) for points in (flanks, flanks.outside_gate))
    return replace(flanks.select(on), outside_gate=flanks.outside_gate.select(outside))


def joined(flanks: Sequence[Flanks], views: Sequence[GearView]) -> Flanks:
    """The flanks of all views as one scan: its profiles are those of the views, one after the other (``stacked``)."""
    first, *others = (_in_stack(points, views, k) for k, points in enumerate(flanks))
    return replace(first.joined(others), outside_gate=first.outside_gate.joined([f.outside_gate for f in others]))


def part_of(flanks: Flanks, views: Sequence[GearView], k: int) -> Flanks:
    """What view ``k`` shows of the flanks of all, its profiles and readings numbered as in its own scan."""
    if len(views) == 1:
        return flanks
    first, points = _first_profile(views, k), views[k].scan.x.shape[1]
    own = flanks.select((flanks.profile >= first) & (flanks.profile < first + views[k].scan.profiles))
    column = own.index % _points(views)
    return replace(own, profile=own.profile - np.int32(first), index=(own.profile - first) * points + column)


def with_views(
    lines: tuple[Characteristic, ...], flanks: Flanks, views: Sequence[GearView]
) -> tuple[Characteristic, ...]:
    """The lines with the views that saw the flanks which they read; of one view, as they are."""
    if len({view.name for view in views}) == 1:
        return lines
    teeth = flanks.toothing.nominal.gear.teeth
    key = view_of(flanks, views) * 2 * teeth + flanks.flank
    count = np.bincount(key, minlength=len(views) * 2 * teeth).reshape(len(views), 2, teeth)
    seen = count > LEAST_SHARE * count.sum(axis=0)

    def names(line: Characteristic) -> tuple[str, ...]:
        sides = slice(None) if line.flank is None else FLANKS.index(line.flank)
        of_line = seen[:, sides] if line.tooth is None else seen[:, sides, line.tooth - 1]
        return tuple(dict.fromkeys(view.name for view, sees in zip(views, of_line, strict=True) if sees.any()))

    return tuple(replace(line, views=names(line)) for line in lines)


def view_of(flanks: FlankPoints, views: Sequence[GearView]) -> Ints:
    """Which view each point (n,) of the flanks of all is of."""
    return surface_of(flanks.profile, [view.surface for view in views])


def _in_stack(flanks: Flanks, views: Sequence[GearView], k: int) -> Flanks:
    if len(views) == 1:
        return flanks
    first, points, all_points = _first_profile(views, k), views[k].scan.x.shape[1], _points(views)

    def moved(of: Points) -> Points:
        profile = of.profile + np.int32(first)
        return replace(of, profile=profile, index=profile.astype(np.int64) * all_points + of.index % points)

    return replace(moved(flanks), outside_gate=moved(flanks.outside_gate))


def _first_profile(views: Sequence[GearView], k: int) -> int:
    """Where the profiles of view ``k`` begin among those of all."""
    return sum(view.scan.profiles for view in views[:k])


def _points(views: Sequence[GearView]) -> int:
    """Points of a profile of all: of the view that has most."""
    return max(int(view.scan.x.shape[1]) for view in views)
