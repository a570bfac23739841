"""The published method, step by step: Klarák et al., Sensors 2022, 22, 5306 (method name ``paper``).

Kept faithful, so that anyone can reproduce the paper and see the difference; each function names its equation. Where
the print can't be meant (Eq. 4 is no rotation, Eq. 6 leaves out the radius) the text's evident meaning is followed;
``tests/calibration/test_paper.py`` shows the printed form. What the method leaves wrong is described in docs/theory.md,
*Reading the paper*, and tested: the leakage that is its "0.26 pi", the second harmonic e^2/4R, the polar angles.
"""

from dataclasses import dataclass
from math import atan, atan2, hypot, pi

import numpy as np

from truestand.calibration.checks import angle_zero_reasons
from truestand.calibration.segment import Segments
from truestand.calibration.start import LEAST_REVOLUTIONS, MOST_ECCENTRICITY_MM
from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.calibration import Calibration, PaperFigures, Residuals, ScanSummary
from truestand.core.errors import NotEnoughData
from truestand.core.frames import LaserPlane, Pose, shaft_from_rotor, table_from_sensor
from truestand.core.harmonics import Bin, Harmonics, fit_harmonics, nearest_bin, wrap
from truestand.core.scan import Scan


def calibrate_paper(scan: Scan, artefact: Artefact, segments: Segments) -> Calibration:
    """The paper's calibration of a scan (its Section 3).

    Raises:
        NotEnoughData: less than half a turn, or the base surface is not seen.
    """
    base = base_surface(scan, artefact, segments)
    phi = axis_angle(base_line(base), segments.phi)
    radial = radial_coordinate(base, phi)
    trace = radial_signal(radial)
    wave = compensation_wave(scan.angle, trace)
    nearest = nearest_bin(filled(trace), scan.revolutions)
    residuals = compensate(radial, scan.angle, wave) - wave.mean
    pose = _pose(artefact, segments, base, phi, wave.mean)
    return _calibration(scan, artefact, segments, pose, wave, nearest, trace, residuals)


@dataclass(frozen=True, slots=True)
class BaseSurface:
    """Readings of the base cylinder (N, W) mm; NaN elsewhere. W columns hold all of it."""

    x: Array
    z: Array


def base_surface(scan: Scan, artefact: Artefact, segments: Segments) -> BaseSurface:
    """Step 2: the points on the base cylinder. The paper chose them by hand; the segmentation does it here."""
    if scan.revolutions < LEAST_REVOLUTIONS:
        raise NotEnoughData(f"need one full revolution, got {scan.revolutions:.2f}; scan for longer")
    band = next((b for b in segments.bands if b.cylinder == 0), None)
    if band is None:
        raise _base_not_seen(artefact)
    steps = [abs(c.radius - artefact.base.radius) for c in artefact.cylinders[1:]]
    reach = min([MOST_ECCENTRICITY_MM, *(0.45 * step for step in steps)])
    on = np.empty(scan.x.shape, dtype=np.bool_)
    for rows in _blocks(scan.profiles):
        u, v = segments.plane.to_uv(scan.x[rows], scan.z[rows])
        on[rows] = (np.abs(u - artefact.base.radius) < reach) & (v > band.low) & (v < band.high)
    used = np.flatnonzero(on.any(axis=0))
    if not used.size:
        raise _base_not_seen(artefact)
    columns = slice(int(used[0]), int(used[-1]) + 1)
    part = on[:, columns]
    return BaseSurface(np.where(part, scan.x[:, columns], np.nan), np.where(part, scan.z[:, columns], np.nan))


def _base_not_seen(artefact: Artefact) -> NotEnoughData:
    return NotEnoughData(f"the base surface {artefact.base.name!r} is not seen; the published method needs it")


def base_line(base: BaseSurface) -> float:
    """Step 3, Eq. 7-8: slope dz/dx of the least-squares line through the base points in the XZ plane.

    Pooled over profiles, each about its own centre: in one heap the eccentricity smears the line by its square (0.7
    degrees on the paper's stand).
    """
    seen = np.isfinite(base.z)
    count = np.maximum(seen.sum(axis=1), 1)
    sxx = sxz = 0.0
    for rows in _blocks(base.x.shape[0]):
        good = seen[rows]
        x, z = np.where(good, base.x[rows], 0.0), np.where(good, base.z[rows], 0.0)
        n = count[rows]
        sxx += float(np.einsum("ij,ij->", x, x) - (x.sum(axis=1) ** 2 / n).sum())
        sxz += float(np.einsum("ij,ij->", x, z) - (x.sum(axis=1) * z.sum(axis=1) / n).sum())
    if sxx <= 0.0:
        raise NotEnoughData("the base surface shows no length along the laser line; turn the sensor")
    return sxz / sxx


def axis_angle(slope: float, rough_phi: float) -> float:
    """Step 3: the angle between axis and sensor z from the line's slope, rad.

    The paper quotes -pi/2 - arctan(slope); of the four quadrants that fit a line, the one the segmentation found.
    """
    phi = -pi / 2 - atan(slope)
    return phi + pi * round((rough_phi - phi) / pi)


def displacement(base: BaseSurface) -> tuple[float, float]:
    """Step 4, Eq. 3, 5, 6: the point (x, z) mm with the smallest Z. One bad point of seven million moves it."""
    i = int(np.nanargmin(base.z))
    return float(base.x.flat[i]), float(base.z.flat[i])


def radial_coordinate(base: BaseSurface, phi: float) -> Array:
    """Step 5, Eq. 1, 4: the radial coordinate (N, W) mm, counted from the displacement of step 4."""
    x0, z0 = displacement(base)
    across_x, across_z = LaserPlane(phi).across
    radial = np.empty_like(base.x)
    for rows in _blocks(base.x.shape[0]):
        radial[rows] = across_x * (base.x[rows] - x0) + across_z * (base.z[rows] - z0)
    return radial


def radial_signal(radial: Array) -> Array:
    """Step 6: one radial value a profile (N,) mm, the mean over its base points; NaN where none is seen."""
    seen = np.isfinite(radial)
    count = seen.sum(axis=1)
    total = np.where(seen, radial, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def filled(trace: Array) -> Array:
    """The trace with gaps interpolated: a Fourier transform needs every sample."""
    seen = np.isfinite(trace)
    at = np.arange(trace.size)
    return np.interp(at, at[seen], trace[seen])


def compensation_wave(angle: Array, trace: Array) -> Harmonics:
    """Step 7, Eq. 2, 9: the once-per-turn wave at the frequency that the table's speed gives, by least squares."""
    return fit_harmonics(angle, trace, (1,))


def wave_phase(wave: Harmonics, angle: Array) -> float:
    """Phase p of the wave written A cos(w i + p) over the profile number i, rad."""
    forwards = np.sign(angle[-1] - angle[0])
    return wrap(float(forwards * angle[0]) + atan2(-float(forwards * wave.sin[0]), float(wave.cos[0])))


def arcsine_shift(angle: Array, trace: Array, wave: Harmonics, nearest: Bin) -> float:
    """Step 7: the phase between the Fourier wave and the measured one by the mean difference of arcsines, rad.

    The arcsine alone folds at +-pi/2; a sample a quarter turn on tells the rising branch from the falling one, so that
    like is compared with like.
    """
    turn = np.abs(angle - angle[0])
    amplitude = hypot(float(wave.cos[0]), float(wave.sin[0]))
    ratio = np.clip((filled(trace) - wave.mean) / amplitude, -1.0, 1.0)
    later = np.interp(turn + pi / 2, turn, ratio, right=np.nan)
    measured = np.where(later >= 0, np.arcsin(ratio), pi - np.arcsin(ratio))
    fourier = turn - nearest.phase + pi / 2
    difference = np.exp(1j * (fourier - measured))[np.isfinite(later)]
    return float(np.angle(difference.mean()))


def compensate(radial: Array, angle: Array, wave: Harmonics) -> Array:
    """Step 8: the radial coordinate less the compensation wave (its mean stays), same shape."""
    return radial - (wave(angle) - wave.mean)[:, None]


def _calibration(
    scan: Scan,
    artefact: Artefact,
    segments: Segments,
    pose: Pose,
    wave: Harmonics,
    nearest: Bin,
    trace: Array,
    residuals: Array,
) -> Calibration:
    ex, ey = float(wave.cos[0]), -float(wave.sin[0])
    deviation = np.abs(residuals[np.isfinite(residuals)])
    summary = Residuals(float(np.sqrt(np.mean(deviation**2))), float(np.quantile(deviation, 0.9)), deviation.size, 0)
    fit_phase = wave_phase(wave, scan.angle)
    figures = PaperFigures(
        bin=nearest.index,
        bin_amplitude=nearest.amplitude,
        fit_amplitude=hypot(ex, ey),
        phase_error_pi=wrap(-nearest.phase - fit_phase) / pi,
        arcsine_shift_pi=arcsine_shift(scan.angle, trace, wave, nearest) / pi,
    )
    hidden = () if segments.shoulder_seen else ("height",)
    return Calibration(
        method="paper",
        table_from_sensor=pose,
        shaft_from_rotor=shaft_from_rotor(ex, ey, 0.0, 0.0),
        stand=scan.stand,
        angle_source=scan.angle_source,
        angle_zero=scan.angle_zero,
        rad_per_profile=None if scan.angle_source == "encoder" else abs(scan.step),
        artefact=artefact,
        residuals=summary,
        not_identifiable=("laser_plane_offset_mm", "laser_plane_tilt_deg", "tilt_mrad", "tilt_direction_deg", *hidden),
        reasons=(*segments.reasons, *angle_zero_reasons(scan.angle_zero)),
        scan=ScanSummary.of(scan),
        paper=figures,
        valid_until=artefact.valid_until,
    )


def _pose(artefact: Artefact, segments: Segments, base: BaseSurface, phi: float, mean: float) -> Pose:
    """The sensor's pose: the mean radial signal put at the base's radius (Eq. 6 with R added), height zero as found."""
    x0, z0 = displacement(base)
    u, v = LaserPlane(phi).to_uv(np.array(x0), np.array(z0))
    # The height of the segmentation belongs to its own angle; the displaced point is where both must agree.
    height = segments.plane.to_uv(np.array(x0), np.array(z0))[1] - v
    return table_from_sensor(phi, artefact.base.radius - mean - float(u), float(height), 0.0, 0.0)


def _blocks(profiles: int, size: int = 256) -> list[slice]:
    return [slice(i, min(i + size, profiles)) for i in range(0, profiles, size)]
