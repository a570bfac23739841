"""A start for the exact model from the segmentation: eccentricity and table speed from the profiles' own medians."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.core.artefact import Artefact
from truestand.core.errors import NotEnoughData
from truestand.core.frames import facing
from truestand.core.harmonics import Harmonics, fit_harmonics_robustly
from truestand.core.scan import Scan
from truestand.core.segment import Segments

Array = NDArray[np.float64]

SAMPLED_PROFILES = 1000
SEARCHED_PROFILES = 500
"""Of these, the ones that a hundred speeds are tried on."""
REACH = 4.0
"""mm: most eccentric shaft that is looked for."""
SPEED_SEARCH = 0.08
"""Relative: how wrong a stated table speed may be and still be found."""
LEAST_REVOLUTIONS = 0.5


@dataclass(frozen=True, slots=True)
class RoughStand:
    """Start values: mm and rad."""

    radial: float
    eccentricity: tuple[float, float]
    speed: float
    """Relative error of the stated table speed."""


def rough_stand(scan: Scan, segments: Segments, artefact: Artefact) -> RoughStand:
    """Eccentricity vector and, where the scan has no angle of its own, the table's speed.

    Raises:
        NotEnoughData: less than half a turn, or too few profiles that show the artefact.
    """
    if scan.revolutions < LEAST_REVOLUTIONS:
        raise NotEnoughData(
            f"need one full revolution, got {scan.revolutions:.2f}; scan for longer (or check the table's speed)"
        )
    angle, trace = base_trace(scan, segments, artefact)
    speed = _find_speed(angle, trace) if scan.angle_source in ("index", "time") else 0.0
    wave, _ = _robust_wave(angle + speed * (angle - scan.angle[0]), trace)
    # Seen along T's X the axis stands at e cos(beta + theta): cos -> ex, sin -> -ey.
    return RoughStand(segments.radial - wave.mean, (float(wave.cos[0]), -float(wave.sin[0])), speed)


def base_trace(scan: Scan, segments: Segments, artefact: Artefact) -> tuple[Array, Array]:
    """Table angle and median radial deviation (n,) mm of the artefact's surfaces, for profiles spread over the scan."""
    rows = np.unique(np.linspace(0, scan.profiles - 1, SAMPLED_PROFILES).astype(np.intp))
    x, z = scan.x[rows], scan.z[rows]
    c, s = np.cos(segments.phi), np.sin(segments.phi)
    u = facing(segments.phi) * (c * x - s * z) + segments.radial
    v = s * x + c * z + segments.height
    deviation = np.full(u.shape, np.nan)
    for band in segments.bands:
        off = u - artefact.cylinders[band.cylinder].radius
        on = (v > band.low) & (v < band.high) & (np.abs(off) < REACH)
        deviation[on] = off[on]
    enough = np.count_nonzero(np.isfinite(deviation), axis=1) >= 5
    if np.count_nonzero(enough) < 20:
        raise NotEnoughData(
            f"found the artefact in {np.count_nonzero(enough)} of {rows.size} profiles, need 20; "
            "check exposure and range"
        )
    return scan.angle[rows[enough]], np.nanmedian(deviation[enough], axis=1)


def _robust_wave(angle: Array, trace: Array) -> tuple[Harmonics, float]:
    """First two harmonics by least absolute deviations, and their mean absolute residual in mm."""
    wave = fit_harmonics_robustly(angle, trace, (1, 2), least=0.01)
    return wave, float(np.abs(trace - wave(angle)).mean())


def _find_speed(angle: Array, trace: Array) -> float:
    """Relative error of the stated speed: the one at which the trace repeats best; 0 if none is better."""
    few = slice(None, None, -(-angle.size // SEARCHED_PROFILES))
    angle, trace = angle[few], trace[few]
    nominal = _robust_wave(angle, trace)[1]
    best, width = 0.0, SPEED_SEARCH
    for _ in range(3):
        tried = best + np.linspace(-width, width, 33)
        costs = [_robust_wave(angle + k * (angle - angle[0]), trace)[1] for k in tried]
        best, width = float(tried[int(np.argmin(costs))]), width / 16
    return best if min(costs) < 0.97 * nominal else 0.0
