"""All teeth cut open and laid side by side: tip and root, and what is wrong with a tooth as a whole.

The folded map is the median radius over place within the pitch and height, one map a tooth. It needs no flank, so it
also shows teeth that aren't there, corners that broke off, and burrs.
"""

from dataclasses import dataclass
from math import hypot

import numpy as np
from numpy.typing import NDArray

from truestand.core.calibration import Contribution
from truestand.core.frames import Pose
from truestand.core.robust import medians, robust_sd
from truestand.core.surface import Surface
from truestand.gear.evidence import FoldedMap
from truestand.gear.flanks import BLOCK, END_MARGIN, located
from truestand.gear.geometry import Involute
from truestand.gear.grid import centres_of

Array = NDArray[np.float64]

PLACES = 48
HEIGHT_CELL, COLUMNS = 0.5, 3.0
"""mm, and points of a profile that a cell must be high at least."""
THIN = 2
"""Every so many points of a profile make the map."""
STRAY = 0.25
"""Share of a tip's usual number of points at a height below which they are strays."""
REACH = 1.0
"""mm beyond tip and root that are looked at."""
TIP_PLACE = 0.6
"""Share of the tip's land about its middle that tells the tip diameter."""
GONE = 0.6
"""Share of the tooth's height, as drawn, that must be missing for the tooth to be missing."""
ROOT_PLACE = 0.46
"""Share of the pitch from the tooth's centre beyond which the root is told."""


@dataclass(frozen=True, slots=True)
class Ends:
    """A tip or root diameter, mm."""

    name: str
    diameter: float
    U: float
    coverage: float
    budget: tuple[Contribution, ...]


def fold(surface: Surface, nominal: Involute, datum: Pose, turned: float) -> FoldedMap:
    """The folded map of every tooth."""
    g = nominal.gear
    low, high = g.root_diameter / 2 - REACH, g.tip_diameter / 2 + REACH
    bottom, top = g.face_from + END_MARGIN, g.face_to - END_MARGIN
    places, heights, radii = [], [], []
    for first in range(0, surface.x.shape[0], BLOCK):
        block = slice(first, min(first + BLOCK, surface.x.shape[0]))
        p = located(surface, nominal, datum, block, low, high, THIN)
        turns = (p.angle - turned) / g.pitch
        tooth = np.rint(turns)
        place = np.clip(((turns - tooth + 0.5) * PLACES).astype(np.int64), 0, PLACES - 1)
        places.append((tooth.astype(np.int64) % g.teeth) * PLACES + place)
        heights.append(p.height)
        radii.append(p.radius)
    middle, span = (low + high) / 2, 1.01 * (high - low)
    height = np.concatenate(heights)
    apart = (top - bottom) * surface.x.shape[0] / max(height.size, 1)  # of the points of a profile
    rows = max(1, round((top - bottom) / max(HEIGHT_CELL, COLUMNS * apart)))
    row = np.clip(((height - bottom) / (top - bottom) * rows).astype(np.int64), 0, rows - 1)
    radius, count = medians(
        np.concatenate(places) * rows + row, np.concatenate(radii) - middle, g.teeth * PLACES * rows, span
    )
    shape = g.teeth, PLACES, rows
    told = FoldedMap((radius + middle).reshape(shape), centres_of(-0.5, 0.5, PLACES), centres_of(bottom, top, rows))
    told.radius[:, tip_places(told, nominal)] = _without_strays(told, count.reshape(shape), nominal)
    return told


def _without_strays(folded: FoldedMap, count: NDArray[np.int64], nominal: Involute) -> Array:
    """The tips' lands, NaN at heights with far fewer points than usual: strays where no point of a profile falls."""
    tip = tip_places(folded, nominal)
    points = count[:, tip].sum(axis=1, keepdims=True)
    usual = float(np.median(points[points > 0])) if points.any() else 0.0
    return np.where(points < STRAY * usual, np.nan, folded.radius[:, tip])


def tip_places(folded: FoldedMap, nominal: Involute) -> NDArray[np.bool_]:
    """Places that lie on the tip's land."""
    half = float(nominal.half_angle(np.asarray(nominal.gear.tip_diameter / 2))) / nominal.gear.pitch
    return np.asarray(np.abs(folded.places) <= max(TIP_PLACE * half, 0.6 / PLACES))


def gone_teeth(folded: FoldedMap, nominal: Involute) -> NDArray[np.bool_]:
    """Teeth (teeth,) that are not there; those that were not seen are."""
    g = nominal.gear
    lowest = g.tip_diameter / 2 - GONE * (g.tip_diameter - g.root_diameter) / 2
    tip = folded.radius[:, tip_places(folded, nominal)]
    by_tooth = tip.reshape(tip.shape[0], -1)
    seen = np.isfinite(by_tooth)
    low = np.count_nonzero(seen & (np.nan_to_num(by_tooth) < lowest), axis=1)
    return np.asarray(low > 0.5 * np.maximum(seen.sum(axis=1), 1))


def tip_and_root(folded: FoldedMap, nominal: Involute, radial: tuple[Contribution, ...]) -> tuple[Ends, ...]:
    """Tip and root diameter: twice the mean over the teeth of each tooth's median radius; no tip where no tooth is.

    ``radial``: lines of U (k = 2, mm) of a diameter of the part.
    """
    tip, root = tip_places(folded, nominal), np.abs(folded.places) >= ROOT_PLACE
    there = np.where(gone_teeth(folded, nominal)[:, None, None], np.nan, folded.radius)
    return _end("d_a", there[:, tip], radial), _end("d_f", folded.radius[:, root], radial)


def _end(name: str, radius: Array, radial: tuple[Contribution, ...]) -> Ends:
    by_tooth = radius.reshape(radius.shape[0], -1)
    seen = np.isfinite(by_tooth).mean(axis=1) > 0.2
    medians_ = np.array([np.nanmedian(r) for r in by_tooth[seen]])
    if not medians_.size:
        return Ends(name, np.nan, np.nan, 0.0, ())
    usual = medians_ if medians_.size < 3 else _usual(medians_)
    u = float(usual.std()) / np.sqrt(usual.size)
    lines = tuple(sorted((*radial, Contribution("scatter of the teeth", 4 * u, u)), key=lambda c: -c.U))
    return Ends(
        name, 2 * float(usual.mean()),
        hypot(*(c.U for c in lines)), float(seen.mean()), lines,
    )  # fmt: skip


def _usual(values: Array) -> Array:
    """Without what is far off the median: chipped and missing teeth are no diameter."""
    off = np.abs(values - np.median(values))
    return np.asarray(values[off <= max(4 * robust_sd(off), 0.02)])
