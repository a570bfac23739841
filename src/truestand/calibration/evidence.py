"""What a report shows of a calibration: small arrays, computed here so that the report only draws them.

Everything is made from evenly spread profiles of the scan and from the calibrations themselves, by the same ``roll``
that users call: what is drawn is what they get.
"""

from dataclasses import dataclass, replace
from math import tau

import numpy as np

from truestand.calibration.paper import radial_signal
from truestand.calibration.segment import EDGE_MARGIN_MM
from truestand.core.arrays import Array, Ints, Mask
from truestand.core.artefact import Artefact, Cylinder
from truestand.core.calibration import Calibration
from truestand.core.frames import LaserPlane, sensor_parameters, shaft_from_rotor
from truestand.core.harmonics import fit_harmonics
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration, table_angle

SAMPLED_PROFILES = 1200
RAW_COLUMNS = 320
MAP_ANGLES, MAP_HEIGHTS = 360, 60
NEAR_MM = 1.5
"""Readings this near to a cylinder are drawn as its own."""
HIGHEST_UPR = 12.0


@dataclass(frozen=True, slots=True)
class RawMap:
    """Range (rows, columns) mm as it came; NaN = not seen. Rows span ``turns`` table turns."""

    range: Array
    turns: float


@dataclass(frozen=True, slots=True)
class Projection:
    """The scan seen along the direction of travel: readings x, z (n,) mm, and which cylinder each was taken for."""

    x: Array
    z: Array
    cylinder: Ints
    """Index in ``names``; -1 = none of them."""
    names: tuple[str, ...]
    line_x: Array
    line_z: Array
    """Two points on the base line."""
    phi: float
    """rad."""


@dataclass(frozen=True, slots=True)
class Wave:
    """The base's radial signal over table turns, and what is fitted to it; mm."""

    turns: Array
    signal: Array
    fitted: Array
    """First harmonic by least squares at the table's own frequency."""
    fourier: Array
    """The nearest Fourier bin's wave: its amplitude, phase and frequency."""


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitude (mm) over frequency (per turn) of the base's radial signal, and the fit to compare with it."""

    frequency: Array
    amplitude: Array
    """Of the discrete Fourier transform: only these bins exist in a scan of this length."""
    dense_frequency: Array
    dense_amplitude: Array
    """Between the bins: the leakage made visible."""
    bin: int
    fit_amplitude: float
    """At one per turn."""


@dataclass(frozen=True, slots=True)
class FlatMap:
    """Deviation from the nominal radius (MAP_HEIGHTS, MAP_ANGLES * turns) mm over height and table turns."""

    surface: str
    turns: float
    low: float
    high: float
    before: Array
    paper: Array | None
    stand: Array
    residual: Array
    """After the fitted form, and the bearing's waves."""


@dataclass(frozen=True, slots=True)
class Rolled:
    """One cross-section of a surface rolled up: polar angle (n,) rad and deviation (n,) mm from the nominal radius."""

    surface: str
    radius: float
    height: float
    before: tuple[Array, Array]
    paper: tuple[Array, Array] | None
    stand: tuple[Array, Array]


@dataclass(frozen=True, slots=True)
class Evidence:
    """All that the report of a calibration draws."""

    raw: RawMap
    projection: Projection
    wave: Wave
    spectrum: Spectrum
    maps: tuple[FlatMap, ...]
    rolled: tuple[Rolled, ...]


def gather(scan: Scan, artefact: Artefact, calibration: Calibration, paper: Calibration | None = None) -> Evidence:
    """The evidence of a calibration by the exact model, and of the published method where given.

    Raises:
        NotEnoughData: no reading of the base, or fewer samples than the fit of its wave needs.
    """
    part = scan.taken(scan.spread(SAMPLED_PROFILES))
    uncentred = replace(calibration, shaft_from_rotor=shaft_from_rotor(0.0, 0.0, 0.0, 0.0), method="stand")
    surfaces = (
        apply_calibration(part, uncentred),
        None if paper is None else apply_calibration(part, paper),
        apply_calibration(part, calibration),
    )
    angle = table_angle(part, calibration)
    turns = np.abs(angle - angle[0]) / tau
    seen = [c for c in artefact.cylinders if _on(surfaces[2], c).sum() > 200]
    wave, spectrum = _signal(surfaces[0], angle, turns, seen[0] if seen else artefact.base, scan)
    return Evidence(
        raw=_raw(scan),
        projection=_projection(part, calibration, surfaces[2], tuple(seen)),
        wave=wave,
        spectrum=spectrum,
        maps=tuple(_flat(c, surfaces, turns, calibration, calibration.bearing_at(angle)) for c in seen),
        rolled=tuple(_rolled(c, surfaces) for c in seen),
    )


def _raw(scan: Scan) -> RawMap:
    rows = scan.spread(600)
    columns = np.unique(np.linspace(0, scan.x.shape[1] - 1, RAW_COLUMNS).astype(np.intp))
    return RawMap(scan.z[np.ix_(rows, columns)], scan.revolutions)


def _on(surface: Surface, cylinder: Cylinder) -> Mask:
    margin = min(EDGE_MARGIN_MM, 0.15 * cylinder.length)
    return np.asarray(
        (np.abs(surface.radius - cylinder.radius) < NEAR_MM)
        & (surface.z > cylinder.bottom + margin)
        & (surface.z < cylinder.top - margin)
    )


def _projection(part: Scan, calibration: Calibration, surface: Surface, seen: tuple[Cylinder, ...]) -> Projection:
    which = np.full(part.x.shape, -1, dtype=np.intp)
    for k, cylinder in enumerate(seen):
        which[_on(surface, cylinder)] = k
    row, column = np.nonzero(np.isfinite(part.z))
    pick = np.unique(np.linspace(0, row.size - 1, 12000).astype(np.intp))
    row, column = row[pick], column[pick]
    phi, radial, height, _, _ = sensor_parameters(calibration.table_from_sensor)
    ends = np.array([-1.0, 1.0]) * 12.0
    base = seen[0].radius if seen else 0.0
    at = np.nanmedian(surface.z[which == 0]) if (which == 0).any() else 0.0
    line = LaserPlane(phi, radial, height).from_uv(np.full(2, base), ends + at)
    return Projection(
        part.x[row, column],
        part.z[row, column],
        which[row, column],
        tuple(c.name for c in seen),
        *line,
        phi,
    )


def _signal(uncentred: Surface, angle: Array, turns: Array, cylinder: Cylinder, scan: Scan) -> tuple[Wave, Spectrum]:
    radius = np.where(_on(uncentred, cylinder), uncentred.radius, np.nan)
    signal = radial_signal(radius) - cylinder.radius
    good = np.isfinite(signal)
    fit = fit_harmonics(angle, signal, (1,))
    even = np.linspace(0.0, turns[-1], turns.size)
    steady = np.interp(even, turns[good], signal[good]) - np.nanmean(signal)
    total = scan.revolutions
    fine = np.linspace(0.02, HIGHEST_UPR, 1500)
    dense = np.abs(np.exp(-1j * tau * np.multiply.outer(fine, even)) @ steady) * 2 / steady.size
    bins = np.arange(0, int(HIGHEST_UPR * total) + 1)
    values = np.exp(-1j * tau * np.multiply.outer(bins / total, even)) @ steady * 2 / steady.size
    nearest = max(1, round(total))
    fourier = np.nanmean(signal) + np.abs(values[nearest]) * np.cos(
        tau * nearest / total * turns + np.angle(values[nearest])
    )
    spectrum = Spectrum(bins / total, np.abs(values), fine, dense, nearest, fit.amplitude(1))
    return Wave(turns, signal, fit(angle), fourier), spectrum


def _flat(
    cylinder: Cylinder,
    surfaces: tuple[Surface, Surface | None, Surface],
    turns: Array,
    calibration: Calibration,
    bearing: Array,
) -> FlatMap:
    before, paper, stand = surfaces
    on = _on(stand, cylinder)
    low, high = float(stand.z[on].min()), float(stand.z[on].max())
    at = np.broadcast_to(turns[:, None], on.shape)[on]
    columns = max(1, round(MAP_ANGLES * min(float(turns[-1]), 5.0)))
    form = calibration.form_of(cylinder.name, stand.angle) + bearing[:, None]

    def mapped(deviation: Array) -> Array:
        return _binned(deviation[on], stand.z[on], at, (low, high), float(turns[-1]), columns)

    return FlatMap(
        cylinder.name,
        float(turns[-1]),
        low,
        high,
        mapped(before.radius - cylinder.radius),
        None if paper is None else mapped(paper.radius - cylinder.radius),
        mapped(stand.radius - cylinder.radius),
        mapped(stand.radius - cylinder.radius - form),
    )


def _binned(
    values: Array, heights: Array, turns: Array, span: tuple[float, float], total: float, columns: int
) -> Array:
    """Means (MAP_HEIGHTS, columns) over height and turns; NaN where nothing was seen."""
    row = np.clip(
        ((heights - span[0]) / max(span[1] - span[0], 1e-9) * MAP_HEIGHTS).astype(np.intp), 0, MAP_HEIGHTS - 1
    )
    column = np.clip((turns / max(total, 1e-9) * columns).astype(np.intp), 0, columns - 1)
    index, size = row * columns + column, MAP_HEIGHTS * columns
    count = np.bincount(index, minlength=size)
    means = np.bincount(index, values, minlength=size) / np.maximum(count, 1)
    return np.where(count > 0, means, np.nan).reshape(MAP_HEIGHTS, columns)


def _rolled(cylinder: Cylinder, surfaces: tuple[Surface, Surface | None, Surface]) -> Rolled:
    before, paper, stand = surfaces
    height = float(np.median(stand.z[_on(stand, cylinder)]))

    def section(surface: Surface) -> tuple[Array, Array]:
        near = _on(surface, cylinder) & (np.abs(surface.z - height) < 0.5)
        angle = np.where(near, surface.angle, 0.0)
        count = near.sum(axis=1)
        rows = count > 0
        # Within one profile the polar angle hardly changes; averaged as a direction it can't fold at 180 degrees.
        direction = np.angle(np.where(near, np.exp(1j * angle), 0.0).sum(axis=1)[rows])
        deviation = np.where(near, surface.radius - cylinder.radius, 0.0).sum(axis=1)[rows] / count[rows]
        order = np.argsort(direction)
        return np.asarray(direction[order]), np.asarray(deviation[order])

    return Rolled(
        cylinder.name,
        cylinder.radius,
        height,
        section(before),
        None if paper is None else section(paper),
        section(stand),
    )
