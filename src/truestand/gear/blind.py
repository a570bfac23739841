"""Points of the sensor that see nothing in a whole scan, and what of the flanks is not seen for want of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truestand.core.arrays import Array
from truestand.gear.flanks import Flanks, about_circle
from truestand.gear.views import GearView

NEAR_POINTS = 3
"""Points to either side of blind ones that say at which heights those look."""
FILLED = 0.5
"""Of the readings that a blind strip lacks on a flank: with fewer by other views it is not seen."""


@dataclass(frozen=True, slots=True)
class BlindStrip:
    """Points beside each other that see nothing, between others that see flanks."""

    first: int
    """Counted from 0."""
    number: int
    bottom: float
    """mm in C: height of the reading below,"""
    top: float
    """and of the one above."""

    @property
    def width(self) -> float:
        """mm of the face that it would have seen."""
        return (self.top - self.bottom) * self.number / (self.number + 1)


def blind_strips(view: GearView) -> tuple[BlindStrip, ...]:
    """The strips in which a view's sensor is blind, about the measuring circle."""
    flanks = about_circle(view.flanks)
    column = flanks.index % view.scan.x.shape[1]
    if not column.size:
        return ()
    live, found = np.flatnonzero(view.scan.live), []
    live = live[(live >= column.min()) & (live <= column.max())]
    for gap in np.flatnonzero(np.diff(live) > 1):
        before, behind = live[gap : gap + 2].tolist()
        near = (column >= before - NEAR_POINTS) & (column <= behind + NEAR_POINTS)
        if np.ptp(column[near]) > 0:
            height = np.poly1d(np.polyfit(column[near], flanks.height[near], 1))
            bottom, top = sorted((float(height(before)), float(height(behind))))
            found.append(BlindStrip(before + 1, behind - before - 1, bottom, top))
    return tuple(found)


def blind_of_helices(views: Sequence[GearView]) -> Array:
    """How much (2, teeth) mm of the helix' range, in one stretch, no view sees because its sensor is blind there."""
    flanks = [about_circle(view.flanks) for view in views]
    nominal = flanks[0].toothing.nominal
    (low, high), widest = nominal.helix_range, np.zeros(2 * nominal.gear.teeth)
    for k, view in enumerate(views):
        others = flanks[:k] + flanks[k + 1 :]
        for strip in blind_strips(view):
            share = max(min(strip.top, high) - max(strip.bottom, low), 0.0) / (strip.top - strip.bottom)
            inside = [f.select((f.height > strip.bottom) & (f.height < strip.top)) for f in others]
            shown = sum((_by_flank(f, widest.size) for f in inside), np.zeros(widest.size))
            lacking = _by_flank(flanks[k], widest.size) * (strip.width / nominal.gear.face_width)
            widest = np.maximum(widest, np.where(shown < FILLED * lacking, share * strip.width, 0.0))
    return widest.reshape(2, -1)


def _by_flank(flanks: Flanks, number: int) -> Array:
    """How many readings lie on each of so many flanks."""
    return np.bincount(flanks.flank, minlength=number).astype(np.float64)
