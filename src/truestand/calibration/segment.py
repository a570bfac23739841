"""From raw profiles to "which cylinder of the artefact": the automatic choice of the base surface.

The paper chooses its base surface by hand and names the automatic choice as its open limitation. Here the outline that
the scan shows along every likely direction of the axis is held against the drawing (steps, order, lengths, what hides
what), both ways up. The explanation with the most evidence wins; the next best one that differs says how surely.
"""

from dataclasses import dataclass, replace
from math import cos

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.match import Match, best_and_margin, confidence, explanations, matched_again, on_cylinder
from truestand.calibration.outline import (
    BIN,
    Sample,
    Silhouette,
    across_and_along,
    directions,
    sample,
    silhouette,
)
from truestand.core.artefact import Artefact
from truestand.core.errors import NotEnoughData
from truestand.core.frames import facing
from truestand.core.scan import Scan

Array = NDArray[np.float64]

LEAST_SHARE = 0.25
"""Share of the outline that the drawing must explain, below which the segmentation is not trusted."""
SURE = 0.99
"""Confidence below which another explanation is as good."""
EDGE_MARGIN = 0.75
"""mm: kept away from a cylinder's ends, where chamfers, fillets and ghosts live (less on short cylinders)."""
MOVES, STILL = 0.05, 0.3
"""mm of wobble that no noise makes; share of it below which another outline counts as standing still."""
SHARPENED = 4
"""Times the direction is sharpened at most."""
FACE_REACH = 2.0
"""mm from the matched height within which the shoulder face is looked for."""
FACE_POINTS = 1.0
"""Readings on the face, per profile, that show it."""
FAN = 0.2
"""rad: the outermost rays of a fan look by as much to either side."""
LEAST_BAND = 0.3
"""mm of one cylinder that must be seen between its margins to measure on it."""


@dataclass(frozen=True, slots=True)
class Band:
    """The part of a cylinder that is measured on: ``low``..``high`` mm above the shoulder."""

    cylinder: int
    """Index in the artefact's drawing."""
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Segments:
    """The rough stand and what is seen of the artefact.

    In the laser plane u = facing(phi) (x cos phi - z sin phi) + radial, v = x sin phi + z cos phi + height.
    """

    phi: float
    radial: float
    height: float
    bands: tuple[Band, ...]
    shoulder_seen: bool
    explained: float
    """Share of the outline that the drawing explains, 0..1."""
    confidence: float
    """Probability 0..1 that this is the right explanation and not the next best one."""
    reasons: tuple[str, ...]
    """Why it is not to be trusted; empty where it is."""


def segment(scan: Scan, artefact: Artefact) -> Segments:
    """Find the artefact's cylinders in the scan.

    Raises:
        NotEnoughData: no points, or nothing that fits the drawing.
    """
    seen = sample(scan)
    outlines = _turning([silhouette(seen, phi) for phi in directions(seen)])
    found = [m for outline in outlines for m in explanations(outline, artefact)]
    best, margin = best_and_margin(found) if found else (None, 0.0)
    if best is None or best.score <= 0:
        raise _nothing(artefact)
    outline, match = _sharpened(seen, best, artefact)
    bands = _bands(outline, match, artefact)
    if not bands:
        raise _nothing(artefact)
    height, shoulder_seen = _shoulder(seen, outline, match, artefact)
    explained = _explained(outline, match, artefact)
    sure = confidence(margin)
    doubts = _doubts(best, found, bands, artefact, explained, sure)
    return Segments(match.phi, match.radial, height, bands, shoulder_seen, explained, sure, doubts)


def _turning(outlines: list[Silhouette]) -> list[Silhouette]:
    """The outlines that move: where one does, another that stands still is a reflection, or a face seen edge on."""
    most = max((o.wobble for o in outlines), default=0.0)
    return [o for o in outlines if most < MOVES or o.wobble > STILL * most]


def _nothing(artefact: Artefact) -> NotEnoughData:
    return NotEnoughData(
        f"found no surface that fits the drawing of {artefact.name!r}; check the artefact's diameters and that the "
        "sensor sees the shaft"
    )


def _sharpened(seen: Sample, match: Match, artefact: Artefact) -> tuple[Silhouette, Match]:
    """The direction again, from the slope of all matched bins together, and the outline along it."""
    outline = silhouette(seen, match.phi)
    for _ in range(SHARPENED):
        match = matched_again(outline, match.height, artefact) or match
        parts = [on_cylinder(outline, match, c) for c in artefact.cylinders]
        parts = [(v, d) for v, d in parts if v.size > 3]
        if not parts:
            break
        turn = facing(match.phi) * _slope(parts)
        turned = silhouette(seen, match.phi + turn)
        # Turning the axis by a small angle moves points along it as well: keep the matched height in place.
        moved = np.nanmedian(across_and_along(seen, match.phi)[1] - across_and_along(seen, turned.phi)[1])
        match = replace(match, phi=turned.phi, height=match.height + float(moved))
        outline = turned
        if abs(turn) < 1e-5:
            break
    return outline, matched_again(outline, match.height, artefact) or match


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
        if v.size < LEAST_BAND / BIN:
            continue
        margin = min(EDGE_MARGIN, 0.15 * c.length)
        low = max(c.bottom + margin, float(np.quantile(v, 0.01)))
        high = min(c.top - margin, float(np.quantile(v, 0.99)))
        if high - low > LEAST_BAND:
            bands.append(Band(k, low, high))
    return tuple(bands)


def _explained(outline: Silhouette, match: Match, artefact: Artefact) -> float:
    """Share of the outline's bins that lie on the drawing."""
    on = sum(on_cylinder(outline, match, c)[0].size for c in artefact.cylinders)
    return on / max(int(np.count_nonzero(np.isfinite(outline.u))), 1)


def _shoulder(seen: Sample, outline: Silhouette, match: Match, artefact: Artefact) -> tuple[float, bool]:
    """The height from the shoulder face where the readings show it; (height, seen)."""
    if len(artefact.cylinders) < 2 or not _faces_sensor(artefact, match.phi):
        return match.height, False
    u, v = across_and_along(seen, outline.phi)
    u, above = u - outline.shift[:, None] + match.radial, v + match.height - artefact.shoulder
    inner, outer = sorted((artefact.cylinders[0].radius, artefact.cylinders[1].radius))
    margin = min(0.5, 0.2 * (outer - inner))
    with np.errstate(invalid="ignore"):
        face = above[(u > inner + margin) & (u < outer - margin) & (np.abs(above) < FACE_REACH)]
    if face.size < FACE_POINTS * len(u):
        return match.height, False
    middle = float(np.median(face))
    flat = np.abs(face - middle) < 0.15
    if np.count_nonzero(flat) < 0.5 * face.size:
        return match.height, False
    return match.height - float(np.median(face[flat])), True


def _faces_sensor(artefact: Artefact, phi: float) -> bool:
    """Whether the shoulder's face looks to the side from which the sensor does (the fan's own angle allowed for)."""
    lower, upper = artefact.cylinders[:2]
    above = -cos(phi)
    return above > -FAN if lower.radius > upper.radius else above < FAN


def _doubts(
    best: Match, found: list[Match], bands: tuple[Band, ...], artefact: Artefact, explained: float, sure: float
) -> tuple[str, ...]:
    doubts = []
    upside_down = max((m.score for m in found if cos(m.phi - best.phi) < 0), default=0.0)
    if confidence(best.score - upside_down) < SURE:
        doubts.append(
            "the drawing fits what is seen both ways up, so the axis may point either way; bring a step into view"
        )
    elif sure < SURE:
        doubts.append(
            f"another place on the drawing explains the view almost as well (confidence {sure:.2f}, need {SURE}): "
            "bring more of the shaft into view"
        )
    if explained < LEAST_SHARE:
        doubts.append(
            f"the drawing explains {explained:.0%} of what the sensor sees, need {LEAST_SHARE:.0%}: check shaft.toml"
        )
    if len(artefact.cylinders) > 1 and len(bands) == 1:
        name = artefact.cylinders[bands[0].cylinder].name
        doubts.append(f"only one surface of the artefact is seen; taken for {name!r}, which one scan can't prove")
    return tuple(doubts)
