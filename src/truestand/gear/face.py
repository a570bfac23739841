"""Whether the toothing ends where the drawing's does: at the ends of its face, at its tip and at its root.

Figures of another stretch than the drawing's are right and mislead all the same: what lies beyond is never looked at.
"""

from dataclasses import dataclass, replace

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.message import Message
from truestand.core.robust import nan_median
from truestand.core.surface import Surface
from truestand.gear.flanks import MATCH, SEARCH_POINTS, Toothing, assign, blocks, near_measuring_circle, toothed_zone
from truestand.gear.match import root_and_tip
from truestand.gear.teeth import FoldedMap

BEYOND = 2.0
"""mm beyond the drawing's face that are looked at."""
BIN = 0.2
"""mm of height."""
REACHED = 0.3
"""Share of the usual number of points from which a height has flanks, or other material."""
OTHER_FACE = 0.6
"""mm by which the toothing may end elsewhere than the drawing's face: seats, chamfers and tolerances do that."""
OTHER_RADIUS = 0.25
"""Modules by which tips may end elsewhere than the drawing's, and roots lie deeper."""
END_FACE = 0.3
"""mm beyond the flanks in which the end face itself may show."""
FAN_EDGE = 0.02
"""Share of a profile's points at either end on which a face that is out of view leaves the sensor's fan."""


def other_face(surface: Surface, toothing: Toothing, height_U: float) -> tuple[Message, ...]:
    """Why the drawing's face is not the part's; empty where it is, or where the sensor doesn't see its ends.

    ``height_U``: mm by which all heights may be off.
    """
    g = toothing.nominal.gear
    heights = _heights(surface, toothing)
    if heights is None:
        return ()
    bottom, top = heights.ends
    off = np.array([bottom - g.face_from, top - g.face_to])
    in_view = [heights.ends_at(bottom, g.face_from), heights.ends_at(top, g.face_to)]
    off = np.where(in_view | (off * [-1.0, 1.0] > 0), off, 0.0)
    if np.abs(off - np.clip(off.mean(), -height_U, height_U)).max() < OTHER_FACE:
        return ()
    lower = "" if bottom > g.face_from - BEYOND + BIN else " or lower"
    upper = "" if top < g.face_to + BEYOND - BIN else " or higher"
    text = (
        f"the toothing reaches from height {bottom:.1f} mm{lower} to {top:.1f} mm{upper}, the drawing's face is "
        f"{g.face_from:g} to {g.face_to:g} mm: check face_from_mm and face_width_mm, and that the part sits on its seat"
    )
    return (Message("other_face", text),)


def other_diameters(folded: FoldedMap, surface: Surface, toothing: Toothing) -> tuple[Message, ...]:
    """Why tip or root are not the drawing's, on which the profiles' ranges rest; empty where they are."""
    nominal, g = toothing.nominal, toothing.nominal.gear
    radius = float(nan_median(folded.tip_radius(nominal)[None], 1)[0])
    if abs(radius - g.tip_diameter / 2) > OTHER_RADIUS * g.module:
        text = (
            f"tips reach to diameter {2 * radius:.2f} mm, the drawing's are {g.tip_diameter:g} mm: check "
            "tip_diameter_mm"
        )
        return (Message("other_tip", text),)
    thin = max(1, int(surface.x.size / (20 * SEARCH_POINTS)))
    low, high = g.root_diameter / 4, g.tip_diameter / 2
    zones = (toothed_zone(surface, nominal, toothing.datum, rows, low, high, thin) for rows in blocks(surface))
    seen = np.concatenate([zone.radius for zone in zones])
    root = root_and_tip(seen)[0] if seen.size else low
    if root < g.root_diameter / 2 - OTHER_RADIUS * g.module:
        text = (
            f"roots lie at diameter {2 * root:.2f} mm, the drawing's at {g.root_diameter:g} mm: check root_diameter_mm"
        )
        return (Message("other_root", text),)
    return ()


@dataclass(frozen=True, slots=True)
class _Heights:
    """Points near the measuring circle over the height, (bins,)."""

    at: Array
    """mm, C."""
    toothed: Mask
    """Heights that have flanks,"""
    filled: Mask
    """and such that have material there, flanks or none."""
    in_fan: Mask
    """Heights whose points don't lie at the end of the sensor's fan."""

    @property
    def ends(self) -> tuple[float, float]:
        """Heights (mm) between which there are flanks."""
        heights = self.at[self.toothed]
        return float(heights[0] - BIN / 2), float(heights[-1] + BIN / 2)

    def ends_at(self, end: float, drawn: float) -> bool:
        """Whether the flanks end before the ``drawn`` end of the face, in the sensor's view and not at a chamfer."""
        low, high = sorted((end, drawn))
        between = (self.at > low) & (self.at < high) & (np.abs(self.at - end) > END_FACE)
        last = int(np.abs(self.at - end).argmin())
        return bool(self.in_fan[last]) and not self.filled[between].any()


def _heights(surface: Surface, toothing: Toothing) -> _Heights | None:
    """What stands near the measuring circle, on the drawing's face and beside it; None where flanks show nowhere."""
    nominal, g, columns = toothing.nominal, toothing.nominal.gear, surface.x.shape[1]
    wide = replace(g, face_from=g.face_from - BEYOND, face_width=g.face_width + 2 * BEYOND)
    points = near_measuring_circle(surface, replace(nominal, gear=wide), toothing.datum)
    flank, delta = assign(points, nominal, toothing.first_tooth)
    on = np.abs(delta - toothing.offsets[flank]) < MATCH * g.module
    edges = np.linspace(wide.face_from, wide.face_to, round(wide.face_width / BIN) + 1)
    everything, flanks = (np.histogram(h, edges)[0] for h in (points.height, points.height[on]))
    if not flanks.any():
        return None
    usual_flanks, usual = (float(np.median(n[flanks > 0])) for n in (flanks, everything))
    toothed = (flanks > REACHED * usual_flanks) & (flanks > REACHED * everything)  # a shoulder has some on flanks, too
    column = points.index % columns
    at_edge = np.minimum(column, columns - 1 - column) < FAN_EDGE * columns
    leaving = np.histogram(points.height[at_edge], edges)[0]
    return _Heights((edges[1:] + edges[:-1]) / 2, toothed, everything > REACHED * usual, leaving == 0)
