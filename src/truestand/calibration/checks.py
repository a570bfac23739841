"""Tests of a calibration by its own scan, in plain words, each with what to do when it fails."""

from math import degrees, hypot

import numpy as np

from truestand.calibration.edges import LEAST_EDGE_MM, largest_edge
from truestand.calibration.estimate import MOST_STEPS
from truestand.calibration.model import DRIFT, Readings
from truestand.calibration.refine import Refined
from truestand.calibration.repeated import repeated_share
from truestand.calibration.segment import LEAST_CONFIDENCE, LEAST_EXPLAINED, Segments
from truestand.core.artefact import Artefact
from truestand.core.calibration import Check, Residuals, StaticProfile
from truestand.core.message import UNTIED, Message
from truestand.core.scan import AngleZero, Scan

SAMPLED_PROFILES = 120
"""For the share of outliers."""
NEAR_SURFACE_MM = 5.0
"""Distance from the surface within which a reading is compared with the model."""
LEAST_SHAFT_SHARE = 0.1
"""Share of a ray's readings that must be the shaft's for it to be one of the shaft's rays."""
INSIDE_MM = 0.1
"""Distance that the shaft's readings of a ray must keep from the ends of what is measured on."""
FULL_TURN = 0.9
MOST_REJECTED = 0.45
ENOUGH_SEEN = 0.2
MOST_DRIFT_MM = 0.01
"""Over the scan."""
MOST_STEP_MM = 0.02
"""Difference of two steps from the drawing that is not called wrong, sensor and certificate apart."""
MOST_OVERLAP_MM = 0.001
"""rms: a trace's stretch of 10 degrees repeats to a tenth of that."""
MOST_BEARING_MM = 0.005
"""rms: no table's bearing differs that much from turn to turn; an angle that is stated wrong does."""
MOST_COMMON_OUTLIERS = 0.02
"""Share of the profiles."""
MOST_SHARED_MM = 0.002
"""Amplitude of a wave that all surfaces have alike."""
MOST_UNEVEN_MM = 0.001
"""rms: a ground shaft is as round at one end as at the other."""
DIRTY_MM = 0.003
"""rms: of 24 shafts under a film of 20 um, those whose U was too small by half and more were beyond it."""
MOST_RESIDUAL_MM = 0.1
"""rms: a laser triangulation sensor on a metal shaft does ten times better."""


def checks_of(
    scan: Scan,
    artefact: Artefact,
    fit: Refined,
    residuals: Residuals,
    static: tuple[StaticProfile, ...],
    uneven: float,
    shared: float,
) -> tuple[Check, ...]:
    """All checks of one calibration, the gravest first.

    ``uneven``: mm, rms, by which form changes along the shaft; ``shared``: mm, the largest wave that all surfaces have
    alike.
    """
    share = max(residuals.rejected / max(residuals.points, 1), outlier_share(scan, fit))
    repeated, most_repeated = repeated_share(scan)
    drift = abs(float(fit.solution.parameters[DRIFT]))
    return (
        Check("revolutions", "revolutions", scan.revolutions, FULL_TURN, scan.revolutions >= FULL_TURN,
              "scan at least one full turn; a partial one can't tell form from eccentricity"),
        Check("readings_rejected", "readings rejected, share", share, MOST_REJECTED, share <= MOST_REJECTED,
              "clean the shaft, reduce exposure, look for reflections"),
        Check("readings_seen", "readings seen, share", scan.seen, ENOUGH_SEEN, scan.seen >= ENOUGH_SEEN,
              "check exposure, range and occlusion"),
        Check("profiles_repeated", "profiles repeated to the last digit, share", repeated, most_repeated,
              repeated <= most_repeated,
              "the sensor gave the same profile again (a held image, a buffer read twice, a copied line): scan again"),
        Check("drawing_explains_view", "drawing explains the view, share", fit.segments.explained, LEAST_EXPLAINED,
              fit.segments.explained >= LEAST_EXPLAINED,
              "check the diameters and lengths in shaft.toml and what else is in view"),
        Check("surfaces_told_apart", "surfaces told apart, confidence", fit.segments.confidence, LEAST_CONFIDENCE,
              fit.segments.confidence >= LEAST_CONFIDENCE,
              "bring a step and an end of the shaft into view; check shaft.toml"),
        Check.at_most_um("residual", "residual, um rms", residuals.rms, MOST_RESIDUAL_MM,
                         "look at the residual map: dirt, a keyway, a loose shaft or a wrong drawing"),
        Check("fit_converged", "fit converged, steps", float(fit.solution.steps), float(MOST_STEPS),
              fit.solution.converged,
              "the exact model found no steady answer; check the drawing and the direction of the table"),
        Check.at_most_um("drift", "drift over the scan, um", drift, MOST_DRIFT_MM,
                         "let sensor and table warm up; check that nothing is loose"),
        _uneven_check(uneven),
        _edges_check(artefact, fit),
        *_angle_checks(scan, fit, shared),
        *_static_checks(scan, artefact, fit, static),
    )  # fmt: skip


def _uneven_check(uneven: float) -> Check:
    """Form that changes along the shaft stands in U; where it is that of a film, nothing is trusted."""
    name = "form changes along the shaft, um"
    if uneven > DIRTY_MM:
        advice = "clean the shaft, or take another: its axis is no better known than its form"
        return Check.at_most_um("form_is_dirt", name, uneven, DIRTY_MM, advice)
    advice = "clean the shaft: oil and dirt look like that; it stands in U"
    return Check.at_most_um("form_changes_along_shaft", name, uneven, MOST_UNEVEN_MM, advice)


def _edges_check(artefact: Artefact, fit: Refined) -> Check:
    readings, solution = fit.cells.readings, fit.solution
    angle = fit.model.angle(solution.parameters, readings.angle)
    edges = []
    for k, band in enumerate(fit.segments.bands):
        on = readings.cylinder == k
        rise, at = largest_edge(angle[on], fit.cells.weight[on], solution.residuals[on], fit.model.orders)
        edges.append((rise, f"on {artefact.cylinders[band.cylinder].name!r}, at {degrees(at):.0f} deg of the table"))
    rise, place = max(edges)
    advice = "dirt, a flat or a keyway that could not be told from the shaft's form: clean the shaft"
    where = f"{place}: " if rise > LEAST_EDGE_MM else ""
    return Check.at_most_um("surface_edges", "edges on a surface, um", rise, LEAST_EDGE_MM, where + advice)


def _angle_checks(scan: Scan, fit: Refined, shared: float) -> list[Check]:
    """What a wrong table angle, or a table whose bearing errs, does to all surfaces alike."""
    checks = []
    source = "angle" if scan.free_speed else "bearing"
    if fit.overlap is not None:
        differ = "angle" if fit.overlap > MOST_BEARING_MM else source
        checks.append(Check.at_most_um(
            f"repeated_turns_differ_{differ}", f"repeated turns differ ({differ}), um rms", fit.overlap,
            MOST_OVERLAP_MM,
            "the same surface reads otherwise on the next turn: lost profiles, uneven turning, slip or drift; "
            "record the table's angle, or check the one recorded, and see that nothing is loose",
        ))  # fmt: skip
    if len(fit.model.radii) < 2:
        return checks
    if scan.free_speed:
        checks.append(Check(
            "surfaces_off_at_once", "all surfaces off their waves at once, share", fit.common_outliers,
            MOST_COMMON_OUTLIERS,
            fit.common_outliers <= MOST_COMMON_OUTLIERS,
            "profiles were lost or the table didn't turn steadily (a start-up ramp?): record its angle, or a "
            "counter, or start the scan later",
        ))  # fmt: skip
    checks.append(Check.at_most_um(
        f"form_shared_{source}", f"form shared by all surfaces ({source}), um", shared, MOST_SHARED_MM,
        "the table's bearing, or an angle that is not what it seems (lost profiles, uneven turning), shows on "
        "all surfaces alike: record the angle, or clamp the shaft at another angle to tell which it is",
    ))  # fmt: skip
    return checks


def _static_checks(scan: Scan, artefact: Artefact, fit: Refined, static: tuple[StaticProfile, ...]) -> list[Check]:
    """Sensor linearity as the static profile shows it, and the step between the diameters against the drawing."""
    stated = scan.stand.sensor.linearity
    limit = 2 * stated
    shown = max(s.peak_to_valley for s in static)
    # A sensor that shows itself worse than stated may read two steps differently by all that it shows.
    linearity = stated if shown <= limit else max(stated, shown)
    checks = [
        Check.at_most_um(
            "static_shape", f"static shape on {profile.surface}, um peak to valley", profile.peak_to_valley, limit,
            "the sensor's range is not linear (or the step's line is not straight): the shape is shown in the "
            "report and is not used as evidence; ask for the sensor's calibration if it matters",
        )
        for profile in static
    ]  # fmt: skip
    for profile, band in zip(static[1:], fit.segments.bands[1:], strict=True):
        cylinders = (artefact.base, artefact.cylinders[band.cylinder])
        certified = 0.5 * hypot(*(c.diameter_U or 0.0 for c in cylinders))
        checks.append(Check.at_most_um(
            "step_against_drawing", f"step from {cylinders[0].name} to {cylinders[1].name} against the drawing, um",
            float(profile.deviation.mean()), MOST_STEP_MM + certified + linearity,
            "check the diameters in shaft.toml against the certificate",
        ))  # fmt: skip
    return checks


DECISIVE = frozenset(
    {
        "readings_rejected", "profiles_repeated", "residual", "fit_converged", "step_against_drawing",
        "surfaces_off_at_once", "repeated_turns_differ_angle", "form_is_dirt",
        "surface_edges",
    }
)  # fmt: skip
"""Codes of the checks whose failure makes a calibration untrusted; the others warn."""


def reasons_of(segments: Segments, checks: tuple[Check, ...], angle_zero: AngleZero) -> tuple[Message, ...]:
    """Why a calibration is not to be trusted; empty where it is."""
    failed = (c.reason for c in checks if not c.ok and c.code in DECISIVE)
    return (*segments.reasons, *failed, *angle_zero_reasons(angle_zero))


def angle_zero_reasons(angle_zero: AngleZero) -> tuple[Message, ...]:
    """The reason not to trust a calibration whose table angle nothing ties to the next scan's."""
    return (UNTIED,) if angle_zero == "unknown" else ()


def outlier_share(scan: Scan, fit: Refined) -> float:
    """Share of the readings, along rays that always meet one surface, that lie off it; 0 where no ray does.

    Outliers lie anywhere, so they are not seen near the surface; but their rays are known.
    """
    rows = scan.spread(SAMPLED_PROFILES)
    x, z = scan.x[rows], scan.z[rows]
    u, v = fit.plane.to_uv(x, z)
    rays = z.shape[1]
    seen = off = 0
    for k, band in enumerate(fit.segments.bands):
        near = (v > band.low) & (v < band.high) & (np.abs(u - fit.model.radii[k]) < NEAR_SURFACE_MM)
        row, column = np.nonzero(near)
        readings = Readings.of(scan, rows, (row, column), np.full(row.size, k, dtype=np.intp))
        on_shaft = np.abs(fit.model.residuals(fit.solution.parameters, readings)) < fit.limit[readings.cylinder]
        row, column = row[on_shaft], column[on_shaft]
        count = np.count_nonzero(np.isfinite(z), axis=0)
        shaft = np.bincount(column, minlength=rays)
        low, high = np.full(rays, np.inf), np.full(rays, -np.inf)
        np.minimum.at(low, column, v[row, column])
        np.maximum.at(high, column, v[row, column])
        used = (shaft > LEAST_SHAFT_SHARE * count) & (low > band.low + INSIDE_MM) & (high < band.high - INSIDE_MM)
        seen += int(count[used].sum())
        off += int((count - shaft)[used].sum())
    return off / seen if seen else 0.0
