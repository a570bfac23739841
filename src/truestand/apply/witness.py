"""The witness band: shaft that shows in a scan of a part, and what it says about the calibration that is applied there.

Where the shaft is in view below or above the part, its first harmonic tells once more where the sensor stands radially,
how eccentric the shaft runs, and, if nothing else does, from which zero the table's angle counts: the shaft's axis lies
in a known direction of the rotor. Everything else (phi, laser plane, tilt, form) is taken from the calibration.
"""

from dataclasses import dataclass, replace
from math import atan2, hypot, pi, sqrt, tau

import numpy as np

from truestand.calibration.covariance import clustered
from truestand.calibration.robust_wave import robust_wave
from truestand.core.arrays import Array, Ints, Mask
from truestand.core.artefact import Cylinder
from truestand.core.assumptions import COAXIALITY_U, K
from truestand.core.calibration import Calibration, Wobble
from truestand.core.frames import axis_sensitivity, in_table, shaft_parameters
from truestand.core.harmonics import wrap
from truestand.core.robust import robust_sd, row_medians, tukey_fit
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration, table_angle

SAMPLED_PROFILES = 2000
REACH_MM = 1.5
"""By which the shaft may run more eccentrically than it did and still be looked for; a gear is farther out."""
SLEEVE_MM = 0.1
"""By which a surface may differ from the one nearest to its drawing; beyond it, it was put on the shaft."""
BIN_MM = 0.25
"""Height of the bins that are the shaft's or not."""
EDGE_MARGIN_MM = 0.5
"""From a cylinder's ends, where chamfers, fillets and burrs are: not used."""
LEAST_SHAFT_SHARE = 0.7
"""Share of a bin's readings that must be the shaft's."""
LEAST_USUAL_SHARE = 0.2
"""Share of the usual number of readings that a bin must have."""
LEAST_HEIGHT_MM = 1.0
"""Of shaft in view that makes a band."""
LEAST_READINGS = 3
LEAST_REVOLUTIONS = 0.75
LEAST_PROFILES = 50
SECTORS = 72
SETTLED_RAD = 1e-7
MOST_STEPS = 20
LEAST_LIMIT_MM = 1e-7
"""Deviations below it are no outliers, however alike all others are."""
MOST_WAVES, NO_NOISE = 60, 5.0
"""Waves a turn that are looked for; standard deviations of its size from which a wave is none of noise."""
RATE_OF_MEAN = sqrt(12.0)
"""U of how much a value changes over a scan, over that of its mean, where both are told by noise."""
SPEED_SURE, DIRECTION_U = 2.0, 0.01
"""U by which a table must be found to turn at another speed than at the calibration for it to be believed; rad of U of
the shaft's direction up to which it is looked for.
"""
TURN_STEP = 1e-3
"""rad by which the scan is turned to see what its readings do then."""
BEARING_CHANGE_U = 2e-4
"""mm, k = 2: by how much a good table's axis runs differently from one scan to the next; what repeats cancels."""


@dataclass(frozen=True, slots=True)
class Witness:
    """What the band says; mm and rad, U with k = 2."""

    surfaces: tuple[str, ...]
    height: float
    """mm of shaft in view."""
    angle_shift: float
    """What has to be added to the scan's table angle so that it counts from the calibration's zero."""
    angle_U: float
    gained: float
    """By how much too little that angle counts from the scan's first profile to its last, beside: the table turned
    faster than at the calibration. 0: a scan with an angle of its own, or no speed to be told from the calibration's.
    """
    gained_U: float
    radial: float
    """By how much the sensor stands farther out than the calibration says."""
    radial_U: float
    drift: float
    """By how much it moves outwards, or inwards, while the scan is taken,"""
    drift_U: float
    wobble: Wobble | None
    """The strongest wave that the calibration does not know."""
    eccentricity_change: tuple[float, float]
    """Axis of the shaft against the calibration's, x and y in R, at the scan's own zero of the angle."""
    eccentricity_size: float
    """By how much it runs more eccentrically, whatever the zero of the angle."""
    eccentricity_U: float
    change_U: float
    """Of ``eccentricity_change``, in the direction in which it is known worst."""

    @property
    def shift_at_start(self) -> tuple[float, float]:
        """``angle_shift`` of the scan's first profile, where the table stood at its zero, and its U."""
        return self.angle_shift - self.gained / 2, hypot(self.angle_U, self.gained_U / 2)

    def tied(self, scan: Scan) -> Scan:
        """The scan with its table angle counted from the calibration's zero, at the speed at which the table turned."""
        return _turned(scan, self.angle_shift, self.gained)


def witness(scan: Scan, calibration: Calibration) -> Witness | None:
    """What the shaft in view of a scan says; None where too little of it shows, or the drawing is not known.

    The published method's calibration holds no pose of the shaft to compare with: None.
    """
    if calibration.artefact is None or calibration.method == "paper" or scan.revolutions < LEAST_REVOLUTIONS:
        return None
    sampled = scan.taken(scan.spread(SAMPLED_PROFILES))
    start = _shaft_bands(sampled, calibration)
    if start is None:
        return None
    shift, bands = start
    found = _witness_of(_tied(sampled, calibration, shift, bands), calibration, bands)
    if scan.free_speed and found.angle_U < DIRECTION_U:
        shift = found.angle_shift
        faster = _witness_of(_tied(sampled, calibration, shift, bands, at_any_speed=True), calibration, bands)
        found = faster if abs(faster.gained) > SPEED_SURE * faster.gained_U else found
    return None if abs(found.radial) > REACH_MM else found  # something else, taken for the shaft


@dataclass(frozen=True, slots=True)
class _Band:
    """Readings (N, M) of one cylinder that are used."""

    cylinder: Cylinder
    on: Mask
    height: float
    """mm of it in view."""


@dataclass(frozen=True, slots=True)
class _Fit:
    """Sensor's radial move and the axis' sideways move (x, y) in R, mm, with their covariance (3, 3)."""

    move: Array
    covariance: Array
    middle: float
    """mm: mean height of the readings."""
    drift: float
    """mm by which the sensor moves from the scan's first profile to its last,"""
    drift_variance: float
    """mm^2."""
    wobble: Wobble | None
    gained: float
    """rad by which the table turned farther than its angle says, from the scan's first profile to its last,"""
    gained_variance: float
    """rad^2; 0: of a speed that is not fitted."""


@dataclass(frozen=True, slots=True)
class _Tied:
    """The fit at the table angle at which the shaft's axis lies where the calibration has it."""

    fit: _Fit
    shift: float
    gained: float
    """rad, of the table angle: as of ``Witness``."""


def _tied(scan: Scan, calibration: Calibration, shift: float, bands: list[_Band], at_any_speed: bool = False) -> _Tied:
    gained = 0.0
    for _ in range(MOST_STEPS):
        fit = _fitted(_turned(scan, shift, gained), calibration, bands, at_any_speed)
        turn = _turn(fit, calibration)
        if max(abs(turn), abs(fit.gained)) < SETTLED_RAD:
            break
        shift, gained = shift + turn, gained + fit.gained
    return _Tied(fit, shift, gained)


def _turned(scan: Scan, shift: float, gained: float) -> Scan:
    """The scan with its table angle farther by a ``shift``, and by what it ``gained`` over the scan, rad."""
    return replace(scan, angle=scan.angle + shift + gained * scan.time_at(np.arange(scan.profiles)))


def _shaft_bands(scan: Scan, calibration: Calibration) -> tuple[float, list[_Band]] | None:
    """Which readings are the shaft's, and the zero of the table's angle by the direction of its first harmonic."""
    assert calibration.artefact is not None
    angle = table_angle(scan, calibration)
    u, v = in_table(calibration.table_from_sensor, scan.x, scan.z)
    ex, ey, tx, ty = shaft_parameters(calibration.shaft_from_rotor)
    bands, shifts, offsets = [], [], []
    for cylinder in calibration.artefact.cylinders:
        ends = [hypot(ex + tx * h, ey + ty * h) for h in (cylinder.bottom, cylinder.top)]
        on = _shaft_in_view(u, v, cylinder, max(ends) + REACH_MM)
        trace = row_medians(u - cylinder.radius, on, LEAST_READINGS)
        seen = np.isfinite(trace)
        if np.count_nonzero(seen) < max(LEAST_PROFILES, 0.5 * seen.size):
            continue
        wave = robust_wave(angle[seen], trace[seen])
        outliers = np.zeros(seen.size, dtype=np.bool_)
        outliers[seen] = wave.outliers
        on = on & ~outliers[:, None]  # more than half of the trace is the wave's
        middle = float(np.median(v[on]))
        bands.append(_Band(cylinder, on, float(np.ptp(v[on]))))
        # Seen along T's X the axis stands at e cos(beta + theta): cos -> ex, sin -> -ey.
        now = atan2(-float(wave.series.sin[0]), float(wave.series.cos[0]))
        # p_R = Rz(-theta) p_T: an angle that counts too little by the shift turns the axis on by it.
        shifts.append(wrap(now - atan2(ey + ty * middle, ex + tx * middle)))
        offsets.append(wave.series.mean)
    if not bands:
        return None
    bare = [i for i, offset in enumerate(offsets) if abs(offset - min(offsets, key=abs)) < SLEEVE_MM]
    largest = max(bare, key=lambda i: np.count_nonzero(bands[i].on))
    return shifts[largest], [bands[i] for i in bare]


def _shaft_in_view(u: Array, v: Array, cylinder: Cylinder, reach: float) -> Mask:
    """Readings (N, M) on the heights of a cylinder at which mostly nothing else is seen."""
    low, high = cylinder.bottom + EDGE_MARGIN_MM, cylinder.top - EDGE_MARGIN_MM
    count = max(int((high - low) / BIN_MM), 1)
    off = u - cylinder.radius
    inside = (v >= low) & (v < low + count * BIN_MM)
    near = inside & (np.abs(off) < reach)
    index = np.floor((np.where(inside, v, low) - low) / BIN_MM).astype(np.intp).clip(0, count - 1)
    seen, on_shaft = np.bincount(index[inside], minlength=count), np.bincount(index[near], minlength=count)
    mean = np.bincount(index[near], off[near], count) / np.maximum(on_shaft, 1)
    shaft = _shaft_bins(seen, on_shaft, mean)
    return np.asarray(near & (shaft[index] & (np.count_nonzero(shaft) * BIN_MM >= LEAST_HEIGHT_MM)))


def _shaft_bins(seen: Ints, on_shaft: Ints, mean: Array) -> Mask:
    """Which bins (n,) of height are the shaft's: enough readings, mostly its own, and no sleeve on it."""
    if not on_shaft.any():
        return np.zeros(on_shaft.size, dtype=np.bool_)
    shaft = np.asarray(
        (on_shaft > 0)
        & (on_shaft >= LEAST_SHAFT_SHARE * seen)
        & (on_shaft > LEAST_USUAL_SHARE * np.median(on_shaft[on_shaft > 0]))
    )
    # Bins at the end of the view see the shaft only while it runs out towards them, and read it too large: few alike.
    alike = (np.abs(mean[:, None] - mean) < SLEEVE_MM / 2) @ np.where(shaft, on_shaft, 0)
    nearest = min(mean[shaft & (alike >= LEAST_USUAL_SHARE * alike[shaft].max(initial=0))], key=abs, default=0.0)
    return np.asarray(shaft & (np.abs(mean - nearest) < SLEEVE_MM))


def _fitted(scan: Scan, calibration: Calibration, bands: list[_Band], at_any_speed: bool) -> _Fit:
    """How far sensor and axis have moved by the scan's table angle, and how they go on moving: robust least squares."""
    off, angle = _off(scan, calibration, bands), table_angle(scan, calibration)
    psi, row, time = off.psi, off.row, scan.time_at(off.row)
    # Farther out along T's X the sensor sees more; an axis that has moved towards the reading sees less.
    design = np.column_stack([np.cos(psi + angle[row]), -np.cos(psi), -np.sin(psi)])
    sectors = np.floor(psi * (SECTORS / tau)).astype(np.intp) % SECTORS
    move, covariance = _robust_fit(design, -off.trace, sectors)
    over_time = [design, design[:, 0] * time]
    if at_any_speed:  # where the table turns faster, the axis comes round sooner, and form
        sooner = _off(_turned(scan, TURN_STEP, 0.0), calibration, bands)
        over_time.append((sooner.trace - off.trace) / TURN_STEP * time)
    going_on = np.column_stack(over_time)
    rates, rates_covariance = _robust_fit(going_on, -off.trace, sectors)
    wobble = _wobble(-off.trace - going_on @ rates, angle[row])
    variance = np.diag(rates_covariance)
    gained = (float(rates[4]), float(variance[4])) if at_any_speed else (0.0, 0.0)
    return _Fit(move, covariance, off.middle, float(rates[3]), float(variance[3]), wobble, *gained)


@dataclass(frozen=True, slots=True)
class _Off:
    """How far the bands' readings (n,) are off the calibrated shaft: one of each band and profile."""

    trace: Array
    """mm, outwards."""
    psi: Array
    """rad: where on the shaft."""
    row: Ints
    """Of the scan."""
    middle: float
    """mm: mean height."""


def _off(scan: Scan, calibration: Calibration, bands: list[_Band]) -> _Off:
    surface = apply_calibration(scan, calibration)
    angle = table_angle(scan, calibration)
    rows, traces, heights, azimuths = [], [], [], []
    for band in bands:
        deviation = _deviation(surface, band, calibration) - calibration.bearing_at(angle)[:, None]
        trace = row_medians(deviation, band.on, LEAST_READINGS)
        seen = np.flatnonzero(np.isfinite(trace))
        x, y = (np.where(band.on[seen], part[seen], 0.0).sum(axis=1) for part in (surface.x, surface.y))
        rows.append(seen)
        traces.append(trace[seen])
        azimuths.append(np.arctan2(y, x))
        heights.append(np.full(seen.size, float(np.median(surface.z[band.on]))))
    trace, psi, row = np.concatenate(traces), np.concatenate(azimuths), np.concatenate(rows)
    return _Off(trace, psi, row, float(np.mean(np.concatenate(heights))))


def _wobble(rest: Array, angle: Array) -> Wobble | None:
    """The strongest wave a turn, of those that noise does not make, in the ``rest`` (n,) mm of a band at table angles
    (n,) rad: the sensor or the table wobbles, or the shaft has form that the calibration left aside.
    """
    spread = max(robust_sd(rest), LEAST_LIMIT_MM)
    waves = np.arange(2, MOST_WAVES + 1)
    sizes = 2 * np.abs(np.exp(-1j * np.outer(waves, angle)) @ np.clip(rest, -4 * spread, 4 * spread)) / rest.size
    strongest = int(np.argmax(sizes))
    noise = spread * sqrt(2.0 / rest.size)
    return Wobble(int(waves[strongest]), float(sizes[strongest])) if sizes[strongest] > NO_NOISE * noise else None


def _deviation(surface: Surface, band: _Band, calibration: Calibration) -> Array:
    """Deviation (N, M) mm of the band's readings from the calibrated shaft, its form and static profile included."""
    x, y, z = (part[band.on] for part in (surface.x, surface.y, surface.z))
    name = band.cylinder.name
    deviation = np.full(band.on.shape, np.nan)
    deviation[band.on] = np.hypot(x, y) - band.cylinder.radius - calibration.form_of(name, np.arctan2(y, x))
    for s in calibration.static_profiles:
        if s.surface == name:
            deviation[band.on] -= np.interp(z, s.height, s.deviation)
    return deviation


def _robust_fit(design: Array, samples: Array, sectors: Ints) -> tuple[Array, Array]:
    """Solution (m,) by Tukey's weights and its covariance, clustered by sectors of the surface."""
    solution, weights = tukey_fit(design, samples, LEAST_LIMIT_MM)
    weighted = design * weights[:, None]
    inverse = np.linalg.pinv(weighted.T @ design)
    scores = clustered(weighted * (samples - design @ solution)[:, None], sectors)
    return solution, np.asarray(inverse @ scores @ inverse.T)


def _axis(calibration: Calibration, height: float) -> Array:
    ex, ey, tx, ty = shaft_parameters(calibration.shaft_from_rotor)
    return np.array([ex + tx * height, ey + ty * height])


def _turn(fit: _Fit, calibration: Calibration) -> float:
    """By how much the table's angle must turn on so that the axis lies where the calibration has it."""
    before = _axis(calibration, fit.middle)
    after = before + fit.move[1:]
    return wrap(atan2(after[1], after[0]) - atan2(before[1], before[0]))


def _witness_of(found: _Tied, calibration: Calibration, bands: list[_Band]) -> Witness:
    fit, shift = found.fit, found.shift
    axis = _axis(calibration, fit.middle)
    size = max(hypot(*axis), 1e-9)
    along = axis / size
    across = np.array([-along[1], along[0]])
    more = float(along @ fit.move[1:])
    c, s = np.cos(shift), np.sin(shift)
    moved = np.array([[c, -s], [s, c]]) @ (axis + more * along) - axis
    covariance = _move_covariance(fit, calibration, bands)
    return Witness(
        surfaces=tuple(b.cylinder.name for b in bands),
        height=float(sum(b.height for b in bands)),
        angle_shift=wrap(shift),
        angle_U=min(K * sqrt(float(across @ covariance @ across)) / size, pi),
        gained=found.gained,
        gained_U=hypot(K * sqrt(fit.gained_variance), RATE_OF_MEAN * BEARING_CHANGE_U / size) if found.gained else 0.0,
        radial=float(fit.move[0]),
        radial_U=K * sqrt(float(fit.covariance[0, 0])),
        drift=fit.drift,
        drift_U=K * sqrt(fit.drift_variance),
        wobble=fit.wobble,
        eccentricity_change=(float(moved[0]), float(moved[1])),
        eccentricity_size=more,
        eccentricity_U=K * sqrt(float(along @ covariance @ along)),
        change_U=K * sqrt(float(np.linalg.eigvalsh(covariance)[-1])),
    )


def _move_covariance(fit: _Fit, calibration: Calibration, bands: list[_Band]) -> Array:
    """Covariance (2, 2) mm2 of the axis' move: the band's own, the calibration's noise, bearing and coaxiality.

    What both scans share (certificate, mounting) cancels.
    """
    assert calibration.artefact is not None
    variance = (BEARING_CHANGE_U / K) ** 2
    total = sum(b.height for b in bands)
    for band in bands:
        if band.cylinder != calibration.artefact.base:
            variance += ((band.cylinder.coaxiality_U or COAXIALITY_U) / K * band.height / total) ** 2
    covariance = fit.covariance[1:, 1:] + variance * np.eye(2)
    if calibration.repeatability.size:
        sensitivity = axis_sensitivity(fit.middle)
        covariance = covariance + sensitivity @ calibration.repeatability @ sensitivity.T
    return np.asarray(covariance)
