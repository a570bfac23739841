"""From a fit to a calibration: poses, uncertainties, what could not be identified, checks in plain words."""

from math import degrees, hypot, sqrt

import numpy as np

from truestand.calibration.checks import NEAR_SURFACE_MM, checks_of, reasons_of
from truestand.calibration.covariance import weighed
from truestand.calibration.model import GEOMETRY, MOUNTING, PLANE, SPEED, Readings, stretches
from truestand.calibration.refine import Refined
from truestand.calibration.sag import covariance_of_sag
from truestand.calibration.uneven_form import SOURCE, covariance_of_uneven_form, uneven_form
from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.assumptions import (
    ANGLE_ZERO_U,
    ASSUMED,
    BEARING_U,
    COAXIALITY_U,
    EXPANSION,
    HEIGHT_HIDDEN_U,
    HEIGHT_SEEN_U,
    HEIGHT_ZERO,
    SCALE_U,
    TEMPERATURE_U,
    K,
)
from truestand.core.calibration import (
    TABLE_BEARING,
    Calibration,
    Harmonic,
    Residuals,
    ScanSummary,
    StaticProfile,
    Uncertainty,
    shared_waves_of,
)
from truestand.core.frames import (
    ECCENTRICITY,
    ECCENTRICITY_X,
    PHI,
    PLANE_OFFSET,
    PLANE_TILT,
    RADIAL,
    TILT,
    UNKNOWNS,
    shaft_from_rotor,
    table_from_sensor,
)
from truestand.core.scan import Scan
from truestand.uncertainty.budget import DIRECTIONS, HALF_TURN_DEG, Input, budget_of
from truestand.uncertainty.lines import diameter_name, expanded_diameter, linearity_name, linearity_of, scale_name

SHARED = " (as the waves that all surfaces share)"
IDENTIFIABLE = 0.5
"""A number is reported where the posterior u is at most this share of the prior's."""
RESIDUAL_PROFILES = 300


def calibration_of(scan: Scan, artefact: Artefact, fit: Refined) -> Calibration:
    """The calibration that follows from the exact model's fit: estimate, uncertainties, checks."""
    fit, parts = weighed(fit, fit.about, plane_identifiable(scan, artefact, fit))
    return calibration_with(scan, artefact, fit, parts)


def calibration_with(scan: Scan, artefact: Artefact, fit: Refined, parts: dict[str, Array]) -> Calibration:
    """The calibration of a fit whose unknowns have a covariance of these ``parts`` (p, p), by source."""
    p, uneven = fit.solution.parameters, uneven_form(fit)
    plane = np.asarray(sum(parts.values()))[np.ix_(PLANE, PLANE)]
    parts = parts | {
        MOUNTING: parts[MOUNTING] + covariance_of_sag(fit, plane),
        SOURCE: covariance_of_uneven_form(fit, uneven),
    }
    geometry = {name: part[:UNKNOWNS, :UNKNOWNS] for name, part in parts.items()}
    static = static_profiles(artefact, fit)
    stated = {q.name: q.u for q in reversed(fit.priors)}
    harmonics = harmonics_of(artefact, fit)
    shared = max((wave.amplitude for wave in shared_waves_of(harmonics)), default=0.0)
    budget = budget_of(p[:UNKNOWNS], geometry, _inputs(scan, artefact, fit, static, shared), _noise_dof(fit), stated)
    residuals = residuals_of(scan, fit)
    checks = checks_of(scan, artefact, fit, residuals, static, float(uneven.max()), shared)
    return Calibration(
        method="stand",
        table_from_sensor=table_from_sensor(p[PHI], p[RADIAL], fit.model.height, p[PLANE_TILT], p[PLANE_OFFSET]),
        shaft_from_rotor=shaft_from_rotor(*p[ECCENTRICITY_X:UNKNOWNS]),
        stand=scan.stand,
        angle_source=scan.angle_source,
        angle_zero=scan.angle_zero,
        speed_factor=1.0 + float(p[SPEED]) if scan.free_speed else 1.0,
        rad_per_profile=None if scan.angle_source == "encoder" else _step(scan) * (1.0 + float(p[SPEED])),
        artefact=artefact,
        residuals=residuals,
        harmonics=harmonics,
        static_profiles=static,
        uncertainty=budget,
        covariance_names=GEOMETRY[:UNKNOWNS],
        covariance=np.asarray(sum(geometry.values())),
        repeatability=geometry["noise"],
        height_repeats=fit.height_u,
        not_identifiable=_not_identifiable(scan, fit, budget),
        checks=checks,
        reasons=reasons_of(fit.segments, checks, scan.angle_zero),
        scan=ScanSummary.of(scan),
        valid_until=artefact.valid_until,
    )


def plane_identifiable(scan: Scan, artefact: Artefact, fit: Refined, coaxiality_U: float | None = None) -> bool:
    """Whether the scan can tell the laser plane: two diameters, and an eccentricity that outweighs their coaxiality.

    u(d) = u(c) / (e |1/R2 - 1/R1|), against the mounting's own u (docs/theory.md, *What the data can tell*). What else
    seems to tell d under a centred shaft comes from waves of form beyond the ones that are fitted.
    """
    cylinders = [artefact.cylinders[b.cylinder] for b in fit.segments.bands]
    curvature = max(abs(1 / c.radius - 1 / cylinders[0].radius) for c in cylinders)
    if coaxiality_U is None:
        coaxiality_U = max((c.coaxiality_U or COAXIALITY_U for c in cylinders[1:]), default=0.0)
    eccentricity = float(hypot(*fit.solution.parameters[ECCENTRICITY]))
    return len(cylinders) > 1 and coaxiality_U < eccentricity * curvature * scan.stand.sensor.mounting[0]


def _step(scan: Scan) -> float:
    """Table angle from one profile to the next, rad, whatever got lost between others."""
    return float(np.median(np.abs(np.diff(scan.angle))))


def harmonics_of(artefact: Artefact, fit: Refined) -> tuple[Harmonic, ...]:
    """Form harmonics of every cylinder in use, then the table bearing's waves."""
    names = [artefact.cylinders[band.cylinder].name for band in fit.segments.bands]
    places = [fit.model.form_slice(k) for k in range(len(names))]
    harmonics = []
    for name, place in zip([*names, TABLE_BEARING], [*places, fit.model.bearing_slice], strict=True):
        a, b = fit.solution.parameters[place].reshape(2, -1)
        harmonics += [
            Harmonic(name, n, float(hypot(c, s)), float(np.arctan2(s, c)))
            for n, c, s in zip(range(2, fit.model.orders + 1), a, b, strict=True)
        ]
    return tuple(harmonics)


def static_profiles(artefact: Artefact, fit: Refined) -> tuple[StaticProfile, ...]:
    """The static profile of every cylinder in use over height, 50 points each."""
    p = fit.solution.parameters
    profiles = []
    for k, band in enumerate(fit.segments.bands):
        height = np.linspace(band.low, band.high, 50)
        x, z = fit.plane.from_uv(np.full(height.size, fit.model.radii[k]), height)
        deviation = fit.model.static_basis(x, z, k) @ p[fit.model.static_slice(k)]
        profiles.append(StaticProfile(artefact.cylinders[band.cylinder].name, height, deviation))
    return tuple(profiles)


def residuals_of(scan: Scan, fit: Refined) -> Residuals:
    """rms and 90 % quantile of the trusted readings of evenly spread profiles; counts of all."""
    rows = scan.spread(RESIDUAL_PROFILES)
    u, v = fit.plane.to_uv(scan.x[rows], scan.z[rows])
    which = np.full(u.shape, -1, dtype=np.intp)
    for k, band in enumerate(fit.segments.bands):
        near = np.abs(u - fit.model.radii[k]) < NEAR_SURFACE_MM
        which[(v > band.low) & (v < band.high) & near] = k
    row, column = np.nonzero(which >= 0)
    readings = Readings.of(scan, rows, (row, column), which[row, column])
    size = np.abs(fit.model.residuals(fit.solution.parameters, readings))
    trusted = size[size < fit.limit[readings.cylinder]]
    rms = float(np.sqrt(np.mean(trusted**2))) if trusted.size else 0.0
    p90 = float(np.quantile(trusted, 0.9)) if trusted.size else 0.0
    return Residuals(rms, p90, fit.cells.points, fit.cells.rejected)


def _not_identifiable(scan: Scan, fit: Refined, budget: dict[str, Uncertainty]) -> tuple[str, ...]:
    """Quantities whose number would say more about the prior than about the scan."""
    sensor = scan.stand.sensor
    names = []
    if IDENTIFIABLE * sensor.mounting[0] < budget["laser_plane_offset_mm"].U:
        names.append("laser_plane_offset_mm")
    if IDENTIFIABLE * degrees(sensor.mounting[1]) < budget["laser_plane_tilt_deg"].U:
        names.append("laser_plane_tilt_deg")
    names += [key for key in DIRECTIONS if budget[key].U > IDENTIFIABLE * HALF_TURN_DEG]
    if not fit.segments.shoulder_seen:
        names.append("height")
    return tuple(names)


def height_zero_u(fit: Refined) -> float:
    """Standard uncertainty (mm) of the height 0 that a fit counts from."""
    return (HEIGHT_SEEN_U if fit.segments.shoulder_seen else max(HEIGHT_HIDDEN_U, fit.segments.open_height)) / K


def _noise_dof(fit: Refined) -> float:
    """Groups of profiles on each surface less the unknowns."""
    used = np.unique(fit.cells.group * len(fit.model.radii) + fit.cells.readings.cylinder).size
    return float(max(used - fit.model.size, 1))


def _inputs(
    scan: Scan, artefact: Artefact, fit: Refined, static: tuple[StaticProfile, ...], shared: float
) -> tuple[Input, ...]:
    """What certificate, data sheet and stand leave open and one scan can't see."""
    sensor, p = scan.stand.sensor, fit.solution.parameters
    eccentricity, tilt = 1000.0 * hypot(*p[ECCENTRICITY]), hypot(*p[TILT])
    band = fit.segments.bands[fit.segments.longest]
    base = artefact.cylinders[fit.segments.bands[0].cylinder]
    # Off by U at either end of the visible line, independently; that slope turns the line and stretches the travel, and
    # so does how the error changes along the range, which an upright line doesn't show.
    slope = sqrt(2.0) / band.length
    lever = abs(band.middle - fit.model.height)  # from the sensor's origin, about which phi turns
    more, along_it = stretches(sensor, float(p[PHI]))
    scale = SCALE_U if sensor.scale_U is None else sensor.scale_U
    # Waves that all surfaces share come from bearing or angle; the first one looks like eccentricity.
    bearing_U = max(BEARING_U, shared)
    bearing_name = "table bearing, once per turn" + (ASSUMED if bearing_U == BEARING_U else SHARED)
    bearing = {"eccentricity_um": 1000.0}
    if eccentricity > 1.0:
        bearing["eccentricity_direction_deg"] = degrees(1000.0 / eccentricity)
    return (
        Input(diameter_name(base), expanded_diameter(base) / 2, "normal", {"radial_position_mm": 0.5}),
        Input(linearity_name(sensor), linearity_of(sensor, static) / 2, "normal",
              {"phi_deg": degrees(slope), "radial_position_mm": hypot(1.0, lever * slope),
               "eccentricity_um": eccentricity * hypot(slope, more), "tilt_mrad": eccentricity * along_it}),
        Input(scale_name(sensor), scale / 2, "normal",
              {"eccentricity_um": eccentricity}),
        Input(HEIGHT_ZERO, height_zero_u(fit), "rectangular",
              {"eccentricity_um": 1000.0 * tilt, "laser_plane_offset_mm": abs(float(np.tan(p[PLANE_TILT])))}),
        Input(f"temperature of the artefact{ASSUMED}", TEMPERATURE_U / 2, "rectangular",
              {"radial_position_mm": EXPANSION * base.radius}),
        Input(bearing_name, bearing_U / 2, "normal", bearing),
        Input(f"zero of the table angle{ASSUMED}", ANGLE_ZERO_U / 2, "rectangular",
              dict.fromkeys(DIRECTIONS, degrees(1))),
    )  # fmt: skip
