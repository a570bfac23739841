"""From raw profiles to "which cylinder of the artefact": the automatic choice of the base surface.

The paper chooses its base surface by hand and names the automatic choice as its open limitation. Here the outline that
the scan shows along every likely direction of the axis is compared with the drawing (steps, order, lengths, what hides
what), both ways up. Every explanation is scored bin by bin in nats: a bin on the drawn surface speaks for it, a bin
beside it or one that is promised, not hidden and not there speaks against it, what lies beyond the drawing says
nothing. The explanation with the most evidence wins; the margin over the best one that differs is the confidence.
"""

from dataclasses import dataclass, replace
from math import cos

import numpy as np

from truestand.calibration.outline import Silhouette, directions, sample, silhouette
from truestand.core.arrays import Array, Mask
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.errors import NotEnoughData
from truestand.core.frames import LaserPlane, facing
from truestand.core.harmonics import wrap
from truestand.core.message import Message
from truestand.core.scan import Scan

LEAST_EXPLAINED = 0.25
"""Share of the outline that the drawing must explain, below which the segmentation is not trusted."""
LEAST_CONFIDENCE = 0.99
"""Below which another explanation is as good."""
EDGE_MARGIN_MM = 0.75
"""From a cylinder's ends, where chamfers, fillets and ghosts lie; less on short cylinders."""
LEAST_WOBBLE_MM, STILL_SHARE = 0.05, 0.3
"""Wobble that no noise makes; share of it below which another outline counts as standing still."""
MOST_REFINEMENTS = 4
"""Of the direction."""
FACE_REACH_MM = 2.0
"""From the matched height, within which the shoulder face is searched for."""
LEAST_FACE_READINGS = 1.0
"""On the face, per profile, that show it."""
FAN_RAD = 0.2
"""Half the opening angle of the fan of rays."""
LEAST_BAND_MM = 0.3
"""Of one cylinder that must be seen between its margins to measure on it."""
SURFACE_WIDTH_MM = 0.25
"""From the drawn surface, within which a bin lies on it (form, linearity, the feet of chamfers)."""
NATS_FOR, NATS_AGAINST = 5.0, 3.0
"""ln(20 mm of range / 2 sqrt(pi) 0.06 mm) for a bin on the surface, -ln(0.05) for an outlier; once a millimetre,
for what lies nearer shares its cause (a chamfer, a ghost)."""
MOST_RUN_STEP_MM = 0.15
"""Neighbouring bins nearer than this across are of one run."""
LEAST_RUN = 5
MOST_RUNS = 14
SAME_HEIGHT_MM, SAME_RADIAL_MM, SAME_DIRECTION_RAD = 1.0, 0.3, 0.03
"""Within which two explanations are one,"""
MOST_SLID_MM = 3.0
"""and by which one may be slid along the axis: what a step hides leaves its height open, and nothing else."""


@dataclass(frozen=True, slots=True)
class Band:
    """The part of a cylinder that is measured on: ``low``..``high`` mm above the shoulder."""

    cylinder: int
    """Index in the artefact's drawing."""
    low: float
    high: float

    @property
    def middle(self) -> float:
        """mm: height halfway up."""
        return (self.low + self.high) / 2

    @property
    def length(self) -> float:
        """mm."""
        return self.high - self.low


@dataclass(frozen=True, slots=True)
class Segments:
    """The rough stand and what is seen of the artefact."""

    phi: float
    radial: float
    height: float
    bands: tuple[Band, ...]
    shoulder_seen: bool
    explained: float
    """Share of the outline that the drawing explains, 0..1."""
    confidence: float
    """Probability 0..1 that this is the right explanation and not the next best one."""
    reasons: tuple[Message, ...]
    """Why it is not to be trusted; empty where it is."""
    open_height: float = 0.0
    """mm by which the shaft may stand higher or lower and explain the view almost as well."""

    @property
    def longest(self) -> int:
        """Which band is the longest."""
        return int(np.argmax([b.length for b in self.bands]))

    @property
    def plane(self) -> LaserPlane:
        """u across the axis, counted from it; v above the shoulder."""
        return LaserPlane(self.phi, self.radial, self.height)


@dataclass(frozen=True, slots=True)
class Match:
    """One explanation: phi (rad), what is added to u and v of the silhouette (mm), and its score (nats)."""

    phi: float
    radial: float
    height: float
    score: float


def segment(scan: Scan, artefact: Artefact) -> Segments:
    """Find the artefact's cylinders in the scan.

    Raises:
        NotEnoughData: no points, or nothing that fits the drawing.
    """
    seen = sample(scan)
    along = (silhouette(seen, phi) for phi in directions(seen))
    outlines = {o.phi: o for outline in along for o in (outline, outline.other_way_up)}
    candidates = _moving([m for o in outlines.values() for m in explanations(o, artefact) if m.score > 0], outlines)
    if not candidates:
        raise _no_fit(artefact)
    best, margin = best_and_margin(candidates)
    open_height = _open_height(best, candidates)
    outline, match = _refined(seen, outlines[best.phi], best, artefact)
    bands = _bands(outline, match, artefact)
    if not bands:
        raise _no_fit(artefact)
    height, shoulder_seen = _shoulder(seen, outline, match, artefact)
    explained = _explained(outline, match, artefact)
    reasons = _reasons(best, candidates, bands, artefact, explained, confidence(margin))
    return Segments(
        match.phi, match.radial, height, bands, shoulder_seen, explained, confidence(margin), reasons, open_height
    )


def _moving(candidates: list[Match], outlines: dict[float, Silhouette]) -> list[Match]:
    """Those whose outline moves: where one does, another that stands still is a reflection, or a face seen edge on.

    An outline that nothing explains may be of no surface: along a face, readings come and go, and it seems to move.
    """
    wobble = [outlines[m.phi].wobble for m in candidates]
    most = max(wobble, default=0.0)
    return [m for m, w in zip(candidates, wobble, strict=True) if most < LEAST_WOBBLE_MM or w > STILL_SHARE * most]


def _no_fit(artefact: Artefact) -> NotEnoughData:
    return NotEnoughData(
        f"found no surface that fits the drawing of {artefact.name!r}; check the artefact's diameters and that the "
        "sensor sees the shaft"
    )


def _refined(seen: Scan, outline: Silhouette, match: Match, artefact: Artefact) -> tuple[Silhouette, Match]:
    """The direction from the slope of all matched bins together, and the outline along it."""
    for _ in range(MOST_REFINEMENTS):
        match = match_near(outline, match.height, artefact) or match
        parts = [on_cylinder(outline, match, c) for c in artefact.cylinders]
        parts = [(v, d) for v, d in parts if v.size > 3]
        if not parts:
            break
        turn = facing(match.phi) * _slope(parts)
        turned = silhouette(seen, match.phi + turn)
        # Turning the axis by a small angle moves points along it as well: keep the matched height in place.
        before, after = (LaserPlane(phi).to_uv(seen.x, seen.z)[1] for phi in (match.phi, turned.phi))
        moved = np.nanmedian(before - after)
        match = replace(match, phi=turned.phi, height=match.height + float(moved))
        outline = turned
        if abs(turn) < 1e-5:
            break
    return outline, match_near(outline, match.height, artefact) or match


def _slope(parts: list[tuple[Array, Array]]) -> float:
    """Common slope of the deviations of several cylinders over height, by least absolute deviations."""
    index = np.concatenate([np.full(v.size, k) for k, (v, _) in enumerate(parts)])
    v, d = (np.concatenate([p[i] for p in parts]) for i in (0, 1))
    design = np.hstack([v[:, None], index[:, None] == np.arange(len(parts))]).astype(np.float64)
    weight, solution = np.ones(d.size), np.zeros(design.shape[1], dtype=np.float64)
    for _ in range(12):
        solution = np.asarray(np.linalg.lstsq(design * weight[:, None], d * weight, rcond=None)[0])
        weight = 1.0 / np.sqrt(np.maximum(np.abs(d - design @ solution), 0.005))
    return float(solution[0])


def _bands(outline: Silhouette, match: Match, artefact: Artefact) -> tuple[Band, ...]:
    """The cylinders that are seen, with the part of each that is measured on."""
    bands = []
    for k, c in enumerate(artefact.cylinders):
        v, _ = on_cylinder(outline, match, c)
        if v.size < LEAST_BAND_MM / outline.bin:
            continue
        margin = min(EDGE_MARGIN_MM, 0.15 * c.length)
        low = max(c.bottom + margin, float(np.quantile(v, 0.01)))
        high = min(c.top - margin, float(np.quantile(v, 0.99)))
        if high - low > LEAST_BAND_MM:
            bands.append(Band(k, low, high))
    return tuple(bands)


def _explained(outline: Silhouette, match: Match, artefact: Artefact) -> float:
    """Share of the outline's bins that lie on the drawing."""
    on = sum(on_cylinder(outline, match, c)[0].size for c in artefact.cylinders)
    return on / max(int(np.count_nonzero(np.isfinite(outline.u))), 1)


def _shoulder(seen: Scan, outline: Silhouette, match: Match, artefact: Artefact) -> tuple[float, bool]:
    """The height from the shoulder face where the readings show it; (height, seen)."""
    if len(artefact.cylinders) < 2 or not _faces_sensor(artefact, match.phi):
        return match.height, False
    u, v = LaserPlane(outline.phi).to_uv(seen.x, seen.z)
    u, above = u - outline.shift[:, None] + match.radial, v + match.height - artefact.shoulder
    inner, outer = sorted((artefact.cylinders[0].radius, artefact.cylinders[1].radius))
    margin = min(0.5, 0.2 * (outer - inner))
    face = above[(u > inner + margin) & (u < outer - margin) & (np.abs(above) < FACE_REACH_MM)]
    if face.size < LEAST_FACE_READINGS * len(u):
        return match.height, False
    middle = float(np.median(face))
    flat = np.abs(face - middle) < 0.15
    if np.count_nonzero(flat) < 0.5 * face.size:
        return match.height, False
    return match.height - float(np.median(face[flat])), True


def _faces_sensor(artefact: Artefact, phi: float) -> bool:
    """Whether the shoulder's face is turned to the sensor, the fan's own angle allowed for."""
    lower, upper = artefact.cylinders[:2]
    above = -cos(phi)
    return above > -FAN_RAD if lower.radius > upper.radius else above < FAN_RAD


def _reasons(
    best: Match, candidates: list[Match], bands: tuple[Band, ...], artefact: Artefact, explained: float, sure: float
) -> tuple[Message, ...]:
    reasons = []
    upside_down = max((m.score for m in candidates if cos(m.phi - best.phi) < 0), default=0.0)
    if confidence(best.score - upside_down) < LEAST_CONFIDENCE:
        text = "the drawing fits what is seen both ways up, so the axis may point either way; bring a step into view"
        reasons.append(Message("drawing_fits_both_ways_up", text))
    elif sure < LEAST_CONFIDENCE:
        text = (
            "another place on the drawing explains the view almost as well (confidence "
            f"{sure:.2f}, need {LEAST_CONFIDENCE}): bring more of the shaft into view"
        )
        reasons.append(Message("another_place_on_drawing", text))
    if explained < LEAST_EXPLAINED:
        text = (
            f"the drawing explains {explained:.0%} of what the sensor sees, need {LEAST_EXPLAINED:.0%}: "
            "check shaft.toml"
        )
        reasons.append(Message("drawing_explains_view", text))
    if len(artefact.cylinders) > 1 and len(bands) == 1:
        name = artefact.cylinders[bands[0].cylinder].name
        text = f"only one surface of the artefact is seen; taken for {name!r}, which one scan can't prove"
        reasons.append(Message("one_surface_seen", text))
    return tuple(reasons)


def explanations(outline: Silhouette, artefact: Artefact) -> list[Match]:
    """Explanations of a silhouette by the drawing, this way up; none where nothing fits."""
    drawn = _Drawing.of(outline, artefact)
    return [m for h in drawn.heights() if (m := drawn.explained(outline.phi, h)) is not None]


def best_and_margin(candidates: list[Match]) -> tuple[Match, float]:
    """The best explanation and by how many nats it is better than the best one that differs."""
    best = max(candidates, key=lambda m: m.score)
    rivals = [m.score for m in candidates if not _same(m, best, MOST_SLID_MM)]
    return best, best.score - max(rivals, default=0.0)


def _open_height(best: Match, candidates: list[Match]) -> float:
    """By how much (mm) explanations that are only slid along the axis differ from the best one, where they are almost
    as good.
    """
    slid = [
        abs(m.height - best.height)
        for m in candidates
        if _same(m, best, MOST_SLID_MM) and confidence(best.score - m.score) < LEAST_CONFIDENCE
    ]
    farthest = max(slid, default=0.0)
    return farthest if farthest > SAME_HEIGHT_MM else 0.0


def confidence(margin: float) -> float:
    """Probability 0..1 that the better of two explanations is the right one, from their scores."""
    return float(1.0 / (1.0 + np.exp(-min(margin, 700.0))))


def _same(a: Match, b: Match, height: float) -> bool:
    """Whether two explanations are one, but for a ``height`` (mm)."""
    turned = abs(wrap(a.phi - b.phi))
    near = abs(a.height - b.height) < height and abs(a.radial - b.radial) < SAME_RADIAL_MM
    return turned < SAME_DIRECTION_RAD and near


@dataclass(frozen=True, slots=True)
class _Drawing:
    """The drawing and a silhouette's bins ``v``, ``u`` (n,) mm to compare with it."""

    artefact: Artefact
    bin: float
    v: Array
    u: Array

    @classmethod
    def of(cls, outline: Silhouette, artefact: Artefact) -> "_Drawing":
        """The drawing, and the bins of an outline that are seen."""
        seen = np.isfinite(outline.u)
        return cls(artefact, outline.bin, outline.v[seen], outline.u[seen])

    def heights(self) -> Array:
        """Shifts (mm) of v that put an end of a run of bins at the like end of a cylinder."""
        breaks = np.flatnonzero((np.abs(np.diff(self.u)) > MOST_RUN_STEP_MM) | (np.diff(self.v) > 3.5 * self.bin))
        runs = zip(np.append(0, breaks + 1), np.append(breaks, self.v.size - 1), strict=True)
        longest = sorted((r for r in runs if r[1] - r[0] >= LEAST_RUN), key=lambda r: r[0] - r[1])[:MOST_RUNS]
        shifts = [
            shift
            for first, last in longest
            for c in self.artefact.cylinders
            for shift in (c.bottom - self.v[first] + self.bin / 2, c.top - self.v[last] - self.bin / 2)
        ]
        near = [s + k * self.bin for s in shifts for k in (-1, 0, 1)]
        return np.unique(np.round(near, 3))

    def explained(self, phi: float, height: float) -> Match | None:
        """The explanation at one height: the radial shift on which most bins agree."""
        radius = drawn_radius(self.v + height, self.artefact)
        drawn = np.isfinite(radius)
        if np.count_nonzero(drawn) < LEAST_RUN:
            return None
        off = radius[drawn] - self.u[drawn]
        cells = np.floor((off - off.min()) / SURFACE_WIDTH_MM).astype(np.intp)
        crowd = np.convolve(np.bincount(cells), np.ones(2))
        middle = off.min() + SURFACE_WIDTH_MM * float(np.argmax(crowd))
        radial = float(np.median(off[np.abs(off - middle) <= SURFACE_WIDTH_MM]))
        d = off - radial
        score = self.bin * float(
            np.where(np.abs(d) < SURFACE_WIDTH_MM, NATS_FOR * (1.0 - (d / SURFACE_WIDTH_MM) ** 2), -NATS_AGAINST).sum()
        )
        if score > 0:
            score -= self.bin * NATS_AGAINST * self._missing(d, drawn, radial, height)
        return Match(phi, radial, height, score)

    def _missing(self, d: Array, drawn: Mask, radial: float, height: float) -> int:
        """Bins that the drawing promises between the lowest and the highest on it: not hidden, not there."""
        heights = self.v[drawn] + height
        on = heights[np.abs(d) < SURFACE_WIDTH_MM]
        promised = np.arange(on.min() + self.bin, on.max(), self.bin)
        radius = drawn_radius(promised, self.artefact)
        after = np.minimum(np.searchsorted(heights, promised), heights.size - 1)
        gap = np.minimum(np.abs(heights[after] - promised), np.abs(heights[np.maximum(after - 1, 0)] - promised))
        out = (gap > 2.5 * self.bin) & np.isfinite(radius)
        return int(np.count_nonzero(out & ~hidden(radius, promised, (radial, height), self.artefact)))


def drawn_radius(heights: Array, artefact: Artefact) -> Array:
    """Radius (n,) mm of the drawing at heights, NaN beyond it and in its gaps."""
    radius = np.full(heights.shape, np.nan)
    for c in artefact.cylinders:
        radius[(heights >= c.bottom) & (heights < c.top)] = c.radius
    return radius


def hidden(radius: Array, heights: Array, sensor: tuple[float, float], artefact: Artefact) -> Mask:
    """Mask (n,) of points of the shaft that one of its cylinders hides from the sensor at (u, v) mm."""
    across, up = sensor
    mask = np.zeros(heights.size, dtype=np.bool_)
    rise = np.where(heights == up, 1e-12, heights - up)
    for c in artefact.cylinders:
        ends = np.sort(np.clip((np.array([[c.bottom], [c.top]]) - up) / rise, 0.0, 1.0), axis=0)
        lowest = across + np.where(radius < across, ends[1], ends[0]) * (radius - across)
        mask |= (ends[1] - ends[0] > 1e-9) & (lowest < c.radius - SURFACE_WIDTH_MM)
    return mask


def match_near(outline: Silhouette, height: float, artefact: Artefact) -> Match | None:
    """The best explanation of a silhouette near a known height, the same way up."""
    drawn = _Drawing.of(outline, artefact)
    near = [m for k in range(-6, 7) if (m := drawn.explained(outline.phi, height + 0.5 * k * outline.bin)) is not None]
    return max(near, key=lambda m: m.score, default=None)


def on_cylinder(outline: Silhouette, match: Match, cylinder: Cylinder) -> tuple[Array, Array]:
    """Height (n,) mm and deviation (n,) mm of the bins on one cylinder of the drawing."""
    v = outline.v + match.height
    d = outline.u + match.radial - cylinder.radius
    on = (np.abs(d) < SURFACE_WIDTH_MM) & (v > cylinder.bottom) & (v < cylinder.top)
    return v[on], d[on]
