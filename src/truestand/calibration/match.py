"""A silhouette held against the drawing: where along the axis, at which distance, which way up, and how surely.

Every explanation is scored bin by bin in nats: a bin on the drawn surface speaks for it, a bin beside it or one that is
promised, not hidden and not there speaks against it, what lies beyond the drawing says nothing. The margin over the
best explanation that is really another one is the confidence.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.outline import BIN, Silhouette
from truestand.core.artefact import Artefact, Cylinder

Array = NDArray[np.float64]

WIDTH = 0.25
"""mm from the drawn surface within which a bin lies on it (form, linearity, the feet of chamfers)."""
FOR, AGAINST = 5.0, 3.0
"""Nats: ln(20 mm of range / 2 sqrt(pi) 0.06 mm) for a bin on the surface, -ln(0.05) for a wild one."""
SAME_LINE = 0.15
"""mm: neighbouring bins nearer than this across are of one run."""
LEAST_RUN = 5
MOST_RUNS = 14
SAME_HEIGHT, SAME_RADIAL, SAME_DIRECTION = 1.0, 0.3, 0.03
"""mm, mm, rad within which two explanations are one."""
INDEPENDENT = 10.0
"""Bins that share one cause (a chamfer, a ghost), so that evidence counts once a millimetre."""


@dataclass(frozen=True, slots=True)
class Match:
    """One explanation: phi (rad), what is added to u and v of the silhouette (mm), and its score (nats)."""

    phi: float
    radial: float
    height: float
    score: float


def explanations(outline: Silhouette, artefact: Artefact) -> list[Match]:
    """Explanations of a silhouette by the drawing, both ways up; none where nothing fits."""
    seen = np.isfinite(outline.u)
    v, u = outline.v[seen], outline.u[seen]
    if v.size < LEAST_RUN:
        return []
    found = []
    for phi, along, across in ((outline.phi, v, u), (outline.phi - pi, -v[::-1], u[::-1])):
        drawn = _Drawing(artefact, along, across)
        found += [m for h in drawn.heights() if (m := drawn.explained(phi, h)) is not None]
    return found


def best_and_margin(found: list[Match]) -> tuple[Match, float]:
    """The best explanation and by how many nats it is better than the best one that differs."""
    best = max(found, key=lambda m: m.score)
    rivals = [m.score for m in found if not _same(m, best)]
    return best, best.score - max(rivals, default=0.0)


def confidence(margin: float) -> float:
    """Probability 0..1 that the better of two explanations is the right one, evidence counted once a millimetre."""
    return float(1.0 / (1.0 + np.exp(-min(margin / INDEPENDENT, 700.0))))


def _same(a: Match, b: Match) -> bool:
    turned = abs((a.phi - b.phi + pi) % (2 * pi) - pi)
    near = abs(a.height - b.height) < SAME_HEIGHT and abs(a.radial - b.radial) < SAME_RADIAL
    return turned < SAME_DIRECTION and near


@dataclass(frozen=True, slots=True)
class _Drawing:
    """The drawing beside a silhouette's bins ``v``, ``u`` (n,) mm."""

    artefact: Artefact
    v: Array
    u: Array

    def heights(self) -> Array:
        """Shifts (mm) of v that put an end of a run of bins at the like end of a cylinder."""
        breaks = np.flatnonzero((np.abs(np.diff(self.u)) > SAME_LINE) | (np.diff(self.v) > 3.5 * BIN))
        runs = zip(np.append(0, breaks + 1), np.append(breaks, self.v.size - 1), strict=True)
        longest = sorted((r for r in runs if r[1] - r[0] >= LEAST_RUN), key=lambda r: r[0] - r[1])[:MOST_RUNS]
        shifts = [
            shift
            for first, last in longest
            for c in self.artefact.cylinders
            for shift in (c.bottom - self.v[first] + BIN / 2, c.top - self.v[last] - BIN / 2)
        ]
        near = [s + k * BIN for s in shifts for k in (-1, 0, 1)]
        return np.unique(np.round(near, 3))

    def explained(self, phi: float, height: float) -> Match | None:
        """The explanation at one height: the radial shift on which most bins agree."""
        radius = drawn_radius(self.v + height, self.artefact)
        drawn = np.isfinite(radius)
        if np.count_nonzero(drawn) < LEAST_RUN:
            return None
        off = radius[drawn] - self.u[drawn]
        cells = np.floor((off - off.min()) / WIDTH).astype(np.intp)
        crowd = np.convolve(np.bincount(cells), np.ones(2))
        middle = off.min() + WIDTH * float(np.argmax(crowd))
        radial = float(np.median(off[np.abs(off - middle) <= WIDTH]))
        d = off - radial
        score = float(np.where(np.abs(d) < WIDTH, FOR * (1.0 - (d / WIDTH) ** 2), -AGAINST).sum())
        if score > 0:
            score -= AGAINST * self._missing(d, drawn, radial, height)
        return Match(phi, radial, height, score)

    def _missing(self, d: Array, drawn: NDArray[np.bool_], radial: float, height: float) -> int:
        """Bins that the drawing promises between the lowest and the highest on it: not hidden, not there."""
        heights = self.v[drawn] + height
        on = heights[np.abs(d) < WIDTH]
        promised = np.arange(on.min() + BIN, on.max(), BIN)
        radius = drawn_radius(promised, self.artefact)
        after = np.minimum(np.searchsorted(heights, promised), heights.size - 1)
        gap = np.minimum(np.abs(heights[after] - promised), np.abs(heights[np.maximum(after - 1, 0)] - promised))
        out = (gap > 2.5 * BIN) & np.isfinite(radius)
        return int(np.count_nonzero(out & ~hidden(radius, promised, (radial, height), self.artefact)))


def drawn_radius(heights: Array, artefact: Artefact) -> Array:
    """Radius (n,) mm of the drawing at heights, NaN beyond it and in its gaps."""
    radius = np.full(heights.shape, np.nan)
    for c in artefact.cylinders:
        radius[(heights >= c.bottom) & (heights < c.top)] = c.radius
    return radius


def hidden(radius: Array, heights: Array, sensor: tuple[float, float], artefact: Artefact) -> NDArray[np.bool_]:
    """Mask (n,) of points of the shaft that one of its cylinders hides from the sensor at (u, v) mm."""
    across, up = sensor
    mask = np.zeros(heights.size, dtype=np.bool_)
    rise = np.where(heights == up, 1e-12, heights - up)
    for c in artefact.cylinders:
        ends = np.sort(np.clip((np.array([[c.bottom], [c.top]]) - up) / rise, 0.0, 1.0), axis=0)
        lowest = across + np.where(radius < across, ends[1], ends[0]) * (radius - across)
        mask |= (ends[1] - ends[0] > 1e-9) & (lowest < c.radius - WIDTH)
    return mask


def matched_again(outline: Silhouette, height: float, artefact: Artefact) -> Match | None:
    """The best explanation of a silhouette near a known height, the same way up."""
    seen = np.isfinite(outline.u)
    drawn = _Drawing(artefact, outline.v[seen], outline.u[seen])
    near = [m for k in range(-6, 7) if (m := drawn.explained(outline.phi, height + 0.5 * k * BIN)) is not None]
    return max(near, key=lambda m: m.score, default=None)


def on_cylinder(outline: Silhouette, match: Match, cylinder: Cylinder) -> tuple[Array, Array]:
    """Height (n,) mm and deviation (n,) mm of the bins on one cylinder of the drawing."""
    v = outline.v + match.height
    d = outline.u + match.radial - cylinder.radius
    with np.errstate(invalid="ignore"):
        on = (np.abs(d) < WIDTH) & (v > cylinder.bottom) & (v < cylinder.top)
    return v[on], d[on]
