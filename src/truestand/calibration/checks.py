"""Questions a scan answers about itself, in plain words, each with what to do."""

from dataclasses import replace
from math import hypot

import numpy as np

from truestand.calibration.estimate import MOST_STEPS
from truestand.calibration.model import DRIFT, Readings
from truestand.calibration.refine import Refined
from truestand.calibration.segment import LEAST_SHARE, SURE
from truestand.core.artefact import Artefact
from truestand.core.calibration import AngleZero, Calibration, Check, Residuals, StaticProfile, Uncertainty
from truestand.core.scan import Scan

PROFILES = 120
"""Looked at for the share of outliers."""
NEAR = 5.0
"""mm from the surface within which a reading is held against the model."""
OFTEN = 0.1
"""Share of a ray's readings that must be the shaft's for it to be one of the shaft's rays."""
INSIDE = 0.1
"""mm that the shaft's readings of a ray must keep from the ends of what is measured on."""
FULL_TURN = 0.9
MOST_REJECTED = 0.45
ENOUGH_SEEN = 0.2
MOST_DRIFT = 0.01
"""mm over the scan."""
MOST_STEP = 0.02
"""mm: difference of two steps from the drawing that is not called wrong, sensor and certificate apart."""
MOST_OVERLAP = 0.001
"""mm rms: a trace's stretch of 10 degrees repeats to a tenth of that."""
MOST_TOGETHER = 0.02
"""Share of the profiles."""
MOST_SHARED, ALIKE = 0.002, 0.25
"""mm; and how far, against the common wave, the surfaces' waves may lie from it to be called the same."""
MOST_RESIDUAL = 0.1
"""mm rms: a laser triangulation sensor on a metal shaft does ten times better."""


def checks_of(
    scan: Scan,
    artefact: Artefact,
    fit: Refined,
    residuals: Residuals,
    static: tuple[StaticProfile, ...],
    budget: dict[str, Uncertainty],
) -> tuple[Check, ...]:
    """All checks of one calibration, the gravest first."""
    share = max(residuals.rejected / max(residuals.points, 1), outlier_share(scan, fit))
    drift = abs(float(fit.solution.parameters[DRIFT]))
    found = [
        Check("revolutions", scan.revolutions, FULL_TURN, scan.revolutions >= FULL_TURN,
              "scan at least one full turn; a partial one can't tell form from eccentricity"),
        Check("readings rejected, share", share, MOST_REJECTED, share <= MOST_REJECTED,
              "clean the shaft, reduce exposure, look for reflections"),
        Check("readings seen, share", scan.seen, ENOUGH_SEEN, scan.seen >= ENOUGH_SEEN,
              "check exposure, range and occlusion"),
        Check("drawing explains the view, share", fit.segments.explained, LEAST_SHARE,
              fit.segments.explained >= LEAST_SHARE,
              "check the diameters and lengths in shaft.toml and what else is in view"),
        Check("surfaces told apart, confidence", fit.segments.confidence, SURE, fit.segments.confidence >= SURE,
              "bring a step and an end of the shaft into view; check shaft.toml"),
        Check("residual, um rms", 1000 * residuals.rms, 1000 * MOST_RESIDUAL, residuals.rms <= MOST_RESIDUAL,
              "look at the residual map: dirt, a keyway, a loose shaft or a wrong drawing"),
        Check("fit converged, steps", float(fit.solution.steps), float(MOST_STEPS), fit.solution.converged,
              "the exact model found no steady answer; check the drawing and the direction of the table"),
        Check("drift over the scan, um", 1000 * drift, 1000 * MOST_DRIFT, drift <= MOST_DRIFT,
              "let sensor and table warm up; check that nothing is loose"),
    ]  # fmt: skip
    found += _angle_checks(scan, fit)
    found += _static_checks(scan, artefact, fit, static)
    return tuple(found)


def _angle_checks(scan: Scan, fit: Refined) -> list[Check]:
    """What a wrong table angle, or a table whose bearing errs, does to all surfaces alike."""
    found = []
    own = "angle" if scan.angle_source in ("index", "time") else "bearing"
    if fit.overlap is not None:
        found.append(
            Check(f"repeated turns differ ({own}), um rms", 1000 * fit.overlap, 1000 * MOST_OVERLAP,
                  fit.overlap <= MOST_OVERLAP,
                  "the same surface reads otherwise on the next turn: lost profiles, uneven turning, slip or drift; "
                  "record the table's angle and see that nothing is loose")
        )  # fmt: skip
    if len(fit.model.radii) < 2:
        return found
    if scan.angle_source in ("index", "time"):
        found.append(
            Check("all surfaces off their waves at once, share", fit.common_outliers, MOST_TOGETHER,
                  fit.common_outliers <= MOST_TOGETHER,
                  "profiles were lost or the table didn't turn steadily (a start-up ramp?): record its angle, or a "
                  "counter, or start the scan later")
        )  # fmt: skip
    shared = shared_form(fit)
    found.append(
        Check(f"form shared by all surfaces ({own}), um", 1000 * shared, 1000 * MOST_SHARED, shared <= MOST_SHARED,
              "the table's bearing, or an angle that is not what it seems (lost profiles, uneven turning), shows on "
              "all surfaces alike: record the angle, or clamp the shaft at another angle to tell which it is")
    )  # fmt: skip
    return found


def shared_form(fit: Refined) -> float:
    """The largest amplitude (mm) of a form harmonic that all surfaces share in size and phase; 0 where none is."""
    p, model = fit.solution.parameters, fit.model
    waves = np.stack([p[model.form_slice(k)].reshape(2, -1) for k in range(len(model.radii))])
    if not waves.size:
        return 0.0
    turning = waves[:, 0] + 1j * waves[:, 1]
    common = turning.mean(axis=0)
    alike = np.abs(turning - common).max(axis=0) < ALIKE * np.abs(common)
    return float(np.abs(common[alike]).max(initial=0.0))


def _static_checks(scan: Scan, artefact: Artefact, fit: Refined, static: tuple[StaticProfile, ...]) -> list[Check]:
    """Sensor linearity as the static profile shows it, and the step between the diameters against the drawing."""
    sensor = scan.stand.sensor
    stated = sensor.linearity
    limit = 2 * stated
    shown = max(s.peak_to_valley for s in static)
    # A sensor that shows itself worse than stated may read two steps differently by all that it shows.
    linearity = stated if shown <= limit else max(stated, shown)
    found = []
    for profile in static:
        shape = profile.peak_to_valley
        found.append(
            Check(
                f"static shape on {profile.surface}, um peak to valley", 1000 * shape, 1000 * limit, shape <= limit,
                "the sensor's range is not linear (or the step's line is not straight): the shape is shown in the "
                "report and is not used as evidence; ask for the sensor's calibration if it matters",
            )
        )  # fmt: skip
    for profile, band in zip(static[1:], fit.segments.bands[1:], strict=True):
        cylinders = (artefact.base, artefact.cylinders[band.cylinder])
        step = float(profile.deviation.mean())
        known = 0.5 * hypot(*(c.diameter_U or 0.0 for c in cylinders))
        allowed = MOST_STEP + known + linearity
        found.append(
            Check(
                f"step from {cylinders[0].name} to {cylinders[1].name} against the drawing, um",
                1000 * step, 1000 * allowed,
                abs(step) <= allowed, "check the diameters in shaft.toml against the certificate",
            )
        )  # fmt: skip
    return found


DECISIVE = (
    "readings rejected, share",
    "drawing explains the view, share",
    "residual, um rms",
    "fit converged, steps",
    "step from",
    "all surfaces off",
    "repeated turns differ (angle)",
)
"""Checks whose failure makes a calibration untrusted; the others warn."""


def reasons_of(calibration: Calibration, fit: Refined) -> Calibration:
    """The calibration with the reasons not to trust it, if any."""
    reasons = list(fit.segments.reasons)
    for check in calibration.checks:
        if not check.ok and check.name.startswith(DECISIVE) and not check.name.startswith("drawing explains"):
            reasons.append(f"{check.name}: {check.value:.3g} (limit {check.limit:.3g}); {check.advice}")
    return replace(calibration, reasons=(*reasons, *no_zero(calibration.angle_zero)))


def no_zero(angle_zero: AngleZero) -> tuple[str, ...]:
    """The reason not to trust a calibration whose table angle nothing ties to the next scan's."""
    if angle_zero != "unknown":
        return ()
    return (
        "nothing ties this scan's table angle to the next one's ([table] start = 'unknown', no angle or encoder): "
        "home the table or record its angle",
    )


def outlier_share(scan: Scan, fit: Refined) -> float:
    """Share of the readings, along rays that always meet one surface, that lie off it; 0 where no ray does.

    Outliers lie anywhere, so they are not seen near the surface; but their rays are known.
    """
    rows, p = scan.spread(PROFILES), fit.solution.parameters
    x, z = scan.x[rows], scan.z[rows]
    u, v = fit.plane.to_uv(x, z)
    time = rows / max(scan.profiles - 1, 1) - 0.5
    seen = off = 0
    for k, band in enumerate(fit.segments.bands):
        with np.errstate(invalid="ignore"):
            near = (v > band.low) & (v < band.high) & (np.abs(u - fit.model.radii[k]) < NEAR)
        row, column = np.nonzero(near)
        if not row.size:
            continue
        which = np.full(row.size, k, dtype=np.intp)
        readings = Readings(x[row, column], z[row, column], scan.angle[rows][row], time[row], which)
        own = np.abs(fit.model.residuals(p, readings)) < fit.limit
        count = np.count_nonzero(np.isfinite(z), axis=0)
        shaft = np.bincount(column[own], minlength=z.shape[1])
        low, high = np.full(z.shape[1], np.inf), np.full(z.shape[1], -np.inf)
        np.minimum.at(low, column[own], v[row, column][own])
        np.maximum.at(high, column[own], v[row, column][own])
        rays = (shaft > OFTEN * count) & (low > band.low + INSIDE) & (high < band.high - INSIDE)
        seen += int(count[rays].sum())
        off += int((count - shaft)[rays].sum())
    return off / seen if seen else 0.0
