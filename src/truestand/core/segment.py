"""From raw profiles to "which cylinder of the artefact": the automatic choice of the base surface.

The paper chooses its base surface by hand and names the automatic choice as its open limitation. Here the median
profile of the scan is searched for the direction along which its points fall into the fewest, sharpest lines; the lines
are then held against the drawing (steps between diameters, order and length along the axis), for both senses of the
axis, and the assignment that explains the most points wins.
"""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from truestand.core.artefact import Artefact, Cylinder
from truestand.core.clean import supported
from truestand.core.errors import NotEnoughData
from truestand.core.frames import facing
from truestand.core.scan import Scan

Array = NDArray[np.float64]

SAMPLED_PROFILES = 400
LINE_WIDTH = 0.3
"""mm: half-width of the band that counts as one line of the median profile (sensor linearity, chamfers' feet)."""
LEAST_POINTS = 12
"""Points of the median profile that make a line."""
LEAST_SHARE = 0.25
"""Share of the profile's points that the drawing must explain, below which the segmentation is not trusted."""
AS_GOOD = 0.97
"""Share of the best score from which another explanation is as good."""
EDGE_MARGIN = 0.75
"""mm: kept away from a cylinder's ends, where chamfers, fillets and ghosts live (less on short cylinders)."""


@dataclass(frozen=True, slots=True)
class Band:
    """The part of a cylinder that is measured on: ``low``..``high`` mm above the shoulder."""

    cylinder: int
    """Index in the artefact's drawing."""
    low: float
    high: float
    points: int
    """Points of the median profile in it."""


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
    """Share of the median profile's points that the drawing explains, 0..1."""
    reasons: tuple[str, ...]
    """Why it is not to be trusted; empty where it is."""
    profile_x: Array
    profile_z: Array
    """The median profile, mm."""


def segment(scan: Scan, artefact: Artefact) -> Segments:
    """Find the artefact's cylinders in the scan.

    Raises:
        NotEnoughData: no points, or nothing that fits the drawing.
    """
    x, z = median_profile(scan)
    candidates = [_match(x, z, phi, artefact) for phi in _directions(x, z)]
    best = max(candidates, key=lambda m: m.score)
    if not best.bands:
        raise NotEnoughData(
            f"found no surface that fits the drawing of {artefact.name!r}; check the artefact's diameters and that the "
            "sensor sees the shaft"
        )
    height, shoulder_seen = _shoulder(x, z, best, artefact)
    explained = best.points / x.size
    doubts = _doubts(best, candidates, artefact, explained)
    return Segments(best.phi, best.radial, height, best.bands, shoulder_seen, explained, doubts, x, z)


def median_profile(scan: Scan) -> tuple[Array, Array]:
    """The typical profile, x and z (G,) mm: medians over profiles spread evenly over whole turns.

    Readings are binned along x, not by column, because some exports leave points without data out.

    Raises:
        NotEnoughData: too few points.
    """
    whole = int(scan.profiles * max(int(scan.revolutions), 1) / max(scan.revolutions, 1.0))
    rows = np.unique(np.linspace(0, max(whole - 1, 0), SAMPLED_PROFILES).astype(np.intp))
    x, z = scan.x[rows], scan.z[rows]
    good = supported(x, z)
    if np.count_nonzero(good) < LEAST_POINTS * rows.size:
        raise NotEnoughData(
            f"found {np.count_nonzero(np.isfinite(scan.z))} points in {scan.profiles} profiles, need a visible "
            "surface; check exposure, range and that the laser was on"
        )
    low, high = np.quantile(x[good], [0.001, 0.999])
    bins = scan.x.shape[1]
    column = np.floor((x - low) * (bins / (high - low)), where=good, out=np.full(x.shape, -1.0)).astype(np.intp)
    good &= (column >= 0) & (column < bins)
    grid = np.full((2, rows.size, bins), np.nan)
    where = (np.broadcast_to(np.arange(rows.size)[:, None], x.shape)[good], column[good])
    grid[0][where], grid[1][where] = x[good], z[good]
    full = np.count_nonzero(np.isfinite(grid[1]), axis=0) >= 0.1 * rows.size
    medians = np.nanmedian(grid[:, :, full], axis=1)
    return medians[0], medians[1]


def _directions(x: Array, z: Array) -> list[float]:
    """Candidate directions of the axis (phi, rad), both senses: where projected points crowd into sharp lines."""
    grid = np.radians(np.arange(0.0, 180.0, 0.5))
    scores = np.array([_crowding(x, z, phi, 0.1) for phi in grid])
    peaks: list[float] = []
    for i in np.argsort(scores)[::-1]:
        if len(peaks) == 4:
            break
        if all(abs((grid[i] - p + pi / 2) % pi - pi / 2) > np.radians(4.0) for p in peaks):
            peaks.append(float(grid[i]))
    fine = np.radians(np.arange(-0.6, 0.601, 0.05))
    sharp = [max((phi + f for f in fine), key=lambda a: _crowding(x, z, a, 0.05)) for phi in peaks]
    return [wrapped for phi in sharp for wrapped in (phi, phi - pi)]


def _crowding(x: Array, z: Array, phi: float, width: float) -> float:
    across = x * cos(phi) - z * sin(phi)
    cells = np.floor((across - across.min()) / width).astype(np.intp)
    counts = np.bincount(cells).astype(np.float64)
    return float((np.convolve(counts, [0.5, 1.0, 0.5]) ** 2).sum())


@dataclass(frozen=True, slots=True)
class _Match:
    phi: float
    radial: float
    height: float
    bands: tuple[Band, ...]
    points: int
    score: float


def _match(x: Array, z: Array, phi: float, artefact: Artefact) -> _Match:
    """The best assignment of the lines along ``phi`` to the drawing's cylinders."""
    u = facing(phi) * (x * cos(phi) - z * sin(phi))
    v = x * sin(phi) + z * cos(phi)
    best = _Match(phi, 0.0, 0.0, (), 0, 0.0)
    for line in _lines(u):
        for k, cylinder in enumerate(artefact.cylinders):
            radial = cylinder.radius - line
            for height in _heights(u + radial, v, artefact):
                found = _explain(u + radial, v + height, artefact)
                points = sum(b.points for b in found)
                # A cylinder that explains nothing where points are missing costs nothing; of two equal
                # explanations the one with more cylinders, then the one anchored on the base, is the better.
                score = points * (1.0 + 0.2 * (len(found) - 1)) - 0.01 * k
                if score > best.score:
                    score -= _missing(u + radial, v + height, (radial, height), artefact)
                if score > best.score:
                    best = _Match(phi, radial, height, tuple(found), points, score)
    return _refined(best, x, z, artefact) if best.bands else best


def _lines(u: Array) -> list[float]:
    """Positions (mm) at which points crowd, the strongest first."""
    cells = np.floor((u - u.min()) / 0.05).astype(np.intp)
    counts = np.convolve(np.bincount(cells), np.ones(7), mode="same")
    lines: list[float] = []
    for i in np.argsort(counts)[::-1]:
        if counts[i] < LEAST_POINTS or len(lines) == 6:
            break
        position = float(u.min() + (i + 0.5) * 0.05)
        if all(abs(position - other) > 2 * LINE_WIDTH for other in lines):
            lines.append(float(np.median(u[np.abs(u - position) < LINE_WIDTH])))
    return lines


def _heights(u: Array, v: Array, artefact: Artefact) -> list[float]:
    """Candidate shifts (mm) of v that put a visible end of a cylinder where the drawing has it."""
    shifts = []
    for c in artefact.cylinders:
        on = v[np.abs(u - c.radius) < LINE_WIDTH]
        if on.size >= LEAST_POINTS:
            low, high = np.quantile(on, [0.01, 0.99])
            shifts += [c.top - high, c.bottom - low]
    return shifts


def _missing(u: Array, v: Array, sensor: tuple[float, float], artefact: Artefact) -> float:
    """How many points the drawing promises in vain between the lowest and the highest seen: not hidden, not there.

    ``sensor`` is where the rays start, (u, v) mm. This tells a shoulder's edge from the first reading behind it.
    """
    on = [np.sort(_on(u, v, c)) for c in artefact.cylinders]
    seen = np.concatenate(on)
    pitch = (seen.max() - seen.min()) / seen.size
    missing = 0
    for c, heights in zip(artefact.cylinders, on, strict=True):
        promised = np.arange(max(c.bottom, seen.min()) + pitch, min(c.top, seen.max()), pitch)
        near = np.zeros(promised.size, dtype=np.bool_)
        if heights.size:
            after = np.minimum(np.searchsorted(heights, promised), heights.size - 1)
            gap = np.minimum(np.abs(heights[after] - promised), np.abs(heights[np.maximum(after - 1, 0)] - promised))
            near = gap < max(LINE_WIDTH, 2 * pitch)
        missing += int(np.count_nonzero(~near & ~_hidden(c.radius, promised, sensor, artefact)))
    return float(missing)


def _hidden(radius: float, heights: Array, sensor: tuple[float, float], artefact: Artefact) -> NDArray[np.bool_]:
    """Mask (n,) of points of one cylinder that another one hides from the sensor."""
    across, up = sensor
    hidden = np.zeros(heights.size, dtype=np.bool_)
    rise = np.where(heights == up, 1e-12, heights - up)
    for c in artefact.cylinders:
        ends = np.sort(np.clip((np.array([[c.bottom], [c.top]]) - up) / rise, 0.0, 1.0), axis=0)
        lowest = across + np.where(radius < across, ends[1], ends[0]) * (radius - across)
        hidden |= (ends[1] - ends[0] > 1e-9) & (lowest < c.radius - LINE_WIDTH)
    return hidden


def _on(u: Array, v: Array, c: Cylinder) -> Array:
    """Heights (n,) of the points on one cylinder of the drawing."""
    return v[(np.abs(u - c.radius) < LINE_WIDTH) & (v > c.bottom - 0.2) & (v < c.top + 0.2)]


def _explain(u: Array, v: Array, artefact: Artefact) -> list[Band]:
    """The cylinders whose drawing explains points of the median profile, with the part that is measured on."""
    bands = []
    for k, c in enumerate(artefact.cylinders):
        on = _on(u, v, c)
        if on.size < LEAST_POINTS:
            continue
        margin = min(EDGE_MARGIN, 0.15 * c.length)
        low = max(c.bottom + margin, float(np.quantile(on, 0.01)))
        high = min(c.top - margin, float(np.quantile(on, 0.99)))
        if high - low > 0.3:
            bands.append(Band(k, low, high, int(on.size)))
    return bands


def _refined(match: _Match, x: Array, z: Array, artefact: Artefact) -> _Match:
    """The direction again, from the slope of all matched lines together (least absolute deviations by reweighting)."""
    phi, radial = match.phi, match.radial
    for _ in range(8):
        u = facing(phi) * (x * cos(phi) - z * sin(phi)) + radial
        v = x * sin(phi) + z * cos(phi) + match.height
        rows: list[NDArray[np.intp]] = []
        deviations: list[Array] = []
        heights: list[Array] = []
        for band in match.bands:
            on = (np.abs(u - artefact.cylinders[band.cylinder].radius) < LINE_WIDTH) & (v > band.low) & (v < band.high)
            rows.append(np.full(int(on.sum()), len(rows)))
            deviations.append(u[on] - artefact.cylinders[band.cylinder].radius)
            heights.append(v[on])
        index, du, dv = np.concatenate(rows), np.concatenate(deviations), np.concatenate(heights)
        if du.size < LEAST_POINTS:
            return match
        design = np.hstack([dv[:, None], index[:, None] == np.arange(len(match.bands))]).astype(np.float64)
        weight = np.ones(du.size)
        for _ in range(10):
            solution = np.linalg.lstsq(design * weight[:, None], du * weight, rcond=None)[0]
            weight = 1.0 / np.sqrt(np.maximum(np.abs(du - design @ solution), 0.005))
        turn = facing(phi) * float(solution[0])
        phi += turn
        radial -= float(solution[1])
        if abs(turn) < 1e-6:
            break
    # Turning the axis by a small angle moves points along it as well: keep the matched height in place.
    moved = np.median((x * sin(match.phi) + z * cos(match.phi)) - (x * sin(phi) + z * cos(phi)))
    return _Match(phi, radial, match.height + float(moved), match.bands, match.points, match.score)


def _shoulder(x: Array, z: Array, match: _Match, artefact: Artefact) -> tuple[float, bool]:
    """The height from the shoulder face where the median profile shows it; (height, seen)."""
    if len(artefact.cylinders) < 2:
        return match.height, False
    u = facing(match.phi) * (x * cos(match.phi) - z * sin(match.phi)) + match.radial
    v = x * sin(match.phi) + z * cos(match.phi) + match.height
    inner, outer = sorted((artefact.cylinders[0].radius, artefact.cylinders[1].radius))
    margin = min(0.5, 0.2 * (outer - inner))
    above = v - artefact.shoulder
    face = above[(u > inner + margin) & (u < outer - margin) & (np.abs(above) < 2.0)]
    if face.size < 5:
        return match.height, False
    middle = float(np.median(face))
    flat = np.abs(face - middle) < 0.15
    if np.count_nonzero(flat) < max(5, 0.5 * face.size):
        return match.height, False
    return match.height - float(np.median(face[flat])), True


def _doubts(match: _Match, others: list[_Match], artefact: Artefact, explained: float) -> tuple[str, ...]:
    doubts = []
    upside_down = max(m.score for m in others if cos(m.phi - match.phi) < 0)
    if upside_down > AS_GOOD * match.score:
        doubts.append(
            "the drawing fits what is seen both ways up, so the axis may point either way; bring a step into view"
        )
    if explained < LEAST_SHARE:
        doubts.append(
            f"the drawing explains {explained:.0%} of what the sensor sees, need {LEAST_SHARE:.0%}: check shaft.toml"
        )
    if len(artefact.cylinders) > 1 and len(match.bands) == 1:
        name = artefact.cylinders[match.bands[0].cylinder].name
        doubts.append(f"only one surface of the artefact is seen; taken for {name!r}, which one scan can't prove")
    return tuple(doubts)
