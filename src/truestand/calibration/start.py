"""Start values of the exact model: eccentricity, tilt, form and table speed from the medians of the profiles, and which
stretches of each surface are not the shaft's."""

from dataclasses import dataclass
from math import tau

import numpy as np

from truestand.calibration.edges import SECTORS, sector_of
from truestand.calibration.patches import patches
from truestand.calibration.robust_wave import MOST_ORDERS, OUTLIER_SD, Wave, robust_wave
from truestand.calibration.segment import Segments
from truestand.core.arrays import Array, Mask
from truestand.core.artefact import Artefact
from truestand.core.errors import NotEnoughData
from truestand.core.harmonics import Harmonics, fit_harmonics, fit_harmonics_robustly
from truestand.core.robust import nan_median, row_medians
from truestand.core.scan import Scan

SAMPLED_PROFILES = 1000
SPEED_PROFILES = 500
"""Of these, the ones on which a hundred table speeds are tried."""
SPEED_PASSES = 6
"""Of the robust fit; near the right speed it settles sooner."""
MOST_ECCENTRICITY_MM = 4.0
"""Most eccentric shaft that is searched for."""
SPEED_RANGE = 0.08
"""Relative: how wrong a stated table speed may be and still be found."""
MOST_COST_RATIO = 0.9
"""Cost at another table speed over that at the stated one, below which it is taken."""
LEAST_REPEATED_TURNS = 1.05
"""From which form repeats, so that it can be separated from a wrong speed."""
LEAST_REVOLUTIONS = 0.5
WHOLE_TURN = 0.95
"""Turns below which only two harmonics of form can be separated from eccentricity."""
OVERLAP_SECTORS = 10
"""That are compared between turns together."""
LEAST_READINGS = 5
LEAST_PROFILES = 20


@dataclass(frozen=True, slots=True)
class RoughStand:
    """Start values: mm and rad."""

    radial: float
    eccentricity: tuple[float, float]
    tilt: tuple[float, float]
    speed: float
    """Relative error of the stated table speed."""
    waves: tuple[Harmonics, ...]
    """Of each band's trace over table angle."""
    outliers: Mask
    """(bands, SECTORS): stretches of table angle in which a band doesn't show the shaft's round surface."""
    common_outliers: float
    """Share of the profiles in which every band is off its wave: seldom by dirt, always by a wrong table angle."""
    angle: Array
    """(n,) rad: nominal table angle of the sampled profiles."""
    traces: Array
    """(bands, n) mm: their deviations, NaN where they are outliers."""

    @property
    def orders(self) -> int:
        """Highest harmonic that the majority of a trace needed."""
        return max(w.orders[-1] for w in self.waves)


def rough_stand(scan: Scan, segments: Segments, artefact: Artefact) -> RoughStand:
    """Eccentricity and tilt, and the table's speed where the scan has no angle of its own.

    Raises:
        NotEnoughData: less than half a turn, or too few profiles that show the artefact.
    """
    if scan.revolutions < LEAST_REVOLUTIONS:
        raise NotEnoughData(
            f"need one full revolution, got {scan.revolutions:.2f}; scan for longer (or check the table's speed)"
        )
    nominal, traces = _band_traces(scan, segments, artefact)
    speed = _find_speed(nominal, traces) if scan.free_speed else 0.0
    angle = nominal + speed * (nominal - scan.angle[0])
    orders = MOST_ORDERS if scan.revolutions >= WHOLE_TURN else 3
    covered = patches(angle, traces, tuple(artefact.cylinders[band.cylinder].radius for band in segments.bands))
    traces = np.where(covered[:, sector_of(angle)], np.nan, traces)
    seen = np.isfinite(traces)
    waves = tuple(robust_wave(angle[on], trace[on], orders) for on, trace in zip(seen, traces, strict=True))
    outliers = covered | np.stack([_outlier_sectors(angle[on], wave) for on, wave in zip(seen, waves, strict=True)])
    off = np.zeros_like(seen)
    off[seen] = np.concatenate([wave.outliers for wave in waves])
    common = float(np.mean(off.all(axis=0))) if len(waves) > 1 else 0.0
    (ex, ey), tilt = _axis(segments, waves)
    radial = segments.radial - waves[segments.longest].series.mean
    traces = np.where(outliers[:, sector_of(angle)], np.nan, traces)
    series = tuple(w.series for w in waves)
    return RoughStand(radial, (ex, ey), tilt, speed, series, outliers, common, nominal, traces)


def repeats_within(start: RoughStand, speed: float) -> float | None:
    """How far repeated turns differ, mm rms, with the table's speed now known; None without a second turn.

    Stretches of ``OVERLAP_SECTORS`` are compared with the same stretch on the other turns, linear drift apart.
    """
    angle, traces = start.angle + speed * (start.angle - start.angle[0]), start.traces
    count = SECTORS // OVERLAP_SECTORS
    turn = np.floor(np.abs(angle - angle[0]) / tau).astype(np.intp)
    cell = turn * count + sector_of(angle) // OVERLAP_SECTORS
    size = (int(turn.max()) + 1) * count
    differences = [np.zeros(0)]
    for trace, wave in zip(traces, start.waves, strict=True):
        seen = np.isfinite(trace)
        if np.count_nonzero(seen) < LEAST_PROFILES:
            continue
        off = trace[seen] - fit_harmonics(angle[seen], trace[seen], wave.orders)(angle[seen])
        time = np.linspace(-0.5, 0.5, trace.size)[seen]
        near = np.abs(off) <= OUTLIER_SD * np.median(np.abs(off))
        drift = np.polyfit(time[near], off[near], 1)
        many = np.bincount(cell[seen], minlength=size).reshape(-1, count)
        sums = np.bincount(cell[seen], off - np.polyval(drift, time), size).reshape(-1, count)
        means = np.where(many >= 3, sums / np.maximum(many, 1), np.nan)
        shared = means[:, np.count_nonzero(np.isfinite(means), axis=0) > 1]
        if shared.size:
            differences.append(np.ravel(shared - np.nanmean(shared, axis=0)))
    together = np.concatenate(differences)
    return float(np.sqrt(np.nanmean(np.square(together)))) if together.size else None


def _band_traces(scan: Scan, segments: Segments, artefact: Artefact) -> tuple[Array, Array]:
    """Table angle (n,) rad of profiles spread over the scan and the median deviation (bands, n) mm of each surface."""
    rows = scan.spread(SAMPLED_PROFILES)
    u, v = segments.plane.to_uv(scan.x[rows], scan.z[rows])
    traces = np.full((len(segments.bands), rows.size), np.nan)
    for k, band in enumerate(segments.bands):
        off = u - artefact.cylinders[band.cylinder].radius
        on = (v > band.low) & (v < band.high) & (np.abs(off) < MOST_ECCENTRICITY_MM)
        traces[k] = row_medians(off, on, LEAST_READINGS)
        found = np.count_nonzero(np.isfinite(traces[k]))
        if found < LEAST_PROFILES:
            raise NotEnoughData(
                f"found {artefact.cylinders[band.cylinder].name!r} in {found} of {rows.size} "
                f"profiles, need {LEAST_PROFILES}; check exposure and range"
            )
    return scan.angle[rows], traces


def _axis(segments: Segments, waves: tuple[Wave, ...]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Eccentricity at height 0 and slope of the axis from the bands' first harmonics."""
    # Seen along T's X the axis stands at e cos(beta + theta): cos -> ex, sin -> -ey.
    ex = np.array([float(w.series.cos[0]) for w in waves])
    ey = np.array([-float(w.series.sin[0]) for w in waves])
    middle = np.array([b.middle for b in segments.bands])
    if middle.size == 1 or np.ptp(middle) < 1.0:
        return (float(np.median(ex)), float(np.median(ey))), (0.0, 0.0)
    (tx, ex0), (ty, ey0) = np.polyfit(middle, ex, 1), np.polyfit(middle, ey, 1)
    return (float(ex0), float(ey0)), (float(tx), float(ty))


def _outlier_sectors(angle: Array, wave: Wave) -> Mask:
    """Sectors (SECTORS,) in which most samples are outliers, and their neighbours."""
    sector = sector_of(angle)
    seen = np.bincount(sector, minlength=SECTORS)
    wrong = np.bincount(sector[wave.outliers], minlength=SECTORS)
    mask = (wrong > 0) & (2 * wrong >= seen)
    return np.asarray(mask | np.roll(mask, 1) | np.roll(mask, -1))


def _find_speed(angle: Array, traces: Array) -> float:
    """Relative error of the stated speed: the one at which the traces repeat best; 0 if none is better."""
    every = -(-angle.size // SPEED_PROFILES)
    angle, traces = angle[::every], traces[:, ::every]
    seen = np.isfinite(traces).any(axis=0)  # whole profiles may be lost
    angle, trace = angle[seen], nan_median(traces[:, seen], axis=0)

    def cost(speed: float) -> float:
        turned = angle + speed * (angle - angle[0])
        wave = fit_harmonics_robustly(turned, trace, orders, least=0.01, passes=SPEED_PASSES)
        return float(np.abs(trace - wave(turned)).mean())

    turns = float(np.ptp(angle)) / tau
    orders = (1, 2, 3, 4, 5, 6) if turns > LEAST_REPEATED_TURNS else (1, 2)
    nominal = cost(0.0)
    best, width, costs = 0.0, SPEED_RANGE, [nominal]
    for _ in range(3):
        tried = best + np.linspace(-width, width, 33)
        costs = [cost(float(k)) for k in tried]
        best, width = float(tried[int(np.argmin(costs))]), width / 16
    return best if min(costs) < MOST_COST_RATIO * nominal else 0.0
